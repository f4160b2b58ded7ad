"""Recordings with more samples than were taken, brought back to their own rate.

Samples between those that were taken carry no information, sensors' noise looks far smaller in
them than it is, and every count of them is wrong. Where one message alone is held from reading to
reading, beside another at the full rate, its readings are late by half of that on average, and
steps: it is led from reading to reading.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from hydro_ident.bag.cubic import cubic_between
from hydro_ident.bag.reading_rate import HeldMessage, look_twice
from hydro_ident.bag.streaming import Piece, map_columns
from hydro_model.arrays import BoolArray, FloatArray, IntArray

#: Beats between two readings beyond which readings are missing.
_PAUSE = 2.5


def at_own_rate(pieces: Iterable[Piece]) -> Iterator[Piece]:
    """Pieces of a recording, of an interpolated or held one with about one sample per reading.

    A message that is held for longer than that is led from reading to reading. The first piece
    tells. Notes say what was done.

    Parameters
    ----------
    pieces : iterable of Piece
    """
    every, text, held = 0, "", tuple[HeldMessage, ...]()
    for piece in pieces:
        if not every:
            look = look_twice(piece.recording)
            every, held = look.every(), look.held()
            text = look.text(every)
        led = _led(piece, held) if held else piece
        yield led if every == 1 else _thinned(led, every, text)


def _led(piece: Piece, held: Sequence[HeldMessage]) -> Piece:
    """Held messages from reading to reading, each taken when it is first seen."""
    recording, changed = piece.recording, dict[str, FloatArray]()
    since = np.asarray(recording.stamp_ns - recording.stamp_ns[0], dtype=float)
    for message in held:
        columns = {name: getattr(recording, name) for name in message.fields}
        columns = {name: v for name, v in columns.items() if v is not None}
        read = _refreshed(np.concatenate(list(columns.values()), axis=1), message.samples)
        reach = _PAUSE * message.samples * recording.period_s * 1e9
        for name, values in columns.items():
            lost = ~np.isfinite(values)
            led = [_between(v, since, read, reach) for v in values.T]
            changed[name] = np.where(lost, np.nan, np.stack(led, axis=1))
    notes = (*recording.notes, *(f"{m.text}; they are led from one to the next" for m in held))
    slowest_s = max(m.samples for m in held) * recording.period_s
    fields: dict[str, Any] = {**changed, "notes": notes, "read_s": slowest_s}
    return replace(piece, recording=replace(recording, **fields))


def _between(values: FloatArray, since: FloatArray, read: IntArray, reach: float) -> FloatArray:
    """One sensor in every cycle, of the cycles in which its message was read."""
    known = read[np.isfinite(values[read])]
    return cubic_between(values[known], since[known], since, reach)


def _refreshed(values: FloatArray, beat: int) -> IntArray:
    """Cycles in which a message that comes every `beat` cycles is a new one.

    At rest it is the same as before: where it stands still for more than one beat it came on each.
    """
    with np.errstate(invalid="ignore"):
        changed = (np.diff(values, axis=0) != 0.0) & np.isfinite(values[1:])
    at = np.flatnonzero(changed.any(axis=1)) + 1
    ends = np.append(at[1:], len(values))
    # Another half beat until it changes: two clocks slip by a cycle.
    more = np.maximum((ends - at - (beat + 1) // 2) // beat, 0)
    number = np.arange(int(more.sum())) - np.repeat(np.cumsum(more) - more, more)
    return np.sort(np.concatenate([at, np.repeat(at, more) + beat * (number + 1)]))


def _thinned(piece: Piece, every: int, text: str) -> Piece:
    recording = piece.recording
    since = (recording.stamp_ns - piece.start_ns) * 1e-9 / recording.period_s
    kept: BoolArray = np.asarray(np.round(since).astype(np.int64) % every == 0)
    thin = map_columns(recording, lambda values: values[kept])
    note = f"{text}; one sample in {every} is used"
    thin = replace(thin, period_s=recording.period_s * every, notes=(*recording.notes, note))
    begin, end = (int(kept[:at].sum()) for at in (piece.core.start, piece.core.stop))
    return Piece(thin, slice(begin, end), piece.start_ns)
