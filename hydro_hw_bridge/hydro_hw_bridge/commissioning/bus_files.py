"""A bus made for a robot: DBC and mapping of an I/O module that nobody has built.

For rehearsing a machine on the simulated rig before its own I/O is there. The frames are laid out
as those of the reference crane's: protected, of 8 bytes, a sync frame with the inputs and the
counter first, then readings as they fit, and one frame for all valves.
"""

from __future__ import annotations

import hashlib
import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import yaml

from hydro_hw_bridge.errors import BridgeError
from hydro_hw_bridge.protocol.e2e import IDENTIFIERS
from hydro_hw_bridge.protocol.layout import MAX_BUS_LOAD
from hydro_hw_bridge.protocol.mapping import SCHEMA
from hydro_model.multibody.joint_ranges import limits
from hydro_model.robot import Robot

#: Bits of a frame, and those in front that the protection and the valves' enable bit take.
_FRAME_BITS, _PROTECTION_BITS, _ENABLE_BITS, _ANSWERED_BITS = 64, 12, 1, 16
#: Bits of a full frame at worst, with stuff bits, as `FrameLayout.worst_case_bits` counts.
_ON_THE_WIRE = 135
_WIRE_BIT_S = 1_000_000
#: A valve's voltage in fewer bits would be told in steps that are felt; in more no finer.
_LEAST_VALVE_BITS, _MOST_VALVE_BITS = 8, 16
#: What a valve's voltage may be above its rated one.
_SPARE = 1.05
#: What a position or a stroke may be beyond its ends, as a share of the way between them: a
#: machine that ran away is not to be read at the end of its sensor.
_BEYOND = 0.5
_STROKE_STEP_M = 1e-6
_SYNC_ID, _COMMAND_ID, _FIRST_CYCLE_ID, _CLAIM_ID = 128, 144, 257, 1792


@dataclass(frozen=True, slots=True)
class BusFiles:
    """What describes a bus.

    Attributes
    ----------
    dbc, mapping : str
        Contents of the files.
    bit_s : int
        Bits a second that it takes to carry it, and what the mapping says.
    """

    dbc: str
    mapping: str
    bit_s: int

    @property
    def fits_a_wire(self) -> bool:
        """A classical CAN bus carries it: 1 Mbit/s."""
        return self.bit_s <= _WIRE_BIT_S


@dataclass(frozen=True, slots=True)
class _Signal:
    """A number in a frame: ``physical = scale * raw + offset``."""

    name: str
    bits: int
    signed: bool = False
    scale: float = 1.0
    offset: float = 0.0
    unit: str = ""
    start: int = 0

    @property
    def line(self) -> str:
        """Its text, without who reads it."""
        low = -(1 << self.bits - 1) if self.signed else 0
        raws = low, low + (1 << self.bits) - 1
        ends = "|".join(f"{self.offset + self.scale * raw:.12g}" for raw in raws)
        return (
            f" SG_ {self.name} : {self.start}|{self.bits}@1{'-' if self.signed else '+'}"
            f' ({self.scale!r},{self.offset!r}) [{ends}] "{self.unit}"'
        )


@dataclass(frozen=True, slots=True)
class _Frame:
    name: str
    identifier: int
    role: str
    signals: tuple[_Signal, ...]

    @property
    def text(self) -> str:
        sender, reader = ("BRIDGE", "DEVICE")[:: 1 if self.role in ("command", "claim") else -1]
        head = f"BO_ {self.identifier} {self.name}: 8 {sender}"
        protection = _Signal(f"{self.name}_crc", 8), _Signal(f"{self.name}_alive", 4, start=8)
        lines = [f"{one.line} {reader}" for one in (*protection, *self.signals)]
        return "\n".join([head, *lines])


def bus_files(robot: Robot, dbc_name: str) -> BusFiles:
    """The DBC and the mapping of a bus that carries all that a robot file measures and drives.

    Parameters
    ----------
    robot : Robot
    dbc_name : str
        File name of the DBC, as the mapping says it.

    Returns
    -------
    BusFiles
        Without spools where a bus of 1 Mbit/s carries the rest alone. What it does not carry even
        so has a rate that no wire has: only a bus within a computer does.

    Raises
    ------
    BridgeError
        The robot has no valve, or more than fit into one frame.
    """
    whole, fewer = (_frames(robot, spools=spools) for spools in (True, False))
    frames = fewer if _bit_s(robot, fewer) <= _WIRE_BIT_S < _bit_s(robot, whole) else whole
    bit_s = max(_WIRE_BIT_S, _bit_s(robot, frames))
    head = 'VERSION ""\n\nNS_ :\n\nBS_:\n\nBU_: DEVICE BRIDGE\n'
    dbc = "\n\n".join([head, *(frame.text for frame in frames)]) + "\n"
    lines = (
        f"# Made for robot {robot.name}, of no I/O module that exists: to rehearse it with the",
        "# simulated rig. Format: hydro_msgs_docs/bus.md.",
        yaml.safe_dump(
            _mapping(robot, frames, dbc_name, bit_s),
            sort_keys=False,
            width=200,
            default_flow_style=None,
        ),
    )
    return BusFiles(dbc, "\n".join(lines), bit_s)


def _bit_s(robot: Robot, frames: Sequence[_Frame]) -> int:
    """Bits a second of a bus that these load by as much as one may be loaded, in whole Mbit/s."""
    sampled = sum(frame.role != "claim" for frame in frames)
    # One frame more a cycle is more than the claims of a bridge.
    needed = (sampled + 0.1) * _ON_THE_WIRE * robot.sensors.rate_hz / MAX_BUS_LOAD
    return math.ceil(needed / _WIRE_BIT_S) * _WIRE_BIT_S


def _frames(robot: Robot, *, spools: bool) -> list[_Frame]:
    status = ("emergency_stop_ok", "pump_on", "enable_switch", "parked")
    after = ("lockstep", "amplifier_enabled", "amplifier_watchdog")
    sync = [_Signal(name, 1) for name in status]
    sync += [_Signal("counter", 32), *(_Signal(name, 1) for name in after)]
    sync += [_Signal("taken", 8), _Signal("refused", 5)]
    claim = [_Signal("instance", 32)]
    readings = list(_packed(_readings(robot, spools=spools)))
    return [
        _Frame("SYNC", _SYNC_ID, "sync", _placed(sync)),
        _Frame("VALVE_COMMAND", _COMMAND_ID, "command", _placed(_command(robot))),
        *(
            _Frame(f"READINGS_{k + 1}", _FIRST_CYCLE_ID + k, "cycle", _placed(signals))
            for k, signals in enumerate(readings)
        ),
        _Frame("BRIDGE_CLAIM", _CLAIM_ID, "claim", _placed(claim)),
    ]


def _readings(robot: Robot, *, spools: bool) -> Iterator[_Signal]:
    """All that is measured, in the order of the robot's names."""
    counts = robot.sensors.encoder_counts_per_rev
    for k, (joint, ends) in enumerate(zip(robot.joints, limits(robot), strict=True)):
        step = (1.0 if joint.prismatic else 2.0 * math.pi) / counts
        unit = "m" if joint.prismatic else "rad"
        most = abs(ends).max() + _BEYOND * (ends[1] - ends[0])
        yield _around_zero(_named("position", k, joint.name), most, step, unit)
    measured = [c for c in robot.cylinders if c.stroke_sensor]
    for k, cylinder in enumerate(measured):
        name, most = _named("stroke", k, cylinder.name), (1.0 + _BEYOND) * cylinder.stroke_m
        yield _around_zero(name, most, _STROKE_STEP_M, "m")
    # A transducer's zero may be off by a tenth of its range.
    most = robot.sensors.pressure_range_pa
    step = _round_up(1.2 * most / 2**16)
    for k, name in enumerate(robot.pressure_names):
        least = -step * math.ceil(0.1 * most / step)
        yield _Signal(_named("pressure", k, name), 16, scale=step, offset=least, unit="Pa")
    if spools:
        for k, valve in enumerate(robot.valves):
            yield _Signal(_named("spool", k, valve.name), 16, signed=True, scale=5e-5)
        yield _Signal("oil_temperature", 12, scale=0.0625, offset=-40.0, unit="degC")


def _around_zero(name: str, most: float, step: float, unit: str) -> _Signal:
    """A signed number that reaches as far either way."""
    bits = math.ceil(math.log2(most / step + 1.0)) + 1
    return _Signal(name, min(bits, 32), signed=True, scale=step, unit=unit)


def _command(robot: Robot) -> list[_Signal]:
    """Enable, a voltage for every valve, and which cycle it answers where there is room for it.

    The alive counter tells that, too.
    """
    if not robot.valves:
        raise BridgeError(f"robot {robot.name}: expected a valve to be driven, found none")
    room, count = _FRAME_BITS - _PROTECTION_BITS - _ENABLE_BITS, len(robot.valves)
    answered = (room - _ANSWERED_BITS) // count >= _MOST_VALVE_BITS
    bits = min(_MOST_VALVE_BITS, (room - _ANSWERED_BITS * answered) // count)
    if bits < _LEAST_VALVE_BITS:
        raise BridgeError(
            f"robot {robot.name}: expected at most {room // _LEAST_VALVE_BITS} valves, whose"
            f" voltages are in one frame, found {count}"
        )
    signals = [_Signal("enable", 1)]
    for k, valve in enumerate(robot.valves):
        step = _round_up(_SPARE * valve.rated_voltage_v / (2 ** (bits - 1) - 1))
        name = _named("voltage", k, valve.name)
        signals.append(_Signal(name, bits, signed=True, scale=step, unit="V"))
    return signals + [_Signal("answered", _ANSWERED_BITS)] * answered


def _round_up(step: float) -> float:
    """The next larger one of 1, 2 and 5 times a power of ten: a person reads the file."""
    power = 10.0 ** math.floor(math.log10(step))
    return float(f"{next(n for n in (1, 2, 5, 10) if n * power >= step * (1 - 1e-9)) * power:.6g}")


def _named(kind: str, index: int, name: str) -> str:
    """A name that a DBC may have (32 characters of C), and that a person finds again."""
    return f"{kind}_{index + 1}_{re.sub(r'[^A-Za-z0-9]', '_', name)}"[:32]


def _packed(signals: Iterator[_Signal]) -> Iterator[list[_Signal]]:
    """Signals by frames, in their order."""
    frame: list[_Signal] = []
    for signal in signals:
        if sum(one.bits for one in (*frame, signal)) > _FRAME_BITS - _PROTECTION_BITS:
            yield frame
            frame = []
        frame.append(signal)
    yield frame


def _placed(signals: Sequence[_Signal]) -> tuple[_Signal, ...]:
    """Signals behind each other, the first behind the protection."""
    placed, start = [], _PROTECTION_BITS
    for one in signals:
        placed.append(replace(one, start=start))
        start += one.bits
    return tuple(placed)


def _mapping(robot: Robot, frames: Sequence[_Frame], dbc_name: str, bit_s: int) -> dict[str, Any]:
    at = {one.name: f"{frame.name}.{one.name}" for frame in frames for one in frame.signals}
    flags = [one.name for one in frames[0].signals if one.bits == 1]
    strokes = [c.name for c in robot.cylinders if c.stroke_sensor]
    listed: dict[str, Any] = {
        "schema": SCHEMA,
        "name": robot.name,
        "dbc": dbc_name,
        "bitrate": bit_s,
        "frames": {
            frame.name: {"role": frame.role, "e2e_profile_2": _identifiers(robot, k)}
            for k, frame in enumerate(frames)
        },
        "sync": {
            "counter": at["counter"],
            "status": {name: at[name] for name in flags},
            "echo": {"taken": at["taken"], "refused": at["refused"]},
        },
        "command": {key: at[key] for key in ("enable", "answered") if key in at},
        "claim": {"instance": at["instance"]},
        "joints": _channels(at, "position", robot.joint_names),
    }
    if strokes:
        listed["strokes"] = _channels(at, "stroke", strokes)
    pressures = _channels(at, "pressure", robot.pressure_names)
    listed["pressures"] = {
        name: channel | {"reference": "gauge"} for name, channel in pressures.items()
    }
    listed["valves"] = {name: {} for name in robot.valve_names}
    for part, kind in (("command", "voltage"), ("spool", "spool")):
        for name, channel in _channels(at, kind, robot.valve_names).items():
            listed["valves"][name][part] = channel
    if "oil_temperature" in at:
        listed["oil_temperature"] = {"signal": at["oil_temperature"]}
    return listed


def _channels(at: dict[str, str], kind: str, names: Sequence[str]) -> dict[str, dict[str, Any]]:
    """The channels of names that are on the bus."""
    signals = {name: _named(kind, k, name) for k, name in enumerate(names)}
    return {name: {"signal": at[one]} for name, one in signals.items() if one in at}


def _identifiers(robot: Robot, frame: int) -> list[int]:
    """Data identifiers of a frame, at every alive count another one than those of all others."""
    drawn = hashlib.sha256(robot.name.encode()).digest()[:IDENTIFIERS]
    # Odd, and so of another remainder for each of 256 frames.
    return [(one + 37 * frame) % 256 for one in drawn]
