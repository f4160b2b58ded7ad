"""A recording of any length thinned out, for what is judged by shares and ranges."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hydro_ident.bag.channels import Loss
from hydro_ident.bag.gaps import Gap
from hydro_ident.bag.recorded_run import Recording
from hydro_ident.bag.streaming import COLUMNS, Piece, cut_recording, map_columns

#: Cycles kept of a recording, at least half of them where there are more.
LARGEST = 65_536


@dataclass(slots=True)
class Digest:
    """Collects a thinned recording piece by piece.

    Attributes
    ----------
    every : int
        Cycles are kept one in so many.
    cycles : int
        Met so far.
    duration_s : float
    """

    every: int = 1
    cycles: int = 0
    duration_s: float = 0.0
    _parts: list[Recording] = field(default_factory=list)
    _kept: int = 0
    _gaps: list[Gap] = field(default_factory=list)
    _losses: list[dict[str, Loss]] = field(default_factory=list)

    def add(self, piece: Piece) -> None:
        """Take in the core of the next piece."""
        core = cut_recording(piece.recording, piece.core)
        count = len(core)
        if not count:
            return
        begin = -self.cycles % self.every
        thin = cut_recording(core, slice(begin, None, self.every))
        # Copies: a view would keep the whole piece alive.
        self._parts.append(map_columns(thin, np.copy))
        self._kept += len(thin)
        self.cycles += count
        self.duration_s = float(core.stamp_ns[-1] - piece.start_ns) * 1e-9
        first, last = int(core.stamp_ns[0]), int(core.stamp_ns[-1])
        self._gaps += [g for g in piece.recording.gaps if first <= g.before_ns <= last]
        self._losses.append({loss.channel: loss for loss in piece.recording.losses})
        while self._kept > LARGEST:
            self._thin()

    def recording(self) -> Recording:
        """The thinned recording, with what is lost in every piece of it or stands for it."""
        lost = {
            channel: loss
            for channel, loss in self._losses[-1].items()
            if all(channel in some for some in self._losses)
        }
        for some in self._losses:
            for channel, loss in some.items():
                if loss.stands:
                    lost.setdefault(channel, loss)
        whole = _concatenated(self._parts)
        return replace(whole, losses=tuple(lost.values()), gaps=tuple(self._gaps))

    def _thin(self) -> None:
        whole = _concatenated(self._parts)
        self._parts = [map_columns(whole, _every_other)]
        self._kept = len(self._parts[0])
        self.every *= 2


def _every_other(values: NDArray[Any]) -> NDArray[Any]:
    return values[::2].copy()


def _concatenated(parts: Sequence[Recording]) -> Recording:
    columns: dict[str, Any] = {}
    for name in COLUMNS:
        values = [getattr(part, name) for part in parts]
        there = [v for v in values if v is not None]
        if not there:
            columns[name] = None
            continue
        filled = [
            np.full((len(part), *there[0].shape[1:]), np.nan) if v is None else v
            for part, v in zip(parts, values, strict=True)
        ]
        columns[name] = np.concatenate(filled)
    sources = [part.valve_source for part in parts if part.valve_source]
    # Notes and metadata grow while a bag is read: the last piece has them all.
    columns["valve_source"] = sources[0] if sources else ""
    result: Recording = replace(parts[-1], **columns)
    return result
