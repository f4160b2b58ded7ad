"""What the signals of a recording go through, of cycles that come stretch by stretch."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from hydro_ident.bag.changes import FirstLook
from hydro_ident.bag.channels import Present
from hydro_ident.bag.dead_sensors import SensorSpans
from hydro_ident.bag.grid import runs
from hydro_ident.bag.latches import FOLLOW_CYCLES, LatchFinder
from hydro_ident.bag.rails import Silence
from hydro_ident.bag.recorded_run import Recording
from hydro_ident.bag.running import Held, Spans
from hydro_ident.bag.streaming import cut_recording
from hydro_model.arrays import BoolArray, FloatArray, IntArray
from hydro_model.robot import Robot
from hydro_msgs_docs.topics import VALVE_STATE

_OPEN_SHARE = 0.02
#: From this share of its full scale on a signal is at the end of it.
FULL_SHARE = 0.999
#: Fields of a recording whose spans are told, beside the oil's temperature.
_SPANNED = ("q", "stroke", "effort", "p_a", "p_b", "supply", "tank", "valve_v", "spool", "tip_ref")
#: Cycles of a recording in memory that are looked at together.
_CYCLES = 8192
_HELD = ("q", "p_a", "p_b", "supply", "tank")


@dataclass(slots=True)
class LatchedSpans:
    """Latched cycles in figures.

    Attributes
    ----------
    count, cycles : int
        Spans, and cycles in them.
    first_ns : int
        Stamp of the first cycle of the first one.
    """

    count: int = 0
    cycles: int = 0
    first_ns: int = 0

    def add(self, spans: Sequence[tuple[int, int]], stamp_ns: IntArray, behind: int = 0) -> None:
        """Count spans; `stamp_ns` are those of the cycles from number `behind` on."""
        if spans and not self.count and spans[0][0] >= behind:
            self.first_ns = int(stamp_ns[spans[0][0] - behind])
        self.count += len(spans)
        self.cycles += sum(end - begin for begin, end in spans)


@dataclass(slots=True)
class SignalLook:
    """A first look at all signals.

    Parameters
    ----------
    robot : Robot

    Attributes
    ----------
    cycles : int
        Met so far.
    first_ns, second_ns, last_ns : int
        Stamps of cycles.
    spans : dict of str to Spans
        By field of `Recording`, and `temperature_c`; fields that were never there are not in it.
    held : dict of str to list of Held
        By field, of each column.
    full, void : dict of str to (k,) int array
        By field, cycles at the end of the range (of voltages: of their rated ones), and below
        vacuum.
    silent : dict of str to Silence
        Of supply and tank.
    latched : LatchedSpans
    sensors : SensorSpans
    changes : FirstLook
    hidden : mapping of str to float
        Dead sensors whose readings are not told.
    """

    robot: Robot
    cycles: int = 0
    first_ns: int = 0
    second_ns: int = 0
    last_ns: int = 0
    spans: dict[str, Spans] = field(default_factory=dict)
    held: dict[str, list[Held]] = field(default_factory=dict)
    full: dict[str, IntArray] = field(default_factory=dict)
    void: dict[str, IntArray] = field(default_factory=dict)
    silent: dict[str, Silence] = field(default_factory=dict)
    latched: LatchedSpans = field(default_factory=LatchedSpans)
    sensors: SensorSpans = field(init=False)
    changes: FirstLook = field(init=False)
    hidden: Mapping[str, float] = field(default_factory=dict)
    _finder: LatchFinder = field(default_factory=LatchFinder)
    #: Stamps of the last cycles met: a latch is told from delay so many cycles behind its first.
    _recent: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))

    def __post_init__(self) -> None:
        self.sensors, self.changes = SensorSpans(self.robot), FirstLook(self.robot)

    def add(self, recording: Recording) -> None:
        """Take in the next cycles, those of latches apart."""
        for name in (*_SPANNED, "temperature_c"):
            values = _matrix(getattr(recording, name))
            if values is not None:
                spans = self.spans.setdefault(name, Spans(values.shape[1]))
                spans.add(values)
        count = len(recording)
        if not count:
            return
        for name in _HELD:
            self._add_held(recording, name)
        for rail in ("supply", "tank"):
            values = getattr(recording, rail)
            if values is not None or rail in self.silent:
                silence = self.silent.setdefault(rail, Silence(self.cycles))
                silence.add(np.full(count, np.nan) if values is None else values)
        self._add_ends(recording)
        self.sensors.add(recording)
        self.changes.add(recording)
        stamps = recording.stamp_ns
        if not self.cycles:
            self.first_ns = int(stamps[0])
        if self.cycles < 2 <= self.cycles + count:
            self.second_ns = int(stamps[1 - self.cycles])
        self.last_ns = int(stamps[-1])
        self.cycles += count

    def _add_held(self, recording: Recording, name: str) -> None:
        values = _matrix(getattr(recording, name))
        if values is None:
            if name not in self.held:
                return
            values = np.full((len(recording), len(self.held[name])), np.nan)
        held = self.held.setdefault(name, [Held() for _ in range(values.shape[1])])
        for i, (one, column) in enumerate(zip(held, values.T, strict=True)):
            driven = _valve_open(recording, i) if name == "q" else None
            one.add(column, recording.stamp_ns, driven)

    def _add_ends(self, recording: Recording) -> None:
        """Count cycles at the ends of ranges."""
        full_pa = FULL_SHARE * self.robot.sensors.pressure_range_pa
        for name in ("p_a", "p_b", "supply", "tank"):
            values = _matrix(getattr(recording, name))
            if values is not None:
                _count(self.full, name, values >= full_pa)
                _count(self.void, name, values < -self.robot.atmospheric_pressure_pa)
        if recording.valve_v is not None:
            rated = np.array([valve.rated_voltage_v for valve in self.robot.valves])
            _count(self.full, "valve_v", np.abs(recording.valve_v) / rated >= FULL_SHARE)

    def add_latches(self, recording: Recording) -> None:
        """Find latches of cycles that were added, in the order of the recording."""
        told = recording.told
        nothing = np.full((len(recording), len(told)), np.nan)
        applied, command = (
            None if v is None else v[:, told] for v in (recording.valve_v, recording.command_v)
        )
        if applied is None or recording.valve_source != VALVE_STATE:
            applied = nothing
        stamps = np.concatenate([self._recent, recording.stamp_ns])
        behind = self.cycles - len(stamps)
        spans = self._finder.add(applied, nothing if command is None else command)
        self.latched.add(spans, stamps, behind)
        since = self._finder.since
        if not self.latched.count and since is not None and since >= behind:
            self.latched.first_ns = int(stamps[since - behind])
        self._recent = stamps[-FOLLOW_CYCLES:].copy()

    def finish(self) -> None:
        """No more cycles come."""
        for held in (one for every in self.held.values() for one in every):
            held.finish()
        self.latched.add(self._finder.finish(), np.zeros(0, dtype=np.int64), self.cycles)

    def seconds(self, stamp_ns: int) -> float:
        """Time of a stamp from the first cycle, s."""
        return (stamp_ns - self.first_ns) * 1e-9

    @property
    def duration_s(self) -> float:
        """From the first cycle to the last, s."""
        return float(self.last_ns - self.first_ns) * 1e-9

    def pressures(self) -> Iterator[tuple[str, str, int]]:
        """Name in `/chamber_pressures`, field and column of every pressure that was recorded.

        Hidden ones left out.
        """
        for i, cylinder in enumerate(self.robot.cylinders):
            for side in "ab":
                name, spans = f"{cylinder.name}/{side}", self.spans.get(f"p_{side}")
                if spans is not None and spans.there[i] and name not in self.hidden:
                    yield name, f"p_{side}", i
        yield from ((rail, rail, 0) for rail in ("supply", "tank") if rail in self.spans)

    def columns(self, name: str) -> list[bool] | None:
        """Which columns of a field have readings that are not hidden; None where none has."""
        if name not in self.spans:
            return None
        there = [bool(one) for one in self.spans[name].there]
        if name == "effort":
            efforts = [f"{joint} effort" for joint in self.robot.joint_names]
            there = [a and b not in self.hidden for a, b in zip(there, efforts, strict=True)]
        elif name in ("p_a", "p_b"):
            told = {i for _, kind, i in self.pressures() if kind == name}
            there = [i in told for i in range(len(there))]
        return there if any(there) else None

    def present(self, period_s: float) -> Present:
        """What was read, of a recording of such a period."""
        silent = [
            self.silent[rail].longest_s(period_s) if rail in self.silent else None
            for rail in ("supply", "tank")
        ]
        return Present(
            q=self.columns("q") or [False] * self.robot.dof,
            stroke=self.columns("stroke"),
            effort=self.columns("effort"),
            chambers=(self.columns("p_a"), self.columns("p_b")),
            silent_s=(silent[0], silent[1]),
            valve_v=self.columns("valve_v"),
        )


def look_at(recording: Recording) -> SignalLook:
    """A look at a recording in memory, with its latches.

    Parameters
    ----------
    recording : Recording

    Returns
    -------
    SignalLook
    """
    look = SignalLook(recording.robot)
    for part in parts_of(recording):
        look.add(part)
    look.finish()
    look.latched = LatchedSpans()
    look.latched.add(runs(recording.latched), recording.stamp_ns)
    return look


def parts_of(recording: Recording) -> Iterator[Recording]:
    """A recording in memory as stretches, so that looks at it take little besides.

    Parameters
    ----------
    recording : Recording

    Yields
    ------
    Recording
        Views; the oil's temperature, which has stamps of its own, is in the first.
    """
    for begin in range(0, len(recording), _CYCLES):
        part = cut_recording(recording, slice(begin, begin + _CYCLES))
        yield replace(part, temperature_c=None) if begin else part


def _matrix(values: FloatArray | None) -> FloatArray | None:
    return values[:, None] if values is not None and values.ndim == 1 else values


def _count(counts: dict[str, IntArray], name: str, those: BoolArray) -> None:
    counts[name] = counts.get(name, 0) + those.sum(axis=0)


def _valve_open(recording: Recording, joint: int) -> BoolArray:
    """In which cycles a valve of a joint is open."""
    robot = recording.robot
    cylinders = {c.name for c in robot.cylinders if c.joint == robot.joint_names[joint]}
    for k, valve in enumerate(robot.valves):
        if valve.cylinder in cylinders and recording.valve_v is not None:
            share = np.abs(np.nan_to_num(recording.valve_v[:, k])) / valve.rated_voltage_v
            return np.asarray(share > _OPEN_SHARE, dtype=np.bool_)
    return np.zeros(len(recording), dtype=np.bool_)
