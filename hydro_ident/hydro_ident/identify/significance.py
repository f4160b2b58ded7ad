"""Tests of changes: Student's and F's tails, Welch's degrees of freedom, Holm's adjustment."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hydro_model.robot import FloatArray

#: Chance of calling anything changed where nothing is.
LEVEL = 0.05
#: What a test found.
CHANGED, UNCHANGED, NOT_CONCLUSIVE = "changed", "unchanged", "not conclusive: model error"


@dataclass(frozen=True, slots=True)
class Significance:
    """A test of whether something changed.

    Attributes
    ----------
    p_value : float
        With what left-out physics may explain.
    noise_p_value : float
        Were noise all there is.
    p_adjusted, noise_p_adjusted : float
        The same, adjusted for everything tested.
    """

    p_value: float
    noise_p_value: float
    p_adjusted: float = 1.0
    noise_p_adjusted: float = 1.0

    @property
    def outcome(self) -> str:
        """`CHANGED`, `UNCHANGED` or `NOT_CONCLUSIVE`."""
        if self.p_adjusted < LEVEL:
            return CHANGED
        return NOT_CONCLUSIVE if self.noise_p_adjusted < LEVEL else UNCHANGED


def welch_dof(parts: Sequence[tuple[float, float]]) -> float:
    """Degrees of freedom of a deviation that several make up.

    Parameters
    ----------
    parts : sequence of (float, float)
        Standard deviations and their degrees of freedom.

    Returns
    -------
    float
        Infinite where all of them are.
    """
    total = sum(std**2 for std, _ in parts)
    uncertain = sum(std**4 / dof for std, dof in parts)
    return total**2 / uncertain if uncertain > 0.0 else math.inf


def two_sided(z: float, dof: float) -> float:
    """Chance of Student's t at least as far from 0 as z.

    `z` is the statistic, `dof` its degrees of freedom.
    """
    from scipy.special import stdtr

    if not math.isfinite(dof):
        return math.erfc(abs(z) / math.sqrt(2.0))
    return 2.0 * float(stdtr(dof, -abs(z)))


def holm(chances: Sequence[float]) -> list[float]:
    """P-values adjusted by Holm's step-down, in the order given.

    `chances` are those of each test by itself.
    """
    result, worst = [0.0] * len(chances), 0.0
    for rank, i in enumerate(sorted(range(len(chances)), key=lambda i: chances[i])):
        worst = max(worst, min(1.0, chances[i] * (len(chances) - rank)))
        result[i] = worst
    return result


def wald(difference: FloatArray, covariance: FloatArray) -> tuple[float, int]:
    """Wald's statistic and its degrees of freedom.

    Parameters
    ----------
    difference : (p,) array
    covariance : (p, p) array
        With a positive diagonal.

    Returns
    -------
    statistic : float
    freedom : int
        Rank of the covariance.
    """
    scale = np.sqrt(np.diag(covariance))
    inverse = np.linalg.pinv(covariance / np.outer(scale, scale), rcond=1e-12, hermitian=True)
    unit = difference / scale
    return float(unit @ inverse @ unit), int(np.linalg.matrix_rank(inverse, hermitian=True))


def f_tail(statistic: float, freedom: int, dof: float) -> float:
    """Chance of a Wald statistic this large, its variances known with `dof` degrees of freedom."""
    from scipy.special import chdtrc, fdtrc

    if not math.isfinite(dof):
        return float(chdtrc(freedom, statistic))
    return float(fdtrc(freedom, dof, statistic / freedom))
