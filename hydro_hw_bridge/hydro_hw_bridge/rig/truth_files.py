"""Truths from files, strictly: every link, cylinder and valve once, no unknown key."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import MISSING
from dataclasses import fields as record_fields
from importlib import resources
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from hydro_hw_bridge.errors import BridgeError
from hydro_hw_bridge.rig.random_truth import random_truth
from hydro_hw_bridge.rig.truth import (
    CylinderTruth,
    FluidTruth,
    LinkTruth,
    SensorTruth,
    SupplyTruth,
    Truth,
    ValveTruth,
    check_physical,
)
from hydro_model.description.fields import Fields
from hydro_model.robot import CylinderPart, Robot
from hydro_model.robot_files import read_yaml

TRUTH_SCHEMA = "hydro_hw_bridge/truth/1"
Record = TypeVar("Record", CylinderTruth, ValveTruth, FluidTruth, SupplyTruth, SensorTruth)

#: Numbers that may be negative.
SIGNED = ("null_bias", "oil_temperature_c")
#: Numbers that divide.
POSITIVE = (
    "stribeck_velocity_m_s",
    "bristle_deflection_m",
    "deadband_rounding",
    "rate_limit_1_s",
    "transition_pressure_pa",
    "bulk_modulus_pa",
    "low_pressure_scale_pa",
    "droop_lag_s",
    "tank_lag_s",
    "pressure_pa",
    *("c_pa", "c_at", "c_pb", "c_bt"),
)


def shipped_truths() -> dict[str, Path]:
    """Truth files inside the package: name -> path."""
    folder = Path(str(resources.files("hydro_hw_bridge"))) / "rig" / "truths"
    return {path.stem: path for path in sorted(folder.glob("*.yaml"))}


def load_truth(truth: str, robot: Robot) -> Truth:
    """A truth by name or file.

    Parameters
    ----------
    truth : str
        `ideal` (the datasheet itself, counts as a bus carries them), `random:SEED`, a shipped
        name such as `realistic`, or a file.
    robot : Robot
        The machine it must fit.

    Returns
    -------
    Truth

    Raises
    ------
    HydroError
        There is no such truth, or it is malformed or another robot's.
    """
    if truth == "ideal":
        return Truth.ideal(robot, quantised=True)
    kind, _, seed = truth.partition(":")
    if kind == "random" and seed.isdecimal():
        return random_truth(robot, int(seed))
    path = shipped_truths().get(truth, Path(truth))
    if not path.is_file():
        names = ", ".join(shipped_truths())
        raise BridgeError(
            f"no truth '{truth}': expected a YAML file, ideal, random:SEED or a shipped one"
            f" ({names})"
        )
    return _truth_from(read_yaml(path), path, robot)


def _truth_from(top: Fields, path: Path, robot: Robot) -> Truth:
    known = ("schema", "robot", "links", "cylinders", "valves", "fluid", "supply", "sensors")
    _check_keys(top, (*known, "command_delay_cycles"))
    schema, name = top.text("schema"), top.text("robot")
    if schema != TRUTH_SCHEMA:
        raise BridgeError(f"{path}: expected schema {TRUTH_SCHEMA}, found '{schema}'")
    if name != robot.name:
        raise BridgeError(f"{path}: expected a truth of robot {robot.name}, found one of {name}")
    delay = top.number("command_delay_cycles", 0.0)
    if delay < 0.0 or delay != int(delay):
        raise BridgeError(
            f"{path}: 'command_delay_cycles' should be a whole number from 0, found {delay:g}"
        )
    cylinders = tuple(c.name for c in robot.cylinders)
    return Truth(
        name=path.stem,
        links=_by_name(top, "links", robot.link_names, _link),
        cylinders=_by_name(top, "cylinders", cylinders, _cylinder),
        valves=_by_name(top, "valves", robot.valve_names, _valve),
        fluid=_numbers(FluidTruth, top.fields("fluid"), {}),
        supply=_numbers(SupplyTruth, top.fields("supply"), {}),
        sensors=_sensors(top.fields("sensors", {}), robot),
        command_delay_cycles=int(delay),
    )


Item = TypeVar("Item")


def _by_name(
    top: Fields, key: str, expected: Sequence[str], read: Callable[[Fields], Item]
) -> tuple[Item, ...]:
    found: dict[str, Item] = {}
    for item in top.items(key):
        name = item.text("name")
        if name not in expected or name in found:
            what = "twice" if name in found else "unknown"
            raise BridgeError(
                f"{top.where}, {key}: '{name}' is {what}, expected each of"
                f" {', '.join(expected)} once"
            )
        found[name] = read(item)
    missing = [name for name in expected if name not in found]
    if missing:
        raise BridgeError(f"{top.where}, {key}: '{missing[0]}' is missing")
    return tuple(found[name] for name in expected)


def _link(f: Fields) -> LinkTruth:
    _check_keys(f, ("name", "mass_kg", "com_m", "inertia_com_kg_m2"))
    xx, xy, xz, yy, yz, zz = f.vector("inertia_com_kg_m2", 6)
    inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    link = LinkTruth(f.text("name"), f.number("mass_kg"), f.vector("com_m", 3), inertia)
    check_physical(link, f.where)
    return link


def _cylinder(f: Fields) -> CylinderTruth:
    parts = {"barrel": _part(f, "barrel", "parent"), "rod": _part(f, "rod", "child")}
    cylinder = _numbers(CylinderTruth, f, {"name": f.text("name"), **parts})
    if cylinder.static_friction_n < cylinder.coulomb_friction_n:
        raise BridgeError(
            f"{f.where}: 'static_friction_n' should be at least coulomb_friction_n"
            f" {cylinder.coulomb_friction_n:g}, found {cylinder.static_friction_n:g}"
        )
    return cylinder


def _part(f: Fields, key: str, pin: str) -> CylinderPart | None:
    part = f.optional_fields(key)
    if part is None:
        return None
    names = ("mass_kg", f"com_from_{pin}_pin_m", "inertia_com_kg_m2")
    _check_keys(part, names)
    return CylinderPart(*(_ranged(part, name) for name in names))


def _valve(f: Fields) -> ValveTruth:
    return _numbers(ValveTruth, f, {"name": f.text("name")})


def _sensors(f: Fields, robot: Robot) -> SensorTruth:
    special: dict[str, Any] = {"quantised": f.flag("quantised", True)}
    for key, names in (
        ("pressure_bias_pa", robot.pressure_names),
        ("encoder_offset", robot.joint_names),
    ):
        values = f.mapping_of_numbers(key) if key in f else {}
        for name in values:
            if name not in names:
                raise BridgeError(
                    f"{f.where}, {key}: '{name}' is unknown, expected some of {', '.join(names)}"
                )
        special[key] = values
    return _numbers(SensorTruth, f, special)


def _numbers(record: type[Record], f: Fields, special: dict[str, Any]) -> Record:
    """A record from its numbers in a mapping, those of `special` read before."""
    names = [field.name for field in record_fields(record)]
    _check_keys(f, names)
    keys = f.keys()
    given = [name for name in keys if name not in special]
    required = [
        field.name
        for field in record_fields(record)
        if field.name not in special and _is_required(field)
    ]
    for name in required:
        if name not in given:
            raise BridgeError(f"{f.where}: key '{name}' is missing, expected a number")
    values: dict[str, Any] = {name: _ranged(f, name) for name in given}
    return record(**special, **values)


def _is_required(field: Any) -> bool:
    return field.default is MISSING and field.default_factory is MISSING


def _ranged(f: Fields, name: str) -> float:
    value = f.positive(name) if name in POSITIVE else f.number(name)
    if value < 0.0 and name not in SIGNED:
        raise BridgeError(f"{f.where}: '{name}' should not be negative, found {value:g}")
    if name == "low_pressure_loss" and value >= 1.0:
        raise BridgeError(f"{f.where}: '{name}' should be below 1, found {value:g}")
    return value


def _check_keys(f: Fields, known: Iterable[str]) -> None:
    names, keys = tuple(known), f.keys()
    unknown = [key for key in keys if key not in names]
    if unknown:
        raise BridgeError(
            f"{f.where}: key '{unknown[0]}' is unknown, expected some of {', '.join(names)}"
        )
