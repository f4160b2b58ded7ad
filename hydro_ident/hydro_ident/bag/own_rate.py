"""Recordings with more samples than were taken, brought back to their own rate.

Between two samples that were taken an interpolated signal runs straight, one that is held (by a
bus slower than the log) stands still. Such samples carry no information, sensors' noise looks far
smaller in them than it is, and every count of them is wrong.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from hydro_ident.bag.grid import runs
from hydro_ident.bag.recorded_run import BoolArray, Recording
from hydro_ident.bag.streaming import Piece, map_columns
from hydro_msgs_docs.cdr import FloatArray

#: Second differences below this share of their rms are those of a straight line: what rounding of
#: a log's digits leaves. White noise is below it in one sample of eight.
_STRAIGHT = 0.15
#: Fewest second differences of a line, and its longest duration: a slow ramp is no interpolation.
_FEWEST, _LONGEST_S = 3, 0.5
#: Share of a signal's samples that lie on such lines.
_COVERED = 0.5
#: Fewest samples to judge.
_SHORTEST = 200
#: Share of the changes of a sensor message that come on the beat of its readings. Two clocks slip
#: by a sample now and then: beside a beat of fewer than `_SLIPPING` samples that would be chance.
_ON_BEAT, _SLIPPING = 0.9, 5
#: A coarse encoder passes its counts one by one. Readings that are held pass over some: this share
#: of the changes is of more than so many of the smallest.
_PASSING, _COUNTS = 0.1, 1.5


def samples_per_reading(recording: Recording) -> int:
    """How many samples of a recording there are for each one that was taken.

    Parameters
    ----------
    recording : Recording

    Returns
    -------
    int
        Of the sensor that was read most often; 1 unless all sensors' signals that change at all
        were interpolated or held. Of interpolated ones fewer than four samples per reading are
        not seen.
    """
    joints = _columns(recording.q, recording.stroke, recording.effort)
    pressures = _columns(recording.p_a, recording.p_b)
    spacings = []
    for message in (joints, pressures):
        beat = _beat(message, recording.period_s)
        known = [column[np.isfinite(column)] for column in message]
        spacings += [max(_spacing(c, recording.period_s), beat) for c in known]
    return int(min(spacings, default=1.0))


def _columns(*sensors: FloatArray | None) -> list[FloatArray]:
    """Signals that change at all."""
    columns = [c for values in sensors if values is not None for c in values.T]
    return [c for c in columns if np.isfinite(c).any() and np.nanmin(c) < np.nanmax(c)]


def _beat(message: Sequence[FloatArray], period_s: float) -> float:
    """Samples from one change of a message's readings to the next; 1 where they have no beat.

    All readings of a message change together and by what their signals moved, a coarse encoder's
    whenever its joint is a count further.
    """
    if not message or message[0].size < _SHORTEST:
        return 1.0
    # A reading that is missing counts as a change: no cycle may be left out for it.
    steps = np.diff(np.stack(message), axis=1)
    at = np.flatnonzero((steps != 0.0).any(axis=0))
    apart = np.diff(at)
    # Readings of a machine at rest repeat themselves.
    apart = apart[apart <= _LONGEST_S / period_s]
    if apart.size < 2 or apart.sum() < _COVERED * steps.shape[1]:
        return 1.0
    beat = float(np.round(np.median(apart)))
    off = np.abs(apart - beat * np.maximum(np.round(apart / beat), 1.0))
    slip = 1.0 if beat >= _SLIPPING else 0.0
    if beat < 2.0 or np.mean(off <= slip) < _ON_BEAT:
        return 1.0
    return beat if any(_passes_over(step) for step in np.abs(steps)) else 1.0


def _passes_over(sizes: FloatArray) -> bool:
    """Whether a signal often changes by more than its resolution at once."""
    changed = sizes[sizes > 0.0]
    return changed.size > 0 and float(np.mean(changed > _COUNTS * changed.min())) > _PASSING


def _spacing(values: FloatArray, period_s: float) -> float:
    """Median samples between readings of one signal; 1 where it does not run in straight lines."""
    if values.size < _SHORTEST:
        return 1.0
    bend, step = np.abs(np.diff(values, 2)), np.abs(np.diff(values))
    scale = float(np.sqrt(np.mean(bend**2)))
    # A quantised signal at rest repeats itself: that is straight, too, but goes nowhere.
    straight: BoolArray = (bend <= _STRAIGHT * scale) & (step[1:] > _STRAIGHT * scale)
    longest = _LONGEST_S / period_s
    lengths = np.array([end - begin for begin, end in runs(straight)])
    lengths = lengths[(lengths >= _FEWEST) & (lengths <= longest)]
    if lengths.sum() < _COVERED * bend.size:
        return 1.0
    return float(np.median(lengths)) + 1.0


def interpolation_text(recording: Recording, every: int) -> str:
    """In words, how far a recording was interpolated, or its readings were held."""
    rate = 1.0 / recording.period_s
    columns = _columns(recording.q, recording.stroke, recording.effort)
    columns += _columns(recording.p_a, recording.p_b)
    # What is interpolated changes in every sample, what is held in one of many.
    still = all(np.mean(np.diff(column) != 0.0) < _COVERED for column in columns)
    runs_how, how = ("stand still", "held") if still else ("run straight", "interpolated")
    return (
        f"its signals {runs_how} over {every} samples at a time: about {rate / every:.3g}"
        f" readings per second, {how} to {rate:.4g} Hz"
    )


def at_own_rate(pieces: Iterable[Piece]) -> Iterator[Piece]:
    """Pieces of a recording, of an interpolated or held one with about one sample per reading.

    The first piece tells. A note says what was left out.
    """
    every, text = 0, ""
    for piece in pieces:
        if not every:
            every = samples_per_reading(piece.recording)
            text = interpolation_text(piece.recording, every)
        yield piece if every == 1 else _thinned(piece, every, text)


def _thinned(piece: Piece, every: int, text: str) -> Piece:
    recording = piece.recording
    since = (recording.stamp_ns - piece.start_ns) * 1e-9 / recording.period_s
    kept: BoolArray = np.asarray(np.round(since).astype(np.int64) % every == 0)
    thin = map_columns(recording, lambda values: values[kept])
    note = f"{text}; one sample in {every} is used"
    thin = replace(thin, period_s=recording.period_s * every, notes=(*recording.notes, note))
    begin, end = (int(kept[:at].sum()) for at in (piece.core.start, piece.core.stop))
    return Piece(thin, slice(begin, end), piece.start_ns)
