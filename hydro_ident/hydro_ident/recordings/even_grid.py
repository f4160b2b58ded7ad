"""Recordings whose readings were taken at uneven times, brought to the even times of their rate.

Filters, differences and windows take a recording for evenly sampled. Readings go along the cubic
through the four nearest ones (Lagrange's polynomial, as over a lost cycle). What a valve was told
holds until it is told anew: each even interval has the mean of what held in it. Cycles that are
missing stay missing.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from hydro_ident.bag.cubic import cubic_between
from hydro_ident.bag.recorded_run import Recording
from hydro_ident.bag.stamp_jitter import StampJitter
from hydro_ident.bag.streaming import Piece
from hydro_ident.estimate.signals.bridging import longest_hole
from hydro_model.arrays import BoolArray, FloatArray, IntArray

#: What goes from reading to reading, and what is held.
_READ = (
    *("q", "stroke", "effort", "p_a", "p_b", "supply", "tank", "spool"),
    *("q_ref", "qd_ref", "force_ref", "tip_ref"),
)
_HELD = ("valve_v", "command_v")
#: Periods that differ by less than this share are one: edges of valves are known no better.
_SAME_PERIOD = 1.0e-4


def on_even_grid(pieces: Iterable[Piece]) -> Iterator[Piece]:
    """Pieces of a recording, of one that was read at stamps that jitter on an even grid.

    The first piece that tells whether readings were taken at their stamps speaks for those that
    follow; where none does, and where stamps are even, they stay as they are. Those that were read
    evenly stay, too, but for a period that their stamps told wrongly.

    Parameters
    ----------
    pieces : iterable of Piece
    """
    told: bool | None = None
    text, period_s = "", 0.0
    for piece in pieces:
        if told is None:
            jitter = StampJitter(piece.recording.period_s)
            jitter.add(piece.recording)
            told, text = jitter.of_readings, jitter.text
            period_s = piece.recording.period_s if told is None else _period_s(piece.recording)
        if told:
            yield _laid(piece, text)
        else:
            other = abs(period_s / piece.recording.period_s - 1.0) > _SAME_PERIOD
            yield _at_period(piece, period_s) if other else piece


def _at_period(piece: Piece, period_s: float) -> Piece:
    return replace(piece, recording=replace(piece.recording, period_s=period_s))


def _period_s(recording: Recording) -> float:
    """The slope of stamps over cycles that follow each other.

    The mean of what is about one interval is off by what jitter takes beyond its bounds.
    """
    products = squares = 0.0
    for part in recording.segments:
        stamps = recording.stamp_ns[part]
        late = (stamps - stamps[0]) * 1e-9
        cycle = np.arange(len(stamps)) - 0.5 * (len(stamps) - 1)
        products, squares = products + float(cycle @ late), squares + float(cycle @ cycle)
    return products / squares if squares else recording.period_s


def _laid(piece: Piece, text: str) -> Piece:
    recording = piece.recording
    since = np.asarray(recording.stamp_ns - piece.start_ns, dtype=float)
    cycle_ns = recording.period_s * 1e9
    first, last = np.ceil(since[0] / cycle_ns), np.floor(since[-1] / cycle_ns)
    grid = np.arange(first, last + 1.0) * cycle_ns
    near, there = _cycles(since, grid, recording)
    grid, near = grid[there], near[there]
    stamps = piece.start_ns + np.round(grid).astype(np.int64)
    reach = (longest_hole(recording.period_s) + 1.5) * cycle_ns
    changed: dict[str, Any] = {"stamp_ns": stamps, "latched": recording.latched[near]}
    for name in _READ:
        values = getattr(recording, name)
        if values is not None:
            changed[name] = _read(values, since, grid, near, reach)
    for name in _HELD:
        values = getattr(recording, name)
        if values is not None:
            changed[name] = _held(values, since, grid, cycle_ns)
    note = f"{text}, and its readings were taken at them: they are interpolated to even times"
    laid = replace(recording, notes=(*recording.notes, note), **changed)
    core = slice(_edge(piece, piece.core.start, stamps), _edge(piece, piece.core.stop, stamps))
    return Piece(laid, core, piece.start_ns)


def _edge(piece: Piece, at: int, stamps: IntArray) -> int:
    """The first even time from a cycle on; what is before the first belongs to it."""
    old = piece.recording.stamp_ns
    if at == 0:
        return 0
    return len(stamps) if at >= len(old) else int(np.searchsorted(stamps, old[at]))


def _cycles(
    since: FloatArray, grid: FloatArray, recording: Recording
) -> tuple[IntArray, BoolArray]:
    """The cycle nearest to each even time, and whether one is there: in no gap, or at its rim."""
    right = np.clip(np.searchsorted(since, grid), 1, len(since) - 1)
    left = right - 1
    before, behind = grid - since[left], since[right] - grid
    near = np.where(before <= behind, left, right)
    segment = np.zeros(len(since), dtype=np.int64)
    for number, part in enumerate(recording.segments):
        segment[part] = number
    rim = np.minimum(before, behind) <= 0.5e9 * recording.period_s
    bridged = (
        before + behind <= (longest_hole(recording.period_s) + 1.5) * 1e9 * recording.period_s
    )
    return near, (segment[left] == segment[right]) | (rim & bridged)


def _read(
    values: FloatArray, since: FloatArray, grid: FloatArray, near: IntArray, reach: float
) -> FloatArray:
    """Readings at even times, column by column where some are missing; NaN where one is."""
    known = np.isfinite(values)
    if known.all():
        return cubic_between(values, since, grid, reach)
    if values.ndim == 1:
        laid = cubic_between(values[known], since[known], grid, reach)
        return np.where(known[near], laid, np.nan)
    columns = [_read(column, since, grid, near, reach) for column in values.T]
    return np.stack(columns, axis=1)


def _held(values: FloatArray, since: FloatArray, grid: FloatArray, cycle_ns: float) -> FloatArray:
    """Mean of what held over the cycle from each even time on; NaN where most is unknown."""
    known = np.isfinite(values)
    edges = np.concatenate([since, [since[-1] + cycle_ns]])
    lasting = np.diff(edges)[:, None]
    means = np.zeros((len(grid), values.shape[1]))
    for column, (one, there) in enumerate(zip(values.T, known.T, strict=True)):
        parts = [np.where(there, one, 0.0), there.astype(float)]
        total, share = (
            _within(
                np.concatenate([[0.0], np.cumsum(part * lasting[:, 0])]), edges, grid, cycle_ns
            )
            for part in parts
        )
        most = share > 0.5
        means[:, column] = np.where(most, total / np.where(most, share, 1.0), np.nan)
    return means


def _within(sums: FloatArray, edges: FloatArray, grid: FloatArray, cycle_ns: float) -> FloatArray:
    """What sums over time grow by over the cycle from each even time on, per cycle."""
    grown = np.interp(grid + cycle_ns, edges, sums) - np.interp(grid, edges, sums)
    return np.asarray(grown / cycle_ns)
