"""Readings that cannot be, although their frames are intact: pure, one look per cycle.

A CRC tells a broken frame from a whole one, not a broken sensor from a sound one. What is looked
for is what no machine does: a joint far above its speed limit from one cycle to the next, a
pressure below vacuum or far above what the transducer can read, an encoder that stands still
to the last count under an open valve, a pressure that is the same to the last count for seconds.
What drives nothing, strokes and the oil's temperature, `side_readings` looks at.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from hydro_hw_bridge.monitoring.side_readings import JUMP_COUNTS, JUMP_FACTOR, SideWatch
from hydro_hw_bridge.protocol.bridge_step import ReadingCounters
from hydro_hw_bridge.protocol.codec import Codec
from hydro_hw_bridge.protocol.frames import Readings

#: Pressures may read this far below vacuum, and this many times the transducers' range.
BELOW_VACUUM_PA, ABOVE_RANGE = 1.0e5, 1.2
#: An encoder that has not moved a count while its valve was so far open for so long is stuck.
STUCK_S, STUCK_SHARE = 0.5, 0.2
#: Of the time that the valve is shut again: by so much what it was open before counts less. More
#: would tell of a stuck encoder too late, as the valve of an arm that moves is shut at times, too.
FORGOTTEN = 1.0 / 32.0
#: A pressure without any noise for so long is named; a sound one may be as still for a while.
STILL_S = 2.0


@dataclass(frozen=True, slots=True)
class Verdict:
    """What is wrong with the readings of one cycle.

    Attributes
    ----------
    passing : str
        Of this cycle alone (a jump, an encoder found stuck); empty where nothing is.
    standing : str
        What holds as long as the readings are so (a pressure out of range).
    """

    passing: str = ""
    standing: str = ""


class ReadingsWatch:
    """Looks at the readings of one cycle after another.

    Parameters
    ----------
    codec : Codec
    period_s : float
        Of the device's cycle.

    Attributes
    ----------
    counters : ReadingCounters
    newest : str
        The newest thing found wrong, in words; empty before the first.
    """

    def __init__(self, codec: Codec, period_s: float) -> None:
        robot = codec.robot
        self.counters = ReadingCounters()
        self.newest = ""
        self._names = codec.joint_names
        self._pressure_names = codec.pressure_names
        self._period_s = period_s
        self._step = tuple(
            JUMP_FACTOR * robot.joints[robot.joint_index(name)].velocity_limit * period_s
            for name in codec.joint_names
        )
        self._slack = tuple(JUMP_COUNTS * abs(gain) for gain in codec.position_steps)
        self._low = -robot.atmospheric_pressure_pa - BELOW_VACUUM_PA
        self._high = ABOVE_RANGE * robot.sensors.pressure_range_pa
        self._valve_of = tuple(_valve_of(codec, name) for name in codec.joint_names)
        self._rated = {valve.name: valve.rated_voltage_v for valve in robot.valves}
        self._valve_names = codec.valve_names
        self._side = SideWatch(codec, period_s, self.counters)
        self.forget()

    def forget(self) -> None:
        """The device counts anew: the next readings are the first."""
        self._last: Readings | None = None
        self._at = 0
        self._unmoved = [0.0] * len(self._names)
        self._unchanged = [0] * len(self._pressure_names)
        self._side.forget()

    def look(self, readings: Readings, counter: int, voltages: Sequence[float]) -> Verdict:
        """Look at a cycle.

        Parameters
        ----------
        readings : Readings
        counter : int
            Sample counter without wrap.
        voltages : sequence of float
            On the wire, V, per valve.

        Returns
        -------
        Verdict
        """
        last, cycles = self._last, max(1, counter - self._at)
        self._last, self._at = readings, counter
        # What may end driving is said last, and stands.
        self.newest = self._side.look(last, readings, cycles) or self.newest
        standing = self._out_of_range(readings)
        if last is None:
            return Verdict(standing=standing)
        passing = self._jump(last, readings, cycles)
        passing = passing or self._stuck(last, readings, cycles, voltages)
        self._still(last, readings, cycles)
        return Verdict(passing, standing)

    def _found(self, text: str) -> str:
        self.newest = text
        return text

    def _out_of_range(self, readings: Readings) -> str:
        for name, value in zip(self._pressure_names, readings.pressures_pa, strict=True):
            if not self._low <= value <= self._high:
                self.counters.out_of_range += 1
                return self._found(
                    f"pressure {name} cannot be {value / 1e5:.1f} bar gauge"
                    f" (from {self._low / 1e5:.1f} to {self._high / 1e5:.1f} bar)"
                )
        return ""

    def _jump(self, last: Readings, now: Readings, cycles: int) -> str:
        for i, name in enumerate(self._names):
            moved = abs(now.positions[i] - last.positions[i])
            most = self._step[i] * cycles + self._slack[i]
            if moved > most:
                self.counters.jumps += 1
                return self._found(
                    f"{name}: position jumped by {moved:.4f} in"
                    f" {1e3 * cycles * self._period_s:.0f} ms (at most {most:.4f})"
                )
        return ""

    def _stuck(self, last: Readings, now: Readings, cycles: int, voltages: Sequence[float]) -> str:
        applied = dict(zip(self._valve_names, voltages, strict=True))
        for i, valve in enumerate(self._valve_of):
            if valve is None:
                continue
            if now.positions[i] != last.positions[i]:
                self._unmoved[i] = 0.0
            elif self._is_shut(applied[valve], valve):
                self._unmoved[i] = max(0.0, self._unmoved[i] - FORGOTTEN * cycles)
            else:
                self._unmoved[i] += cycles
            if self._unmoved[i] * self._period_s >= STUCK_S:
                self._unmoved[i] = 0.0
                self.counters.stuck += 1
                return self._found(
                    f"{self._names[i]}: encoder stuck, not a count in {STUCK_S:g} s with"
                    f" {valve} at {applied[valve]:.2f} V"
                )
        return ""

    def _is_shut(self, voltage: float, valve: str) -> bool:
        return abs(voltage) < STUCK_SHARE * self._rated[valve]

    def _still(self, last: Readings, now: Readings, cycles: int) -> None:
        for i, name in enumerate(self._pressure_names):
            same = now.pressures_pa[i] == last.pressures_pa[i]
            self._unchanged[i] = self._unchanged[i] + cycles if same else 0
            if self._unchanged[i] * self._period_s >= STILL_S:
                self._unchanged[i] = 0
                self.counters.still += 1
                self._found(f"pressure {name} without any noise for {STILL_S:g} s: stuck?")


def _valve_of(codec: Codec, joint: str) -> str | None:
    """The valve that moves a joint, if it has one."""
    robot = codec.robot
    moving = [c.name for c in robot.cylinders if c.joint == joint]
    found = [v.name for v in robot.valves if v.cylinder in moving]
    return found[0] if found else None
