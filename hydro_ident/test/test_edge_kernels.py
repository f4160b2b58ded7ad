"""Compiled integrals of the edges against the readable law of the valve."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from hydro_ident.estimate.flows.edge_kernels import integrate_edges
from hydro_model.hydraulics.valve import edge_flows
from hydro_model.robot_files import load_robot


@pytest.mark.parametrize("side_a", [True, False])
@pytest.mark.parametrize("fraction", [0.0, 0.3, 1.0])
def test_integrals_are_the_law_at_the_middle_of_each_part(side_a: bool, fraction: float) -> None:
    random = np.random.default_rng(5)
    count, step_s = 400, 0.002
    p_a, p_b = random.uniform(0.0, 2.0e7, (2, count))
    supply, tank = random.uniform(1.5e7, 2.0e7, count), random.uniform(0.0, 5.0e5, count)
    late, soon = random.uniform(-1.0, 1.0, (2, count - 1))
    late[:5] = 0.0
    unit = replace(load_robot("xs031").valves[0], c_pa=1.0, c_at=1.0, c_pb=1.0, c_bt=1.0)
    opening, closing = np.zeros(count - 1), np.zeros(count - 1)
    for signal, share, middle in (
        (late, fraction, fraction / 2.0),
        (soon, 1.0 - fraction, (1.0 + fraction) / 2.0),
    ):
        rails = [p[:-1] + middle * np.diff(p) for p in (p_a, p_b, supply, tank)]
        flow = edge_flows(unit, signal, *rails)[0 if side_a else 1] * share * step_s
        opening += np.where(signal > 0.0, flow, 0.0)
        closing += np.where(signal > 0.0, 0.0, flow)
    out = np.empty((2, count - 1))
    pressure = p_a if side_a else p_b
    integrate_edges(late, soon, fraction, step_s, pressure, supply, tank, side_a, out)
    assert out == pytest.approx(np.stack([opening, closing]), rel=1e-9, abs=1e-12)


def test_an_unknown_signal_leaves_its_interval_unknown() -> None:
    signal = np.array([0.1, np.nan, -0.1])
    flat = np.full(4, 1.0e7)
    out = np.empty((2, 3))
    integrate_edges(signal, signal, 0.5, 0.002, flat, flat + 1.0e6, flat * 0.0, True, out)
    assert np.isfinite(out.sum(axis=0)).tolist() == [True, False, True]
