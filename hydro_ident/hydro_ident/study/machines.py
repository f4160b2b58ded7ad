"""Random cranes: robot files of one to three joints, in proportions that make sense.

The reference crane is the pattern. Lengths, masses, bores and pins are drawn around it; what is
drawn is what the datasheet says, known to the diagnosis but for what a real machine hides.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from hydro_ident.errors import IdentError
from hydro_model.multibody.joint_ranges import middle
from hydro_model.robot import Robot
from hydro_model.robot_files import load_robot

#: Shares of cranes with one, two and three joints.
JOINT_SHARES = (0.1, 0.8, 0.1)
#: Of the pattern: pins (l1, l2), angle offset, closed length, pin direction, limits.
_LIFT = (1.00712, 0.37611, 1.0056, 0.830, -0.1845, -0.05, 1.70)
_TILT = (1.13219, 0.30901, 2.7192, 0.830, -0.3614, -2.40, -0.15)
_STROKE_M, _BORE_M, _ROD_M = 0.590, 0.080, 0.045
#: Links of the pattern: length, mass, centre of mass (x, z), principal central inertias.
_BOOM = (1.6, 128.51, (0.7404, 0.0368), (2.0, 25.35, 25.0))
_JIB = (2.106, 641.42, (1.7082, 0.1434), (20.0, 189.8, 185.0))
_TRIES = 60


@dataclass(frozen=True, slots=True)
class RobotFiles:
    """The two files of a robot, as text.

    Attributes
    ----------
    name : str
    hydraulics : dict
        Content of the hydraulics file.
    urdf : str
    """

    name: str
    hydraulics: dict[str, Any]
    urdf: str

    def write(self, folder: Path) -> Path:
        """Write both; returns the path of the hydraulics file."""
        folder.mkdir(parents=True, exist_ok=True)
        (folder / f"{self.name}.urdf").write_text(self.urdf, encoding="utf-8")
        path = folder / f"{self.name}.hydraulics.yaml"
        path.write_text(yaml.safe_dump(self.hydraulics, sort_keys=False), encoding="utf-8")
        return path


@dataclass(frozen=True, slots=True)
class _Link:
    name: str
    joint: str
    offset_m: float
    prismatic: bool
    limits: tuple[float, float]
    mass: float
    com: tuple[float, float]
    inertia: tuple[float, float, float]


def random_crane(name: str, seed: int, folder: Path) -> tuple[RobotFiles, Robot]:
    """A crane whose every joint can hold its load with force to spare.

    Parameters
    ----------
    name : str
        Of robot and files.
    seed : int
    folder : Path
        Where the files are written to be read back.

    Returns
    -------
    RobotFiles
    Robot

    Raises
    ------
    IdentError
        No crane of this seed holds its load.
    """
    for attempt in range(_TRIES):
        random = np.random.default_rng([seed, attempt])
        files = _draw(name, random)
        robot = load_robot(files.write(folder))
        if _strong(robot):
            return files, robot
    raise IdentError(f"crane of seed {seed}: none of {_TRIES} draws holds its own load")


def _strong(robot: Robot) -> bool:
    """Whether every cylinder has force to spare and a sensible mode over most of the range."""
    from hydro_ident.design.limits import Limits, limit_ratios

    axes = [np.linspace(j.lower + 0.1, j.upper - 0.1, 7) for j in robot.joints]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, robot.dof)
    grid = np.concatenate([middle(robot)[None], grid])
    still = np.zeros_like(grid)
    ratios = limit_ratios(robot, Limits(force=0.8), grid, still, still)
    fine = ratios.max(axis=1) <= 1.0
    return bool(fine[0] and np.mean(fine) > 0.35)


def _draw(name: str, random: np.random.Generator) -> RobotFiles:
    joints = int(random.choice([1, 2, 3], p=JOINT_SHARES))
    scale = float(random.uniform(0.75, 1.3))
    boom, jib = _link_of(_BOOM, scale, random), _link_of(_JIB, scale, random)
    links: list[_Link] = []
    cylinders: list[dict[str, Any]] = []
    bodies = bool(random.random() < 0.5)
    if joints == 1:
        # The boom alone, with the jib's share of the load welded to it.
        mass, com, inertia = jib
        limits, record = _triangle("lift", _LIFT, scale, random, bodies)
        links.append(_Link("lift_link", "lift", 0.0, False, limits, mass, com, inertia))
        cylinders.append(record)
        reach = _BOOM[0] * scale
    else:
        limits, record = _triangle("lift", _LIFT, scale, random, bodies)
        links.append(_Link("lift_link", "lift", 0.0, False, limits, *boom))
        cylinders.append(record)
        limits, record = _triangle("tilt", _TILT, scale, random, bodies)
        length = _BOOM[0] * scale * float(random.uniform(0.95, 1.05))
        links.append(_Link("tilt_link", "tilt", length, False, limits, *jib))
        cylinders.append(record)
        reach = _JIB[0] * scale
    if joints == 3:
        light = tuple(0.6 * part for part in (jib[0], *jib[2]))
        links[1] = _Link(
            *("tilt_link", "tilt", links[1].offset_m, False, links[1].limits),
            *(light[0], (0.8 * jib[1][0], jib[1][1]), (light[1], light[2], light[3])),
        )
        slide, record = _telescope(scale, random)
        links.append(slide)
        cylinders.append(record)
        reach = 0.8 * scale
    supply = float(random.uniform(17.0e6, 22.0e6))
    content = _hydraulics(name, cylinders, scale, supply, random)
    return RobotFiles(name, content, _urdf(name, links, reach))


def _around(random: np.random.Generator, share: float) -> float:
    return float(random.uniform(1.0 - share, 1.0 + share))


def _link_of(
    pattern: tuple[float, float, tuple[float, float], tuple[float, float, float]],
    scale: float,
    random: np.random.Generator,
) -> tuple[float, tuple[float, float], tuple[float, float, float]]:
    """Mass, centre of mass and principal inertias of a link like the pattern's."""
    _, mass, com, inertia = pattern
    mass *= scale**2 * _around(random, 0.25)
    factor = mass / pattern[1] * scale**2
    place = com[0] * scale * _around(random, 0.1), com[1] * scale * _around(random, 0.5)
    # Second moments of mass, each off by itself, keep the body physical.
    half = 0.5 * sum(inertia)
    x, y, z = (factor * (half - part) * _around(random, 0.15) for part in inertia)
    return mass, place, (y + z, x + z, x + y)


def _triangle(
    joint: str,
    pattern: tuple[float, ...],
    scale: float,
    random: np.random.Generator,
    bodies: bool,
) -> tuple[tuple[float, float], dict[str, Any]]:
    """Joint limits and the cylinder of a joint, the stroke kept within its ends."""
    l1, l2, q0, x0, pin, lower, upper = pattern
    l1, l2 = l1 * scale * _around(random, 0.03), l2 * scale * _around(random, 0.06)
    x0, stroke = x0 * scale, _STROKE_M * scale
    q = np.linspace(lower, upper, 400)
    x = np.sqrt(l1 * l1 + l2 * l2 - 2.0 * l1 * l2 * np.cos(q + q0)) - x0
    inside = q[(x > 0.02 * stroke) & (x < 0.98 * stroke)]
    if inside.size < 100:
        inside = q
    bore = _BORE_M * scale * float(random.uniform(0.95, 1.15))
    record: dict[str, Any] = {
        "name": f"{joint}_cylinder",
        "joint": joint,
        "bore_m": round(bore, 4),
        "rod_m": round(bore * float(random.uniform(0.5, 0.62)), 4),
        "stroke_m": stroke,
        "l1_m": l1,
        "l2_m": l2,
        "q0_rad": q0,
        "x0_m": x0,
        "child_pin_angle_rad": pin,
    }
    if bodies:
        for part, end, mass in (("barrel", "parent", 17.4), ("rod", "child", 10.3)):
            weight = mass * scale**2 * _around(random, 0.2)
            record[part] = {
                "mass_kg": weight,
                f"com_from_{end}_pin_m": 0.35 * scale,
                "inertia_com_kg_m2": 0.05 * weight * scale**2,
            }
    return (float(inside[0]) + 0.005, float(inside[-1]) - 0.005), record


def _telescope(scale: float, random: np.random.Generator) -> tuple[_Link, dict[str, Any]]:
    """A sliding extension with its cylinder along it."""
    mass = 110.0 * scale**2 * _around(random, 0.2)
    stroke = 0.9 * scale
    link = _Link(
        *("slide_link", "slide", 0.9 * scale, True, (0.02 * stroke, 0.98 * stroke), mass),
        *((0.35 * scale, 0.02 * scale), (0.02 * mass, 0.12 * mass, 0.12 * mass)),
    )
    record = {
        "name": "slide_cylinder",
        "joint": "slide",
        "bore_m": round(0.06 * scale, 4),
        "rod_m": round(0.035 * scale, 4),
        "stroke_m": stroke,
        "x0_m": 0.0,
    }
    return link, record


def _hydraulics(
    name: str,
    cylinders: list[dict[str, Any]],
    scale: float,
    supply: float,
    random: np.random.Generator,
) -> dict[str, Any]:
    edge = 8.91e-7 * scale**2 * _around(random, 0.15)
    valves = []
    for record in cylinders:
        share = (record["bore_m"] / (_BORE_M * scale)) ** 2
        coefficients = dict.fromkeys(("c_pa", "c_at", "c_pb", "c_bt"), edge * share)
        joint = record["joint"]
        valves.append(
            {"name": f"{joint}_valve", "cylinder": record["name"], "rated_voltage_v": 10.0}
            | coefficients
        )
    counts = int(2 ** random.integers(17, 22))
    return {
        "robot": name,
        "urdf": f"{name}.urdf",
        "tip_link": "tip_link",
        "cylinders": cylinders,
        "valves": valves,
        "fluid": {"bulk_modulus_pa": 1.2e9, "atmospheric_pressure_pa": 101325.0},
        "supply": {"pressure_pa": supply, "tank_pressure_pa": float(random.uniform(0.3e6, 1.2e6))},
        "sensors": {
            "rate_hz": 500,
            "encoder": {"counts_per_rev": counts},
            "pressure": {
                "range_pa": 25.0e6,
                "resolution_pa": float(random.choice([500.0, 1000.0, 2000.0])),
            },
        },
    }


def _urdf(name: str, links: list[_Link], reach: float) -> str:
    lines = [f'<robot name="{name}">', '  <link name="base_link"/>']
    parent = "base_link"
    for link in links:
        kind, axis = ("prismatic", "1 0 0") if link.prismatic else ("revolute", "0 -1 0")
        xx, yy, zz = link.inertia
        lines += [
            f'  <joint name="{link.joint}" type="{kind}">',
            f'    <parent link="{parent}"/>',
            f'    <child link="{link.name}"/>',
            f'    <origin xyz="{link.offset_m:.9g} 0 0" rpy="0 0 0"/>',
            f'    <axis xyz="{axis}"/>',
            f'    <limit lower="{link.limits[0]:.9g}" upper="{link.limits[1]:.9g}"'
            ' effort="80000" velocity="1.2"/>',
            "  </joint>",
            f'  <link name="{link.name}">',
            "    <inertial>",
            f'      <origin xyz="{link.com[0]:.9g} 0 {link.com[1]:.9g}" rpy="0 0 0"/>',
            f'      <mass value="{link.mass:.9g}"/>',
            f'      <inertia ixx="{xx:.9g}" iyy="{yy:.9g}" izz="{zz:.9g}"'
            ' ixy="0" ixz="0" iyz="0"/>',
            "    </inertial>",
            "  </link>",
        ]
        parent = link.name
    lines += [
        '  <joint name="tip" type="fixed">',
        f'    <parent link="{parent}"/>',
        '    <child link="tip_link"/>',
        f'    <origin xyz="{reach:.9g} 0 0" rpy="0 0 0"/>',
        "  </joint>",
        '  <link name="tip_link"/>',
        "</robot>",
    ]
    return "\n".join(lines) + "\n"
