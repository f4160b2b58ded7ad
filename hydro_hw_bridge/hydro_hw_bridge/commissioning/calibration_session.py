"""The machine at the other end of the bus, cycle by cycle, for procedures without ROS."""

from __future__ import annotations

import time
from collections.abc import Iterator

from hydro_hw_bridge.bus.bus import Bus
from hydro_hw_bridge.bus.claims import CLAIM_PERIOD_S, Claim
from hydro_hw_bridge.errors import BridgeError, CalibrationError
from hydro_hw_bridge.protocol.assembler import Assembler, CycleKind
from hydro_hw_bridge.protocol.codec import Codec
from hydro_hw_bridge.protocol.frames import Frame, Readings

SILENCE_S = 3.0
SLICE_S = 0.05
STOP_FRAMES = 5
STOP_PERIOD_S = 0.002
#: A cycle that is driven may come again so often before it is answered by no more than 0 V: its
#: answer is lost now and then, and a counter that stands counts no length of a pulse.
MAX_REPEATS = 5


class Session:
    """Claims the bus and answers every cycle, as a bridge does, with what `drive` says.

    Parameters
    ----------
    bus : Bus
    codec : Codec
        Not calibrated: what is measured are the mapping's own errors.

    Raises
    ------
    BridgeError
        A bridge is on the bus.
    """

    def __init__(self, bus: Bus, codec: Codec) -> None:
        self.codec = codec
        self._bus = bus
        self._assembler = Assembler(codec.cycle_frames, codec.sample_counter)
        self._zero = (0.0,) * len(codec.valve_names)
        self._voltages, self._enable = self._zero, False
        self._counter: int | None = None
        self._claim = Claim(bus, codec)
        self._claim.take()
        self._claimed_at = time.monotonic()

    def drive(self, valve: str | None, voltage_v: float = 0.0) -> None:
        """From the next cycle on: this voltage on one valve, 0 V on the others.

        Parameters
        ----------
        valve : str or None
            None: 0 V and enable off.
        voltage_v : float
        """
        names = self.codec.valve_names
        self._voltages = tuple(voltage_v if name == valve else 0.0 for name in names)
        self._enable = valve is not None

    def cycles(self) -> Iterator[Readings]:
        """The machine's cycles as they come; each is answered when the next is asked for.

        Raises
        ------
        CalibrationError
            Nothing comes from the device; or the same cycle again and again, or a device that
            counts anew, while it is driven.
        BridgeError
            A bridge appeared on the bus, or the bus went away.
        """
        heard, repeats = time.monotonic(), 0
        self._answer()
        while True:
            now = time.monotonic()
            if now - self._claimed_at > CLAIM_PERIOD_S:
                self._claim.send()
                self._claimed_at = now
            if now - heard > SILENCE_S:
                raise CalibrationError(
                    f"nothing from the device on {self._bus.name} for {SILENCE_S:g} s"
                )
            message = self._bus.receive(SLICE_S)
            frame = None if message is None else self.codec.receive(message)
            if frame is None:
                continue
            if frame.role == "claim":
                self._hear(frame)
            if frame.role not in ("sync", "cycle"):
                continue
            restarts = self._assembler.counters.restarts
            cycle = self._assembler.add(frame)
            if self._enable and self._assembler.counters.restarts != restarts:
                self._refuse_restarted()
            if cycle is None:
                continue
            heard, self._counter = now, cycle.counter
            if cycle.kind is not CycleKind.REPEAT:
                repeats = 0
                yield self.codec.readings(cycle.data)
            elif self._enable:
                repeats += 1
                self._refuse_more(repeats)
            self._answer()

    def _refuse_restarted(self) -> None:
        """Of a pulse nobody knows how much a device that starts anew has given."""
        raise CalibrationError(
            "the device restarted while it was driven: its sample counter went back to"
            f" {self._assembler.counter} from {self._counter}"
        )

    def _refuse_more(self, repeats: int) -> None:
        if repeats > MAX_REPEATS:
            raise CalibrationError(
                f"the device's sample counter stands at {self._counter} while it is driven,"
                " expected it to count its cycles"
            )

    def _hear(self, frame: Frame) -> None:
        if frame.intact and self._claim.hear(self.codec.decode_claim(frame)):
            raise BridgeError(f"a bridge appeared on CAN bus {self._bus.name}: stop it first")

    def _answer(self) -> None:
        if self._counter is not None:
            voltages, enable = self._voltages, self._enable
            self._bus.send(self.codec.encode_command(self._counter, voltages, enable))

    def stop(self) -> None:
        """0 V and enable off, now and several times: any one frame may be lost."""
        self.drive(None)
        for _ in range(STOP_FRAMES):
            self._answer()
            time.sleep(STOP_PERIOD_S)
