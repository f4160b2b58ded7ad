"""A valve that is later than the others: told with its reason, not hidden in the base's delay."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from hydro_ident.mismatch.answer.answering import answered
from hydro_ident.mismatch.answer.confirmation import searched
from hydro_ident.mismatch.answer.odd_valve import explains, held_to_others, odd_valve
from hydro_ident.mismatch.fitting.fitted import Fitted
from hydro_ident.mismatch.fitting.fitting import fit
from hydro_ident.mismatch.fitting.training import Training, start_model
from hydro_ident.mismatch.modelling.model import robot_of
from hydro_ident.mismatch.naming.lags import OF_VALVES
from hydro_ident.mismatch.split.residuals import Residuals
from hydro_ident.mismatch.verifying.agreement import fitted_there
from hydro_model.effects.catalogue import resolve
from hydro_model.robot import EffectSpec, Robot
from hydro_model.robot_files import load_robot

Make = tuple[Callable[..., Robot], Callable[..., object]]
CYCLE_S = 0.002
OWN_S, LATER_S = 0.0008, 0.0009
LIFT, TILT = 0, 1
LATE = EffectSpec("command_delay", "tilt_valve", {"delay": LATER_S})


@pytest.fixture(scope="module")
def late(make_run: Make, lay_out: Callable[..., Residuals]) -> Residuals:
    """One valve later than the other by less than a cycle, both within what a base may have."""
    true_crane, simulated_run = make_run
    truth = replace(true_crane(), command_delay_s=OWN_S, effects=(LATE,))
    return lay_out(simulated_run(truth, 13.0))


@pytest.fixture(scope="module")
def plain(make_run: Make, lay_out: Callable[..., Residuals]) -> Residuals:
    """Nothing left out."""
    true_crane, simulated_run = make_run
    return lay_out(simulated_run(replace(true_crane(), command_delay_s=OWN_S), 13.0))


@pytest.mark.thorough
def test_the_bases_delay_hides_it(late: Residuals) -> None:
    _, whole, findings, _ = searched(late, late.base)
    assert not findings
    delays_s = np.array(whole.model.delays_s)
    assert delays_s[TILT] - delays_s[LIFT] == pytest.approx(LATER_S, rel=0.1)
    assert odd_valve(late.training, whole) == TILT


@pytest.mark.thorough
def test_it_is_found_as_what_makes_a_valve_late(late: Residuals) -> None:
    answer = answered(late, late.base)
    (finding,) = answer.findings
    assert set(finding.named.names) <= set(OF_VALVES)
    assert "command_delay" in finding.named.names
    assert finding.named.term.cylinder == TILT
    delays = [c.term.parameters[0] for c in finding.named.tried if c.name == "command_delay"]
    assert delays[0] == pytest.approx(LATER_S, rel=0.1)
    # The base is left with what both valves have.
    assert answer.whole.model.delays_s[TILT] <= answer.whole.model.delays_s[LIFT] + 1.0e-6


def test_a_base_held_to_the_others_misses_what_the_valve_is_late_by(late: Residuals) -> None:
    held = held_to_others(late, late.base, TILT)
    lift_s, tilt_s = held.base.model.delays_s
    assert tilt_s == pytest.approx(late.base.model.delays_s[LIFT])
    assert lift_s == pytest.approx(OWN_S, abs=5.0e-5)
    assert held.scan is held.training
    # The same rows, weighed alike: what the free delay took up is left.
    noise = late.base.bench.noise
    free = fit(late.training, late.base.model, noise)
    tied = fit(held.training, held.base.model, noise)
    assert tied.squares > 2.0 * free.squares


def test_rows_to_verify_on_hold_the_valve_to_the_others_as_well(late: Residuals) -> None:
    """The same model fitted to them takes up no more: what the valve is later by is left there."""
    held = held_to_others(late, late.base, TILT)
    there, free = (fitted_there(w.training, w.check, held.base) for w in (held, late))
    assert there is not None
    assert free is not None
    assert free.model.delays_s[TILT] - free.model.delays_s[LIFT] == pytest.approx(LATER_S, rel=0.1)
    assert there.model.delays_s[TILT] == pytest.approx(held.base.model.delays_s[TILT], abs=1e-9)


def test_valves_alike_are_none(plain: Residuals) -> None:
    assert odd_valve(plain.training, plain.base) is None


def test_what_was_told_already_is_not_asked_again(late: Residuals) -> None:
    whole = late.base
    for target in ("tilt_valve", "xs031"):
        assert odd_valve(late.training, _with(late, whole, target)) is None


def test_a_difference_within_its_doubt_is_none(late: Residuals) -> None:
    """As after a cycle of work that hardly moves the valves."""
    assert odd_valve(late.training, late.base) == TILT
    at = list(late.training.predictor.delay_columns.values())
    covariance = late.base.covariance.copy()
    covariance[at, at] = (0.3 * LATER_S) ** 2
    assert odd_valve(late.training, _Doubted(late.base, covariance)) is None  # type: ignore[arg-type]


def test_a_delay_that_no_row_tells_is_none_to_compare_with(late: Residuals) -> None:
    """Of a valve whose rows are all left out: it stays as the file has it, without deviation."""
    predictor = late.training.predictor
    channels = np.array(predictor.material.channels)[predictor.material.channel]
    rows = late.training.mask & ~np.char.startswith(channels, "tilt/flow")
    training = Training.of(predictor, rows, late.training.prior)
    base = fit(training, start_model(late.robot, predictor))
    assert base.model.delays_s[TILT] == late.robot.command_delay_s
    assert base.model.delays_s[LIFT] == pytest.approx(OWN_S, abs=5.0e-5)
    assert odd_valve(training, base) is None
    found = robot_of(predictor, base, late.robot)
    assert found.robot.command_delay_s == base.model.delays_s[LIFT]
    assert not any("delays differ" in note for note in found.notes)


def test_one_delay_for_all_is_the_better_told_ones(plain: Residuals) -> None:
    """Unless they surely differ."""
    predictor, (lift, tilt) = plain.training.predictor, (0.0006, 0.0012)
    model = replace(plain.base.model, delays_s=(lift, tilt))
    at = list(predictor.delay_columns.values())
    for sizes_s, delay_s in (((1.0e-5, 3.0e-4), lift), ((1.0e-5, 1.0e-5), 0.5 * (lift + tilt))):
        covariance = plain.base.covariance.copy()
        covariance[at, at] = np.square(sizes_s)
        told = replace(plain.base, model=model, refined=covariance)
        found = robot_of(predictor, told, plain.robot)
        assert found.robot.command_delay_s == pytest.approx(delay_s, rel=0.01)
        differ = any("delays differ" in note for note in found.notes)
        assert differ == (sizes_s[LIFT] == sizes_s[TILT])


@pytest.mark.thorough
def test_nor_is_a_delay_at_its_bound_that_the_rows_do_not_tell(
    make_run: Make, lay_out: Callable[..., Residuals]
) -> None:
    """It is held there, and has no deviation for that: how well it is told is another matter."""
    true_crane, simulated_run = make_run
    beyond = replace(LATE, parameters={"delay": 0.9 * CYCLE_S})
    run = simulated_run(replace(true_crane(), command_delay_s=OWN_S, effects=(beyond,)), 18.0)
    rng = np.random.default_rng(1)
    for noise_pa, odd in ((1.0e5, TILT), (1.0e6, None)):
        p_a, p_b = run.p_a.copy(), run.p_b.copy()
        for pressure in (p_a, p_b):
            pressure[:, TILT] += noise_pa * rng.normal(size=len(pressure))
        work = lay_out(replace(run, p_a=p_a, p_b=p_b))
        assert work.base.model.delays_s[TILT] == pytest.approx(1.25 * CYCLE_S)
        assert odd_valve(work.training, work.base) == odd


def test_which_effects_explain_a_late_valve() -> None:
    assert explains({("valve_rate_limit", TILT), ("coulomb_friction", LIFT)}, TILT)
    assert not explains({("valve_rate_limit", TILT)}, LIFT)
    assert not explains({("coulomb_friction", TILT), ("command_delay", None)}, TILT)


class _Doubted:
    """A fit whose numbers are told less well."""

    def __init__(self, fitted: Fitted, covariance: np.ndarray) -> None:
        self.model, self.covariance = fitted.model, covariance
        self.names, self.held = fitted.names, fitted.held


def _with(work: Residuals, whole: Fitted, target: str) -> Fitted:
    spec = EffectSpec("command_delay", target, {"delay": LATER_S})
    (term,) = resolve(replace(load_robot("xs031"), effects=(spec,)))
    return fit(work.training, whole.model.with_term(term), passes=1)
