"""Valve flows: signs, edges, reversed pressures, and the inverse."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hydro_model.hydraulics import root_kernels
from hydro_model.hydraulics.valve import (
    SMOOTH_PRESSURE_PA,
    edge_flows,
    flow_term,
    signed_root,
    valve_signal,
)
from hydro_model.robot_files import load_robot

ROBOT = load_robot("xs031")
CYLINDER = ROBOT.cylinders[0]
VALVE = replace(ROBOT.valves[0], c_pa=8e-7, c_at=7e-7, c_pb=9e-7, c_bt=6e-7)
P_S, P_T = 19e6, 1e6

between = st.floats(P_T + SMOOTH_PRESSURE_PA, P_S - SMOOTH_PRESSURE_PA)
signal = st.floats(-1.0, 1.0).filter(lambda u: abs(u) > 1e-6)


@given(u=signal, p_a=between, p_b=between, share=st.floats(0.01, 0.99))
def test_signal_comes_back_from_its_flows(u, p_a, p_b, share) -> None:
    x = share * CYLINDER.stroke_m
    q_a, q_b = edge_flows(VALVE, u, p_a, p_b, P_S, P_T)
    term = flow_term(CYLINDER, x, q_a, q_b)
    assert np.sign(term) == -np.sign(u)
    back = valve_signal(VALVE, CYLINDER, term, x, p_a, p_b, P_S, P_T)
    assert back == pytest.approx(u, rel=1e-12)


def test_edges_as_the_paper_prints_them() -> None:
    """Eqs. 11 and 12 with Q2 counting outflow, so q_b = -Q2."""
    p_a, p_b = 9e6, 5e6
    q_a, q_b = edge_flows(VALVE, 0.5, p_a, p_b, P_S, P_T)
    assert q_a == pytest.approx(8e-7 * np.sqrt(P_S - p_a) * 0.5, rel=1e-6)
    assert -q_b == pytest.approx(6e-7 * np.sqrt(p_b - P_T) * 0.5, rel=1e-6)
    q_a, q_b = edge_flows(VALVE, -0.5, p_a, p_b, P_S, P_T)
    assert q_a == pytest.approx(-7e-7 * np.sqrt(p_a - P_T) * 0.5, rel=1e-6)
    assert -q_b == pytest.approx(-9e-7 * np.sqrt(P_S - p_b) * 0.5, rel=1e-6)


def test_rated_flow_of_the_reference_valve() -> None:
    """100 l/min at 35 bar per edge and full signal."""
    q_a, _ = edge_flows(ROBOT.valves[0], 1.0, 0.0, 0.0, 35e5, 0.0)
    assert q_a * 60000.0 == pytest.approx(100.0, rel=2e-3)


def test_positive_signal_extends() -> None:
    q_a, q_b = edge_flows(VALVE, 0.1, 8e6, 8e6, P_S, P_T)
    assert q_a > 0.0
    assert q_b < 0.0
    assert flow_term(CYLINDER, 0.3, q_a, q_b) < 0.0


def test_closed_valve_passes_nothing() -> None:
    q_a, q_b = edge_flows(VALVE, 0.0, [0.0, 30e6], [30e6, -5e5], P_S, P_T)
    np.testing.assert_array_equal(q_a, 0.0)
    np.testing.assert_array_equal(q_b, 0.0)


def test_reversed_pressure_reverses_the_flow() -> None:
    over, _ = edge_flows(VALVE, 0.5, P_S + 1e6, 8e6, P_S, P_T)
    under, _ = edge_flows(VALVE, 0.5, P_S - 1e6, 8e6, P_S, P_T)
    assert over == pytest.approx(-under)


def test_root_is_odd_monotone_and_smooth() -> None:
    d = np.linspace(-5.0, 5.0, 1001) * SMOOTH_PRESSURE_PA
    root = signed_root(d)
    np.testing.assert_allclose(root, -root[::-1], atol=1e-12)
    slope = np.diff(root) / np.diff(d)
    assert np.all(slope > 0.0)
    assert slope.max() == pytest.approx(1.0 / np.sqrt(SMOOTH_PRESSURE_PA), rel=1e-3)
    assert signed_root(1e5) == pytest.approx(np.sqrt(1e5), rel=3e-5)


def test_the_compiled_root_is_the_same_one() -> None:
    d = np.linspace(-5.0, 5.0, 1001) ** 7 * SMOOTH_PRESSURE_PA
    compiled = [root_kernels.root(one) for one in d]
    np.testing.assert_allclose(compiled, signed_root(d), rtol=1e-15)
    assert np.isnan(root_kernels.root(np.nan))


@pytest.mark.parametrize("term", [-0.01, 0.01])
def test_inverse_stays_finite_where_no_pressure_is_left(term) -> None:
    fed, drained = P_S - 10.0, P_T - 1e5
    p_a, p_b = (fed, drained) if term < 0.0 else (drained, fed)
    u = valve_signal(VALVE, CYLINDER, term, 0.3, p_a, p_b, P_S, P_T)
    assert np.isfinite(u)
    assert np.sign(u) == -np.sign(term)
    assert abs(u) > 0.1


@pytest.mark.parametrize("term", [-0.01, 0.01])
def test_no_valve_opens_where_the_load_would_empty_into_the_supply(term) -> None:
    """Nothing that it could open would give the flow that is wanted: the arm would drop."""
    held, other = P_S + 4e6, P_T + 1e4
    p_a, p_b = (held, other) if term < 0.0 else (other, held)
    assert valve_signal(VALVE, CYLINDER, term, 0.3, p_a, p_b, P_S, P_T) == 0.0
    # Beside a chamber that is under pressure the other edge gives more than runs back.
    p_a, p_b = (P_S + 1e5, 8e6) if term < 0.0 else (8e6, P_S + 1e5)
    u = valve_signal(VALVE, CYLINDER, term, 0.3, p_a, p_b, P_S, P_T)
    flows = edge_flows(VALVE, u, p_a, p_b, P_S, P_T)
    assert flow_term(CYLINDER, 0.3, *flows) == pytest.approx(term, rel=1e-3)


def test_no_flow_wanted_is_no_signal() -> None:
    assert valve_signal(VALVE, CYLINDER, 0.0, 0.3, 8e6, 8e6, P_S, P_T) == 0.0


def test_arrays_broadcast() -> None:
    u = np.linspace(-1.0, 1.0, 5)
    p_a = np.full(5, 8e6)
    q_a, q_b = edge_flows(VALVE, u, p_a, 6e6, P_S, P_T)
    assert q_a.shape == q_b.shape == (5,)
    for k in range(5):
        one_a, one_b = edge_flows(VALVE, u[k], 8e6, 6e6, P_S, P_T)
        assert (q_a[k], q_b[k]) == (one_a, one_b)
