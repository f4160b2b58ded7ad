"""How far left-out physics may move hydraulics, of which some parameters have no column."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from hydro_ident.estimate.effects.left_out import cylinder_errors
from hydro_ident.estimate.effects.listed_effects import ListedEffects
from hydro_ident.estimate.flows.cylinder_fit import CylinderFit
from hydro_ident.estimate.flows.hydraulics import fit_hydraulics
from hydro_ident.identify.estimation import Estimates
from hydro_ident.identify.estimator_choice import Chosen
from hydro_ident.identify.identification import identify
from hydro_ident.identify.rejection import within_bounds
from hydro_ident.parameters.model_statistics import statistics_of
from hydro_ident.study.synthetic import Noise, synthetic_recording
from hydro_model.robot import EffectSpec, Robot
from hydro_model.robot_files import load_robot

LIFT, EDGES = "lift_cylinder", ("c_pa", "c_at", "c_pb", "c_bt")
#: Left-out flow of every chamber, m^3/s.
LEFT_OUT = {f"{joint}/flow_{side}": 1e-6 for joint in ("lift", "tilt") for side in "ab"}


def fitted(robot: Robot, trace: Any, *effects: EffectSpec) -> CylinderFit:
    """The lift, what noise leaves outside its bounds held there."""
    robot = replace(robot, effects=effects)
    listed = ListedEffects.of(robot)
    fit = fit_hydraulics(robot, [trace], None, listed.chamber_columns)
    found = within_bounds(robot, Estimates(None, fit, listed, Chosen("wls", "")))
    assert found.hydraulic is not None
    [lift] = found.hydraulic.cylinders
    assert not lift.rejected
    return lift


def errors(fit: CylinderFit) -> dict[str, float]:
    covariance = cylinder_errors(fit, LEFT_OUT)
    assert np.isfinite(covariance).all()
    return dict(zip(fit.names, np.sqrt(np.diag(covariance)), strict=True))


@pytest.mark.parametrize("held", [1, 2])
@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_what_is_held_at_zero_takes_no_others_model_error(
    robot: Robot, bench: Any, held: int
) -> None:
    """A leakage at its bound has no column: errors are those of a fit that does not list it."""
    trace, rng = bench.run(robot, leakage=-5e-15), np.random.default_rng(0)
    noisy = replace(trace, p_a=trace.p_a + 3e3 * rng.normal(size=trace.p_a.shape))
    noisy = replace(noisy, p_b=trace.p_b + 3e3 * rng.normal(size=trace.p_b.shape))
    external = {"coefficient_a": 1e-13, "coefficient_b": 1e-13}
    listed = [
        EffectSpec("external_leakage", LIFT, external),
        EffectSpec("internal_leakage", LIFT, {"coefficient": 1e-13}),
    ][:held]
    plain, bounded = fitted(robot, noisy), fitted(robot, noisy, *listed)
    at_zero = [part for part in bounded.held if part.value == 0.0]
    assert len(at_zero) >= held
    expected, found = errors(plain), errors(bounded)
    for name in ("inverse_bulk_modulus", *EDGES):
        assert found[name] == pytest.approx(expected[name], rel=0.15), name
    assert all(found[bounded.names[part.index]] == 0.0 for part in at_zero)


@pytest.mark.thorough
@pytest.mark.needs("clarabel")
@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_a_valve_that_never_opened_ends_no_identification() -> None:
    """Edges that are exactly zero; the other cylinder's errors are what they are without it."""
    run = synthetic_recording(load_robot("xs031"), 18.0, noise=Noise(0.0, 200.0))
    assert run.valve_v is not None
    volts = run.valve_v.copy()
    volts[:, 0] = 0.0
    found = [identify(run.robot, [r]) for r in (run, replace(run, valve_v=volts))]
    assert found[1].verdict == "partly_identified"
    whole = found[0].hydraulic
    assert whole is not None
    assert found[1].hydraulic is not None
    [lift, tilt] = found[1].hydraulic.cylinders
    assert lift.rejected
    assert not tilt.rejected
    assert not cylinder_errors(lift, LEFT_OUT)[1:, 1:].any()
    statistics = [statistics_of(f.parameters, f.inertial, f.hydraulic, f.channels) for f in found]
    assert statistics[0].model_error.keys() >= statistics[1].model_error.keys()
    assert errors(tilt) == pytest.approx(errors(whole.cylinders[1]), rel=0.1)
