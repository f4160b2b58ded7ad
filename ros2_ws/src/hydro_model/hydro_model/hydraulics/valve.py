"""Valve flows and their inverse (eqs. 11 to 15 and 24).

Signs. The code counts flow **into** a chamber as positive: ``q_a = Q1`` and ``q_b = -Q2`` of the
paper, whose Q2 leaves chamber B. A positive signal sends supply oil to chamber A and opens
chamber B to tank, so the cylinder extends. The paper's scalar is
``Q = -(Q1 / x + Q2 / (S - x))``; hence u > 0 means Q < 0.

Square roots are signed, so that a pressure difference that reverses reverses the flow, and
smooth: ``root(d) = d / (d^2 + d0^2)^(1/4)`` with ``d0 = SMOOTH_PRESSURE_PA``. The slope at
d = 0 stays finite; at 1 bar the flow differs from the square root by 3e-5.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from hydro_model.robot import Cylinder, FloatArray, Valve

#: Pressure difference below which an orifice goes over from square root to linear, Pa. As
#: small as what a transducer of this class resolves, so nothing measured can tell.
SMOOTH_PRESSURE_PA = 1000.0


def signed_root(difference_pa: ArrayLike) -> FloatArray:
    """``sign(d) sqrt(|d|)`` of `difference_pa`, smoothed below `SMOOTH_PRESSURE_PA`; sqrt(Pa)."""
    d = np.asarray(difference_pa, dtype=float)
    return np.asarray(d / (d * d + SMOOTH_PRESSURE_PA**2) ** 0.25)


def edge_flows(
    valve: Valve,
    u: ArrayLike,
    p_a: ArrayLike,
    p_b: ArrayLike,
    p_s: ArrayLike,
    p_t: ArrayLike,
) -> tuple[FloatArray, FloatArray]:
    """Flows through the four edges (eqs. 11 to 13), by chamber.

    Parameters
    ----------
    valve : Valve
    u : array
        Normalised signal, voltage over rated voltage; not limited here.
    p_a, p_b, p_s, p_t : array
        Gauge pressures of the chambers, supply and tank in Pa. All arguments broadcast.

    Returns
    -------
    q_a, q_b : array
        Flow **into** chamber A (= Q1) and **into** chamber B (= -Q2), m^3/s.
    """
    u = np.asarray(u, dtype=float)
    p_a, p_b, p_s, p_t = _floats(p_a, p_b, p_s, p_t)
    up, down = np.maximum(u, 0.0), np.minimum(u, 0.0)
    q_a = valve.c_pa * signed_root(p_s - p_a) * up + valve.c_at * signed_root(p_a - p_t) * down
    q_b = -valve.c_bt * signed_root(p_b - p_t) * up - valve.c_pb * signed_root(p_s - p_b) * down
    return np.asarray(q_a), np.asarray(q_b)


def flow_term(cylinder: Cylinder, x: ArrayLike, q_a: ArrayLike, q_b: ArrayLike) -> FloatArray:
    """The flow-related scalar ``Q = -Q1 / x - Q2 / (S - x)`` of eq. 14, m^2/s.

    Parameters
    ----------
    cylinder : Cylinder
    x : array
        Piston displacement in m, ``0 < x < S``.
    q_a, q_b : array
        Flows into the chambers, m^3/s (so Q2 = -q_b).

    Returns
    -------
    array
        Negative while the valve extends the cylinder.
    """
    x = np.asarray(x, dtype=float)
    rest = cylinder.stroke_m - x
    return np.asarray(-np.asarray(q_a, dtype=float) / x + np.asarray(q_b, dtype=float) / rest)


def valve_signal(
    valve: Valve,
    cylinder: Cylinder,
    q_term: ArrayLike,
    x: ArrayLike,
    p_a: ArrayLike,
    p_b: ArrayLike,
    p_s: ArrayLike,
    p_t: ArrayLike,
) -> FloatArray:
    """Normalised signal that gives a flow term: the inverse of eqs. 11 to 14 (eqs. 15 and 24).

    Exact wherever the paper's assumptions hold (``0 < x < S``, chamber pressures between tank
    and supply by at least `SMOOTH_PRESSURE_PA`). Smaller differences are taken as
    `SMOOTH_PRESSURE_PA`, and a return line's above its chamber, too: the signal stays finite,
    large and of the right sign. Where the chamber that is to be fed is above the supply its flow
    runs back; the signal is 0 where the valve could only give the opposite of what is wanted. It
    is not limited here; the caller saturates.

    Parameters
    ----------
    valve : Valve
    cylinder : Cylinder
    q_term : array
        Wanted Q of eq. 14, m^2/s.
    x : array
        Piston displacement in m.
    p_a, p_b, p_s, p_t : array
        Gauge pressures in Pa.

    Returns
    -------
    array
        u, positive where `q_term` is negative.
    """
    x = np.asarray(x, dtype=float)
    return signal_at_lengths(valve, q_term, x, cylinder.stroke_m - x, p_a, p_b, p_s, p_t)


def signal_at_lengths(
    valve: Valve,
    q_term: ArrayLike,
    length_a: ArrayLike,
    length_b: ArrayLike,
    p_a: ArrayLike,
    p_b: ArrayLike,
    p_s: ArrayLike,
    p_t: ArrayLike,
) -> FloatArray:
    """`valve_signal` with the oil columns of the chambers given: ``Q = -Q1 / l_A - Q2 / l_B``.

    Parameters
    ----------
    valve : Valve
    q_term : array
        Wanted Q, m^2/s.
    length_a, length_b : array
        In m: x and S - x in eqs. 14 and 15, longer where a chamber is softer than that.
    p_a, p_b, p_s, p_t : array
        Gauge pressures in Pa.

    Returns
    -------
    array
        u, positive where `q_term` is negative.
    """
    q_term, x, rest = _floats(q_term, length_a, length_b)
    p_a, p_b, p_s, p_t = _floats(p_a, p_b, p_s, p_t)
    extend = valve.c_pa * _fed_root(p_s - p_a) / x + valve.c_bt * _open_root(p_b - p_t) / rest
    retract = valve.c_at * _open_root(p_a - p_t) / x + valve.c_pb * _fed_root(p_s - p_b) / rest
    least = _open_root(np.zeros(()))
    extending = q_term < 0.0
    flow = np.where(extending, extend, retract)
    # Less than that is left where the fed chamber empties into the supply: to open further
    # would drop the load.
    starved = flow <= np.where(extending, valve.c_pa / x, valve.c_pb / rest) * least
    return np.asarray(np.where(starved, 0.0, -q_term / np.where(starved, 1.0, flow)))


def _open_root(difference_pa: FloatArray) -> FloatArray:
    return signed_root(np.maximum(difference_pa, SMOOTH_PRESSURE_PA))


def _fed_root(difference_pa: FloatArray) -> FloatArray:
    """Of supply over the chamber that it feeds: what runs back counts as such."""
    return np.where(difference_pa < 0.0, signed_root(difference_pa), _open_root(difference_pa))


def _floats(*values: ArrayLike) -> list[FloatArray]:
    return [np.asarray(value, dtype=float) for value in values]
