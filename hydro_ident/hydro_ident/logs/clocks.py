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
from hydro_ident.logs.joining import joined
from hydro_ident.logs.map import LogMap
from hydro_ident.logs.origin import Seconds, instant_since, seconds_of
from hydro_ident.logs.signal import Clock, LogSignal
from hydro_ident.logs.times import EPOCH_S, counts_from, stop_of
from hydro_model.arrays import FloatArray, IntArray


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
    found = {name: _seconds(log, mapping, name, signals) for name in sorted(clocks)}
    # Beside numbers that count from 1970 a double has no place for single ns.
    origin_ns = next(iter(found.values())).origin_ns
    origin_s = origin_ns * 1e-9
    times = {
        name: _checked(log, one, one.since(origin_ns), padded=len(clocks) > 1)
        for name, one in found.items()
    }
    remarks = [_beginning(name, seconds, times, origin_s) for name, seconds in times.items()]
    begin, end = (instant_since(limit, origin_ns) for limit in (mapping.from_s, mapping.to_s))
    inside = {
        n: (t >= begin - found[n].slack_s) & (t <= end + found[n].slack_s)
        for n, t in times.items()
    }
    # Cells without a time, below a slower clock's last, are no samples.
    cut = sum(int(np.count_nonzero(~kept & np.isfinite(times[n]))) for n, kept in inside.items())
    if cut:
        remarks.append(f"{cut} samples outside from_s to to_s left out")
    cut_times = {n: t[inside[n]] for n, t in times.items()}
    cycles, rows, words, apart = joined(cut_times, mapping.within_s)
    stamps = _stamps_ns(log, mapping, cycles, origin_ns)
    all_rows = {}
    for name, kept in inside.items():
        all_rows[name] = np.full(len(kept), -1, dtype=np.int64)
        all_rows[name][kept] = rows[name]
    said = tuple(r for r in [*remarks, *words] if r)
    return Timeline(stamps, all_rows, said, tuple(apart) if mapping.common else ())


def _seconds(log: Log, mapping: LogMap, name: str, signals: Sequence[LogSignal]) -> Seconds:
    """Times of a clock, and the signal that they are of (none: counted)."""
    if name:
        clock = mapping.clocks.get(name, Clock(name, mapping.time.factor if mapping.time else 1.0))
    elif mapping.time is not None:
        clock = mapping.time
    else:
        count = len(log.column(signals[0].signal, str(mapping.source)))
        return Seconds(np.arange(count) / mapping.rate_hz)
    recorded = log.column(clock.signal, f"{mapping.source}, time")
    if clock.signal in log.dated and clock.factor != 1.0:
        raise BagError(
            f"{mapping.source}: expected unit s for '{clock.signal}', whose dates are read as"
            f" seconds, found one of {clock.factor:g} s"
        )
    return seconds_of(clock, recorded, log.exact.get(clock.signal))


def _checked(log: Log, clock: Seconds, seconds: FloatArray, *, padded: bool) -> FloatArray:
    """Times that increase; beside other clocks a slower one's column may end before the table."""
    if len(seconds) < 2:
        raise BagError(f"{log.path}: expected at least 2 samples, found {len(seconds)}")
    known = np.isfinite(seconds)
    if not known.any():
        raise BagError(
            f"{log.path}: expected numbers or dates in the time, found neither"
            + log.why_unread(clock.signal)
        )
    last = int(np.flatnonzero(known)[-1])
    if not known[: last + 1 if padded else None].all():
        raise BagError(_no_time_at(log, clock.signal, known))
    if (np.diff(seconds[: last + 1]) <= 0.0).any():
        raise BagError(
            f"{log.path}: expected a time that increases, found '{clock.signal}'"
            f" {stop_of(log, clock.signal, clock.factor)}"
        )
    return seconds


def _no_time_at(log: Log, signal: str, known: np.ndarray) -> str:
    k = int(np.flatnonzero(~known)[0])
    text = f"{log.path}: sample {k + 1} has no time"
    if signal not in log.lines:
        return text
    return f"{text} ('{signal}', {log.place(signal, k)}): leave such lines out of a copy"


def _stamps_ns(log: Log, mapping: LogMap, cycles: FloatArray, origin_ns: int) -> IntArray:
    if len(cycles) < 2:
        raise BagError(f"{log.path}: expected at least 2 samples, found {len(cycles)}")
    _check_span(log, mapping, cycles + origin_ns * 1e-9)
    stamps = np.asarray(mapping.start_ns + origin_ns + np.round(cycles * 1e9).astype(np.int64))
    same = np.flatnonzero(np.diff(stamps) <= 0)
    if len(same):
        at = cycles[same[0]] + origin_ns * 1e-9
        raise BagError(f"{log.path}: expected times at least 1 ns apart, found two at {at:.9g} s")
    return stamps


def _check_span(log: Log, mapping: LogMap, cycles: FloatArray) -> None:
    seconds = mapping.start_ns * 1e-9 + cycles
    if seconds.min() < 0.0:
        raise BagError(f"{log.path}: {-seconds.min():g} s before 1970: give a later 'start'")
    if seconds.max() >= EPOCH_S[1]:
        clock = mapping.time
        unit, zero = counts_from(cycles / clock.factor) if clock is not None else ("", "")
        hint = (
            f"; '{clock.signal}' counts {unit} from {zero[:4]}: give it unit: {unit}, and"
            f' start: "{zero}"'
            if clock is not None and unit
            else "; is the unit of the time right, and 'start'?"
        )
        raise BagError(
            f"{log.path}: expected times before 2038, found {seconds.max():g} s of 1970{hint}"
        )


def _beginning(
    name: str, seconds: FloatArray, times: Mapping[str, FloatArray], origin_s: float
) -> str:
    """A clock that begins elsewhere than at zero, or later than others: a trigger."""
    begin, first = float(seconds[0]), min(float(t[0]) for t in times.values())
    called = f"clock '{name}'" if name else "time"
    if len(times) > 1 and begin - first > 1e-9:
        return f"{called} begins {begin - first:.6g} s after the first"
    if len(times) == 1 and abs(begin + origin_s) > 1e-9:
        return f"{called} begins at {begin + origin_s:.6g} s"
    return ""
