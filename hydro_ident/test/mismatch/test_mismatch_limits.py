"""Steps of fits whose numbers are at the ends of what they may be."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.optimize import minimize

from hydro_ident.mismatch.fitting.bench import Bench
from hydro_ident.mismatch.fitting.fitted import fitted
from hydro_ident.mismatch.fitting.fitting import fit
from hydro_ident.mismatch.fitting.limits import Limits, solved_within
from hydro_ident.mismatch.fitting.stepping import is_free, stepped, term_limits
from hydro_ident.mismatch.fitting.whitening import Layout, Noise
from hydro_ident.mismatch.naming.named import named_of
from hydro_ident.mismatch.split.residuals import Residuals
from hydro_ident.mismatch.trials.contender import Contender
from hydro_ident.mismatch.verifying.verify import verify
from hydro_model.effects.catalogue import resolve
from hydro_model.effects.targets import ActiveEffect
from hydro_model.robot import EffectSpec, Robot
from hydro_model.robot_files import load_robot

ROWS = 400


def _columns(count: int) -> tuple[np.ndarray[Any, Any], np.ndarray[Any, Any]]:
    rng = np.random.default_rng(3)
    x = rng.standard_normal((ROWS, count)) @ (np.eye(count) + 0.6)
    return x, x @ np.array([3.0, -2.0, 0.5, 1.0]) + rng.standard_normal(ROWS)


@pytest.mark.parametrize("fixed", [0.0, 0.7])
def test_coefficients_within_limits_are_a_minimisers(fixed: float) -> None:
    x, y = _columns(4)
    limits = Limits(np.array([-1.0, -1.0, -np.inf, fixed]), np.array([1.0, 2.0, np.inf, fixed]))
    found = solved_within(x, y, limits)
    ends = list(zip(limits.lower, limits.upper, strict=True))
    own = minimize(lambda t: 0.5 * np.sum((y - x @ t) ** 2), np.zeros(4), bounds=ends, tol=1e-12)
    assert found == pytest.approx(own.x, abs=1e-4)
    # What is cut off afterwards leaves the others where they were wanted.
    cut = np.clip(np.linalg.lstsq(x, y, rcond=None)[0], limits.lower, limits.upper)
    assert np.sum((y - x @ cut) ** 2) > 1.2 * np.sum((y - x @ found) ** 2)


def test_what_a_step_takes_out_is_what_the_rows_lose() -> None:
    x, y = _columns(4)
    layout = Layout(
        np.zeros(ROWS, dtype=np.intp), np.zeros(ROWS, dtype=np.intp), np.arange(ROWS) * 0.02,
        np.zeros(ROWS, dtype=bool),
    )  # fmt: skip
    bench = Bench(layout, Noise((np.zeros(0),), np.ones(1)), y, x, 1.0)
    limits = Limits(np.full(4, -0.5), np.full(4, 0.5))
    step = bench.solve(limits=limits)
    assert bench.taken_out(step) == pytest.approx(np.sum(y**2) - np.sum((y - x @ step) ** 2))
    assert bench.taken_out(bench.solve()) == pytest.approx(
        np.sum(y**2) - bench.residual @ bench.residual
    )


def _friction(robot: Robot, velocity_m_s: float, turning_m_s: float) -> list[ActiveEffect]:
    """A dry friction that falls off, from where a fit begins."""
    falling = {"force": 60.0, "stribeck_velocity": velocity_m_s, "exponent": 1.0}
    turning = {"velocity_scale": turning_m_s}
    effects = (
        EffectSpec("coulomb_friction", "tilt_cylinder", {"force": 200.0} | turning),
        EffectSpec("stribeck_friction", "tilt_cylinder", falling | turning),
    )
    return list(resolve(replace(robot, effects=effects)))


def test_a_shape_goes_by_factors_and_no_number_beyond_its_bound(robot: Robot) -> None:
    term = _friction(robot, 0.015, 0.002)[1]
    names = [s.name for i, s in enumerate(term.effect.parameters) if is_free(term, i)]
    limits = term_limits(term)
    ends = dict(zip(names, zip(limits.lower, limits.upper, strict=True), strict=True))
    assert ends["exponent"] == pytest.approx((-0.5, 0.5))
    assert ends["force"] == pytest.approx((-60.0, 1e5 - 60.0))
    assert ends["velocity_scale"] == pytest.approx((-0.001, 0.001))
    far = stepped(term, np.full(limits.lower.size, -1e9)).parameters
    assert far[[s.name in names for s in term.effect.parameters]] == pytest.approx(
        [0.0, 0.0075, 0.001, 0.5]
    )


@pytest.mark.parametrize(
    ("velocity_m_s", "turning_m_s"),
    [(0.03, 0.0025), pytest.param(0.002, 0.01, marks=pytest.mark.thorough)],
)
def test_what_is_at_a_limit_does_not_keep_the_others_from_theirs(
    lay_out: Callable[..., Residuals],
    make_run: tuple[Callable[..., Any], Callable[..., Any]],
    robot: Robot,
    velocity_m_s: float,
    turning_m_s: float,
) -> None:
    true_crane, simulated_run = make_run
    falling = {"force": 400.0, "stribeck_velocity": 0.004, "exponent": 2.0}
    turning = {"velocity_scale": 0.001}
    effects = (
        EffectSpec("coulomb_friction", "tilt_cylinder", {"force": 400.0} | turning),
        EffectSpec("stribeck_friction", "tilt_cylinder", falling | turning),
    )
    crane = replace(true_crane(), effects=effects)
    work, squares = lay_out(simulated_run(crane, 20.0)), list[float]()
    for terms in (list(resolve(crane)), _friction(robot, velocity_m_s, turning_m_s)):
        model = replace(work.base.model, terms=tuple(terms))
        squares.append(fit(work.training, model, work.base.bench.noise, 12).start_squares)
    # In units of the noise's variance: another start ends as near as that from the truth.
    assert squares[1] < squares[0] + 2.0


def test_a_size_that_ran_to_its_end_beside_what_was_named_since_is_none(
    rubbing: Residuals,
) -> None:
    """As it was named it was within; in the model with the others it is not."""
    training, base = rubbing.training, rubbing.base
    spec = EffectSpec("coulomb_friction", "lift_cylinder", {"force": 2500.0})
    (term,) = resolve(replace(load_robot("xs031"), effects=(spec,)))
    whole = fit(training, base.model.with_term(term))
    found = Contender(term, whole.weighed, base.squares - whole.squares, 1e4, 4.0)
    named = named_of([found], 0.001, 1.0)
    assert verify(training, whole, named, rubbing.check).stands
    at_its_end = replace(
        term, parameters=np.where(term.parameters == 2500.0, 1e5, term.parameters)
    )
    gone_on = fitted(training, base.model.with_term(at_its_end), whole.bench.noise)
    said = verify(training, gone_on, named, rubbing.check)
    assert not said.stands
    assert said.reason == "its force ran to the end of what is possible (1e+05 N)"
