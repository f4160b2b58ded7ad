"""The frames of a DBC bound to a mapping: identifiers, signal positions, scalings, bus load."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hydro_hw_bridge.errors import BridgeError
from hydro_hw_bridge.protocol.e2e import PROTECTED_BITS
from hydro_hw_bridge.protocol.mapping import BusMapping, Channel
from hydro_hw_bridge.protocol.signals import RawSignal, raw_signal
from hydro_model.errors import in_short
from hydro_model.robot import Robot

MAX_DBC_BYTES = 4_000_000
CLAIM_RATE_HZ = 10.0


@dataclass(frozen=True, slots=True)
class FrameLayout:
    """One frame: its identifier, size, role and protection.

    `extended` identifiers have 29 bits, others 11.
    """

    name: str
    identifier: int
    extended: bool
    size: int
    role: str
    identifiers: tuple[int, ...] | None

    @property
    def worst_case_bits(self) -> int:
        """Bits on a classical CAN bus with the most stuff bits possible, interframe space too.

        A data frame of s bytes has 34 + 8 s stuffable bits (54 + 8 s extended) and 13 others
        (Davis, Burns, Bril, Lukkien, "Controller Area Network (CAN) schedulability analysis",
        Real-Time Systems 35, 2007, eqs. 1 and 2).
        """
        stuffable = (54 if self.extended else 34) + 8 * self.size
        return stuffable + 13 + (stuffable - 1) // 4


@dataclass(frozen=True, slots=True)
class Binding:
    """A raw signal as a quantity in SI units: ``value = gain * raw + bias``."""

    raw: RawSignal
    gain: float
    bias: float

    def decode(self, data: bytes | bytearray) -> float:
        """The value in a frame."""
        return self.gain * self.raw.unpack(data) + self.bias

    def encode(self, value: float, data: bytearray) -> None:
        """Write a finite value, rounded to the nearest raw one, saturated at the ends."""
        self.raw.pack(self._nearest(value), data)

    def quantised(self, value: float) -> float:
        """The value that encoding and decoding leaves."""
        return self.gain * self._nearest(value) + self.bias

    def _nearest(self, value: float) -> int:
        raw = round((value - self.bias) / self.gain)
        return min(max(raw, self.raw.low), self.raw.high)


@dataclass(frozen=True, slots=True)
class Layout:
    """The frames of the protocol and the signals in them.

    `source` is the DBC file, `bitrate` the bus's in bit/s, `rate_hz` the rate of cycles.
    """

    source: Path
    bitrate: int
    rate_hz: float
    frames: tuple[FrameLayout, ...]
    signals: dict[str, RawSignal]

    def of_role(self, role: str) -> tuple[FrameLayout, ...]:
        """The frames of a role, in the mapping's order."""
        return tuple(frame for frame in self.frames if frame.role == role)

    def named(self, name: str) -> FrameLayout:
        """A frame by name."""
        return next(frame for frame in self.frames if frame.name == name)

    def raw(self, signal: str) -> RawSignal:
        """A signal by `FRAME.Signal`; it has been checked to exist."""
        return self.signals[signal]

    def bind(self, channel: Channel, shift: float = 0.0) -> Binding:
        """A channel of the mapping on its signal, `shift` added to the value."""
        raw = self.signals[channel.signal]
        factor = channel.sign * channel.scale
        bias = factor * raw.offset + channel.offset + shift
        return Binding(raw, factor * raw.scale, bias)

    @property
    def bus_load(self) -> float:
        """Worst-case share of the bus that the protocol takes, 0 to 1."""
        bits_per_s = sum(
            frame.worst_case_bits * (CLAIM_RATE_HZ if frame.role == "claim" else self.rate_hz)
            for frame in self.frames
        )
        return bits_per_s / self.bitrate

    def describe_load(self) -> str:
        """The bus load in words."""
        return (
            f"bus load {100 * self.bus_load:.1f} % of {self.bitrate} bit/s"
            f" ({len(self.frames)} frames, {self.rate_hz:g} Hz, worst-case stuffing)"
        )


MAX_BUS_LOAD = 0.5
#: Bytes of a frame, bits of a signal and start bits beyond this are nobody's: CAN FD has 64 bytes.
MAX_BITS = 4096
_GAP = r"(?:\s|//[^\n]*\n)*"
#: Words are matched whole and once (`(?=(x))\1`): no text makes the search go back over them.
_SIZES = {
    "the size of a frame": re.compile(
        rf"BO_{_GAP}(?=(?P<id>[\w.+-]+))(?P=id){_GAP}(?:(?=(?P<name>\w+))(?P=name){_GAP})?:{_GAP}"
        r"(?P<size>\d+)"
    ),
    "a start bit": re.compile(rf":{_GAP}(?P<size>\d+){_GAP}\|"),
    "the length of a signal": re.compile(rf"\|{_GAP}(?P<size>\d+){_GAP}@"),
}


def load_layout(dbc: Path, mapping: BusMapping, robot: Robot) -> Layout:
    """Read a DBC and check the mapping's frames and signals against it.

    Parameters
    ----------
    dbc : Path
    mapping : BusMapping
    robot : Robot

    Returns
    -------
    Layout

    Raises
    ------
    BridgeError
        The DBC is missing or malformed; a frame or signal of the mapping is not in it, sits in
        a frame of the wrong role or under the protection; a rated voltage does not fit its
        signal; or the bus load is above 50 %.
    """
    messages = {message.name: message for message in _read(dbc).messages}
    frames, signals = [], {}
    for rule in mapping.frames:
        message = messages.get(rule.name)
        if message is None:
            known = ", ".join(sorted(messages)) or "none"
            raise BridgeError(f"{dbc}: no frame '{rule.name}' (known: {known})")
        if not 1 <= message.length <= 8 or message.is_fd or message.is_container:
            raise BridgeError(
                f"{dbc}: frame {rule.name} should be a classical CAN frame of 1 to 8 bytes,"
                f" found {message.length} bytes"
            )
        frame = FrameLayout(
            name=rule.name,
            identifier=message.frame_id,
            extended=message.is_extended_frame,
            size=message.length,
            role=rule.role,
            identifiers=rule.identifiers,
        )
        frames.append(frame)
        used = [s for s in message.signals if f"{rule.name}.{s.name}" in _used(mapping)]
        signals.update({f"{rule.name}.{s.name}": raw_signal(message, s) for s in used})
    layout = Layout(dbc, mapping.bitrate, robot.sensors.rate_hz, tuple(frames), signals)
    _check_signals(layout, mapping)
    _check_plain(layout, mapping)
    _check_protection(layout)
    _check_voltages(layout, mapping, robot)
    if layout.bus_load > MAX_BUS_LOAD:
        raise BridgeError(
            f"{dbc}: expected at most {100 * MAX_BUS_LOAD:g} % bus load,"
            f" found {layout.describe_load()}"
        )
    return layout


def _read(dbc: Path) -> Any:
    import cantools

    if not dbc.is_file():
        raise BridgeError(f"no DBC file '{dbc}'")
    if dbc.stat().st_size > MAX_DBC_BYTES:
        raise BridgeError(f"{dbc}: larger than {MAX_DBC_BYTES} bytes, no DBC")
    try:
        text = dbc.read_text(encoding="cp1252", errors="replace")
        _check_sizes(dbc, text)
        return cantools.database.load_string(text, database_format="dbc")
    except BridgeError:
        raise
    except Exception as error:  # the parser raises IndexError, TypeError, ArithmeticError ...
        raise BridgeError(f"{dbc}: not a valid DBC: {in_short(error)}") from error


def _check_sizes(dbc: Path, text: str) -> None:
    """Refuse frames and signals for whose bits the parser would make lists without end."""
    for what, pattern in _SIZES.items():
        for found in pattern.finditer(text):
            digits = found["size"].lstrip("0")
            if len(digits) > 6 or int(digits or 0) > MAX_BITS:
                raise BridgeError(
                    f"{dbc}: expected at most {MAX_BITS} as {what}, found {digits[:20]}"
                )


def _by_role(mapping: BusMapping) -> dict[str, list[str]]:
    """Signals of the mapping by the roles of the frames that may carry them."""
    measured = [*mapping.joints.values(), *mapping.strokes.values(), *mapping.pressures.values()]
    measured += [v.spool for v in mapping.valves.values() if v.spool is not None]
    if mapping.oil_temperature is not None:
        measured.append(mapping.oil_temperature)
    command = [mapping.enable, *(v.command.signal for v in mapping.valves.values())]
    return {
        "sync": [mapping.counter, *mapping.status.values(), *mapping.echo.values()],
        "sync or cycle": [channel.signal for channel in measured],
        "command": command + ([] if mapping.answered is None else [mapping.answered]),
        "claim": [mapping.instance],
    }


def _used(mapping: BusMapping) -> set[str]:
    return {signal for signals in _by_role(mapping).values() for signal in signals}


def _check_signals(layout: Layout, mapping: BusMapping) -> None:
    role_of = {frame.name: frame.role for frame in layout.frames}
    for roles, names in _by_role(mapping).items():
        for name in names:
            if name not in layout.signals:
                raise BridgeError(
                    f"{mapping.source}: no signal '{name}' in {layout.source.name}, expected"
                    " FRAME.Signal with a frame listed under 'frames'"
                )
            role = role_of[name.split(".")[0]]
            if role not in roles.split(" or "):
                raise BridgeError(
                    f"{mapping.source}: signal '{name}' should be in a frame of role {roles},"
                    f" found in one of role {role}"
                )
    # An instance of fewer bits would not be the one that its bridge drew.
    for what, name in (("sample counter", mapping.counter), ("instance", mapping.instance)):
        if layout.raw(name).length != 32:
            raise BridgeError(
                f"{mapping.source}: {what} '{name}' should have 32 bits,"
                f" found {layout.raw(name).length}"
            )
    command = layout.of_role("command")[0]
    if mapping.answered is None and command.identifiers is None:
        raise BridgeError(
            f"{mapping.source}: {command.name} needs an 'answered' signal or protection,"
            " to tell which sample it answers"
        )


def _check_plain(layout: Layout, mapping: BusMapping) -> None:
    """States and counts are taken as their bits stand: what a DBC makes of them would be lost.

    Of a state that is active low, or that has values for error and not available, the bits alone
    say the reverse, or yes.
    """
    states = (mapping.enable, *mapping.status.values())
    counts = [mapping.counter, mapping.instance, *mapping.echo.values()]
    counts += [] if mapping.answered is None else [mapping.answered]
    for name in (*states, *counts):
        raw = layout.raw(name)
        length = 1 if name in states else raw.length
        if (raw.length, raw.signed, raw.scale, raw.offset) != (length, False, 1.0, 0.0):
            kind = "one unsigned bit (1 is yes)" if name in states else "an unsigned count"
            signed = "signed" if raw.signed else "unsigned"
            raise BridgeError(
                f"{layout.source}: expected '{name}' to be {kind} of factor 1 and offset 0, found"
                f" {raw.length} {signed} bits of factor {raw.scale:g} and offset {raw.offset:g}"
            )


def _check_protection(layout: Layout) -> None:
    for name, raw in layout.signals.items():
        frame = layout.named(raw.frame)
        if frame.identifiers is not None and raw.bits() & PROTECTED_BITS:
            raise BridgeError(
                f"{layout.source}: signal '{name}' overlaps the protection, expected byte 0 and"
                " the low nibble of byte 1 free for CRC and alive counter"
            )
        if frame.identifiers is not None and frame.size < 2:
            raise BridgeError(f"{layout.source}: protected frame {frame.name} needs 2 bytes")


def _check_voltages(layout: Layout, mapping: BusMapping, robot: Robot) -> None:
    for valve in robot.valves:
        channel = mapping.valves[valve.name].command
        binding = layout.bind(channel)
        for voltage in (-valve.rated_voltage_v, 0.0, valve.rated_voltage_v):
            error = abs(binding.quantised(voltage) - voltage)
            if not math.isclose(error, 0.0, abs_tol=0.51 * abs(binding.gain)):
                raise BridgeError(
                    f"{mapping.source}: {voltage:g} V of valve '{valve.name}' does not fit"
                    f" signal '{channel.signal}'"
                )
