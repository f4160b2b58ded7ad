"""Frames to readings and voltages to frames, both ways: one codec for the bridge and the device.

Positions are in rad (m where prismatic), pressures in Pa gauge, spools in [-1, 1], voltages in V.
Nothing here knows of a bus, a clock or ROS.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TypeVar

import can

from hydro_hw_bridge.protocol.calibration import Calibration, calibrated_mapping
from hydro_hw_bridge.protocol.e2e import alive_counter, is_intact, protect
from hydro_hw_bridge.protocol.frames import CommandFrame, Echo, Frame, Readings, Status
from hydro_hw_bridge.protocol.layout import Binding, FrameLayout, Layout, load_layout
from hydro_hw_bridge.protocol.mapping import ECHO_NAMES, STATUS_NAMES, BusMapping, load_mapping
from hydro_model.robot import Robot
from hydro_msgs_docs.shipped_mapping import default_mapping

COUNTER_BITS = 32
#: Less than that is rounding of the numbers of a DBC.
_ROUNDING_V = 1e-9
_Codec = TypeVar("_Codec", bound="Codec")


class Codec:
    """Encodes and decodes the frames of one bus.

    Parameters
    ----------
    robot : Robot
    mapping : BusMapping
    layout : Layout

    Attributes
    ----------
    joint_names, stroke_names, pressure_names, valve_names : tuple of str
        Order of the values in `Readings` and in commands.
    device_ids, bridge_ids : tuple of int
        Identifiers that the device sends and that bridges send.
    cycle_frames : tuple of str
        The frames that make one sample, sync first.
    tells_clock : bool
        The sync frame says whether the device is in lockstep.
    tells_amplifiers : bool
        The sync frame says whether the amplifiers are on.
    echo_spans : tuple of int
        After how many the counts of `Echo` begin anew; empty where the device does not tell them.
    """

    def __init__(self, robot: Robot, mapping: BusMapping, layout: Layout) -> None:
        self.robot = robot
        self.mapping = mapping
        self.layout = layout
        self.joint_names = tuple(mapping.joints)
        self.stroke_names = tuple(mapping.strokes)
        self.pressure_names = tuple(mapping.pressures)
        self.valve_names = tuple(mapping.valves)
        self._by_id = {frame.identifier: frame for frame in layout.frames}
        self._sync = layout.of_role("sync")[0]
        self._command = layout.of_role("command")[0]
        self._claim = layout.of_role("claim")[0]
        sampled = (self._sync, *layout.of_role("cycle"))
        self.cycle_frames = tuple(frame.name for frame in sampled)
        self.device_ids = tuple(frame.identifier for frame in sampled)
        self.bridge_ids = (self._command.identifier, self._claim.identifier)
        self._bind(layout)

    def _bind(self, layout: Layout) -> None:
        mapping, robot = self.mapping, self.robot
        atmosphere = robot.atmospheric_pressure_pa
        self._counter = layout.raw(mapping.counter)
        self.tells_clock = "lockstep" in mapping.status
        self.tells_amplifiers = "amplifier_enabled" in mapping.status
        self._status = {name: layout.raw(signal) for name, signal in mapping.status.items()}
        self._echo = tuple(layout.raw(mapping.echo[name]) for name in ECHO_NAMES if mapping.echo)
        self.echo_spans = tuple(1 << raw.length for raw in self._echo)
        # Of the few combinations that occur, each is made once.
        self._statuses: dict[tuple[int, ...], Status] = {}
        self._positions = tuple(layout.bind(c) for c in mapping.joints.values())
        self._strokes = tuple(layout.bind(c) for c in mapping.strokes.values())
        self._pressures = tuple(
            layout.bind(c, shift=-atmosphere if c.absolute else 0.0)
            for c in mapping.pressures.values()
        )
        self._spools = tuple(
            None if v.spool is None else layout.bind(v.spool) for v in mapping.valves.values()
        )
        self._voltages = tuple(layout.bind(v.command) for v in mapping.valves.values())
        temperature = mapping.oil_temperature
        self._temperature = None if temperature is None else layout.bind(temperature)
        self._enable = layout.raw(mapping.enable)
        self._answered = None if mapping.answered is None else layout.raw(mapping.answered)
        self._instance = layout.raw(mapping.instance)

    @property
    def position_steps(self) -> tuple[float, ...]:
        """What one count of every joint's sensor is worth, rad or m, signed."""
        return tuple(binding.gain for binding in self._positions)

    @property
    def stroke_steps(self) -> tuple[float, ...]:
        """What one count of every stroke sensor is worth, m, signed."""
        return tuple(binding.gain for binding in self._strokes)

    @classmethod
    def load(
        cls: type[_Codec],
        dbc_path: str | Path | None,
        mapping_path: str | Path | None,
        robot: Robot,
        calibration: Calibration | None = None,
    ) -> _Codec:
        """Read DBC and mapping and check them against each other and the robot.

        Parameters
        ----------
        dbc_path : path or None
            By default the DBC that the mapping names.
        mapping_path : path or None
            By default the one shipped for the robot's name.
        robot : Robot
        calibration : Calibration, optional
            Zeros, references and signs measured on the machine (bridge side only).

        Returns
        -------
        Codec

        Raises
        ------
        BridgeError
            A file is missing or malformed, or they contradict each other or the robot.
        ContractError
            No mapping is named, and none is shipped for the robot.
        """
        mapping = load_mapping(Path(mapping_path or default_mapping(robot.name)), robot)
        if calibration is not None:
            mapping = calibrated_mapping(mapping, calibration, robot.name)
        layout = load_layout(Path(dbc_path or mapping.dbc), mapping, robot)
        return cls(robot, mapping, layout)

    def receive(self, message: can.Message) -> Frame | None:
        """Check a message of the bus.

        Parameters
        ----------
        message : can.Message

        Returns
        -------
        Frame or None
            None where the message is not part of the protocol.
        """
        frame = self._by_id.get(message.arbitration_id)
        if frame is None or message.is_extended_id != frame.extended:
            return None
        data = bytes(message.data)
        if len(data) != frame.size or message.is_remote_frame or message.is_error_frame:
            return Frame(frame.name, frame.role, None, data, intact=False)
        if frame.identifiers is None:
            return Frame(frame.name, frame.role, None, data, intact=True)
        intact = is_intact(data, frame.identifiers)
        return Frame(frame.name, frame.role, alive_counter(data), data, intact)

    def sample_counter(self, sync: Frame) -> int:
        """The sample counter of a sync frame."""
        return self._counter.unpack(sync.data)

    def readings(self, data: Mapping[str, bytes]) -> Readings:
        """The readings of one complete cycle.

        Parameters
        ----------
        data : mapping from frame name to bytes
            Every frame of `cycle_frames`, intact, all of one cycle.

        Returns
        -------
        Readings
        """

        def value(binding: Binding) -> float:
            return binding.decode(data[binding.raw.frame])

        sync = data[self._sync.name]
        temperature = self._temperature
        return Readings(
            counter=self._counter.unpack(sync),
            status=self._status_of(sync),
            positions=tuple(map(value, self._positions)),
            pressures_pa=tuple(map(value, self._pressures)),
            spools=tuple(float("nan") if b is None else value(b) for b in self._spools),
            strokes_m=tuple(map(value, self._strokes)),
            oil_temperature_c=None if temperature is None else value(temperature),
            echo=Echo(*(raw.unpack(sync) for raw in self._echo)) if self._echo else None,
        )

    def status(self, sync: Frame) -> Status:
        """The device's status bits in a sync frame."""
        return self._status_of(sync.data)

    def _status_of(self, sync: bytes) -> Status:
        bits = tuple(raw.unpack(sync) for raw in self._status.values())
        known = self._statuses.get(bits)
        if known is None:
            named = zip(self._status, map(bool, bits), strict=True)
            known = self._statuses[bits] = Status(**dict(named))
        return known

    def encode_cycle(self, readings: Readings) -> list[can.Message]:
        """The frames of one cycle, sync first (device side).

        Values outside what a signal can carry saturate, as a transducer does.

        Parameters
        ----------
        readings : Readings

        Returns
        -------
        list of can.Message
        """
        data = {name: bytearray(self.layout.named(name).size) for name in self.cycle_frames}
        counter = readings.counter & ((1 << COUNTER_BITS) - 1)
        self._counter.pack(counter, data[self._sync.name])
        for name in STATUS_NAMES:
            if name in self._status:
                self._status[name].pack(int(getattr(readings.status, name)), data[self._sync.name])
        if self._echo and readings.echo is not None:
            counts = (readings.echo.taken, readings.echo.refused)
            for raw, count in zip(self._echo, counts, strict=True):
                raw.pack(count, data[self._sync.name])
        groups = (
            (self._positions, readings.positions),
            (self._strokes, readings.strokes_m),
            (self._pressures, readings.pressures_pa),
            (self._spools, readings.spools),
            ((self._temperature,), (readings.oil_temperature_c,)),
        )
        for bindings, values in groups:
            for binding, value in zip(bindings, values, strict=True):
                if binding is not None and value is not None:
                    binding.encode(value, data[binding.raw.frame])
        return [
            _message(self.layout.named(name), data[name], counter) for name in self.cycle_frames
        ]

    def encode_command(self, counter: int, voltages: Sequence[float], enable: bool) -> can.Message:
        """The valve command that answers a cycle (bridge side).

        Parameters
        ----------
        counter : int
            Sample counter of the answered cycle.
        voltages : sequence of float
            V, per valve.
        enable : bool

        Returns
        -------
        can.Message
        """
        data = bytearray(self._command.size)
        self._enable.pack(int(enable), data)
        if self._answered is not None:
            self._answered.pack(counter, data)
        for binding, voltage in zip(self._voltages, voltages, strict=True):
            binding.encode(voltage, data)
        return _message(self._command, data, counter)

    def decode_command(self, frame: Frame) -> CommandFrame:
        """Read a valve command (device side).

        Parameters
        ----------
        frame : Frame
            Of role command, intact.

        Returns
        -------
        CommandFrame
        """
        if self._answered is None:
            answered, bits = frame.alive or 0, 4
        else:
            answered, bits = self._answered.unpack(frame.data), self._answered.length
        return CommandFrame(
            answered=answered,
            answered_bits=bits,
            voltages=tuple(b.decode(frame.data) for b in self._voltages),
            enable=bool(self._enable.unpack(frame.data)),
        )

    def quantised(self, voltages: Sequence[float]) -> tuple[float, ...]:
        """The voltages that the wire carries for those asked for."""
        return tuple(b.quantised(v) for b, v in zip(self._voltages, voltages, strict=True))

    @property
    def zero_v(self) -> dict[str, float]:
        """What valves get for 0 V that is no whole count of their signal, V; of such alone."""
        at_zero = self.quantised((0.0,) * len(self.valve_names))
        pairs = zip(self.valve_names, at_zero, strict=True)
        return {name: value for name, value in pairs if abs(value) > _ROUNDING_V}

    def encode_claim(self, instance: int, alive: int) -> can.Message:
        """The claim that a bridge sends at 10 Hz.

        Parameters
        ----------
        instance : int
            The bridge's random number.
        alive : int
            Counts its claims.

        Returns
        -------
        can.Message
        """
        data = bytearray(self._claim.size)
        self._instance.pack(instance, data)
        return _message(self._claim, data, alive)

    def decode_claim(self, frame: Frame) -> int:
        """The instance number in a claim."""
        return self._instance.unpack(frame.data)


def _message(frame: FrameLayout, data: bytearray, alive: int) -> can.Message:
    if frame.identifiers is not None:
        protect(data, alive, frame.identifiers)
    return can.Message(
        arbitration_id=frame.identifier, is_extended_id=frame.extended, data=data, check=False
    )
