"""A calibration file: zeros, references and signs measured on one machine at one date."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import yaml

from hydro_hw_bridge.errors import BridgeError
from hydro_hw_bridge.mapping import BusMapping, Channel
from hydro_model.errors import RobotError
from hydro_model.fields import Fields
from hydro_model.robot_files import read_yaml

SCHEMA = "hydro_hw_bridge/calibration/1"


@dataclass(frozen=True, slots=True)
class Calibration:
    """What `calibrate` measured; anything it did not measure is absent.

    Attributes
    ----------
    name : str
        Names the calibration in diagnostics and bags.
    robot, mapping : str
        What it was measured with.
    pressure_zero_pa : mapping
        Reading of each transducer at atmospheric pressure, gauge.
    position_offset : mapping
        To add to each joint's position, rad or m.
    valve_sign : mapping
        -1 where a valve is wired the other way round than the mapping says.
    """

    name: str
    robot: str
    mapping: str
    pressure_zero_pa: Mapping[str, float]
    position_offset: Mapping[str, float]
    valve_sign: Mapping[str, int]


def load_calibration(path: Path) -> Calibration:
    """Read a calibration file.

    Parameters
    ----------
    path : Path

    Returns
    -------
    Calibration

    Raises
    ------
    BridgeError
        The file is missing or malformed.
    """
    if not path.is_file():
        raise BridgeError(f"no calibration file '{path}': expected what `calibrate` wrote")
    try:
        return _read(read_yaml(path), path)
    except RobotError as error:
        raise BridgeError(str(error)) from error


def _read(top: Fields, path: Path) -> Calibration:
    schema = top.text("schema")
    if schema != SCHEMA:
        raise BridgeError(f"{path}: expected schema {SCHEMA}, found '{schema}'")
    signs = top.mapping_of_numbers("valve_sign")
    wrong = [name for name, sign in signs.items() if sign not in (1.0, -1.0)]
    if wrong:
        raise BridgeError(
            f"{path}: sign of valve '{wrong[0]}' should be 1 or -1, found {signs[wrong[0]]:g}"
        )
    return Calibration(
        name=top.text("name"),
        robot=top.text("robot"),
        mapping=top.text("mapping"),
        pressure_zero_pa=top.mapping_of_numbers("pressure_zero_pa"),
        position_offset=top.mapping_of_numbers("position_offset"),
        valve_sign={name: int(sign) for name, sign in signs.items()},
    )


def calibration_text(calibration: Calibration, notes: Mapping[str, Any]) -> str:
    """The text of a calibration file.

    Parameters
    ----------
    calibration : Calibration
    notes : mapping
        What else a person wants to know, such as date and standard deviations.

    Returns
    -------
    str
    """
    content = {
        "schema": SCHEMA,
        "name": calibration.name,
        "robot": calibration.robot,
        "mapping": calibration.mapping,
        "pressure_zero_pa": dict(calibration.pressure_zero_pa),
        "position_offset": dict(calibration.position_offset),
        "valve_sign": dict(calibration.valve_sign),
        "notes": dict(notes),
    }
    return str(yaml.safe_dump(content, sort_keys=False))


def calibrated_mapping(mapping: BusMapping, calibration: Calibration) -> BusMapping:
    """A mapping with a machine's zeros, references and signs worked in.

    Parameters
    ----------
    mapping : BusMapping
    calibration : Calibration

    Returns
    -------
    BusMapping

    Raises
    ------
    BridgeError
        The calibration is of another mapping or names what the mapping does not have.
    """
    if calibration.mapping != mapping.name:
        raise BridgeError(
            f"calibration {calibration.name}: expected one of mapping '{mapping.name}',"
            f" found mapping '{calibration.mapping}'"
        )
    known = (
        (calibration.pressure_zero_pa, mapping.pressures, "pressure"),
        (calibration.position_offset, mapping.joints, "joint"),
        (calibration.valve_sign, mapping.valves, "valve"),
    )
    for named, there, what in known:
        strange = [name for name in named if name not in there]
        if strange:
            raise BridgeError(
                f"calibration {calibration.name}: the mapping has no {what} '{strange[0]}'"
                f" (known: {', '.join(there)})"
            )
    pressures = {
        name: _shifted(channel, -calibration.pressure_zero_pa.get(name, 0.0))
        for name, channel in mapping.pressures.items()
    }
    joints = {
        name: _shifted(channel, calibration.position_offset.get(name, 0.0))
        for name, channel in mapping.joints.items()
    }
    valves = {
        name: replace(
            valve,
            command=_turned(valve.command, calibration.valve_sign.get(name, 1)),
            spool=valve.spool and _turned(valve.spool, calibration.valve_sign.get(name, 1)),
        )
        for name, valve in mapping.valves.items()
    }
    return replace(mapping, pressures=pressures, joints=joints, valves=valves)


def _shifted(channel: Channel, offset: float) -> Channel:
    return replace(channel, offset=channel.offset + offset)


def _turned(channel: Channel, sign: int) -> Channel:
    return replace(channel, sign=channel.sign * sign, offset=channel.offset * sign)
