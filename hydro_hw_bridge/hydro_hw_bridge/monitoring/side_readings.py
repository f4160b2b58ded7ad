"""Readings that drive nothing and cannot be: strokes and the oil's temperature. Pure.

Nothing stops by them, as nothing is driven by them; but recordings are identified by them, and who
drives is to know of a dead one before, not after. What is looked for is what no machine does: a
stroke beyond its cylinder, a piston far above the speed of its joint, a stroke that stays while
the joint moves, oil that would not flow or that no seal bears, oil that changes at once. A
temperature that stays is none of it: oil at work keeps its own to the last count for minutes.
"""

from __future__ import annotations

from hydro_hw_bridge.protocol.bridge_step import ReadingCounters
from hydro_hw_bridge.protocol.codec import Codec
from hydro_hw_bridge.protocol.frames import Readings
from hydro_model.hydraulics.cylinder import stroke
from hydro_model.robot import Cylinder, Robot

#: A joint or piston may move this many times its velocity limit between two cycles.
JUMP_FACTOR = 4.0
#: Counts of a sensor of positions that are no jump, whatever the speed limit.
JUMP_COUNTS = 16
#: Strokes may read this share of the cylinder's beyond its ends: zeros are not calibrated.
BEYOND_SHARE = 0.1
#: A stroke that has not changed by a count while its joint moved the piston by this share and
#: two counts is stuck.
STUCK_SHARE, STUCK_COUNTS = 0.05, 2
#: Oil below does not flow, above it is no oil for long. deg C; a broken wire reads an end.
COLDEST_C, HOTTEST_C = -40.0, 130.0
#: Oil does not change by more than this at once and this much more in every second.
TEMPERATURE_STEP_K, TEMPERATURE_RATE_K_S = 5.0, 5.0
_OIL = "oil temperature"


class SideWatch:
    """Looks at the strokes and the oil's temperature of one cycle after another.

    Parameters
    ----------
    codec : Codec
    period_s : float
        Of the device's cycle.
    counters : ReadingCounters
        Its `strokes` and `temperatures` are counted here.
    """

    def __init__(self, codec: Codec, period_s: float, counters: ReadingCounters) -> None:
        robot = codec.robot
        self._counters, self._period_s = counters, period_s
        known = {cylinder.name: cylinder for cylinder in robot.cylinders}
        self._cylinders = tuple(known[name] for name in codec.stroke_names)
        self._joints = tuple(codec.joint_names.index(c.joint) for c in self._cylinders)
        self._counts = tuple(abs(gain) for gain in codec.stroke_steps)
        self._step = tuple(
            JUMP_FACTOR * _fastest(robot, cylinder) * period_s for cylinder in self._cylinders
        )
        self.forget()

    def forget(self) -> None:
        """The device counts anew: the next readings are the first."""
        self._wrong: frozenset[str] = frozenset()
        self._still_at_m = [0.0] * len(self._cylinders)

    def look(self, last: Readings | None, now: Readings, cycles: int) -> str:
        """Look at a cycle.

        Parameters
        ----------
        last : Readings or None
            Of the cycle before; None where there was none.
        now : Readings
        cycles : int
            From that cycle to this.

        Returns
        -------
        str
            What was not wrong in the cycle before; empty where nothing is.
        """
        found = {
            cylinder.name: text
            for i, cylinder in enumerate(self._cylinders)
            if (text := self._stroke(i, last, now, cycles))
        }
        self._counters.strokes += bool(found)
        if text := self._oil(last, now, cycles):
            self._counters.temperatures += 1
            found[_OIL] = text
        new = [text for name, text in found.items() if name not in self._wrong]
        self._wrong = frozenset(found)
        return new[0] if new else ""

    def _stroke(self, i: int, last: Readings | None, now: Readings, cycles: int) -> str:
        cylinder, value = self._cylinders[i], now.strokes_m[i]
        by_joint_m = float(stroke(cylinder, now.positions[self._joints[i]]))
        if last is None or value != last.strokes_m[i]:
            self._still_at_m[i] = by_joint_m
        low, high = -BEYOND_SHARE * cylinder.stroke_m, (1.0 + BEYOND_SHARE) * cylinder.stroke_m
        if not low <= value <= high:
            return (
                f"{cylinder.name}: stroke cannot be {value:.4f} m (from {low:.4f} to {high:.4f} m)"
            )
        jump = "" if last is None else self._jump(i, value - last.strokes_m[i], cycles)
        return jump or self._stuck(i, by_joint_m)

    def _jump(self, i: int, step_m: float, cycles: int) -> str:
        most = self._step[i] * cycles + JUMP_COUNTS * self._counts[i]
        if abs(step_m) <= most:
            return ""
        return (
            f"{self._cylinders[i].name}: stroke jumped by {abs(step_m):.4f} m in"
            f" {self._milliseconds(cycles)} (at most {most:.4f} m)"
        )

    def _stuck(self, i: int, by_joint_m: float) -> str:
        cylinder, moved = self._cylinders[i], abs(by_joint_m - self._still_at_m[i])
        if moved <= STUCK_SHARE * cylinder.stroke_m + STUCK_COUNTS * self._counts[i]:
            return ""
        return (
            f"{cylinder.name}: stroke sensor stuck, not a count while {cylinder.joint} moved the"
            f" piston by {moved:.4f} m"
        )

    def _oil(self, last: Readings | None, now: Readings, cycles: int) -> str:
        value = now.oil_temperature_c
        if value is None:
            return ""
        if not COLDEST_C < value < HOTTEST_C:
            return (
                f"{_OIL} cannot be {value:.1f} deg C (from {COLDEST_C:g} to {HOTTEST_C:g} deg C)"
            )
        if last is None or last.oil_temperature_c is None:
            return ""
        changed = abs(value - last.oil_temperature_c)
        most = TEMPERATURE_STEP_K + TEMPERATURE_RATE_K_S * cycles * self._period_s
        if changed <= most:
            return ""
        return (
            f"{_OIL} jumped by {changed:.1f} K in {self._milliseconds(cycles)}"
            f" (at most {most:.1f} K)"
        )

    def _milliseconds(self, cycles: int) -> str:
        return f"{1e3 * cycles * self._period_s:.0f} ms"


def _fastest(robot: Robot, cylinder: Cylinder) -> float:
    """The speed of a piston at its joint's velocity limit, where the lever is longest, m/s."""
    limit = robot.joints[robot.joint_index(cylinder.joint)].velocity_limit
    # In a triangle the lever is no longer than the shorter of the sides at the joint.
    return limit * (min(cylinder.l1_m, cylinder.l2_m) if cylinder.l1_m > 0.0 else 1.0)
