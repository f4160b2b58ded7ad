"""Writes robots as `model.yaml`, which `hydro_model.robot_files.load_robot` reads back."""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from hydro_ident.errors import IdentError
from hydro_ident.parameters.model_statistics import Statistics, statistics_dict
from hydro_model.robot import Cylinder, CylinderPart, Robot, Valve
from hydro_model.robot_files import MODEL_SCHEMA

_HEADER = (
    "# Written by hydro_ident. SI units; pressures are gauge unless a key says absolute.\n"
    "# Accepted wherever a robot is.\n"
)


def model_dict(
    robot: Robot,
    provenance: Mapping[str, Any] | None = None,
    statistics: Statistics | None = None,
) -> dict[str, Any]:
    """The content of a model file.

    Parameters
    ----------
    robot : Robot
        Without base parameters, the inertia is that of its URDF.
    provenance : mapping, optional
    statistics : Statistics, optional
        Of the identification, for later comparisons.

    Returns
    -------
    dict
        Plain numbers, texts, lists and mappings; numbers read back bit for bit.

    Raises
    ------
    IdentError
        The robot was not read from files, so there is no URDF to stand beside the model.
    """
    if robot.urdf is None:
        raise IdentError(f"robot {robot.name} has no URDF file, a model file needs one")
    data: dict[str, Any] = {
        "schema": MODEL_SCHEMA,
        "robot": robot.name,
        "urdf": robot.urdf.name,
        "tip_link": robot.tip_link,
        "gravity_m_s2": [float(g) for g in robot.gravity_m_s2],
    }
    data |= _estimates(robot)
    if statistics is not None:
        data |= statistics_dict(statistics)
    if robot.standard_parameters:
        data["standard_parameters"] = {k: float(v) for k, v in robot.standard_parameters.items()}
    if robot.dry_joints:
        data["joints"] = [
            {"name": joint.name, "viscous_friction": float(joint.viscous_friction)}
            for joint in (robot.joints[j] for j in robot.dry_joints)
        ]
    data["cylinders"] = [_cylinder_dict(c) for c in robot.cylinders]
    data["valves"] = [_valve_dict(v) for v in robot.valves]
    data["command_delay_s"] = float(robot.command_delay_s)
    data["effects"] = [
        {
            "name": e.name,
            "target": e.target,
            "parameters": {k: float(v) for k, v in e.parameters.items()},
        }
        for e in robot.effects
    ]
    data |= _surroundings(robot)
    if provenance:
        data["provenance"] = dict(provenance)
    return data


def _surroundings(robot: Robot) -> dict[str, Any]:
    sensors = robot.sensors
    return {
        "fluid": {"atmospheric_pressure_pa": float(robot.atmospheric_pressure_pa)},
        "supply": {
            "pressure_pa": float(robot.supply_pressure_pa),
            "tank_pressure_pa": float(robot.tank_pressure_pa),
        },
        "sensors": {
            "rate_hz": float(sensors.rate_hz),
            "encoder": {"counts_per_rev": int(sensors.encoder_counts_per_rev)},
            "pressure": {
                "range_pa": float(sensors.pressure_range_pa),
                "resolution_pa": float(sensors.pressure_resolution_pa),
            },
        },
    }


def _estimates(robot: Robot) -> dict[str, Any]:
    """Base parameters and how sure they and the others are, as far as they are known."""
    data: dict[str, Any] = {}
    if robot.base_parameters:
        data["base_parameters"] = [
            {
                "name": p.name,
                "combination": {k: float(v) for k, v in p.combination.items()},
                "value": float(p.value),
                **covariance,
            }
            for p, covariance in zip(robot.base_parameters, _rows(robot), strict=True)
        ]
    if robot.base_covariance is not None:
        data["base_covariance"] = [[float(v) for v in row] for row in robot.base_covariance]
    if robot.standard_deviations:
        data["standard_deviations"] = {k: float(v) for k, v in robot.standard_deviations.items()}
    return data


def _rows(robot: Robot) -> list[dict[str, list[float]]]:
    """The covariance of every base parameter with all of them, in their order."""
    matrix = robot.base_covariance
    if matrix is None:
        return [{} for _ in robot.base_parameters]
    return [{"covariance": [float(v) for v in row]} for row in matrix]


def _cylinder_dict(c: Cylinder) -> dict[str, Any]:
    data: dict[str, Any] = {
        "name": c.name,
        "joint": c.joint,
        "bore_m": float(c.bore_m),
        "rod_m": float(c.rod_m),
        "stroke_m": float(c.stroke_m),
    }
    if c.l1_m != 0.0:
        data |= {"l1_m": float(c.l1_m), "l2_m": float(c.l2_m), "q0_rad": float(c.q0_rad)}
    data |= {"x0_m": float(c.x0_m), "child_pin_angle_rad": float(c.child_pin_angle_rad)}
    for name, pin, part in (("barrel", "parent", c.barrel), ("rod", "child", c.rod)):
        if part is not None:
            data[name] = _part_dict(part, pin)
    return data | {
        "bulk_modulus_pa": float(c.bulk_modulus_pa),
        "viscous_friction": float(c.viscous_friction),
        "stroke_sensor": bool(c.stroke_sensor),
    }


def _part_dict(part: CylinderPart, pin: str) -> dict[str, float]:
    return {
        "mass_kg": float(part.mass_kg),
        f"com_from_{pin}_pin_m": float(part.com_from_pin_m),
        "inertia_com_kg_m2": float(part.inertia_com_kg_m2),
    }


def _valve_dict(v: Valve) -> dict[str, Any]:
    numbers = {k: float(getattr(v, k)) for k in ("c_pa", "c_at", "c_pb", "c_bt")}
    return {
        "name": v.name,
        "cylinder": v.cylinder,
        "rated_voltage_v": float(v.rated_voltage_v),
        **numbers,
    }


def write_model(
    robot: Robot,
    file: Path,
    provenance: Mapping[str, Any] | None = None,
    statistics: Statistics | None = None,
) -> None:
    """Write a model file and copy its URDF beside it.

    Parameters
    ----------
    robot : Robot
    file : Path
        Such as `DIR/model.yaml`; DIR exists.
    provenance : mapping, optional
    statistics : Statistics, optional
        Of the identification, for later comparisons.

    Raises
    ------
    IdentError
        The robot has no URDF file, or it or the model cannot be copied or written.
    """
    data = model_dict(robot, provenance, statistics)
    text = yaml.safe_dump(data, sort_keys=False, allow_unicode=True, width=99)
    beside = file.parent / str(data["urdf"])
    try:
        if robot.urdf is not None and robot.urdf.resolve() != beside.resolve():
            shutil.copyfile(robot.urdf, beside)
        file.write_text(_HEADER + text, encoding="utf-8")
    except OSError as error:
        raise IdentError(f"{file}: cannot be written: {error}") from error
