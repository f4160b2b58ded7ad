"""Between samples of a slow log pressures are no straight lines: intervals know of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

from hydro_ident.bag.recording import Recording
from hydro_ident.estimate.flows.hydraulics import fit_hydraulics
from hydro_ident.estimate.signals.traces import traces_of
from hydro_ident.parameters.parameters import cylinder_parameters
from hydro_model.robot import Robot
from hydro_model.robot_files import load_robot

DELAY_S = 0.0013


@pytest.fixture(scope="module")
def exact(make_run: tuple[Callable[..., Robot], Callable[..., Any]]) -> Any:
    true_crane, simulated_run = make_run
    crane = replace(true_crane(), command_delay_s=DELAY_S)
    return simulated_run(crane, 16.0, seed=3, noisy=False)


def _one_in(recording: Recording, count: int) -> Recording:
    names = ("stamp_ns", "q", "p_a", "p_b", "supply", "tank", "valve_v", "command_v", "latched")
    kept = {name: getattr(recording, name) for name in names}
    thin = {name: values[::count] for name, values in kept.items() if values is not None}
    return replace(recording, period_s=count * recording.period_s, **thin)


@pytest.mark.parametrize("count", [1, 5, 10])
def test_delay_and_moduli_hold_at_slow_rates(exact: Any, count: int) -> None:
    """Without noise there is nothing else that they could be off by."""
    thin = _one_in(exact.recording(), count)
    fit = fit_hydraulics(load_robot("xs031"), traces_of([thin]))
    assert fit is not None
    assert abs(fit.delay_s - DELAY_S) < 1.96 * fit.delay_std_s
    # No wider than a twentieth of a cycle either way.
    assert fit.delay_std_s < 0.025 * count * exact.recording().period_s
    for true, cylinder in zip(exact.robot.cylinders, fit.cylinders, strict=True):
        bulk = cylinder_parameters(exact.robot, cylinder, {})[0]
        assert bulk.ci95 is not None
        assert bulk.ci95[0] < true.bulk_modulus_pa < bulk.ci95[1]
