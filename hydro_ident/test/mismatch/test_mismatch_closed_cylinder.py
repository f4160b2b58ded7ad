"""A joint that is parked behind a closed valve: its oil is a spring, and it swings on that."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from hydro_ident.estimate.forces.standstill import least_travel
from hydro_ident.mismatch.answer.odd_valve import odd_valve
from hydro_ident.mismatch.fitting.fitting import fit
from hydro_ident.mismatch.modelling.model import robot_of
from hydro_ident.mismatch.rows.rests import motions_of, moving_rows
from hydro_ident.mismatch.split.residuals import Residuals
from hydro_model.effects.catalogue import resolve
from hydro_model.robot import EffectSpec, Robot
from hydro_model.simulation.simulate import simulate

LIFT, TILT = 0, 1
COUNT_RAD = 2.0 * np.pi / 2**20


def _parked(run: Any, truth: Robot) -> Any:
    """The machine driven by the run's lift valve alone, the other one at 0 V, with noise."""
    voltage, rng = run.voltage * [1.0, 0.0], np.random.default_rng(5)
    out = simulate(truth, 0.002 * np.arange(len(voltage)), voltage, run.q[0])

    def read(values: np.ndarray, step: float, spread: float) -> np.ndarray:
        return step * np.round(values / step + rng.normal(0.0, spread, values.shape))

    pressures = {n: read(getattr(out, n), 1e3, 4.0) for n in ("p_a", "p_b")}
    return replace(run, q=read(out.q, COUNT_RAD, 0.5), voltage=voltage, **pressures)


@pytest.fixture(scope="module")
def parked(crane_run: Any) -> Any:
    return _parked(crane_run, crane_run.robot)


@pytest.fixture(scope="module")
def laid(parked: Any, lay_out: Callable[..., Residuals]) -> Residuals:
    return lay_out(parked)


def _rms(work: Residuals, channel: str) -> float:
    material = work.training.predictor.material
    own = work.training.mask & (material.channel == material.channels.index(channel))
    return float(np.sqrt(np.mean(work.base.residual[own] ** 2)))


def test_the_others_feel_how_it_swings(laid: Residuals, parked: Any) -> None:
    """What a cylinder's oil lets its joint do is in their forces, and nothing else is left."""
    travel = np.ptp(parked.q[:, TILT])
    assert 100.0 * COUNT_RAD < travel < least_travel(laid.robot)[TILT]
    (stretch,) = laid.training.predictor.material.stretches
    assert stretch.moved is not None
    assert np.ptp(stretch.moved.q[:, TILT]) == pytest.approx(travel, rel=0.1)
    assert _rms(laid, "lift/force") < 1.5 * laid.noise_floors()["lift/force"]


def test_its_own_force_is_not_asked(laid: Residuals) -> None:
    material = laid.training.predictor.material
    own = material.channel == material.channels.index("tilt/force")
    assert own.any()
    assert not (laid.training.mask & own).any()
    assert motions_of(material, TILT) == 0


def test_a_valve_that_was_never_moved_makes_no_other_late(laid: Residuals) -> None:
    """It has no delay to compare with, and none to average the others' with."""
    training, true_s = laid.training, 0.0013
    assert list(training.predictor.delay_columns) == [LIFT]
    assert laid.base.model.delays_s[LIFT] == pytest.approx(true_s, abs=3.0e-5)
    assert odd_valve(training, laid.base) is None
    found = robot_of(training.predictor, laid.base, laid.robot)
    assert found.robot.command_delay_s == laid.base.model.delays_s[LIFT]
    assert not any("delays differ" in note for note in found.notes)
    off_s = abs(found.robot.command_delay_s - true_s)
    assert off_s < 4.0 * found.robot.standard_deviations["command_delay"]


def test_what_leaks_behind_a_closed_valve_is_asked(
    crane_run: Any, lay_out: Callable[..., Residuals]
) -> None:
    """Its signal answers to nothing; `internal_leakage` is told apart by such a recording."""
    leak = EffectSpec("internal_leakage", "tilt_cylinder", {"coefficient": 1.0e-13})
    run = _parked(crane_run, replace(crane_run.robot, effects=(leak,)))
    work = lay_out(run)
    assert np.ptp(run.q[:, TILT]) < least_travel(work.robot)[TILT]
    (term,) = resolve(replace(work.robot, effects=(leak,)))
    start = work.base.model.with_term(replace(term, parameters=0.1 * term.parameters))
    found = fit(work.training, start)
    assert found.model.terms[-1].parameters[0] == pytest.approx(1.0e-13, rel=0.05, abs=0.0)


def test_a_loop_that_holds_a_joint_in_its_encoders_noise_tells_nothing_of_its_valve(
    parked: Any, lay_out: Callable[..., Residuals]
) -> None:
    """Unless it opens the valve by a tenth of all, and nothing moves."""
    noise = 0.02 * np.random.default_rng(1).normal(size=len(parked.voltage))
    for opened_v in (0.0, 2.0):
        voltage = parked.voltage.copy()
        voltage[:, TILT] = noise
        voltage[4000:4500, TILT] += opened_v
        material = lay_out(replace(parked, voltage=voltage)).training.predictor.material
        own = material.channel == material.channels.index("tilt/flow_a")
        asked = material.time_s[own & moving_rows(material)]
        begin, end = material.stretches[0].trace.time_s[[4000, 4500]]
        assert (asked.size > 10) == (opened_v > 0.0)
        assert np.all((asked > begin - 0.2) & (asked < end + 0.2))
