"""Chance of what held-out rows and a finding have in common.

A finding changes the prediction of held-out rows by c; without it these are off by r, with it by
``a = r - c``. The product ``c' r`` is what speaks for it. How large it gets by chance follows from
``c' a``, block by block with random signs: from what is left once the finding has said its part,
as a search draws chance from the residual without its best candidate (Freedman and Lane, J. Bus.
Econ. Stat. 1 (1983) 292). Signs of ``c' r`` itself would take a true effect for its own chance:
where it acts in k blocks they all agree once in 2^k times, whatever it explains there.

A false finding has ``c' a = c' r - c' c``: what it adds counts against it. Where it acts in few
blocks that bounds its chance by no more than one half; the product has then to stand out from
noise of the size that is left there, too.

What no flip reaches is rarer than so many flips can say. Where that matters, because the chance is
paid for many times over, it is taken from the tail: what all signs there are may make of sums of
this size at most (Bentkus and Dzindzalieta, Bernoulli 21 (2015) 1231), and no less than Student's
law of as many blocks. A product that is large by chance leaves little, and looks the larger beside
it; that law is what becomes of it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.stats import norm
from scipy.stats import t as student

from hydro_ident.mismatch.trials.chance import reached
from hydro_ident.mismatch.trials.constancy import SHIFTS
from hydro_model.arrays import IndexArray
from hydro_model.robot import FloatArray

#: Sign flips: p-values are multiplied by what was tried, and must be able to be small still.
_FLIPS = 19999
#: What a value has that none of them reaches.
_UNREACHED = 1.0 / (1 + _FLIPS)
#: Sums with random signs exceed a value no more often than so many times a normal law of their
#: variance: the smallest such factor, `1 / (4 P(N >= sqrt 2))`.
_SIGNS = 1.0 / (4.0 * float(norm.sf(np.sqrt(2.0))))


def chance(gains: FloatArray) -> float:
    """Share of sign flips that reach the sum of blocks' gains; 1 where there is none."""
    return reached(gains, flips=_FLIPS)


def chance_beside(
    change: FloatArray,
    before: FloatArray,
    after: FloatArray,
    block: IndexArray,
    short: IndexArray,
    tried: float = 1.0,
) -> float:
    """Chance that a change goes with what is left without it as far as it does.

    Parameters
    ----------
    change, before, after : (M,) array
        What is put to whitened rows, and what is left of these without the finding and with it.
    block, short : (M,) int array
        The block of time that each row is in, and the shortest one that is still independent.
    tried : float
        What the chance will be multiplied by: it is told so many times further down.

    Returns
    -------
    float
        1 where they do not go together. Otherwise the larger of the share of sign flips of whole
        blocks of `after` that reach the product, and of Student's law with the variance of
        `left_variance` and as many short blocks as the change acts in.
    """
    product = float(change @ before)
    if product <= 0.0:
        return 1.0
    left = np.asarray(np.bincount(block, weights=change * after), dtype=np.float64)
    deviation = np.sqrt(left_variance(change, after, block, short))
    by_noise = float(student.sf(product / deviation, _freedom(change, short)))
    by_signs = reached(left[left != 0.0], product, _FLIPS)
    if by_signs <= _UNREACHED:
        by_signs = _beyond_flips(product, left, _freedom(change, block), tried)
    return max(by_signs, by_noise)


def paid(chances: Sequence[float]) -> list[float]:
    """Chances of one finding in several views of the same rows, with the choice paid for.

    The smallest becomes their harmonic mean (Wilson, PNAS 116 (2019) 1195): itself where all
    views say the same, so many times itself where the others say nothing. The others are
    multiplied by the number of views.

    Parameters
    ----------
    chances : sequence of float
        Of at least one view, each above 0.

    Returns
    -------
    list of float
        At most 1 each.
    """
    count, least = len(chances), int(np.argmin(chances))
    mean = count / sum(1.0 / chance for chance in chances)
    return [min(1.0, mean if k == least else count * one) for k, one in enumerate(chances)]


def _beyond_flips(product: float, left: FloatArray, freedom: float, tried: float) -> float:
    """Chance of a product that no flip of blocks' sums (B,) reaches, as far down as is asked."""
    size = float(np.linalg.norm(left))
    if size <= 0.0:
        return _UNREACHED
    beyond = product / size
    tail = max(_SIGNS * float(norm.sf(beyond)), float(student.sf(beyond, freedom)))
    return min(max(tail, _UNREACHED / tried), _UNREACHED)


def _freedom(change: FloatArray, short: IndexArray) -> float:
    """Degrees of freedom of what rows tell of a change: short blocks that it acts in, less one.

    Parameters
    ----------
    change, short
        As `chance_beside`.
    """
    energy = np.bincount(short, weights=change**2)
    squares = float(energy @ energy)
    return max(float(energy.sum()) ** 2 / squares - 1.0, 1.0) if squares > 0.0 else 1.0


def share_of_time(change: FloatArray, short: IndexArray) -> float:
    """Share of the short blocks that a change acts in, by its energy.

    Parameters
    ----------
    change, short
        As `chance_beside`.
    """
    blocks = np.unique(short).size
    return min((_freedom(change, short) + 1.0) / blocks, 1.0) if blocks else 0.0


def left_variance(
    change: FloatArray, after: FloatArray, block: IndexArray, short: IndexArray
) -> float:
    """Variance of the product of a change with rows like those that are left.

    Never less than white noise of unit variance makes of it. More where what is left is larger in
    the very rows that change (White, Econometrica 48 (1980) 817), or goes together with them in
    short blocks, and where sums over blocks of the change at other times, which is not there, are
    larger than those of independent rows.

    Parameters
    ----------
    change, after, block, short
        As `chance_beside`.
    """
    squares = change**2
    spreads = [
        float(np.sum(np.bincount(block, weights=moved * after) ** 2)) / whole
        for shift in SHIFTS
        for moved in [np.roll(change, round(shift * change.size))]
        if (whole := float(moved**2 @ after**2)) > 0.0
    ]
    spread = max(1.0, float(np.median(spreads or [1.0])))
    together = float(np.sum(np.bincount(short, weights=change * after) ** 2))
    return max(spread * max(float(squares.sum()), float(squares @ after**2)), together)
