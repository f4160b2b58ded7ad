"""Least squares whose coefficients have limits."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import lsq_linear

from hydro_model.robot import FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Limits:
    """Between which coefficients lie.

    Attributes
    ----------
    lower, upper : (p,) array
        Infinite where there is no limit.
    """

    lower: FloatArray
    upper: FloatArray


def solved_within(rows: FloatArray, wanted: FloatArray, limits: Limits) -> FloatArray:
    """Least-squares coefficients between limits (Stark and Parker, Comput. Stat. 10 (1995) 129).

    Parameters
    ----------
    rows : (N, p) array
        Of full rank.
    wanted : (N,) array
    limits : Limits

    Returns
    -------
    (p,) array
        Where both limits are one, that.
    """
    free = limits.upper > limits.lower
    theta = np.where(free, 0.0, limits.lower)
    if free.any():
        ends = (limits.lower[free], limits.upper[free])
        left = wanted - rows @ theta
        theta[free] = lsq_linear(rows[:, free], left, ends, method="bvls").x
    return theta
