"""Several clocks of one log on one line of time: which sample belongs to which cycle.

Samples are put to cycles, never made: where clocks agree on an instant, their samples share a
cycle, and elsewhere each has its own.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from hydro_ident.errors import BagError
from hydro_ident.logs.file import Log
from hydro_ident.logs.map import LogMap
from hydro_ident.logs.signal import Clock, LogSignal
from hydro_ident.logs.times import EPOCH, EPOCH_S, epoch_unit, stop_of
from hydro_msgs_docs.cdr import FloatArray, IntArray

#: Instants of different clocks this share of the finest period apart are one.
SAME = 0.05
#: Share of a slower clock's instants that have to lie on the finest clock's for a quiet report.
SHARED = 0.5
#: Share of them that may stay without a cycle of all signals before a person is warned.
_LOST = 0.1
#: Of a period: half of one reaches every nearest instant of an even clock, the rest an uneven one.
_JOINING = 0.6
#: What two doubles of one instant may differ by: steps of a double, and never below 1 ns.
_STEPS, _LEAST_S = 4.0, 1e-9


@dataclass(frozen=True, slots=True)
class Timeline:
    """The cycles of a bag and whose samples they hold.

    Attributes
    ----------
    stamps_ns : (N,) int64 array
    rows : mapping of str to (K,) int array
        By clock (empty: the log's own): cycle of each of its K samples, -1 where it was left out.
    remarks : tuple of str
        What a person should know.
    warnings : tuple of str
        What costs a large share of the cycles.
    """

    stamps_ns: IntArray
    rows: Mapping[str, IntArray]
    remarks: tuple[str, ...]
    warnings: tuple[str, ...] = ()


def clock_of(log: Log, mapping: LogMap, signal: LogSignal) -> str:
    """Name of the clock of a signal.

    Parameters
    ----------
    log : Log
    mapping : LogMap
    signal : LogSignal

    Returns
    -------
    str
        Empty: the log's own.
    """
    own = signal.time or log.clocks.get(signal.signal, "")
    if mapping.time is None or own == mapping.time.signal:
        return ""
    return own


def timeline_of(log: Log, mapping: LogMap) -> Timeline:
    """Put all samples that a mapping asks for to cycles.

    Parameters
    ----------
    log : Log
    mapping : LogMap

    Returns
    -------
    Timeline

    Raises
    ------
    BagError
        Fewer than two samples, or a time that is missing, does not increase, or lies before 1970
        or after 2038.
    """
    signals = [s for section in mapping.sections.values() for s in section.values() if s.signal]
    if not signals:
        raise BagError(f"{mapping.source}: expected at least one signal of the log")
    clocks = {clock_of(log, mapping, signal) for signal in signals}
    times = {
        name: _checked(log, *_seconds(log, mapping, name, signals), padded=len(clocks) > 1)
        for name in sorted(clocks)
    }
    remarks = [_beginning(log, name, seconds, times) for name, seconds in times.items()]
    inside = {n: (t >= mapping.from_s) & (t <= mapping.to_s) for n, t in times.items()}
    # Cells without a time, below a slower clock's last, are no samples.
    cut = sum(int(np.count_nonzero(~kept & np.isfinite(times[n]))) for n, kept in inside.items())
    if cut:
        remarks.append(f"{cut} samples outside from_s to to_s left out")
    cut_times = {n: t[inside[n]] for n, t in times.items()}
    cycles, rows, joined, apart = _cycles(cut_times, mapping.within_s)
    stamps = _stamps_ns(log, mapping, cycles)
    all_rows = {}
    for name, kept in inside.items():
        all_rows[name] = np.full(len(kept), -1, dtype=np.int64)
        all_rows[name][kept] = rows[name]
    said = tuple(r for r in [*remarks, *joined] if r)
    return Timeline(stamps, all_rows, said, tuple(apart) if mapping.common else ())


def _seconds(
    log: Log, mapping: LogMap, name: str, signals: Sequence[LogSignal]
) -> tuple[FloatArray, str, float]:
    """Times of a clock, s, the signal that they are of (none: counted), and its factor."""
    if name:
        clock = mapping.clocks.get(name, Clock(name, mapping.time.factor if mapping.time else 1.0))
    elif mapping.time is not None:
        clock = mapping.time
    else:
        count = len(log.column(signals[0].signal, str(mapping.source)))
        return np.arange(count) / mapping.rate_hz, "", 1.0
    recorded = log.column(clock.signal, f"{mapping.source}, time")
    if clock.signal in log.dated and clock.factor != 1.0:
        raise BagError(
            f"{mapping.source}: expected unit s for '{clock.signal}', whose dates are read as"
            f" seconds, found one of {clock.factor:g} s"
        )
    return clock.seconds(recorded), clock.signal, clock.factor


def _checked(
    log: Log, seconds: FloatArray, signal: str, factor: float, *, padded: bool
) -> FloatArray:
    """Times that increase; beside other clocks a slower one's column may end before the table."""
    if len(seconds) < 2:
        raise BagError(f"{log.path}: expected at least 2 samples, found {len(seconds)}")
    known = np.isfinite(seconds)
    if not known.any():
        raise BagError(
            f"{log.path}: expected numbers or dates in the time, found neither"
            + log.why_unread(signal)
        )
    last = int(np.flatnonzero(known)[-1])
    if not known[: last + 1 if padded else None].all():
        raise BagError(_no_time_at(log, signal, known))
    if (np.diff(seconds[: last + 1]) <= 0.0).any():
        raise BagError(
            f"{log.path}: expected a time that increases, found '{signal}'"
            f" {stop_of(log, signal, factor)}"
        )
    return seconds


def _no_time_at(log: Log, signal: str, known: np.ndarray) -> str:
    k = int(np.flatnonzero(~known)[0])
    text = f"{log.path}: sample {k + 1} has no time"
    if signal not in log.lines:
        return text
    return f"{text} ('{signal}', {log.place(signal, k)}): leave such lines out of a copy"


def _stamps_ns(log: Log, mapping: LogMap, cycles: FloatArray) -> IntArray:
    if len(cycles) < 2:
        raise BagError(f"{log.path}: expected at least 2 samples, found {len(cycles)}")
    _check_span(log, mapping, cycles)
    stamps = np.asarray(mapping.start_ns + np.round(cycles * 1e9).astype(np.int64))
    same = np.flatnonzero(np.diff(stamps) <= 0)
    if len(same):
        raise BagError(
            f"{log.path}: expected times at least 1 ns apart, found two at {cycles[same[0]]:.9g} s"
        )
    return stamps


def _check_span(log: Log, mapping: LogMap, cycles: FloatArray) -> None:
    seconds = mapping.start_ns * 1e-9 + cycles
    if seconds.min() < 0.0:
        raise BagError(f"{log.path}: {-seconds.min():g} s before 1970: give a later 'start'")
    if seconds.max() >= EPOCH_S[1]:
        clock = mapping.time
        unit = epoch_unit(cycles / clock.factor) if clock is not None else ""
        hint = (
            f"; '{clock.signal}' counts {unit} from 1970: give it unit: {unit}, and"
            f' start: "{EPOCH}"'
            if clock is not None and unit
            else "; is the unit of the time right, and 'start'?"
        )
        raise BagError(
            f"{log.path}: expected times before 2038, found {seconds.max():g} s of 1970{hint}"
        )


def _beginning(log: Log, name: str, seconds: FloatArray, times: Mapping[str, FloatArray]) -> str:
    """A clock that begins elsewhere than at zero, or later than others: a trigger."""
    begin, first = float(seconds[0]), min(float(t[0]) for t in times.values())
    called = f"clock '{name}'" if name else "time"
    if len(times) > 1 and begin - first > 1e-9:
        return f"{called} begins {begin - first:.6g} s after the first"
    if len(times) == 1 and abs(begin) > 1e-9:
        return f"{called} begins at {begin:.6g} s"
    return ""


def _cycles(
    times: Mapping[str, FloatArray], within_s: float
) -> tuple[FloatArray, dict[str, IntArray], list[str], list[str]]:
    """Instants of all clocks as one line, where on it each clock's samples are, and words on it.

    The last are warnings where only instants of all signals are kept.
    """
    known = {name: t[np.isfinite(t)] for name, t in times.items()}
    order = sorted((n for n in known if len(known[n])), key=lambda n: _period(known[n]))
    if not order:
        return np.zeros(0), {n: np.full(len(t), -1, np.int64) for n, t in times.items()}, [], []
    finest = known[order[0]]
    cycles, remarks, apart = finest, [], []
    period = _period(finest)
    within = within_s or SAME * period
    for name in order[1:]:
        near = nearest(cycles, known[name])
        shift = np.abs(cycles[near] - known[name])
        shared = shift <= within + slack_s(cycles)
        cycles = np.union1d(cycles, known[name][~shared])
        remarks.append(_shared_remark(name, shared, shift, period))
        during = (known[name] >= finest[0]) & (known[name] <= finest[-1])
        apart += _lost_warning(name, shared[during], within, period)
    rows = {}
    for name, t in times.items():
        rows[name] = np.full(len(t), -1, dtype=np.int64)
        rows[name][np.isfinite(t)] = nearest(cycles, t[np.isfinite(t)])
    return cycles, rows, remarks, apart


def _period(seconds: FloatArray) -> float:
    return float(np.median(np.diff(seconds))) if len(seconds) > 1 else np.inf


def joining_s(period_s: float) -> float:
    """A `within_s` that moves every instant to the nearest of a clock.

    Parameters
    ----------
    period_s : float
        Of the clock.

    Returns
    -------
    float
        Three digits of it: more than half a period, at which rounding would decide.
    """
    return float(f"{_JOINING * period_s:.3g}")


def slack_s(line: FloatArray) -> float:
    """What the rounding of stamps may make of equal instants, s.

    Parameters
    ----------
    line : (N,) array
        Instants, s; at least one of them.

    Returns
    -------
    float
    """
    return max(_STEPS * float(np.spacing(np.abs(line).max())), _LEAST_S)


def nearest(line: FloatArray, instants: FloatArray) -> IntArray:
    """Index of the instant of a line that is nearest; of two that are equally near the earlier.

    Parameters
    ----------
    line : (N,) array
        Increasing.
    instants : (K,) array

    Returns
    -------
    (K,) int array
    """
    right = np.clip(np.searchsorted(line, instants), 1, len(line) - 1)
    left = right - 1
    further = np.abs(line[left] - instants) - np.abs(line[right] - instants)
    closer = further <= slack_s(line)
    return np.asarray(np.where(closer, left, right), dtype=np.int64)


def _shared_remark(name: str, shared: np.ndarray, shift: FloatArray, period: float) -> str:
    text = f"{_called(name)}: {int(shared.sum())} of {len(shared)} instants are the finest clock's"
    if shared.any() and shift[shared].max() > 1e-9:
        text += f" (moved by up to {shift[shared].max() * 1e6:.3g} us)"
    if shared.mean() < SHARED:
        text += (
            f"; the others have cycles of their own, which no analysis can join: time:"
            f" {{within_s: {joining_s(period):g}}} would move each to the nearest"
        )
    return text


def _lost_warning(name: str, shared: np.ndarray, within: float, period: float) -> list[str]:
    """Of instants while the finest clock runs: those that `keep: common` will leave out."""
    lost = int(np.count_nonzero(~shared))
    if lost <= _LOST * len(shared):
        return []
    more = joining_s(period)
    hint = f": time: {{within_s: {more:g}}} would keep them" if within < more else ""
    return [
        f"{_called(name)}: {lost} of {len(shared)} instants are further than {within:.3g} s"
        f" (within_s) from the finest clock's, and keep: common leaves them out{hint}"
    ]


def _called(name: str) -> str:
    return f"clock '{name}'" if name else "the log's time"
