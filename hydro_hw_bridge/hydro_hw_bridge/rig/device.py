"""The simulated machine as a device on the bus: its clock, its frames and the frames it takes."""

from __future__ import annotations

import time
from dataclasses import dataclass

import can

from hydro_hw_bridge.bus.bus import Bus
from hydro_hw_bridge.errors import BridgeError
from hydro_hw_bridge.protocol.codec import Codec
from hydro_hw_bridge.protocol.frames import CommandFrame, Echo, Readings, Status
from hydro_hw_bridge.rig.amplifier import WATCHDOG_S
from hydro_hw_bridge.rig.core import RigCore
from hydro_hw_bridge.rig.truth_log import TruthLog

#: Wall time after which an unanswered cycle is sent again in lockstep.
REPEAT_S = 1.0
#: Older commands do not drive; 0 V and enable off is taken up to the watchdog's time.
OLDEST_ENABLED_S = 0.010
#: Longest wait for a frame before the device looks whether it shall stop.
SLICE_S = 0.05
#: Behind by more than this, the real-time clock starts afresh instead of catching up.
LARGEST_LAG_S = 0.1
#: How long a device listens for another one before it speaks: one in lockstep is silent for less.
LISTEN_S = REPEAT_S + 0.3


@dataclass(slots=True)
class Counters:
    """What happened, for the summary.

    Attributes
    ----------
    cycles : int
        Cycles of device time.
    repeats : int
        Cycles sent again for want of an answer.
    taken, stale, corrupt : int
        Valve frames that were followed; that answered another cycle; that failed their check.
    missed : int
        Real-time cycles without a valve frame while driving.
    late, slips : int
        Real-time cycles begun late by more than a cycle; times the clock started afresh.
    """

    cycles: int = 0
    repeats: int = 0
    taken: int = 0
    stale: int = 0
    corrupt: int = 0
    missed: int = 0
    late: int = 0
    slips: int = 0


class Device:
    """Runs a rig core on a bus.

    Parameters
    ----------
    core : RigCore
    codec : Codec
    bus : Bus
        Open, receiving the bridge's identifiers.
    lockstep : bool
        Wait for the answer to every cycle instead of for the clock.
    log : TruthLog, optional

    Attributes
    ----------
    counters : Counters
    stopping : bool
        Set it, from a signal handler too, to end `run` soon.
    """

    def __init__(
        self,
        core: RigCore,
        codec: Codec,
        bus: Bus,
        *,
        lockstep: bool,
        log: TruthLog | None = None,
    ) -> None:
        self.core = core
        self.counters = Counters()
        self.stopping = False
        self._codec = codec
        self._bus = bus
        self._lockstep = lockstep
        self._log = log
        self._echo, self._echoed = Echo(0, 0), -1
        self._oldest = {
            enable: max(1, round(age_s / core.cycle_s))
            for enable, age_s in ((True, OLDEST_ENABLED_S), (False, WATCHDOG_S))
        }
        names = core.robot.pressure_names
        self._pressures = tuple(names.index(name) for name in codec.pressure_names)
        sensed = [c.name for c in core.robot.cylinders if c.stroke_sensor]
        self._strokes = tuple(sensed.index(name) for name in codec.stroke_names)

    def run(self, cycles: int | None = None, driven_cycles: int | None = None) -> None:
        """Run until stopped or for a number of cycles.

        Parameters
        ----------
        cycles : int, optional
            Of all cycles.
        driven_cycles : int, optional
            Of those since the machine was first driven: in real time it waits for its users.

        Raises
        ------
        BridgeError
            The bus went away.
        """
        step = self._lockstep_cycle if self._lockstep else self._real_time_cycle
        self._deadline = time.monotonic()
        driven = 0
        while not self.stopping and (cycles is None or self.counters.cycles < cycles):
            if driven_cycles is not None and driven >= driven_cycles:
                break
            if self._log is not None:
                self._log.append(self.core.truth_row())
            if step():
                self.counters.cycles += 1
                driven += not self.core.parked

    def frames(self) -> list[can.Message]:
        """The frames of the current cycle."""
        readings = self.core.readings()
        measurement, inputs = readings.measurement, readings.inputs
        return self._codec.encode_cycle(
            Readings(
                counter=readings.counter,
                status=Status(
                    emergency_stop_ok=inputs.emergency_stop_ok,
                    pump_on=inputs.pump_on,
                    enable_switch=inputs.enable_switch,
                    parked=readings.parked,
                    lockstep=self._lockstep,
                    amplifier_enabled=readings.amplifier_enabled,
                    amplifier_watchdog=readings.amplifier_watchdog,
                ),
                positions=measurement.positions,
                pressures_pa=tuple(measurement.pressures_pa[i] for i in self._pressures),
                spools=measurement.spools,
                strokes_m=tuple(measurement.strokes_m[i] for i in self._strokes),
                oil_temperature_c=measurement.oil_temperature_c,
                echo=self._echo_of(readings.counter),
            )
        )

    def _echo_of(self, counter: int) -> Echo:
        """What was heard up to the begin of a cycle: sent again, it says the same."""
        if counter != self._echoed:
            heard = self.counters
            self._echo = Echo(heard.taken, heard.stale + heard.corrupt)
            self._echoed = counter
        return self._echo

    def _send(self) -> None:
        for message in self.frames():
            self._bus.send(message)

    def _lockstep_cycle(self) -> bool:
        """Send the cycle until it is answered; False where stopped before."""
        self._send()
        sent = time.monotonic()
        while not self.stopping:
            wait = sent + REPEAT_S - time.monotonic()
            if wait <= 0.0:
                self.counters.repeats += 1
                self._send()
                sent = time.monotonic()
                continue
            command = self._receive(min(wait, SLICE_S))
            if command is None:
                continue
            if self.takes(command):
                self.core.actuate(command.voltages, command.enable)
                return True
        return False

    def _real_time_cycle(self) -> bool:
        """Send the cycle, take frames until the next one is due, then advance."""
        self._pace()
        self._send()
        self._deadline += self.core.cycle_s
        newest: CommandFrame | None = None
        while not self.stopping:
            wait = self._deadline - time.monotonic()
            # Past the deadline too, take what has arrived already.
            command = self._receive(min(max(wait, 0.0), SLICE_S))
            if command is not None:
                newest = command if self.takes(command) else newest
            if wait <= 0.0:
                break
        if newest is None:
            self.counters.missed += self.core.amplifier.enabled
            self.core.actuate(None)
        else:
            self.core.actuate(newest.voltages, newest.enable)
        return True

    def _pace(self) -> None:
        lag = time.monotonic() - self._deadline
        if lag > self.core.cycle_s:
            self.counters.late += 1
        if lag > LARGEST_LAG_S:
            self.counters.slips += 1
            self._deadline += lag

    def takes(self, command: CommandFrame) -> bool:
        """Whether a command may be followed; counted either way.

        Parameters
        ----------
        command : CommandFrame
            In lockstep it has to answer the cycle at hand, else one of late.
        """
        if self._lockstep:
            taken = command.answers(self.core.counter)
        else:
            span = 1 << command.answered_bits
            age = (self.core.counter - command.answered) % span
            taken = age <= self._oldest[command.enable]
        self.counters.taken += taken
        self.counters.stale += not taken
        return taken

    def _receive(self, timeout_s: float) -> CommandFrame | None:
        message = self._bus.receive(timeout_s)
        return None if message is None else self.decoded(message)

    def decoded(self, message: can.Message) -> CommandFrame | None:
        """The valve command in a message; None, and counted, where it is not intact.

        Parameters
        ----------
        message : can.Message

        Returns
        -------
        CommandFrame or None
        """
        frame = self._codec.receive(message)
        if frame is None or frame.role != "command":
            return None
        if not frame.intact:
            self.counters.corrupt += 1
            return None
        return self._codec.decode_command(frame)


def refuse_second_device(bus: Bus, codec: Codec) -> None:
    """Listen for a while; raise BridgeError where another device already sends cycles."""
    end = time.monotonic() + LISTEN_S
    while (wait := end - time.monotonic()) > 0.0:
        message = bus.receive(wait)
        if message is not None and message.arbitration_id in codec.device_ids:
            raise BridgeError(
                f"CAN bus {bus.name}: expected to be the only device, found another one that"
                f" sends identifier 0x{message.arbitration_id:X}"
            )
