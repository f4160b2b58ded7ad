"""The two passages over a bag that an inspection takes, each in memory that does not grow."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from hydro_ident.bag.aligned import Meetings
from hydro_ident.bag.gaps import GapCount, GapFinder
from hydro_ident.bag.intervals import Intervals
from hydro_ident.bag.reading_rate import SecondLook
from hydro_ident.bag.stamp_jitter import StampJitter
from hydro_ident.bag.stretch_cycles import Known
from hydro_ident.bag.stretches import Stretch
from hydro_ident.inspecting.complaints import Complaints
from hydro_ident.inspecting.signal_look import SignalLook
from hydro_model.arrays import IntArray
from hydro_model.robot import Robot
from hydro_msgs_docs.topics import VALVE_COMMAND, VALVE_STATE


@dataclass(slots=True)
class Stamps:
    """Stamps of a topic, or of the cycles, in order.

    Attributes
    ----------
    intervals : Intervals
    first_ns, last_ns : int
    count : int
    """

    intervals: Intervals
    first_ns: int = 0
    last_ns: int = 0
    count: int = 0

    def add(self, stamp_ns: IntArray) -> None:
        """Take in the next stamps, (N,)."""
        if not len(stamp_ns):
            return
        before = np.array([self.last_ns] if self.count else [], dtype=np.int64)
        self.intervals.add(np.diff(np.concatenate([before, stamp_ns])))
        if not self.count:
            self.first_ns = int(stamp_ns[0])
        self.last_ns, self.count = int(stamp_ns[-1]), self.count + len(stamp_ns)


@dataclass(slots=True)
class FirstPass:
    """What a first passage finds.

    Parameters
    ----------
    known : Known

    Attributes
    ----------
    stamps : dict of str to Stamps
        By topic.
    cycles : Stamps
    meetings : dict of str to Meetings
        By topic of valves.
    complaints : Complaints
    signals : SignalLook or None
        None without a robot.
    """

    known: Known
    stamps: dict[str, Stamps] = field(default_factory=dict)
    cycles: Stamps = field(init=False)
    meetings: dict[str, Meetings] = field(default_factory=dict)
    complaints: Complaints = field(default_factory=Complaints)
    signals: SignalLook | None = None

    def __post_init__(self) -> None:
        self.cycles = self._none()

    def _none(self) -> Stamps:
        # What is read as one is in memory anyway.
        return Stamps(Intervals(most=1 << 62) if self.known.whole else Intervals())

    def add(self, stretch: Stretch) -> None:
        """Take in the next stretch."""
        self.complaints.add(stretch.statuses)
        for topic, stamp_ns in stretch.stamps.items():
            self.stamps.setdefault(topic, self._none()).add(stamp_ns)
        cycles = stretch.cycles
        if cycles is None:
            return
        self.signals = self.signals or SignalLook(cycles.robot)
        self.signals.add(cycles)
        self.signals.add_latches(cycles)
        self.cycles.add(cycles.stamp_ns)
        for topic in (VALVE_STATE, VALVE_COMMAND):
            stamp_ns = stretch.stamps.get(topic, cycles.stamp_ns[:0])
            self.meetings.setdefault(topic, Meetings()).add(cycles.stamp_ns, stamp_ns)

    def finish(self) -> None:
        """No more stretches come."""
        if self.signals is not None:
            self.signals.finish()
            self.signals.hidden = self.signals.sensors.dead()

    def period_s(self, robot: Robot) -> float:
        """Of the cycles."""
        if self.cycles.count < 2:
            return 1.0 / robot.sensors.rate_hz
        return self.cycles.intervals.period_s


class SecondPass:
    """What a second passage finds against the rates of the first one: gaps and readings.

    Parameters
    ----------
    first : FirstPass
    signals : SignalLook or None
        Of the first one; None where only the topics are looked at.

    Attributes
    ----------
    gaps : dict of str to GapCount
        By topic, of those with a rate.
    cycle_gaps : GapCount
    readings : SecondLook and StampJitter, or None

    Raises
    ------
    UndecidedError
        The intervals that are kept apart do not tell a rate.
    """

    def __init__(self, first: FirstPass, signals: SignalLook | None) -> None:
        steady = {t: s for t, s in first.stamps.items() if s.count > 1}
        self.finders = {t: _finder(s.intervals, s.intervals.period_s) for t, s in steady.items()}
        self.gaps = {topic: GapCount() for topic in steady}
        self.cycle_gaps = GapCount()
        self.readings: tuple[SecondLook, StampJitter] | None = None
        self._cycles: GapFinder | None = None
        if signals is not None:
            period_s = first.period_s(signals.robot)
            self.readings = SecondLook(signals.changes, period_s), StampJitter(period_s)
            if first.cycles.count > 1:
                self._cycles = _finder(first.cycles.intervals, period_s)

    @property
    def needed(self) -> bool:
        """Something is to be found."""
        return bool(self.finders) or self.readings is not None

    def add(self, stretch: Stretch) -> None:
        """Take in the next stretch."""
        for topic, finder in self.finders.items():
            if topic in stretch.stamps:
                self.gaps[topic].add(g for _, g in finder.add(stretch.stamps[topic]))
        if stretch.cycles is not None and self.readings is not None:
            for look in self.readings:
                look.add(stretch.cycles)
            if self._cycles is not None:
                self.cycle_gaps.add(g for _, g in self._cycles.add(stretch.cycles.stamp_ns))

    def finish(self) -> None:
        """No more stretches come."""
        for topic, finder in self.finders.items():
            self.gaps[topic].add(g for _, g in finder.finish())
        if self._cycles is not None:
            self.cycle_gaps.add(g for _, g in self._cycles.finish())


def _finder(intervals: Intervals, period_s: float) -> GapFinder:
    return GapFinder(period_s, intervals.usual_ns(period_s * 1e9))
