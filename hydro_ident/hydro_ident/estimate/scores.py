"""How well a model predicts the residual channels on rows that took no part in its fit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from hydro_ident.estimate.least_squares import BoolArray, Rows
from hydro_model.robot import FloatArray

#: Rows this close to a held-out block take part in neither: the filters carry over (3 / 10 Hz).
GUARD_S = 0.3


@dataclass(frozen=True, slots=True)
class HoldOut:
    """Every `every`-th block of each recording is kept from the fit and used for the scores.

    Blocks spread over the whole run see every kind of motion that the fit sees; the last part
    of a run alone would judge a chirp by a ramp.

    Attributes
    ----------
    block_s : mapping of str to float
        Length of the blocks by recording name.
    every : int
        0: nothing is held out (whole bags validate).
    """

    block_s: Mapping[str, float] = field(default_factory=dict)
    every: int = 5

    @staticmethod
    def of(durations_s: Mapping[str, float], every: int = 5, longest_s: float = 4.0) -> HoldOut:
        """Blocks of at most `longest_s`, at least `every` of them in each recording."""
        return HoldOut({k: min(longest_s, v / every) for k, v in durations_s.items()}, every)

    def training(self, rows: Rows) -> Rows:
        """The rows to fit: outside held-out blocks and their guard."""
        if self.every == 0:
            return rows
        kept = ~self._held(rows, 0.0)
        for shift in (-GUARD_S, GUARD_S):
            kept &= ~self._held(rows, shift)
        return rows.take(kept)

    def held_out(self, rows: Rows) -> Rows:
        """The rows to score."""
        return rows if self.every == 0 else rows.take(self._held(rows, 0.0))

    def _held(self, rows: Rows, shift_s: float) -> BoolArray:
        block = self.block_s[rows.label.rsplit("#", 1)[0]]
        index = np.floor((rows.time_s + shift_s) / block).astype(int)
        return np.asarray(index % self.every == self.every - 1)


@dataclass(frozen=True, slots=True)
class ChannelScore:
    """Prediction of one channel by the given and by the identified robot.

    Attributes
    ----------
    name, unit : str
    time_s, measured, before, after : (T,) array
        On rows that took no part in the fit.
    noise_floor : float
        What sensor noise alone leaves.
    recordings : tuple of str
        Where the rows come from.
    """

    name: str
    unit: str
    time_s: FloatArray
    measured: FloatArray
    before: FloatArray
    after: FloatArray
    noise_floor: float
    recordings: tuple[str, ...]

    def summary(self) -> dict[str, float | str]:
        """The entry under `channels` of the result file."""
        return {
            "unit": self.unit,
            "rmse_before": _rms(self.measured - self.before),
            "rmse_after": _rms(self.measured - self.after),
            "noise_floor": self.noise_floor,
            "fit_before_pct": fit_percent(self.measured, self.before),
            "fit_after_pct": fit_percent(self.measured, self.after),
        }


def fit_percent(measured: FloatArray, predicted: FloatArray) -> float:
    """``100 (1 - |y - yhat| / |y - mean y|)``; 0 where the channel is constant."""
    spread = float(np.linalg.norm(measured - measured.mean()))
    if spread == 0.0:
        return 0.0
    return 100.0 * (1.0 - float(np.linalg.norm(measured - predicted)) / spread)


def score(
    name: str,
    unit: str,
    rows: Sequence[tuple[Rows, FloatArray, FloatArray]],
    column: int,
    noise_floor: float,
) -> ChannelScore | None:
    """Score one channel.

    Parameters
    ----------
    name, unit : str
    rows : sequence of (Rows, before, after)
        Rows with the (T, k) predictions of either model.
    column : int
        The channel's column.
    noise_floor : float

    Returns
    -------
    ChannelScore or None
        None where the channel was not measured.
    """
    parts = []
    for piece, before, after in rows:
        known = np.isfinite(piece.y[:, column])
        parts.append(
            [v[known] for v in (piece.time_s, piece.y[:, column], before[:, column])]
            + [after[known, column]]
        )
    if not parts or not sum(p[0].size for p in parts):
        return None
    time_s, measured, before, after = (np.concatenate(c) for c in zip(*parts, strict=True))
    names = tuple(dict.fromkeys(r.label.rsplit("#", 1)[0] for r, _, _ in rows))
    return ChannelScore(name, unit, time_s, measured, before, after, noise_floor, names)


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))
