"""Cylinder kinematics: stroke and lever arm (eqs. 16 and 17 corrected)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from hydro_model.robot import Cylinder, FloatArray


def stroke(cylinder: Cylinder, q: ArrayLike) -> FloatArray:
    """Piston displacement x(q) in m (eq. 16 with the squares the paper dropped).

    Parameters
    ----------
    cylinder : Cylinder
    q : array
        Joint position, rad or m, any shape.

    Returns
    -------
    array
        Same shape as `q`.
    """
    q = np.asarray(q, dtype=float)
    if cylinder.l1_m == 0.0:
        return q - cylinder.x0_m
    l1, l2 = cylinder.l1_m, cylinder.l2_m
    angle = q + cylinder.q0_rad
    return np.asarray(np.sqrt(l1 * l1 + l2 * l2 - 2.0 * l1 * l2 * np.cos(angle)) - cylinder.x0_m)
