"""Rows that took no part, whitened: as they are predicted, and behind a refit to them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import norm

from hydro_ident.mismatch.fitting.bench import Bench
from hydro_ident.mismatch.fitting.fitted import Fitted
from hydro_ident.mismatch.fitting.prior import Prior
from hydro_ident.mismatch.fitting.slopes import linearised
from hydro_ident.mismatch.fitting.training import layout_of
from hydro_ident.mismatch.fitting.whitening import Noise
from hydro_ident.mismatch.settings import BLOCK_S
from hydro_ident.mismatch.split.check import Check
from hydro_model.arrays import BoolArray, IndexArray
from hydro_model.robot import FloatArray

#: A finding that goes with held-out rows by chance more often than this does not stand.
STANDS = 0.025
#: Deviations at which a true finding stands more often than not, in either of two looks.
_HALF_TOLD = float(norm.isf(STANDS / 2.0))
#: Blocks that a p-value needs, and the shortest that still are independent.
_LEAST_BLOCKS, SHORTEST_HELD_OUT_S = 20, 0.2


@dataclass(frozen=True, slots=True)
class HeldOut:
    """Held-out rows as they are, or behind a refit of all but the finding to them.

    Attributes
    ----------
    check : Check
    bench : Bench
        Of the residual without the finding.
    columns : (N, p) array
        What a refit may move, on all rows; zeros for none.
    used : (N,) bool array
    doubt : (M, k) array
        What the model may be off by on the whitened rows: columns of unit variance each.
    """

    check: Check
    bench: Bench
    columns: FloatArray
    used: BoolArray
    doubt: FloatArray

    def doubted(self, refitted: HeldOut, whole: FloatArray) -> HeldOut:
        """Rows as predicted, whose model is off by what a refit gains, not by what fits say alone.

        Parameters
        ----------
        refitted : HeldOut
            The same rows behind a refit.
        whole : (N,) array
            Residual with all that was found: none of it is the model's error.
        """
        gained = float(np.sum(self.left(whole) ** 2) - np.sum(refitted.left(whole) ** 2))
        expected = refitted.bench.rank + float(np.sum(self.doubt**2))
        factor = np.sqrt(max(1.0, gained / max(expected, 1.0)))
        return replace(self, doubt=factor * self.doubt)

    def left(self, residual: FloatArray) -> FloatArray:
        """What a refit leaves of a residual (N,), whitened, (M,)."""
        return self.bench.beyond(residual[self.used][:, None])[: self.bench.measured, 0]

    def weighed(self, change: FloatArray) -> FloatArray:
        """What whitened rows (M,) are multiplied by to see whether a change (M,) is in them.

        The change itself, where a true finding's product would stand out from noise and the
        model's error more often than not. Elsewhere over the covariance of both (generalised
        least squares), which tells more but asks for the finding's exact form:
        `(1 + D D')^-1 = 1 - D (1 + D' D)^-1 D'` for
        the doubt D (Woodbury 1950).

        Parameters
        ----------
        change : (M,) array
        """
        if not self.doubt.size or change @ change >= _HALF_TOLD * self.error(change):
            return change
        inner = np.eye(self.doubt.shape[1]) + self.doubt.T @ self.doubt
        own = np.linalg.solve(inner, self.doubt.T @ change)
        return np.asarray(change - self.doubt @ own)

    def error(self, weighed: FloatArray) -> float:
        """Deviation of a product with noise and the model's error.

        Parameters
        ----------
        weighed : (M,) array
            What whitened rows are multiplied by.
        """
        return float(np.hypot(np.linalg.norm(weighed), np.linalg.norm(self.doubt.T @ weighed)))

    def blocks(self, longest_s: float = BLOCK_S) -> IndexArray:
        """The block of time that each whitened row is in, (M,).

        Parameters
        ----------
        longest_s : float
            Length of a block, where there is time for enough of them.
        """
        layout, rows = self.bench.layout, self.bench.rows
        # So few blocks that no flip could be rare would reject whatever is put to them.
        block_s = min(longest_s, max(layout.occupied_s / _LEAST_BLOCKS, SHORTEST_HELD_OUT_S))
        return np.asarray(layout.blocks(block_s)[rows])

    def rmse(self, residual: FloatArray) -> dict[str, float]:
        """What a refit leaves of a residual (N,) by channel, in its unit."""
        left = residual - self.columns @ self.bench.refit(residual[self.used])
        names = self.check.predictor.material.channels
        return {n: rms(left[self.check.rows(k, n) & self.used]) for k, n in enumerate(names)}


def held_out(
    check: Check, without: Fitted, noise: Noise, prior: Prior | None = None
) -> tuple[HeldOut, HeldOut]:
    """Rows of a check behind a refit to them of all that is in a model, and as it predicts them.

    Parameters
    ----------
    check : Check
    without : Fitted
        The model without the finding, fitted to other rows.
    noise : Noise
        Of the check's channels.
    prior : Prior, optional
        What is known of the check's base before: how far a refit moves it.
    """
    used = check.mask & check.moving
    residual, columns, names = linearised(check.predictor, without.model)
    known = None
    if prior is not None:
        known = prior.rows(columns.shape[1]), np.zeros(prior.root.shape[0])
    layout, none = layout_of(check.predictor).take(used), np.zeros((residual.size, 1))
    refitted = Bench(layout, noise, residual[used], columns[used], BLOCK_S, known)
    plain = Bench(layout, noise, residual[used], none[used], BLOCK_S)
    doubt = plain.beyond(columns[used] @ _root(without, names))
    return (
        HeldOut(check, refitted, columns, used, np.zeros((refitted.measured, 0))),
        HeldOut(check, plain, none, used, doubt),
    )


def _root(without: Fitted, names: Sequence[str]) -> FloatArray:
    """Square root of a fit's covariance, (p, k), of the numbers `names`; none of unknown ones."""
    at = [without.names.index(name) if name in without.names else -1 for name in names]
    own = np.where(np.outer(np.array(at) >= 0, np.array(at) >= 0), 1.0, 0.0)
    covariance = own * without.covariance[np.ix_(at, at)]
    size = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    scale = np.where(size > 0.0, size, 1.0)
    values, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    return np.asarray(scale[:, None] * vectors * np.sqrt(np.maximum(values, 0.0)))


def rms(values: FloatArray) -> float:
    """Root of the mean square of values (N,); 0 of none."""
    return float(np.sqrt(np.mean(values**2))) if values.size else 0.0
