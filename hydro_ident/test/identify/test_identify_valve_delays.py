"""Valves whose command delays differ, and delays beyond the range."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest

from hydro_ident.estimate.flows.chambers import WindowSettings
from hydro_ident.estimate.flows.delay import ValveDelay, _differ, _Group
from hydro_ident.estimate.flows.hydraulics import HydraulicFit, fit_hydraulics
from hydro_ident.estimate.signals.traces import traces_of
from hydro_ident.identify.identification import _delay_notes, identify
from hydro_ident.parameters.parameters import cylinder_parameters
from hydro_model.robot import Robot
from hydro_model.robot_files import load_robot

COMMON_S, LATER_S = 0.0004, 0.0012


@pytest.fixture(scope="module")
def run_of(make_run: tuple[Callable[..., Robot], Callable[..., Any]]) -> Callable[..., Any]:
    """`run_of(common, later)`: 12 s of the crane whose lift valve is later than the other."""
    true_crane, simulated_run = make_run

    def run(common_s: float, later_s: float) -> Any:
        crane = replace(true_crane(), command_delay_s=common_s)
        lift, *others = crane.valves
        valves = (replace(lift, command_delay_s=later_s), *others)
        return simulated_run(replace(crane, valves=valves), 12.0)

    return run


@pytest.fixture(scope="module")
def apart(run_of: Callable[..., Any]) -> Any:
    return run_of(COMMON_S, LATER_S)


def _fit(run: Any) -> HydraulicFit:
    fit = fit_hydraulics(load_robot("xs031"), traces_of([run.recording()]))
    assert fit is not None
    return fit


def _moduli_hold(run: Any, fit: HydraulicFit) -> None:
    for true, cylinder in zip(run.robot.cylinders, fit.cylinders, strict=True):
        bulk = cylinder_parameters(run.robot, cylinder, {})[0]
        assert bulk.ci95 is not None
        assert bulk.ci95[0] < true.bulk_modulus_pa < bulk.ci95[1]


def test_each_valve_is_fitted_at_its_own_delay(apart: Any) -> None:
    fit = _fit(apart)
    lift, tilt = (fit.delay_of(valve.name) for valve in apart.robot.valves)
    assert lift == pytest.approx(COMMON_S + LATER_S, abs=5e-5)
    assert tilt == pytest.approx(COMMON_S, abs=5e-5)
    assert tilt < fit.delay_s < lift
    # What is stated as the delay of all reaches every one of them.
    assert max(lift - fit.delay_s, fit.delay_s - tilt) <= fit.delay_std_s
    _moduli_hold(apart, fit)
    for true, cylinder in zip(apart.robot.cylinders, fit.cylinders, strict=True):
        assert cylinder.bulk_modulus()[0] == pytest.approx(true.bulk_modulus_pa, rel=0.004)


@pytest.mark.needs("clarabel")
def test_delays_that_differ_are_said(apart: Any) -> None:
    found = identify(load_robot("xs031"), [apart.recording()])
    [note] = [n for n in found.notes if "delays differ" in n]
    assert "lift_valve 1.6" in note
    assert "tilt_valve 0.4" in note
    assert found.robot is not None
    assert COMMON_S < found.robot.command_delay_s < COMMON_S + LATER_S
    # Eq. 14 beside the chambers: each cylinder's at its own valve's delay.
    for true, one in zip(apart.robot.cylinders, found.summed, strict=True):
        for chamber in (one.chamber_a, one.chamber_b):
            modulus = 1.0 / chamber.theta[chamber.names.index("inverse_bulk_modulus")]
            assert modulus == pytest.approx(true.bulk_modulus_pa, rel=0.004)


def test_valves_that_agree_have_one_delay(run_of: Callable[..., Any]) -> None:
    run = run_of(COMMON_S, 0.0)
    fit = _fit(run)
    assert not fit.valve_delays
    assert fit.delay_s == pytest.approx(COMMON_S, abs=3e-5)
    _moduli_hold(run, fit)


@pytest.mark.thorough
def test_intervals_reach_as_far_as_a_delay_beyond_its_bound(run_of: Callable[..., Any]) -> None:
    """1.6 cycles where one is tried: oil and edges take up the rest, and their intervals say."""
    run = run_of(0.0032, 0.0)
    fit = _fit(run)
    assert fit.delay_s == fit.longest_s == 0.002
    _moduli_hold(run, fit)
    for cylinder in fit.cylinders:
        own = max(c.fit.std[0] for c in cylinder.chambers)
        assert cylinder.value("inverse_bulk_modulus")[1] > 2.0 * own


def _group(delay_s: float, beyond_s: float, std_s: float) -> Any:
    return _Group({}, delay_s, beyond_s, {"own": SimpleNamespace(variance=std_s**2, dof=9.0)})


def test_how_far_beyond_its_bound_a_delay_would_be_makes_no_difference() -> None:
    """Steps of noise: 30 ms beyond a bound of 2 ms, where the deviation is 6 ms."""
    unsure = [_group(0.002, 0.030, 0.00643), _group(0.0, -0.002, 0.00128)]
    assert not _differ(unsure, 0.002)
    assert _differ([_group(0.002, 0.001, 2e-5), _group(0.0004, 0.0, 2e-5)], 0.002)


def test_a_valve_that_never_moved_has_no_delay_in_the_note() -> None:
    delays = {"a": ValveDelay(0.0014, 1e-5), "b": ValveDelay(0.0007, math.inf)}
    [note] = _delay_notes(HydraulicFit(0.001, 5e-4, (), WindowSettings(), valve_delays=delays))
    assert "inf" not in note
    assert "a 1.40 +- 0.01, b not told" in note
