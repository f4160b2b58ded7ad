"""Instants of several clocks as one line of cycles: what shares one, and what is lost."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from hydro_model.arrays import FloatArray, IntArray

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


def joined(
    times: Mapping[str, FloatArray], within_s: float
) -> tuple[FloatArray, dict[str, IntArray], list[str], list[str]]:
    """Instants of all clocks as one line of cycles.

    Parameters
    ----------
    times : mapping of str to (K,) array
        By clock, s; NaN where there is no sample.
    within_s : float
        Instants that lie this close are one; 0: a share of the finest clock's period.

    Returns
    -------
    (N,) array, dict of str to (K,) int array, list of str, list of str
        Instants; where on them each clock's samples are, -1 where there is none; words on it; and
        warnings where only instants of all signals are kept.
    """
    known = {name: t[np.isfinite(t)] for name, t in times.items()}
    order = sorted((n for n in known if len(known[n])), key=lambda n: _period(known[n]))
    if not order:
        return np.zeros(0), {n: np.full(len(t), -1, np.int64) for n, t in times.items()}, [], []
    finest = known[order[0]]
    cycles, remarks, apart = finest, [], []
    period = _period(finest)
    within = within_s or SAME * period
    places = dict(known)
    for name in order[1:]:
        near = nearest(cycles, known[name])
        shift = np.abs(cycles[near] - known[name])
        reached = shift <= within + slack_s(cycles)
        shared = _one_for_each(near, shift, reached, slack_s(cycles))
        places[name] = np.where(shared, cycles[near], known[name])
        cycles = np.union1d(cycles, places[name])
        remarks.append(_shared_remark(name, shared, shift, period))
        remarks.append(_taken_remark(name, int((reached & ~shared).sum())))
        during = (known[name] >= finest[0]) & (known[name] <= finest[-1])
        apart += _lost_warning(name, reached[during], within, period)
    rows = {}
    for name, t in times.items():
        rows[name] = np.full(len(t), -1, dtype=np.int64)
        rows[name][np.isfinite(t)] = np.searchsorted(cycles, places[name])
    return cycles, rows, remarks, apart


def _one_for_each(
    near: IntArray, shift: FloatArray, reached: np.ndarray, slack: float
) -> np.ndarray:
    """Of one clock's instants that reach the same cycle the nearest; of equally near the last.

    The last: where the nearest of two cycles is in doubt, instants take the earlier.
    """
    at = np.flatnonzero(reached)
    taken, group = np.unique(near[at], return_inverse=True)
    least = np.full(len(taken), np.inf)
    np.minimum.at(least, group, shift[at])
    nearest_ones = shift[at] <= least[group] + slack
    keeper = np.zeros(len(taken), dtype=np.int64)
    np.maximum.at(keeper, group[nearest_ones], at[nearest_ones])
    shared = np.zeros(len(near), dtype=bool)
    shared[keeper] = True
    return shared


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


def _taken_remark(name: str, count: int) -> str:
    if not count:
        return ""
    return (
        f"{_called(name)}: {count} instants have cycles of their own, as another of the same clock"
        " is nearer to the instant that within_s moves them to"
    )


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
