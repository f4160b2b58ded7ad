"""Whether an effect has one size all along: what comes and goes is no property of the machine.

An effect's size is estimated in every stretch of a few blocks by itself, s_b with variance 1/I_b.
Where the machine has it, these differ by chance alone: ``Q = sum_b I_b (s_b - s)^2`` follows the
chi-square law, and what is beyond it is their own variance (DerSimonian and Laird, Controlled
Clinical Trials 7 (1986) 177, eq. 8). Something else that only resembles the effect on the average,
a drag that comes and goes say, has it in some stretches and not in others.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from hydro_ident.mismatch.fitting.bench import Bench
from hydro_ident.mismatch.settings import FAMILY_ERROR_UNNAMED
from hydro_model.robot import FloatArray

#: Blocks that make a stretch, and the share of what tells an effect below which one tells nothing.
_TOGETHER, _TELLS = 2, 0.002
#: Fewest stretches that can say.
_LEAST_STRETCHES = 8
#: Standard deviation of the size over the size itself from which it comes and goes: what is there
#: half the time changes by one. Laws of forces that are of another form than the machine's change
#: by up to a quarter, those of flows, which act through what an opening happens to be, by more.
COMES_AND_GOES, COMES_AND_GOES_FLOW = 0.6, 1.0
#: Shifts, as shares of the rows, after which an effect is no longer in the residual. Here they are
#: of all rows: into other channels, too, whose whitened noise is as large.
SHIFTS = (0.17, 0.29, 0.37, 0.46, 0.57, 0.68, 0.83)


@dataclass(frozen=True, slots=True)
class Sizes:
    """How an effect's size differs from stretch to stretch.

    Attributes
    ----------
    mean : float
        The size from all rows together.
    deviation : float
        Standard deviation of the sizes beyond chance.
    chance : float
        Share of chance in which they differ as much; 1 where too few stretches tell.
    """

    mean: float
    deviation: float
    chance: float


def inconstancy(bench: Bench, column: FloatArray) -> float:
    """Standard deviation of an effect's size from stretch to stretch, over the size itself.

    Parameters
    ----------
    bench : Bench
        Of a model without the effect.
    column : (N,) array
        What the effect adds to the prediction, in units of the channels, on the bench's rows.

    Returns
    -------
    float
        0 where the stretches differ by no more than chance, or there are too few.
    """
    sizes = sizes_of(bench, column, _TOGETHER)
    if sizes.mean <= 0.0 or sizes.chance > FAMILY_ERROR_UNNAMED:
        return 0.0
    return sizes.deviation / sizes.mean


def sizes_of(bench: Bench, column: FloatArray, together: int) -> Sizes:
    """How a column's size differs between stretches of so many blocks.

    Parameters
    ----------
    bench : Bench
        Of a model without it.
    column : (N,) array
        On the bench's rows.
    together : int
    """
    left = bench.beyond(column[:, None])[: bench.measured, 0]
    residual = bench.residual[: bench.measured]
    stretch = bench.block[: bench.measured] // together
    told = float(left @ left)
    if told <= 0.0:
        return Sizes(0.0, 0.0, 1.0)
    mean = float(left @ residual) / told
    usual = [
        spread / freedom
        for shift in SHIFTS
        for spread, freedom, _ in [
            _spread(np.roll(left, round(shift * left.size)), residual, stretch)
        ]
        if freedom
    ]
    spread, freedom, worth = _spread(left, residual, stretch)
    if freedom + 1 < _LEAST_STRETCHES or not usual:
        return Sizes(mean, 0.0, 1.0)
    # Slow noise makes stretches differ, too: as much as those of what is not there.
    noise = max(1.0, float(np.median(usual)))
    deviation = math.sqrt(max(0.0, spread - noise * freedom) / worth)
    return Sizes(mean, deviation, float(chi2.sf(spread / noise, freedom)))


def _spread(
    left: FloatArray, residual: FloatArray, stretch: np.ndarray[tuple[int, ...], np.dtype[np.intp]]
) -> tuple[float, int, float]:
    """Spread of the sizes, its degrees of freedom, and what it grows by with their variance."""
    worth = np.bincount(stretch, weights=left**2)
    products = np.bincount(stretch, weights=left * residual)
    kept = worth > _TELLS * worth.sum()
    worth, products = worth[kept], products[kept]
    if worth.size < 2:
        return 0.0, 0, 1.0
    total = float(worth.sum())
    spread = float(np.sum(products**2 / worth)) - float(products.sum()) ** 2 / total
    return spread, int(worth.size) - 1, total - float(np.sum(worth**2)) / total
