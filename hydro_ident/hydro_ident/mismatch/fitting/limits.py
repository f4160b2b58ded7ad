"""Least squares whose coefficients have limits."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import lsq_linear

from hydro_model.robot import FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Limits:
    """Between which coefficients lie; 0 is among what is allowed.

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
        0 where both limits are.
    """
    theta = np.zeros(rows.shape[1])
    free = limits.upper > limits.lower
    if free.any():
        ends = (limits.lower[free], limits.upper[free])
        theta[free] = lsq_linear(rows[:, free], wanted, ends, method="bvls").x
    return theta
