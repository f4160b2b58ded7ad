"""Compiled flows of a valve's edges: the diagnosis writes them into rows thousands of times."""

from __future__ import annotations

from typing import Any

from hydro_model.effects.signals import (
    PRESSURE_A,
    PRESSURE_B,
    SUPPLY_PRESSURE,
    TANK_PRESSURE,
    VALVE_FLOW_A,
    VALVE_FLOW_B,
    VALVE_SIGNAL,
)
from hydro_model.hydraulics.valve import SMOOTH_PRESSURE_PA
from hydro_model.numerics.kernel import inlined, kernel

Array = Any  # numba types the kernels; mypy follows no numba import
_SMOOTH_SQUARED = SMOOTH_PRESSURE_PA**2


@inlined
def _root(difference: float) -> float:
    """As `hydro_model.hydraulics.valve`, to the last digit: two square roots would be another."""
    return float(difference / (difference * difference + _SMOOTH_SQUARED) ** 0.25)


@kernel
def write_edge_flows(s: Array, c_pa: float, c_at: float, c_pb: float, c_bt: float) -> None:
    """`hydro_model.hydraulics.valve.edge_flows` of every row of signals, into the row.

    Parameters
    ----------
    s : (N, SIGNAL_COUNT) array
        With pressures and the valve's signal.
    c_pa, c_at, c_pb, c_bt : float
        Coefficients of the edges.
    """
    for k in range(s.shape[0]):
        u, p_a, p_b = s[k, VALVE_SIGNAL], s[k, PRESSURE_A], s[k, PRESSURE_B]
        p_s, p_t = s[k, SUPPLY_PRESSURE], s[k, TANK_PRESSURE]
        # An unknown line leaves both chambers' flows unknown, that of the closed edge as well.
        if u > 0.0:
            s[k, VALVE_FLOW_A] = c_pa * _root(p_s - p_a) * u + 0.0 * p_t
            s[k, VALVE_FLOW_B] = -c_bt * _root(p_b - p_t) * u + 0.0 * p_s
        else:
            s[k, VALVE_FLOW_A] = c_at * _root(p_a - p_t) * u + 0.0 * p_s
            s[k, VALVE_FLOW_B] = -c_pb * _root(p_s - p_b) * u + 0.0 * p_t
