"""Recordings with more samples than were taken, brought back to their own rate.

Samples between those that were taken carry no information, sensors' noise looks far smaller in
them than it is, and every count of them is wrong.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np

from hydro_ident.bag.reading_rate import look_twice
from hydro_ident.bag.recorded_run import BoolArray
from hydro_ident.bag.streaming import Piece, map_columns


def at_own_rate(pieces: Iterable[Piece]) -> Iterator[Piece]:
    """Pieces of a recording, of an interpolated or held one with about one sample per reading.

    The first piece tells. A note says what was left out.
    """
    every, text = 0, ""
    for piece in pieces:
        if not every:
            look = look_twice(piece.recording)
            every = look.every()
            text = look.text(every)
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
