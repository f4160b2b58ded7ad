"""The mapping file: which signal of the DBC is which joint, pressure or valve of the robot."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hydro_hw_bridge.errors import BridgeError
from hydro_hw_bridge.protocol.e2e import IDENTIFIERS
from hydro_model.description.fields import Fields
from hydro_model.errors import RobotError
from hydro_model.robot import Robot
from hydro_model.robot_files import read_yaml

SCHEMA = "hydro_hw_bridge/mapping/1"
ROLES = ("sync", "cycle", "command", "claim")
#: Bits of the sync frame's status; the first three are permissives and must be there.
STATUS_NAMES = (
    "emergency_stop_ok",
    "pump_on",
    "enable_switch",
    "parked",
    "lockstep",
    "amplifier_enabled",
    "amplifier_watchdog",
)
PERMISSIVES = STATUS_NAMES[:3]
#: Counts of valve frames by what the amplifiers made of them: both of them, or none.
ECHO_NAMES = ("taken", "refused")
#: Scales and offsets beyond this are no unit's.
LARGEST = 1e12
#: Pressures that a lab may not measure.
OPTIONAL_PRESSURES = ("supply", "tank")


@dataclass(frozen=True, slots=True)
class FrameRule:
    """Role and protection of one frame.

    Attributes
    ----------
    name : str
    role : {"sync", "cycle", "command", "claim"}
    identifiers : tuple of 16 int, or None
        Data identifiers of E2E profile 2; None where the frame is not protected.
    """

    name: str
    role: str
    identifiers: tuple[int, ...] | None


@dataclass(frozen=True, slots=True)
class Channel:
    """A signal as a quantity: ``value = sign * scale * physical + offset``, SI units.

    Attributes
    ----------
    signal : str
        `FRAME.Signal` of the DBC.
    scale, offset : float
    sign : int
        1 or -1.
    absolute : bool
        A pressure transducer that reads absolute pressure.
    """

    signal: str
    scale: float = 1.0
    offset: float = 0.0
    sign: int = 1
    absolute: bool = False


@dataclass(frozen=True, slots=True)
class ValveChannels:
    """Command (V) and measured spool position ([-1, 1]; None where there is none)."""

    command: Channel
    spool: Channel | None


@dataclass(frozen=True, slots=True)
class BusMapping:
    """A mapping file, checked against a robot.

    Attributes
    ----------
    name : str
    source, dbc : Path
    bitrate : int
        Bit/s.
    frames : tuple of FrameRule
    counter, enable, instance : str
        Signals of sample counter, command enable and claim.
    answered : str or None
        Signal of the answered sample counter; None where the alive counter alone tells it.
    status : mapping from a name of `STATUS_NAMES` to a signal
    echo : mapping from a name of `ECHO_NAMES` to a signal
        Empty where the amplifiers do not tell which valve frames they heard.
    joints, strokes, pressures : mapping from name to Channel
    valves : mapping from name to ValveChannels
    oil_temperature : Channel or None
        Degrees Celsius.
    """

    name: str
    source: Path
    dbc: Path
    bitrate: int
    frames: tuple[FrameRule, ...]
    counter: str
    enable: str
    answered: str | None
    instance: str
    status: Mapping[str, str]
    echo: Mapping[str, str]
    joints: Mapping[str, Channel]
    strokes: Mapping[str, Channel]
    pressures: Mapping[str, Channel]
    valves: Mapping[str, ValveChannels]
    oil_temperature: Channel | None


def load_mapping(path: Path, robot: Robot) -> BusMapping:
    """Read a mapping file and check it against a robot.

    Parameters
    ----------
    path : Path
    robot : Robot

    Returns
    -------
    BusMapping

    Raises
    ------
    BridgeError
        The file is missing or malformed, names a joint, pressure or valve that the robot does
        not have, leaves one out, or uses a signal twice.
    """
    if not path.is_file():
        raise BridgeError(f"no mapping file '{path}': expected a *.mapping.yaml")
    try:
        mapping = _mapping(read_yaml(path), path, robot)
    except RobotError as error:
        raise BridgeError(str(error)) from error
    _check_signals(mapping)
    return mapping


_KEYS = {"schema", "name", "dbc", "bitrate", "frames", "sync", "command", "claim"} | {
    "joints",
    "strokes",
    "pressures",
    "valves",
    "oil_temperature",
}


def _mapping(top: Fields, path: Path, robot: Robot) -> BusMapping:
    schema = top.text("schema")
    if schema != SCHEMA:
        raise BridgeError(f"{path}: expected schema {SCHEMA}, found '{schema}'")
    _no_other_keys(top, _KEYS)
    sync, command, claim = (top.fields(key) for key in ("sync", "command", "claim"))
    _no_other_keys(sync, {"counter", "status", "echo"})
    status, echo = sync.fields("status"), sync.optional_fields("echo")
    _no_other_keys(status, set(STATUS_NAMES))
    if echo is not None:
        _no_other_keys(echo, set(ECHO_NAMES))
    bits = [n for n in STATUS_NAMES if n in PERMISSIVES or n in status]
    required = [p for p in robot.pressure_names if p not in OPTIONAL_PRESSURES]
    strokes = [c.name for c in robot.cylinders if c.stroke_sensor]
    temperature = top.optional_fields("oil_temperature")
    return BusMapping(
        name=top.name("name"),
        source=path,
        dbc=top.file_below("dbc", path),
        bitrate=int(top.positive("bitrate")),
        frames=_frames(top.fields("frames")),
        counter=sync.text("counter"),
        enable=command.text("enable"),
        answered=command.text("answered") if "answered" in command else None,
        instance=claim.text("instance"),
        status={name: status.text(name) for name in bits},
        echo={} if echo is None else {name: echo.text(name) for name in ECHO_NAMES},
        joints=_named(top, "joints", robot.joint_names, robot.joint_names, _channel),
        strokes=_named(top, "strokes", strokes, strokes, _channel),
        pressures=_named(top, "pressures", robot.pressure_names, required, _pressure),
        valves=_named(top, "valves", robot.valve_names, robot.valve_names, _valve),
        oil_temperature=None if temperature is None else _channel(temperature),
    )


def _frames(fields: Fields) -> tuple[FrameRule, ...]:
    names = fields.keys()
    frames = tuple(_frame(name, fields.fields(name)) for name in names)
    for role in ("sync", "command", "claim"):
        found = [frame.name for frame in frames if frame.role == role]
        if len(found) != 1:
            listed = ", ".join(found) or "none"
            raise BridgeError(f"{fields.where}: expected one frame of role {role}, found {listed}")
    return frames


def _frame(name: str, fields: Fields) -> FrameRule:
    _no_other_keys(fields, {"role", "protection", "e2e_profile_2"})
    role = fields.text("role")
    if role not in ROLES:
        expected = ", ".join(ROLES)
        raise BridgeError(f"{fields.where}: 'role' should be one of {expected}, found '{role}'")
    if "protection" in fields:
        protection = fields.text("protection")
        if protection != "none" or "e2e_profile_2" in fields:
            raise BridgeError(
                f"{fields.where}: expected either 'protection: none' or 'e2e_profile_2' with"
                f" {IDENTIFIERS} data identifiers, found 'protection: {protection}'"
            )
        return FrameRule(name, role, None)
    values = fields.vector("e2e_profile_2", IDENTIFIERS)
    wrong = [v for v in values if v != int(v) or not 0 <= v <= 255]
    if wrong:
        raise BridgeError(
            f"{fields.where}: data identifiers should be integers from 0 to 255, found {wrong[0]}"
        )
    return FrameRule(name, role, tuple(int(v) for v in values))


def _named(
    top: Fields,
    key: str,
    known: Sequence[str],
    required: Sequence[str],
    read: Callable[[Fields], Any],
) -> dict[str, Any]:
    """The entries of a section in the robot's order; unknown and missing names are refused."""
    fields = top.fields(key, {})
    strange = sorted(set(fields.keys()) - set(known))
    if strange:
        expected = ", ".join(known) or "none"
        raise BridgeError(f"{fields.where}: the robot has no '{strange[0]}' (known: {expected})")
    missing = [name for name in required if name not in fields]
    if missing:
        raise BridgeError(f"{fields.where}: '{missing[0]}' of the robot is missing")
    return {name: read(fields.fields(name)) for name in known if name in fields}


def _channel(fields: Fields) -> Channel:
    _no_other_keys(fields, {"signal", "scale", "offset", "sign"})
    return _linear(fields, absolute=False)


def _pressure(fields: Fields) -> Channel:
    _no_other_keys(fields, {"signal", "scale", "offset", "sign", "reference"})
    reference = fields.text("reference")
    if reference not in ("gauge", "absolute"):
        raise BridgeError(
            f"{fields.where}: 'reference' should be gauge or absolute, found '{reference}'"
        )
    return _linear(fields, absolute=reference == "absolute")


def _valve(fields: Fields) -> ValveChannels:
    _no_other_keys(fields, {"command", "spool"})
    spool = fields.optional_fields("spool")
    return ValveChannels(
        _channel(fields.fields("command")), None if spool is None else _channel(spool)
    )


def _linear(fields: Fields, *, absolute: bool) -> Channel:
    sign = fields.number("sign", 1.0)
    if sign not in (1.0, -1.0):
        raise BridgeError(f"{fields.where}: 'sign' should be 1 or -1, found {sign:g}")
    scale, offset = fields.positive("scale", 1.0), fields.number("offset", 0.0)
    if not 1.0 / LARGEST <= scale <= LARGEST or abs(offset) > LARGEST:
        raise BridgeError(
            f"{fields.where}: expected a scale from {1.0 / LARGEST:g} to {LARGEST:g} and no larger"
            f" offset, found {scale:g} and {offset:g}"
        )
    return Channel(
        signal=fields.text("signal"),
        scale=scale,
        offset=offset,
        sign=int(sign),
        absolute=absolute,
    )


def _no_other_keys(fields: Fields, known: set[str]) -> None:
    strange = set(fields.keys()) - known
    if strange:
        expected, found = ", ".join(sorted(known)), min(strange)
        raise BridgeError(f"{fields.where}: unknown key '{found}' (known: {expected})")


def _check_signals(mapping: BusMapping) -> None:
    signals = [mapping.counter, mapping.enable, mapping.instance]
    signals += [*mapping.status.values(), *mapping.echo.values()]
    if mapping.answered is not None:
        signals.append(mapping.answered)
    channels = [*mapping.joints.values(), *mapping.strokes.values(), *mapping.pressures.values()]
    for valve in mapping.valves.values():
        channels += [valve.command] if valve.spool is None else [valve.command, valve.spool]
    if mapping.oil_temperature is not None:
        channels.append(mapping.oil_temperature)
    signals += [channel.signal for channel in channels]
    twice = sorted({s for s in signals if signals.count(s) > 1})
    if twice:
        raise BridgeError(f"{mapping.source}: signal '{twice[0]}' is used more than once")
