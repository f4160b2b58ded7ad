"""A calibration file: zeros, references and signs measured on one machine at one date."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import yaml

from hydro_hw_bridge.errors import BridgeError
from hydro_hw_bridge.protocol.mapping import BusMapping, Channel
from hydro_model.description.fields import Fields
from hydro_model.errors import RobotError
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
    channels : str
        `channels_hash` of the mapping that it was measured with; empty in files of before.
    """

    name: str
    robot: str
    mapping: str
    pressure_zero_pa: Mapping[str, float]
    position_offset: Mapping[str, float]
    valve_sign: Mapping[str, int]
    channels: str = ""


def channels_hash(mapping: BusMapping) -> str:
    """A mapping's signals, scales, offsets and signs in one short text.

    What a calibration adds holds on top of these alone: a sign that was mended in the mapping
    would be turned twice.

    Parameters
    ----------
    mapping : BusMapping
        Not calibrated.

    Returns
    -------
    str
        16 hexadecimal digits, of joints, pressures and valves.
    """
    parts = {f"joint {name}": channel for name, channel in mapping.joints.items()}
    parts |= {f"pressure {name}": channel for name, channel in mapping.pressures.items()}
    parts |= {f"command {name}": valve.command for name, valve in mapping.valves.items()}
    parts |= {f"spool {name}": v.spool for name, v in mapping.valves.items() if v.spool}
    rows = [(k, c.signal, c.scale, c.offset, c.sign, c.absolute) for k, c in parts.items()]
    return hashlib.sha256(repr(sorted(rows)).encode()).hexdigest()[:16]


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
        channels=top.text("mapping_channels") if "mapping_channels" in top else "",
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
        **({"mapping_channels": calibration.channels} if calibration.channels else {}),
        "pressure_zero_pa": dict(calibration.pressure_zero_pa),
        "position_offset": dict(calibration.position_offset),
        "valve_sign": dict(calibration.valve_sign),
        "notes": dict(notes),
    }
    return str(yaml.safe_dump(content, sort_keys=False))


def unmeasured(mapping: BusMapping, calibration: Calibration) -> str:
    """What a calibration lacks to drive a machine with it.

    `calibrate` writes a file after each of its steps: with the zeros alone the encoders' readings
    have no reference, and every valve its sign by luck.

    Parameters
    ----------
    mapping : BusMapping
    calibration : Calibration

    Returns
    -------
    str
        Empty where every joint has its offset and every valve its sign; 0 and 1 written by hand
        are one, too: who writes them means them.
    """
    joints = [name for name in mapping.joints if name not in calibration.position_offset]
    valves = [name for name in mapping.valves if name not in calibration.valve_sign]
    lacking = []
    if joints:
        references = " ".join(f"{name}=VALUE" for name in joints)
        lacking.append(f"position_offset of {', '.join(joints)} (--reference {references})")
    if valves:
        lacking.append(f"valve_sign of {', '.join(valves)} (--signs)")
    if not lacking:
        return ""
    return (
        f"calibration {calibration.name}: expected an offset of every joint and a sign of every"
        f" valve, found no {' and no '.join(lacking)}: measure it by calibrate --from this file,"
        " or write 0 (of a valve 1) there where the mapping's own value is meant"
    )


def _refuse_another(mapping: BusMapping, calibration: Calibration, robot: str) -> None:
    """Refuse a calibration that was measured on another machine, or beside another mapping."""
    for what, expected, found in (
        ("robot", robot, calibration.robot),
        ("mapping", mapping.name, calibration.mapping),
    ):
        if expected != found:
            raise BridgeError(
                f"calibration {calibration.name}: expected one of {what} '{expected}',"
                f" found {what} '{found}'"
            )
    now = channels_hash(mapping)
    if calibration.channels not in ("", now):
        raise BridgeError(
            f"calibration {calibration.name}: expected one measured with the joints, pressures and"
            f" valves of {mapping.source} as they are (mapping_channels {now}), found"
            f" {calibration.channels}: signals, scales, offsets or signs have been changed since;"
            " calibrate anew"
        )


def calibrated_mapping(mapping: BusMapping, calibration: Calibration, robot: str) -> BusMapping:
    """A mapping with a machine's zeros, references and signs worked in.

    Parameters
    ----------
    mapping : BusMapping
    calibration : Calibration
    robot : str
        Name of the robot.

    Returns
    -------
    BusMapping

    Raises
    ------
    BridgeError
        The calibration is of another robot or mapping or names what the mapping does not have.
    """
    _refuse_another(mapping, calibration, robot)
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
