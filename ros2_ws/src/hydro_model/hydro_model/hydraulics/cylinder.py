"""Cylinder kinematics and statics: stroke, lever arm, piston force, chamber volumes.

Equations 9, 16 and 17 of the paper with their errata: A2 is the annulus, and the squares under
the root of eqs. 16 and 17 are restored. All functions take scalars or arrays of any shape.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from hydro_model.errors import RobotError
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
    return np.asarray(_pin_distance(cylinder, q) - cylinder.x0_m)


def lever(cylinder: Cylinder, q: ArrayLike) -> FloatArray:
    """Lever arm dx/dq in m/rad, or 1 on a prismatic joint (eq. 17 corrected).

    It takes joint velocity to piston velocity and piston force to joint torque. With
    ``L(q)`` the distance between the pins, ``dx/dq = l1 l2 sin(q + q0) / L``.

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
        return np.ones_like(q)
    product = cylinder.l1_m * cylinder.l2_m
    return np.asarray(product * np.sin(q + cylinder.q0_rad) / _pin_distance(cylinder, q))


def lever_rate(cylinder: Cylinder, q: ArrayLike) -> FloatArray:
    """Second derivative d2x/dq2 in m/rad^2, or 0 on a prismatic joint.

    From ``L L' = l1 l2 sin``: ``x'' = (l1 l2 cos(q + q0) - x'^2) / L``. Piston acceleration is
    ``x' qdd + x'' qd^2``.

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
        return np.zeros_like(q)
    product = cylinder.l1_m * cylinder.l2_m
    slope = lever(cylinder, q)
    top = product * np.cos(q + cylinder.q0_rad) - slope * slope
    return np.asarray(top / _pin_distance(cylinder, q))


def joint_position(cylinder: Cylinder, x: ArrayLike, near: float = 0.0) -> FloatArray:
    """Joint position at a piston displacement: the inverse of `stroke`.

    The triangle closes on either side of a dead centre; between dead centres x(q) is monotone.

    Parameters
    ----------
    cylinder : Cylinder
    x : array
        Piston displacement in m, any shape.
    near : float
        A joint position on the wanted side of the dead centres, such as one inside the joint's
        limits.

    Returns
    -------
    array
        Joint position, rad or m, same shape as `x`.

    Raises
    ------
    RobotError
        The triangle cannot close at a displacement, which the message names.
    """
    x = np.asarray(x, dtype=float)
    if cylinder.l1_m == 0.0:
        return x + cylinder.x0_m
    l1, l2 = cylinder.l1_m, cylinder.l2_m
    cosine = (l1 * l1 + l2 * l2 - (x + cylinder.x0_m) ** 2) / (2.0 * l1 * l2)
    # Rounding may leave the ends of the range a hair outside [-1, 1]; anything more is an error.
    if not np.all(np.abs(cosine) <= 1.0 + 1e-12):
        worst = float(np.ravel(x)[np.argmax(np.abs(np.ravel(cosine)))])
        low, high = abs(l1 - l2) - cylinder.x0_m, l1 + l2 - cylinder.x0_m
        raise RobotError(
            f"cylinder '{cylinder.name}': no joint position at x = {worst:g} m,"
            f" its triangle closes from {low:.4f} to {high:.4f} m"
        )
    angle = np.arccos(np.clip(cosine, -1.0, 1.0))
    half_turn = np.floor((near + cylinder.q0_rad) / np.pi)
    if half_turn % 2.0:
        return np.asarray((half_turn + 1.0) * np.pi - angle - cylinder.q0_rad)
    return np.asarray(half_turn * np.pi + angle - cylinder.q0_rad)


def inside_stroke(cylinder: Cylinder, q: FloatArray) -> tuple[float, float] | None:
    """Ends of the longest stretch of joint positions whose strokes the cylinder has.

    Parameters
    ----------
    cylinder : Cylinder
    q : (N,) array
        Joint positions that are looked at, in order, rad or m.

    Returns
    -------
    tuple of float or None
        Two of them; None where the piston is outside at all.
    """
    x = stroke(cylinder, q)
    good = (x >= 0.0) & (x <= cylinder.stroke_m)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], good.astype(int), [0]])))
    if not edges.size:
        return None
    starts, ends = edges[::2], edges[1::2] - 1
    longest = int(np.argmax(ends - starts))
    return float(q[starts[longest]]), float(q[ends[longest]])


def piston_force(cylinder: Cylinder, p_a: ArrayLike, p_b: ArrayLike) -> FloatArray:
    """Piston force ``f = p_a A1 - p_b A2`` in N (eq. 9, A2 being the annulus).

    Parameters
    ----------
    cylinder : Cylinder
    p_a, p_b : array
        Gauge chamber pressures in Pa.

    Returns
    -------
    array
        Positive when it extends the cylinder.
    """
    bore_side = np.asarray(p_a, dtype=float) * cylinder.area_a_m2
    return np.asarray(bore_side - np.asarray(p_b, dtype=float) * cylinder.area_b_m2)


def chamber_volumes(cylinder: Cylinder, x: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Chamber volumes ``(A1 x, A2 (S - x))`` in m^3, without dead volume (eq. 10).

    Parameters
    ----------
    cylinder : Cylinder
    x : array
        Piston displacement in m.

    Returns
    -------
    volume_a, volume_b : array
        Same shape as `x`.
    """
    x = np.asarray(x, dtype=float)
    volume_b = cylinder.area_b_m2 * (cylinder.stroke_m - x)
    return np.asarray(cylinder.area_a_m2 * x), np.asarray(volume_b)


def _pin_distance(cylinder: Cylinder, q: FloatArray) -> FloatArray:
    l1, l2 = cylinder.l1_m, cylinder.l2_m
    cosine = np.cos(q + cylinder.q0_rad)
    return np.asarray(np.sqrt(l1 * l1 + l2 * l2 - 2.0 * l1 * l2 * cosine))
