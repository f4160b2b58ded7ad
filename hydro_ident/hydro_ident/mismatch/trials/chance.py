"""How much of what trials gain could be chance: sign flips of whole blocks, over all of them."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from hydro_ident.mismatch.fitting.bench import Bench
from hydro_ident.mismatch.settings import FLIPS, SEED
from hydro_ident.mismatch.trials.scoring import PER_COEFFICIENT, SWALLOWED, Score, best_subset
from hydro_model.arrays import BoolArray
from hydro_model.robot import FloatArray

#: Trials whose columns are taken at a time, and the least share of noise that fits leave.
_TOGETHER, _LEAST_LEFT = 40, 0.05
#: Flips whose sums are taken at a time: so many signs lie in a processor's cache as floats.
_AT_ONCE = 1024
#: Gain of a block that tells an effect by itself: three deviations and a bit.
_TELLING = 10.0
#: Value that no chance reaches in a channel by itself, over all trials.
_STANDS_OUT = 40.0


def signs(blocks: int, flips: int = FLIPS) -> FloatArray:
    """Signs of `flips` draws of `blocks` whole blocks, (F, B): always the same."""
    return _drawn(blocks, flips).astype(np.float64)


@lru_cache(maxsize=32)
def _drawn(blocks: int, flips: int) -> NDArray[np.int8]:
    """Those signs as they are kept: many flips of many blocks, of all sets of rows."""
    rng = np.random.default_rng(SEED)
    drawn = np.where(rng.random((flips, blocks)) < 0.5, np.int8(-1), np.int8(1))
    drawn.flags.writeable = False
    return drawn


def reached(sums: FloatArray, total: float | None = None, flips: int = FLIPS) -> float:
    """Share of sign flips of whole blocks that reach a total, the observed one counted in.

    Parameters
    ----------
    sums : (B,) array
        Of the blocks.
    total : float, optional
        By default their own.
    flips : int

    Returns
    -------
    float
        1 where the total is not positive.
    """
    total = float(sums.sum()) if total is None else total
    if total <= 0.0:
        return 1.0
    drawn = _drawn(sums.size, flips)
    flipped = [drawn[k : k + _AT_ONCE] @ sums for k in range(0, flips, _AT_ONCE)]
    return p_value(total, np.concatenate(flipped))


def effective_blocks(bench: Bench, one: Score, mask: BoolArray) -> float:
    """How many blocks a trial's strongest column is worth: of equal weight, or that stand out.

    Where one block holds most of it, others may still each tell it by themselves; of those one is
    left out, since an event may lie in two.
    """
    used = told_best(one)
    left = bench.beyond(one.entry.columns(mask.size)[mask][:, used : used + 1])
    scores = bench.by_block(left * bench.residual[:, None])[:, 0]
    squares = bench.by_block(left**2)[:, 0]
    size = scores.sum() / max(float(squares.sum()), 1e-300)
    telling = np.count_nonzero(2.0 * size * scores - size**2 * squares >= _TELLING)
    return max(bench.spread(left[:, 0]), float(telling - 1))


def foremost(scores: Sequence[Score]) -> list[Score]:
    """The best trial, and of those that share no rows with better ones what stands out as far.

    Parameters
    ----------
    scores : sequence of Score
        At least one.
    """
    order = sorted(scores, key=lambda one: -one.value)
    taken, result = order[0].entry.rows.copy(), [order[0]]
    for one in order[1:]:
        if one.value < _STANDS_OUT:
            break
        if not (one.entry.rows & taken).any():
            taken |= one.entry.rows
            result.append(one)
    return result


def used_columns(chosen: Sequence[Score], size: int) -> FloatArray:
    """Columns that some trials used, side by side, (N, k)."""
    used = [one.entry.columns(size)[:, one.coefficients != 0.0] for one in chosen]
    return np.concatenate(used, axis=1)


def lost_by_fits(
    bench: Bench, scores: Sequence[Score], taken: Sequence[Score], mask: BoolArray
) -> list[FloatArray]:
    """What every column's products with the residual are to be raised by, (k,) of each trial.

    A refit of the base, and taking some trials out, make the residual of every block smaller
    than the noise: its products with a column c have the variance ``sum_b c_b' (I - Q Q')_bb c_b``
    with the fit's directions Q, where noise itself would give ``c' c``.

    `taken` are the trials that were taken out.
    """
    fresh = bench.beyond(used_columns(taken, mask.size)[mask])
    directions = np.concatenate([bench.basis, np.linalg.qr(fresh)[0]], axis=1)
    order = np.argsort(bench.block, kind="stable")
    edges = np.searchsorted(bench.block[order], np.arange(bench.blocks + 1))
    directions = directions[order]
    result: list[FloatArray] = []
    for begin in range(0, len(scores), _TOGETHER):
        some = scores[begin : begin + _TOGETHER]
        columns = [one.entry.columns(mask.size)[mask] for one in some]
        left = bench.beyond(np.concatenate(columns, axis=1))[order]
        lost = np.zeros(left.shape[1])
        for a, b in itertools.pairwise(edges.tolist()):
            lost += np.sum((directions[a:b].T @ left[a:b]) ** 2, axis=0)
        whole = np.maximum(np.sum(left**2, axis=0), 1e-300)
        raised = 1.0 / np.sqrt(np.maximum(1.0 - lost / whole, _LEAST_LEFT))
        result += np.split(raised, np.cumsum([c.shape[1] for c in columns])[:-1])
    return result


def told_best(one: Score) -> int:
    """A trial's column whose coefficient is told best."""
    return int(np.argmax(np.abs(one.coefficients) / one.std))


def overdispersion(one: Score, raised: FloatArray | None = None) -> float:
    """How much more a trial's sums over blocks vary than independent rows' would; at least 1.

    Where a channel holds more than its noise, whatever is put to it gains by chance: that is no
    measure of what trials of other channels gain.

    Parameters
    ----------
    one : Score
    raised : (k,) array, optional
        As `lost_by_fits`.
    """
    told = told_best(one)
    own = float(one.partial.gram[told, told])
    if own <= SWALLOWED * one.partial.plain[told]:
        return 1.0
    factor = 1.0 if raised is None else float(raised[told])
    return max(1.0, factor**2 * float(np.sum(one.partial.chance[:, told] ** 2)) / own)


def overdispersed(bench: Bench, left: FloatArray, residual: FloatArray) -> float:
    """As `overdispersion`, of columns and what a fit with them leaves.

    Parameters
    ----------
    bench : Bench
    left : (M, k) array
        Whitened columns beyond the bench's base.
    residual : (M,) array
        Whitened.
    """
    told = float(np.sum(left**2))
    sums = bench.by_block(left * residual[:, None])
    return max(1.0, float(np.sum(sums**2)) / told) if told > 0.0 else 1.0


def chance_of(
    scores: Sequence[Score], flips: FloatArray, raised: Sequence[FloatArray] | None = None
) -> FloatArray:
    """The largest value of any trial under every sign flip, over its `overdispersion`.

    Westfall and Young, Resampling-Based Multiple Testing (1993): statistics are brought to one
    scale before their maximum is taken, lest the widest decide for all.

    Parameters
    ----------
    scores : sequence of Score
        Of a residual without the best trials in it: what is left is what chance has to work with.
    flips : (F, B) array
    raised : sequence of (k,) array, optional
        As `lost_by_fits`.
    """
    largest = np.zeros(flips.shape[0])
    for k, one in enumerate(scores):
        own = None if raised is None else raised[k]
        drawn = flips @ one.partial.chance / np.sqrt(overdispersion(one, own))
        if own is not None:
            drawn *= own
        kept = np.diag(one.partial.gram) > SWALLOWED * one.partial.plain
        gains, coefficients = best_subset(one.partial.gram, drawn, one.entry.trial.signed, kept)
        extra = np.maximum(np.count_nonzero(coefficients, axis=1) - 1, 0)
        largest = np.maximum(largest, gains - PER_COEFFICIENT * extra)
    return largest


def chances(
    scores: Sequence[Score],
    chosen: Sequence[Score],
    flips: FloatArray,
    raised: Sequence[FloatArray] | None = None,
) -> tuple[float, ...]:
    """Chance that any trial reaches what a trial does, each by its own scale.

    Parameters
    ----------
    scores : sequence of Score
        All that share the family's error.
    chosen : sequence of Score
        Of these, whose chances are wanted.
    flips, raised
        As `chance_of`.
    """
    chance = chance_of(scores, flips, raised)
    own = {id(s): None if raised is None else raised[k] for k, s in enumerate(scores)}
    return tuple(p_value(one.value / overdispersion(one, own[id(one)]), chance) for one in chosen)


def p_value(value: float, chance: FloatArray) -> float:
    """Share of draws that reach a value, the observed one counted in.

    `chance` are the draws.
    """
    return float((1 + np.sum(chance >= value)) / (1 + chance.size))
