"""Effects that hide each other: pairs of which neither stands out alone.

Two effects whose contributions nearly cancel leave little for either by itself. Once nothing more
stands out alone, all pairs of columns are held against the residual at once: the gain of two
columns beyond what either gains alone follows from their products with each other and with the
residual, and what the best of so many pairs gains by chance from the same under sign flips of
whole blocks.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hydro_ident.mismatch.fitting.bench import Bench
from hydro_ident.mismatch.trials.chance import p_value, signs
from hydro_ident.mismatch.trials.scoring import SWALLOWED, Score
from hydro_model.arrays import BoolArray, IndexArray
from hydro_model.effects.targets import ActiveEffect
from hydro_model.robot import FloatArray

#: Columns whose correlation leaves less than this share of either count as one.
_APART = 0.1
#: Flips that are held against all pairs at a time.
_CHUNK = 25


@dataclass(frozen=True, slots=True)
class Pair:
    """Two trials that gain together.

    Attributes
    ----------
    effects : (ActiveEffect, ActiveEffect)
        At the sizes that they have beside each other.
    gain : float
        Of both beyond what they gain alone, in units of the noise's variance.
    p_value : float
        Over all pairs.
    """

    effects: tuple[ActiveEffect, ActiveEffect]
    gain: float
    p_value: float


def best_pair(bench: Bench, scores: Sequence[Score], mask: BoolArray) -> Pair | None:
    """The pair of trials that gains most; None where there are not two.

    Parameters
    ----------
    bench : Bench
    scores : sequence of Score
        The best shape of every effect and target.
    mask : (N,) bool array
        Training rows of the material, which `bench` is of.
    """
    own, columns, signed = _columns(scores, mask)
    if len(own) < 2:
        return None
    white = bench.beyond(columns)
    sizes = np.linalg.norm(white, axis=0)
    white /= np.where(sizes > 0.0, sizes, np.inf)
    pairs = _Pairs.of(white.T @ white, own, np.where(signed, -np.inf, 0.0))
    sums = bench.by_block(white * bench.residual[:, None])
    gains = pairs.gains(sums.sum(axis=0)[None])[0]
    if not gains.size or gains.max() <= 0.0:
        return None
    best = int(np.argmax(gains))
    flips = signs(bench.blocks)
    largest = [
        pairs.gains(flips[k : k + _CHUNK] @ sums).max(axis=1)
        for k in range(0, flips.shape[0], _CHUNK)
    ]
    chance = np.concatenate(largest)
    p = p_value(float(gains[best]), chance)
    i, j = int(pairs.one[best]), int(pairs.other[best])
    theta = np.linalg.lstsq(white[:, [i, j]], bench.residual, rcond=None)[0]
    one, other = (
        _at(scores[own[k][0]], own[k][1], float(size / sizes[k]))
        for k, size in zip((i, j), theta, strict=True)
    )
    return Pair((one, other), float(gains[best]), p)


def _at(one: Score, column: int, size: float) -> ActiveEffect:
    """A trial at a size of one of its columns."""
    coefficients = np.zeros(len(one.entry.trial.units))
    coefficients[column] = size
    return one.entry.trial.at(coefficients)


def _columns(
    scores: Sequence[Score], mask: BoolArray
) -> tuple[list[tuple[int, int]], FloatArray, BoolArray]:
    """Trial and column within it of all columns, the columns, and which may be negative."""
    own: list[tuple[int, int]] = []
    signed: list[bool] = []
    columns: list[FloatArray] = []
    for k, one in enumerate(scores):
        told = np.diag(one.partial.gram) > SWALLOWED * one.partial.plain
        whole = one.entry.columns(mask.size)[mask]
        for j in np.flatnonzero(told):
            own.append((k, int(j)))
            signed.append(one.entry.trial.signed[j])
            columns.append(whole[:, j])
    stacked = np.stack(columns, axis=1) if columns else np.zeros((int(mask.sum()), 0))
    return own, stacked, np.array(signed, dtype=np.bool_)


@dataclass(frozen=True, slots=True)
class _Pairs:
    """All pairs of columns of unit size that may stand beside each other."""

    one: IndexArray
    other: IndexArray
    product: FloatArray
    low: FloatArray

    @staticmethod
    def of(gram: FloatArray, own: Sequence[tuple[int, int]], low: FloatArray) -> _Pairs:
        one, other = np.triu_indices(gram.shape[0], 1)
        product = gram[one, other]
        trial = np.array([k for k, _ in own])
        apart = (trial[one] != trial[other]) & (1.0 - product**2 > _APART)
        one, other, product = one[apart], other[apart], product[apart]
        return _Pairs(one, other, product, low)

    def gains(self, sums: FloatArray) -> FloatArray:
        """What pairs gain beyond both alone, (F, P), for products (F, K) with F residuals.

        0 where a sign is impossible.
        """
        a, b, g = sums[:, self.one], sums[:, self.other], self.product
        x, y = a - g * b, b - g * a
        possible = (x >= self.low[self.one]) & (y >= self.low[self.other])
        single = np.where(sums >= self.low, sums**2, 0.0)
        alone = single[:, self.one] + single[:, self.other]
        return np.where(possible, (a * x + b * y) / (1.0 - g * g) - alone, 0.0)
