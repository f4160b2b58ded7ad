"""Recordings that were interpolated to more samples than were taken, brought back to their rate.

Between two samples that were taken an interpolated signal runs straight. Such samples carry no
information, sensors' noise looks far smaller in them than it is, and every count of them is wrong.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np

from hydro_ident.bag.cdr import FloatArray
from hydro_ident.bag.grid import runs
from hydro_ident.bag.recorded_run import BoolArray, Recording
from hydro_ident.bag.streaming import Piece, map_columns

#: Second differences below this share of their rms are those of a straight line: what rounding of
#: a log's digits leaves. White noise is below it in one sample of eight.
_STRAIGHT = 0.15
#: Fewest second differences of a line, and its longest duration: a slow ramp is no interpolation.
_FEWEST, _LONGEST_S = 3, 0.5
#: Share of a signal's samples that lie on such lines.
_COVERED = 0.5
#: Fewest samples to judge.
_SHORTEST = 200


def samples_per_reading(recording: Recording) -> int:
    """How many samples of a recording there are for each one that was taken.

    Parameters
    ----------
    recording : Recording

    Returns
    -------
    int
        Of the sensor that was read most often; 1 unless all sensors' signals that change at all
        were interpolated. Fewer than four samples per reading are not seen.
    """
    sensors = (recording.q, recording.stroke, recording.effort, recording.p_a, recording.p_b)
    columns = [c for values in sensors if values is not None for c in values.T]
    known = [column[np.isfinite(column)] for column in columns]
    spacings = [_spacing(c, recording.period_s) for c in known if c.size and np.ptp(c) > 0.0]
    return int(min(spacings, default=1.0))


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
    """In words, how far a recording was interpolated."""
    rate = 1.0 / recording.period_s
    return (
        f"its signals run straight over {every} samples at a time: about {rate / every:.3g}"
        f" readings per second, interpolated to {rate:.4g} Hz"
    )


def at_own_rate(pieces: Iterable[Piece]) -> Iterator[Piece]:
    """Pieces of a recording, of an interpolated one with about one sample per reading.

    The first piece tells. A note says what was left out.
    """
    every = 0
    for piece in pieces:
        every = every or samples_per_reading(piece.recording)
        yield piece if every == 1 else _thinned(piece, every)


def _thinned(piece: Piece, every: int) -> Piece:
    recording = piece.recording
    since = (recording.stamp_ns - piece.start_ns) * 1e-9 / recording.period_s
    kept: BoolArray = np.asarray(np.round(since).astype(np.int64) % every == 0)
    thin = map_columns(recording, lambda values: values[kept])
    note = f"{interpolation_text(recording, every)}; one sample in {every} is used"
    thin = replace(thin, period_s=recording.period_s * every, notes=(*recording.notes, note))
    begin, end = (int(kept[:at].sum()) for at in (piece.core.start, piece.core.stop))
    return Piece(thin, slice(begin, end), piece.start_ns)
