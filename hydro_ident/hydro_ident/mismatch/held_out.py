"""What rows that took no part say of a finding: as they are predicted, and behind a refit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import norm

from hydro_ident.estimate.rows import BoolArray
from hydro_ident.mismatch.bench import Bench
from hydro_ident.mismatch.check import Check
from hydro_ident.mismatch.fitted import Fitted
from hydro_ident.mismatch.modelled import Model
from hydro_ident.mismatch.prior import Prior
from hydro_ident.mismatch.products import chance_beside, share_of_time
from hydro_ident.mismatch.settings import BLOCK_S
from hydro_ident.mismatch.slopes import linearised
from hydro_ident.mismatch.training import layout_of
from hydro_ident.mismatch.whitening import IndexArray, Noise
from hydro_model.robot import FloatArray

#: A finding that goes with held-out rows by chance more often than this does not stand.
STANDS = 0.025
#: A placebo does as well where chance beats it more often than this; nor is dependence without a
#: name confirmed that chance makes more often.
VERIFIED = 0.1
#: Nor does one with which a channel's held-out rows are predicted worse than this, rms.
WORSE = 1.05
#: Deviations that are exceeded on one side once in forty times.
_ONE_IN_FORTY = 1.96
#: Deviations at which a true finding stands more often than not, in either of two looks.
_HALF_TOLD = float(norm.isf(STANDS / 2.0))
#: What a finding has to be able to gain on held-out rows before these can tell: two deviations.
SHOWN = 4.0
#: Blocks that a p-value needs, and the shortest that still are independent.
_LEAST_BLOCKS, _SHORTEST_BLOCK_S = 20, 0.2
#: Share of the short blocks from which a finding acts all along, not in a few instants.
_LASTING = 0.25


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

    @staticmethod
    def predicted(check: Check, without: Fitted, noise: Noise) -> HeldOut:
        """Rows of a check as a model predicts them.

        Parameters
        ----------
        check : Check
        without : Fitted
            The model without the finding, fitted to other rows.
        noise : Noise
            Of the check's channels.
        """
        used = check.mask & check.moving
        residual, columns, names = linearised(check.predictor, without.model)
        layout = layout_of(check.predictor).take(used)
        bench = Bench(layout, noise, residual[used], np.zeros((int(used.sum()), 1)), BLOCK_S)
        doubt = bench.beyond(columns[used] @ _root(without, names))
        return HeldOut(check, bench, np.zeros((residual.size, 1)), used, doubt)

    @staticmethod
    def refitted(check: Check, model: Model, noise: Noise, prior: Prior | None = None) -> HeldOut:
        """Rows of a check behind a refit of all that is in a model to them.

        Parameters
        ----------
        check : Check
        model : Model
            Without the finding.
        noise : Noise
            Of the check's channels.
        prior : Prior, optional
            What is known of the check's base before: how far a refit moves it.
        """
        used = check.mask & check.moving
        residual, columns, _ = linearised(check.predictor, model)
        known = None
        if prior is not None:
            known = prior.rows(columns.shape[1]), np.zeros(prior.root.shape[0])
        layout = layout_of(check.predictor).take(used)
        bench = Bench(layout, noise, residual[used], columns[used], BLOCK_S, known)
        return HeldOut(check, bench, columns, used, np.zeros((bench.measured, 0)))

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
        block_s = min(longest_s, max(layout.occupied_s / _LEAST_BLOCKS, _SHORTEST_BLOCK_S))
        return np.asarray(layout.blocks(block_s)[rows])

    def rmse(self, residual: FloatArray) -> dict[str, float]:
        """What a refit leaves of a residual (N,) by channel, in its unit."""
        left = residual - self.columns @ self.bench.refit(residual[self.used])
        names = self.check.predictor.material.channels
        return {n: rms(left[self.check.rows(k, n) & self.used]) for k, n in enumerate(names)}


def _root(without: Fitted, names: Sequence[str]) -> FloatArray:
    """Square root of a fit's covariance, (p, k), of the numbers `names`; none of unknown ones."""
    at = [without.names.index(name) if name in without.names else -1 for name in names]
    own = np.where(np.outer(np.array(at) >= 0, np.array(at) >= 0), 1.0, 0.0)
    covariance = own * without.covariance[np.ix_(at, at)]
    size = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    scale = np.where(size > 0.0, size, 1.0)
    values, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    return np.asarray(scale[:, None] * vectors * np.sqrt(np.maximum(values, 0.0)))


@dataclass(frozen=True, slots=True)
class Look:
    """What held-out rows say, seen in one way.

    Attributes
    ----------
    p_value : float
    placebo : float
        As `Verification`.
    against : float
        Chance that the finding beats a median placebo.
    shown : float
        Sum of squares, weighed by noise and the model's error, of what the finding changes here:
        what it would gain if it were true.
    sides : (dict, dict) of str to float
        Rmse by channel without and with it.
    worse : str
        What speaks against it in a channel.
    instants : int
        From how many it had to choose on these rows when it comes and goes.
    """

    p_value: float
    placebo: float
    against: float
    shown: float
    sides: tuple[dict[str, float], dict[str, float]]
    worse: str
    instants: int = 1

    @property
    def paid(self) -> float:
        """The p-value with the choice among instants paid for, at most 1."""
        return min(1.0, self.instants * self.p_value)


def looked(
    rows: HeldOut,
    plain: FloatArray,
    with_it: FloatArray,
    placebos: Sequence[FloatArray],
    acting: Sequence[str],
    tried: float = 1.0,
) -> Look:
    """Look at held-out rows in one way.

    Parameters
    ----------
    rows : HeldOut
    plain, with_it : (N,) array
        Residuals without the finding and with it.
    placebos : sequence of (N,) array
        With a placebo in its place.
    acting : sequence of str
        Channels that it acts on.
    tried : float
        As `chance_beside`.
    """
    before, after = rows.left(plain), rows.left(with_it)
    change = before - after
    real = _gain(before, change)
    others = [before - rows.left(residual) for residual in placebos]
    shares = [_gain(before, other) for other in others]
    # What is the same at all times has no placebo: none does as well.
    share = float(np.median(shares)) / real if shares and real > 0.0 else 0.0
    # Products with what is left without the finding: those of a false one are as often negative,
    # whereas its gain is negative by itself, and asks twice the size of a true one.
    block = rows.blocks(), rows.blocks(_SHORTEST_BLOCK_S)
    p = chance_beside(change, before, after, *block, tried) if real > 0.0 else 1.0
    p = max(p, _by_error(rows, before, change))
    against = [chance_beside(change - other, before, after, *block) for other in others]
    sides = rows.rmse(plain), rows.rmse(with_it)
    lasting = share_of_time(change, block[1]) >= _LASTING
    median = float(np.median(against or [0.0]))
    shown = float(change @ rows.weighed(change))
    return Look(p, share, median, shown, sides, _worse(sides, acting, lasting))


def _by_error(rows: HeldOut, before: FloatArray, change: FloatArray) -> float:
    """Chance that the model's own error goes with a change: one draw for all blocks, no flip's."""
    if not rows.doubt.size:
        return 0.0
    weighed = rows.weighed(change)
    error = rows.error(weighed)
    return float(norm.sf(float(before @ weighed) / error)) if error > 0.0 else 1.0


def _gain(before: FloatArray, change: FloatArray) -> float:
    """What a change takes off the sum of squares."""
    return float(2.0 * before @ change - change @ change)


def missed(shown: float) -> float:
    """Chance of held-out rows that a true finding stays above once in forty times.

    Parameters
    ----------
    shown : float
        As `Look`, over the sums' overdispersion: the mean of its product with what is left, whose
        deviation is the root.
    """
    return float(norm.sf(np.sqrt(max(shown, 0.0)) - _ONE_IN_FORTY))


def objection(one: Look, least: float) -> str:
    """What speaks against a finding, seen in one way; empty where nothing does.

    Parameters
    ----------
    one : Look
    least : float
        Largest p-value, instants paid for, with which it stands.
    """
    if one.worse:
        return one.worse
    if one.paid > least:
        return f"held-out rows are not predicted better with it (p = {one.paid:.2g})"
    if one.against > VERIFIED:
        return f"a placebo of equal freedom predicts held-out rows as well ({one.placebo:.0%})"
    return ""


def _worse(sides: Sequence[Mapping[str, float]], acting: Sequence[str], lasting: bool) -> str:
    """Whether a channel that a finding acts on is predicted worse with it, or all are."""
    before, after = sides
    known = [n for n in acting if n in before] or list(before)
    if lasting and known and all(after[n] > before[n] for n in known):
        # Weighed by the noise it may still gain; a fit that nobody can see improve did not.
        # What acts in a few instants, such as a play, is not judged by the mean over all rows.
        return f"held-out rows of {', '.join(known)} are predicted no better with it"
    worse = max(known, key=lambda n: after[n] / max(before[n], 1e-300))
    if after[worse] <= WORSE * before[worse]:
        return ""
    return (
        f"held-out rows of {worse} are predicted worse with it (RMSE {before[worse]:.3g} to"
        f" {after[worse]:.3g})"
    )


def rms(values: FloatArray) -> float:
    """Root of the mean square of values (N,); 0 of none."""
    return float(np.sqrt(np.mean(values**2))) if values.size else 0.0
