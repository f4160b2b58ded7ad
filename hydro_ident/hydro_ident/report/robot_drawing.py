"""A robot drawn from the side: links, pins and cylinders in the plane that it moves in."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from hydro_ident.everyday_units import bracketed
from hydro_ident.report.figure import Figure, numbers
from hydro_ident.report.page import written
from hydro_ident.report.palette import BEFORE, INK, joint_colour
from hydro_ident.robots.robot_ranges import drawn_poses
from hydro_model.hydraulics.cylinder import stroke
from hydro_model.multibody.closed_chain import part_places
from hydro_model.multibody.joint_ranges import limits, middle
from hydro_model.multibody.kinematics import link_frames, tip_position
from hydro_model.robot import Cylinder, FloatArray, Robot

#: Poses that are drawn: places within the joints' ranges, all joints alike.
POSES = (("lower limits", 0.0), ("middle of the ranges", 0.5), ("upper limits", 1.0))
#: Names of a cylinder's pins: at `l1_m` of the joint's axis and at `l2_m`.
PINS = ("1", "2")
#: Of a point outside the plane, m.
FLAT_M = 1e-3
_CLOUD = 1500


@dataclass(frozen=True, slots=True)
class Plane:
    """The plane that is drawn.

    Attributes
    ----------
    across, up : (3,) array
        Unit vectors in the base frame, to the right and upwards.
    """

    across: FloatArray
    up: FloatArray

    def flat(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Points (N, 3) in the plane."""
        return points @ self.across, points @ self.up

    def depth(self, points: FloatArray) -> float:
        """How far points lie apart perpendicular to it, m."""
        return float(np.ptp(points @ np.cross(self.across, self.up)))


def plane_of(robot: Robot) -> Plane:
    """The plane in which most cylinders turn their joints, gravity downwards.

    Parameters
    ----------
    robot : Robot

    Returns
    -------
    Plane
    """
    pose = middle(robot)
    _, rotations = link_frames(robot, pose)
    axes = [
        turn @ joint.axis
        for joint, turn in zip(robot.joints, rotations, strict=True)
        if not joint.prismatic
    ]
    up = _unit(-robot.gravity_m_s2, np.array([0.0, 0.0, 1.0]))
    level = [axis for axis in axes if abs(axis @ up) < 0.9]
    if level:
        across = _unit(np.cross(up, level[-1]), np.array([1.0, 0.0, 0.0]))
    elif axes:  # every joint turns about the vertical: seen from above
        across, up = np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])
    else:
        slide = rotations[0] @ robot.joints[0].axis
        across = _unit(slide - (slide @ up) * up, np.array([1.0, 0.0, 0.0]))
    if tip_position(robot, pose) @ across < 0.0:
        across = -across
    return Plane(across, np.asarray(_unit(up - (up @ across) * across, up)))


def _unit(vector: FloatArray, otherwise: FloatArray) -> FloatArray:
    size = float(np.linalg.norm(vector))
    return np.asarray(vector / size) if size > 1e-9 else otherwise


def drawings(robot: Robot) -> tuple[Figure, ...]:
    """One figure per pose, then the places that the tip can reach.

    Parameters
    ----------
    robot : Robot

    Returns
    -------
    tuple of Figure
    """
    plane = plane_of(robot)
    low, high = limits(robot).T
    figures = [
        _pose(robot, plane, low + share * (high - low), name, legend=k == 0)
        for k, (name, share) in enumerate(POSES)
    ]
    return (*figures, _reach(robot, plane))


def _pose(robot: Robot, plane: Plane, q: FloatArray, name: str, *, legend: bool) -> Figure:
    """One legend is enough: on a narrow screen it takes as much room as a drawing."""
    values = ", ".join(
        f"{joint.name} {_place(value, prismatic=joint.prismatic)}"
        for joint, value in zip(robot.joints, q, strict=True)
    )
    traces = [*_links(robot, plane, q), *_cylinders(robot, plane, q)]
    for trace in traces:
        trace["showlegend"] &= legend
    title = f"At the {name}: {values}"
    note = ", ".join(_stroke(cylinder, robot, q) for cylinder in robot.closed_chains)
    return Figure(title, "across in m", ("up in m",), traces, _equal(), note, tall=1.9)


def _stroke(cylinder: Cylinder, robot: Robot, q: FloatArray) -> str:
    x = float(stroke(cylinder, q[robot.joint_index(cylinder.joint)]))
    return f"{cylinder.name} out by {x:.3f} of {cylinder.stroke_m:.3f} m"


def _place(value: float, *, prismatic: bool) -> str:
    unit = "m" if prismatic else "rad"
    return f"{value:.3f} {unit}{written(bracketed((value,), unit))}"


def _equal() -> dict[str, Any]:
    return {"xaxis": {"scaleanchor": "y", "scaleratio": 1, "constrain": "domain"}}


def _links(robot: Robot, plane: Plane, q: FloatArray) -> Iterator[dict[str, Any]]:
    origins, rotations = link_frames(robot, q)
    ends = np.vstack([origins[1:], origins[-1] + rotations[-1] @ robot.tip_offset_m])
    starts = np.vstack([np.zeros(3), origins])
    yield _line("base", plane, starts[:2], INK, 3.0, legend=False)
    for i, link in enumerate(robot.link_names):
        colour = joint_colour(robot.joint_names, robot.joint_names[i])
        yield _line(link, plane, np.stack([origins[i], ends[i]]), colour, 5.0)
    yield _marks("joint axes", plane, origins, INK, "circle-open", 12)
    yield _marks("tip", plane, ends[-1:], INK, "x", 9)


def _cylinders(robot: Robot, plane: Plane, q: FloatArray) -> Iterator[dict[str, Any]]:
    origins, rotations = link_frames(robot, q)
    places = part_places(robot)
    for k, cylinder in enumerate(robot.closed_chains):
        at = robot.joint_index(cylinder.joint)
        pins = np.array(
            [
                place.pin_m
                if place.host < 0
                else origins[place.host] + rotations[place.host] @ place.pin_m
                for place in places[2 * k : 2 * k + 2]
            ]
        )
        colour = joint_colour(robot.joint_names, cylinder.joint)
        arms = np.stack([pins[0], origins[at], pins[1]])
        yield _line(cylinder.name, plane, pins, colour, 2.5, "dash")
        yield _line("arms to the pins", plane, arms, BEFORE, 1.0, "dot", legend=False)
        named = {
            "mode": "markers+text", "text": list(PINS), "textfont": {"color": INK, "size": 13},
            # Apart where one cylinder's rod is pinned beside the next one's barrel.
            "textposition": ["bottom left", "top right"],
        }  # fmt: skip
        title = f"pins of {cylinder.name}"
        yield _marks(title, plane, pins, colour, "circle", 8, legend=False) | named


def _reach(robot: Robot, plane: Plane) -> Figure:
    tips = tip_position(robot, drawn_poses(robot, _CLOUD))
    note = "Joint positions drawn at random within the limits."
    if plane.depth(tips) > FLAT_M:
        note += " The tip leaves this plane: what is seen is its projection."
    origins, _ = link_frames(robot, middle(robot))
    traces = [
        _marks("tip", plane, tips, BEFORE, "circle", 4),
        _marks("first joint", plane, origins[:1], INK, "circle-open", 12),
    ]
    title = "Where the tip can be"
    return Figure(title, "across in m", ("up in m",), traces, _equal(), note, tall=1.9)


def _line(
    name: str,
    plane: Plane,
    points: FloatArray,
    colour: str,
    width: float,
    dash: str = "solid",
    *,
    legend: bool = True,
) -> dict[str, Any]:
    style = {"color": colour, "width": width, "dash": dash}
    return _trace(name, plane, points, legend) | {"mode": "lines", "line": style}


def _marks(
    name: str,
    plane: Plane,
    points: FloatArray,
    colour: str,
    symbol: str,
    size: int,
    *,
    legend: bool = True,
) -> dict[str, Any]:
    style = {"color": colour, "symbol": symbol, "size": size}
    return _trace(name, plane, points, legend) | {"mode": "markers", "marker": style}


def _trace(name: str, plane: Plane, points: FloatArray, legend: bool) -> dict[str, Any]:
    across, up = plane.flat(points)
    return {
        "type": "scatter",
        "name": name,
        "x": numbers(across),
        "y": numbers(up),
        "xaxis": "x",
        "yaxis": "y",
        "showlegend": legend,
    }
