"""Multiple shooting: analytic systems, and effects of a simulated crane refined by roll-outs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hydro_ident.bag.recording import Recording
from hydro_ident.identify.survey import survey_source
from hydro_ident.mismatch.fitting.fitted import Fitted, fitted
from hydro_ident.mismatch.fitting.fitting import fit
from hydro_ident.mismatch.fitting.zeros import of_zeros
from hydro_ident.mismatch.modelling.model import robot_of
from hydro_ident.mismatch.modelling.refined_robot import Refinable
from hydro_ident.mismatch.modelling.refinement import Refinement, refine
from hydro_ident.mismatch.modelling.shooting import Solution, Unknowns, shoot
from hydro_ident.mismatch.settings import DiagnosisSettings, RefineSettings
from hydro_ident.mismatch.split.residuals import Residuals, residuals
from hydro_ident.recordings.sources import sources_of
from hydro_model.effects.catalogue import resolve
from hydro_model.robot import EffectSpec, Robot
from hydro_model.robot_files import load_robot

TIMES = np.arange(50) * 0.02
#: Rate and input gain of ``x' = -rate x + gain u`` with a constant input per window.
TRUTH = np.array([1.7, 0.6])
FRICTION_N = 2500.0
BUDGET = RefineSettings(windows=10, window_s=1.2)


def _decay(x: np.ndarray, start: float, pushed: float) -> np.ndarray:
    """``x(t) = x0 e^-at + (b u / a) (1 - e^-at)``."""
    fade = np.exp(-x[0] * TIMES)
    return start * fade + x[1] * pushed / x[0] * (1.0 - fade)


def _measured(rng: np.random.Generator, noise: float) -> list[tuple[float, float, np.ndarray]]:
    """Windows of the system with errors that hang together over a fifth of a window."""
    result = []
    for _ in range(16):
        start, pushed = rng.normal(size=2) * 2.0
        error = np.zeros(TIMES.size)
        for k in range(1, error.size):
            error[k] = 0.9 * error[k - 1] + rng.normal() * noise
        result.append((start, pushed, _decay(TRUTH, start, pushed) + error))
    return result


def _unknowns(start: Sequence[float], information: np.ndarray | None = None) -> Unknowns:
    return Unknowns(
        np.array(start), np.array([0.1, -5.0]), np.array([9.0, 5.0]), np.full(2, 1e-5),
        np.zeros(2, dtype=bool), np.zeros((2, 2)) if information is None else information,
    )  # fmt: skip


def _shot(seen: Sequence[tuple[float, float, np.ndarray]], unknowns: Unknowns) -> Solution:
    solution = shoot(lambda x: [y - _decay(x, s, u) for s, u, y in seen], unknowns, 12)
    assert solution is not None
    return solution


def test_without_noise_the_truth_is_found() -> None:
    solution = _shot(_measured(np.random.default_rng(0), 0.0), _unknowns([0.8, 1.5]))
    assert solution.x == pytest.approx(TRUTH, abs=1e-6)
    assert solution.cost[1] < 1e-9 * solution.cost[0]


def test_intervals_cover_the_truth_although_errors_hang_together() -> None:
    hits, far = np.zeros(2), []
    for seed in range(60):
        one = _shot(_measured(np.random.default_rng(seed), 0.05), _unknowns([1.4, 0.8]))
        std = np.sqrt(np.diag(one.covariance))
        hits += np.abs(one.x - TRUTH) <= one.quantile * std
        far.append((one.x - TRUTH) / std)
    assert np.all(hits / 60.0 >= 0.88)
    # And they are no wider than they have to be.
    assert np.all(np.std(far, axis=0) > 0.7)


def test_bounds_hold() -> None:
    unknowns = replace(_unknowns([1.0, 0.8]), upper=np.array([1.3, 5.0]))
    solution = _shot(_measured(np.random.default_rng(1), 0.01), unknowns)
    assert solution.x[0] == pytest.approx(1.3)


def test_what_is_known_beforehand_counts_by_its_certainty() -> None:
    seen, start = _measured(np.random.default_rng(2), 0.05), np.array([1.4, 0.8])
    alone = _shot(seen, _unknowns(start))
    for deviation, least, most in ((1e-5, 0.0, 0.01), (100.0, 0.95, 1.05)):
        held = _shot(seen, _unknowns(start, np.eye(2) / deviation**2))
        share = (held.x - start) / (alone.x - start)
        assert np.all((share >= least) & (share <= most))
        size = np.sqrt(np.diag(held.covariance))
        expected = np.minimum(deviation, np.sqrt(np.diag(alone.covariance)))
        assert size == pytest.approx(expected, rel=0.1)


def test_what_cannot_be_rolled_out_is_no_step() -> None:
    seen = _measured(np.random.default_rng(3), 0.0)

    def errors(x: np.ndarray) -> list[np.ndarray] | None:
        return None if x[0] > 1.72 else [y - _decay(x, s, u) for s, u, y in seen]

    solution = shoot(errors, _unknowns([0.8, 1.5]), 20)
    assert solution is not None
    assert solution.x == pytest.approx(TRUTH, abs=1e-3)
    assert shoot(errors, _unknowns([2.0, 0.6])) is None


def _recording(run: object, name: str = "run") -> Recording:
    count = len(run.q)
    rail = np.ones(count)
    return Recording(
        path=Path(name), robot=load_robot("xs031"), stamp_ns=10**18 + np.arange(count) * 2_000_000,
        period_s=0.002, q=run.q, stroke=None, effort=None, p_a=run.p_a, p_b=run.p_b,
        supply=run.robot.supply_pressure_pa * rail, tank=run.robot.tank_pressure_pa * rail,
        valve_v=run.voltage, valve_source="/valve_state", command_v=run.voltage, spool=None,
        latched=np.zeros(count, dtype=bool), q_ref=None, qd_ref=None, force_ref=None,
        tip_ref=None, temperature_stamp_ns=None, temperature_c=None, losses=(), gaps=(),
        duplicates={}, notes=(), metadata={},
    )  # fmt: skip


def _work(run: object, check: object) -> Residuals:
    robot = load_robot("xs031")
    sources, others = sources_of([_recording(run)]), sources_of([_recording(check, "check")])
    surveys = [survey_source(source, robot) for source in (*sources, *others)]
    work = residuals(robot, sources, others, surveys, DiagnosisSettings())
    assert work is not None
    return work


def _spec(force_n: float) -> EffectSpec:
    return EffectSpec("coulomb_friction", "lift_cylinder", {"force": force_n})


@pytest.fixture(scope="module")
def machine(make_run: tuple) -> Callable[[float, int], object]:
    """Runs of the crane with some dry friction in its lift cylinder."""
    true_crane, simulated_run = make_run

    def run(force_n: float, seed: int) -> object:
        return simulated_run(replace(true_crane(), effects=(_spec(force_n),)), 12.0, seed)

    return run


@pytest.fixture(scope="module")
def work(machine: Callable[[float, int], object]) -> Residuals:
    return _work(machine(FRICTION_N, 0), machine(FRICTION_N, 3))


@pytest.fixture(scope="module")
def whole(work: Residuals) -> Fitted:
    term = resolve(replace(load_robot("xs031"), effects=(_spec(1500.0),)))[0]
    return fit(work.training, work.base.model.with_term(term))


def _supposed(work: Residuals, whole: Fitted, force_n: float, std_n: float) -> Fitted:
    """The fit with another friction, known to some deviation."""
    term = whole.model.terms[0]
    changed = replace(term, parameters=np.array([force_n, *term.parameters[1:]]))
    other = fitted(work.training, replace(whole.model, terms=(changed,)), whole.bench.noise)
    covariance = whole.bench.covariance.copy()
    at = whole.names.index("lift_cylinder.coulomb_friction.force")
    covariance[at, :] = covariance[:, at] = 0.0
    covariance[at, at] = std_n**2
    return replace(other, refined=covariance)


def _refined(work: Residuals, start: Fitted, settings: RefineSettings = BUDGET) -> Refinement:
    given = robot_of(work.training.predictor, start, work.robot).robot
    return refine(work, start, given, settings, False)


@pytest.mark.thorough
def test_roll_outs_correct_a_friction_that_the_equations_got_wrong(
    work: Residuals, whole: Fitted
) -> None:
    found = _refined(work, _supposed(work, whole, 1800.0, 500.0))
    assert found.accepted, found.reason
    force = next(p for p in found.parameters if p.name.endswith(".force"))
    assert abs(force.value - FRICTION_N) < 0.3 * abs(force.before - FRICTION_N)
    assert force.ci95[0] <= FRICTION_N <= force.ci95[1]
    # Robot, fit and report say the same.
    assert found.robot.effects[0].parameters["force"] == pytest.approx(force.value)
    assert found.whole.model.terms[0].parameters[0] == pytest.approx(force.value)
    std = found.robot.standard_deviations["lift_cylinder.coulomb_friction.force"]
    assert 0.0 < std <= force.std
    assert found.rollouts <= BUDGET.rollouts


@pytest.mark.thorough
def test_a_good_fit_is_not_harmed(work: Residuals, whole: Fitted) -> None:
    found = _refined(work, whole)
    force = next(p for p in found.parameters if p.name.endswith(".force"))
    assert force.value == pytest.approx(force.before, abs=2.0 * force.before_std)
    if not found.accepted:
        assert found.whole is whole


@pytest.mark.thorough
def test_what_held_out_windows_contradict_is_refused(
    machine: Callable[[float, int], object], work: Residuals, whole: Fitted
) -> None:
    """The machine that is checked on has the friction that the fit started from."""
    other = _work(machine(FRICTION_N, 0), machine(1800.0, 3))
    start = _supposed(other, whole, 1800.0, 500.0)
    found = _refined(other, start)
    assert not found.accepted
    assert "held-out" in found.reason
    assert found.whole is start
    assert found.robot.effects[0].parameters["force"] == pytest.approx(1800.0)


@pytest.mark.thorough
def test_a_parameter_that_leaves_its_interval_is_refused(work: Residuals, whole: Fitted) -> None:
    """Far off, but said to be known well: one of the two is wrong, and nobody knows which."""
    found = _refined(work, _supposed(work, whole, 400.0, 150.0))
    assert not found.accepted
    assert "beyond what the equations leave open" in found.reason


def test_what_cannot_be_refined_is_said(work: Residuals, whole: Fitted) -> None:
    assert "too few" in _refined(work, whole, RefineSettings(rollouts=100)).reason
    assert "no effects" in _refined(work, work.base).reason
    dry: Robot = replace(work.robot, cylinders=(), valves=())
    assert "cylinder" in refine(work, whole, dry, BUDGET, False).reason


def test_an_accepted_base_carries_its_own_deviations(work: Residuals, whole: Fitted) -> None:
    start = _supposed(work, whole, 1800.0, 500.0)
    predictor = work.training.predictor
    given = robot_of(predictor, start, work.robot).robot
    space = Refinable.of(predictor, start, given, False)
    base = space.directions.shape[1]
    assert space.start[space.free :] == pytest.approx(np.zeros(base))
    own = np.diag([4.0e4, *np.full(space.free - 1, 1e-8), *np.full(base, 0.25)])
    covariance = space.covariance(start, own)
    robot = space.with_deviations(given, covariance)
    fresh, old = robot.standard_deviations, given.standard_deviations
    assert fresh["lift_cylinder.coulomb_friction.force"] == pytest.approx(200.0)
    # Half the deviations of every direction are half those of every number, but for the
    # transducers' zeros, of which roll-outs tell nothing.
    count, zeros = len(given.base_covariance), np.diag(of_zeros(predictor, start))
    modulus = given.cylinders[1].bulk_modulus_pa
    for name, fitted_name, unit in (
        ("tilt_cylinder.bulk_modulus", "tilt_cylinder.inverse_bulk_modulus", modulus**2),
        ("lift_valve.c_pa", "lift_valve.c_pa", 1.0),
        ("lift_cylinder.viscous_friction", "lift_cylinder.viscous_friction", 1.0),
    ):
        zero = unit**2 * zeros[predictor.names.index(fitted_name)]
        assert fresh[name] ** 2 == pytest.approx(0.25 * (old[name] ** 2 - zero), rel=2e-3)
    assert np.diag(robot.base_covariance) == pytest.approx(
        0.25 * (np.diag(given.base_covariance) - zeros[:count]), rel=1e-3
    )
    # And a point one deviation off in a direction is the robot's own step by it.
    x = space.start.copy()
    x[space.free] += 1.0
    moved = space.robot(x)
    at = predictor.names.index("lift_valve.c_pa")
    step = moved.valves[0].c_pa - given.valves[0].c_pa
    assert step == pytest.approx(space.directions[at, 0], abs=1e-16)
