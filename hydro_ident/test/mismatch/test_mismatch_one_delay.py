"""Spools that all lag, or commands that are late: which it is, once all else stands."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest

from hydro_ident.identify.survey import survey_source
from hydro_ident.mismatch.answer.confirmation import searched
from hydro_ident.mismatch.fitting.fitted import Fitted, fitted
from hydro_ident.mismatch.fitting.fitting import fit
from hydro_ident.mismatch.modelling.model import robot_of
from hydro_ident.mismatch.naming.contest import Contest
from hydro_ident.mismatch.naming.lags import OF_VALVES, lag_s, resolved
from hydro_ident.mismatch.naming.name import Searcher
from hydro_ident.mismatch.naming.named import Named, named_of
from hydro_ident.mismatch.naming.one_delay import as_one_delay
from hydro_ident.mismatch.naming.revision import Revision
from hydro_ident.mismatch.naming.valley import from_one_delay
from hydro_ident.mismatch.rows.prediction import Model
from hydro_ident.mismatch.settings import DiagnosisSettings
from hydro_ident.mismatch.split.residuals import Residuals, residuals
from hydro_ident.recordings.sources import sources_of
from hydro_model.effects.catalogue import resolve
from hydro_model.robot import EffectSpec, Robot
from hydro_model.robot_files import load_robot

Make = tuple[Callable[..., Robot], Callable[..., object]]
CYCLE_S = 0.002
BENT = EffectSpec("valve_gain_nonlinearity", "lift_valve", {"progression": -0.05})
LATE = EffectSpec("command_delay", "xs031", {"delay": 0.004})
LAGS = tuple(
    EffectSpec("valve_spool_lag", f"{joint}_valve", {"frequency": hz, "damping": 0.8})
    for joint, hz in (("lift", 60.0), ("tilt", 40.0))
)


def _lagging(
    work: Residuals,
    truth: Sequence[EffectSpec],
    *others: EffectSpec,
    lags: Sequence[EffectSpec] = LAGS,
) -> tuple[Contest, list[Named], Fitted]:
    """A lag at every spool as findings, `others` beside them, weighed by what the truth leaves."""
    noise = fit(work.training, _with(work, truth), passes=8).bench.noise
    whole = fit(work.training, _with(work, (*lags, *others)), noise, passes=12)
    contest, named = Contest(work.training), []
    for lag in whole.model.terms[: len(lags)]:
        gone = (lag.effect, lag.target)
        rest = tuple(t for t in whole.model.terms if (t.effect, t.target) != gone)
        without = fit(work.training, replace(whole.model, terms=rest), noise, passes=2)
        named.append(contest.weighed(without, [lag], noise, 1.0))
    return contest, named, whole


def _with(work: Residuals, effects: Sequence[EffectSpec]) -> Model:
    model = work.base.model
    for one in resolve(replace(load_robot("xs031"), effects=tuple(effects))):
        model = model.with_term(one)
    return model


@pytest.fixture(scope="module")
def late(make_run: Make, lay_out: Callable[..., Residuals]) -> Residuals:
    """Commands that are 4 ms later than a cycle, and a bent valve."""
    true_crane, simulated_run = make_run
    truth = replace(true_crane(), command_delay_s=3.0 * CYCLE_S, effects=(BENT,))
    return lay_out(simulated_run(truth, 13.0))


@pytest.mark.thorough
def test_one_delay_takes_the_place_of_lags_that_say_no_more(late: Residuals) -> None:
    contest, lags, whole = _lagging(late, (LATE, BENT), BENT)
    found, after = as_one_delay(contest, lags, whole)
    assert [n.names[0] for n in found] == ["command_delay"]
    assert found[0].term.cylinder is None
    assert after.model.delays_s == pytest.approx([CYCLE_S] * 2, abs=1.0e-5)
    assert float(found[0].term.parameters[0]) == pytest.approx(2.0 * CYCLE_S, abs=2.0e-4)
    # The other effect stays as it is.
    kept = [t for t in after.model.terms if t.effect.name == BENT.name]
    assert [t.parameters[0] for t in kept] == pytest.approx([-0.05], abs=0.01)
    assert contest.held_out(after) < contest.held_out(whole)


@pytest.mark.thorough
def test_nor_need_the_lags_be_of_one_name(late: Residuals) -> None:
    """What the one spool's lag says as well as the other's slew limit may be said by one delay."""
    slow = EffectSpec("valve_rate_limit", "tilt_valve", {"rate": 8.0})
    contest, lags, whole = _lagging(late, (LATE, BENT), BENT, lags=(LAGS[0], slow))
    assert len({n.names[0] for n in lags}) == 2
    found, after = as_one_delay(contest, lags, whole)
    assert [n.names[0] for n in found] == ["command_delay"]
    assert contest.held_out(after) < contest.held_out(whole)


@pytest.mark.thorough
def test_a_delay_that_was_refused_does_not_come_back_in_the_place_of_lags(
    late: Residuals,
) -> None:
    """What held-out rows have refused is not sought again, and not put in another's place."""
    refused = LATE.name, LATE.target
    search = Searcher(late.training, late.base, {refused}).run()
    assert len([n for n in search.named if n.term.effect.name in OF_VALVES]) > 1
    terms = [*search.fitted.model.terms, *(n.term for n in search.named)]
    assert refused not in {(t.effect.name, t.target) for t in terms}


def test_beside_a_delay_only_what_makes_valves_late_is_weighed_at_each(
    late: Residuals, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Once the base's delays have moved, any law gains what they do."""
    held = EffectSpec("pressure_compensation", "lift_valve", {"share": 0.1, "margin": 7e5})
    noise, contest = late.base.bench.noise, Contest(late.training)
    without = fitted(late.training, late.base.model, noise)
    terms = _with(late, (LATE, held, LAGS[0])).terms
    found = named_of(contest.fitted(without, terms, noise), 0.0005, 1.0)
    assert found.term.effect.name == "command_delay"
    assert {c.term.effect.name for c in found.tried} > {"pressure_compensation"}
    asked: list[str] = []
    monkeypatch.setattr(Contest, "_at_all", lambda *given: asked.append(given[-1]) or [])
    contest.at_each(late.base, noise, found, ())
    assert "valve_spool_lag" in asked
    assert set(asked) <= set(OF_VALVES)


@pytest.mark.thorough
def test_spools_that_all_lag_are_begun_anew_together(
    make_run: Make, lay_out: Callable[..., Residuals]
) -> None:
    """One alone is fitted beside a base that is late at the other: neither is told."""
    true_crane, simulated_run = make_run
    slow = tuple(
        EffectSpec("valve_spool_lag", f"{joint}_valve", {"frequency": hz, "damping": 0.6})
        for joint, hz in (("lift", 24.0), ("tilt", 20.0))
    )
    work = lay_out(simulated_run(replace(true_crane(), effects=slow), 13.0))
    noise = fit(work.training, _with(work, slow), passes=8).bench.noise
    contest, without = Contest(work.training), fitted(work.training, work.base.model, noise)
    (delay,) = contest.fitted(without, _with(work, (LATE,)).terms, noise)
    # Where such fits come to rest: damped so much that frequency and damping are one number.
    resting = [replace(one, parameters={"frequency": 450.0, "damping": 2.9}) for one in LAGS]
    alone = [
        replace(delay, term=one, fitted=fitted(work.training, base.with_term(one), noise).weighed)
        for base, one in ((work.base.model, term) for term in _with(work, resting).terms)
    ]
    found = replace(named_of([delay], 0.0005, 1.0), tried=(delay, *alone))
    each = contest.at_each(work.base, noise, found, ())
    assert [n.names[0] for n in each.named] == ["valve_spool_lag"] * 2
    late_s = [lag_s(t) + d for t, d in zip(each.model.terms, each.model.delays_s, strict=True)]
    own_s = true_crane().command_delay_s
    true_s = [0.6 / (np.pi * hz) + own_s for hz in (24.0, 20.0)]
    assert late_s == pytest.approx(true_s, abs=1.5e-4)


@pytest.mark.thorough
def test_what_was_named_is_weighed_again_whatever_another_gained_in_training(
    late: Residuals,
) -> None:
    """A law that bends to the rows of its fit gains twice as much there and says little else."""
    whole = fit(late.training, _with(late, (LATE, BENT)), passes=8)
    noise, contest = whole.bench.noise, Contest(late.training)
    without = fit(late.training, _with(late, (BENT,)), noise, passes=2)
    lag, delay = contest.fitted(without, _with(late, (LATE, LAGS[0])).terms, noise)
    bent = replace(lag, gain=2.5 * delay.gain, held_out=0.1 * delay.held_out)
    named = named_of([delay, bent], 0.0005, 1.0)
    assert named.names == ("command_delay",)
    _, again = Revision(Searcher(late.training, late.base).contest).again(named, whole)
    assert again is not None
    assert again.names[0] == "command_delay"


def test_an_effect_of_one_joint_is_not_the_whole_robots(
    late: Residuals, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An encoder's offset leaves its place to no laws at every cylinder."""
    turned = EffectSpec("encoder_offset", "lift", {"offset": 0.01})
    biased = EffectSpec("pressure_sensor_bias", "lift_cylinder/a", {"bias": 1e5})
    noise, contest = late.base.bench.noise, Contest(late.training)
    without = fitted(late.training, late.base.model, noise)
    terms = _with(late, (turned, biased)).terms
    found = named_of(contest.fitted(without, terms, noise), 0.0005, 1.0)
    found = replace(found, contenders=tuple(c for c in found.tried if c.term.joint == 0)[:1])
    assert found.term.effect.name == "encoder_offset"
    monkeypatch.setattr(Contest, "_at_all", lambda *given: pytest.fail(f"tried {given[-1]}"))
    each = contest.at_each(late.base, noise, found, ())
    assert list(each.named) == [found]


@pytest.mark.thorough
def test_a_delay_shows_at_every_valve_though_they_differ(
    make_run: Make, lay_out: Callable[..., Residuals]
) -> None:
    """The base's own delays take up none of what a delay says, not even where they are free."""
    true_crane, simulated_run = make_run
    slower = replace(LAGS[0], parameters={"frequency": 900.0, "damping": 0.8})
    truth = replace(true_crane(), command_delay_s=1.8 * CYCLE_S, effects=(slower,))
    work = lay_out(simulated_run(truth, 13.0), [simulated_run(truth, 12.0, seed=5)])
    _, _, (found,), _ = searched(work, work.base)
    assert found.named.term.effect.name == "command_delay"
    flows = {f"{joint}/flow_{side}" for joint in ("lift", "tilt") for side in "ab"}
    assert set(found.channels) == flows


@pytest.mark.parametrize("late_s", [0.7e-3, 1.3e-3])
def test_a_delay_says_all_that_goes_beyond_a_cycle(
    late_s: float, make_run: Make, lay_out: Callable[..., Residuals]
) -> None:
    """The base keeps none of it, though it may have a quarter of a cycle where nothing is named.

    Valves whose spools lag by parts of a millisecond, 2 zeta / w each, are later by different
    times: the slower keeps what it is later than the other.
    """
    true_crane, simulated_run = make_run
    hz = 900.0, 1400.0
    quick = tuple(
        replace(spec, parameters={"frequency": f, "damping": 0.8})
        for spec, f in zip(LAGS, hz, strict=True)
    )
    lag_s = [2.0 * 0.8 / (2.0 * np.pi * f) for f in hz]
    truth = replace(true_crane(), command_delay_s=CYCLE_S + late_s, effects=quick)
    work = lay_out(simulated_run(truth, 13.0))
    start = replace(LATE, parameters={"delay": 1.0e-4})
    assert max(work.base.model.delays_s) == pytest.approx(1.25 * CYCLE_S, rel=1e-3)
    whole = fit(work.training, _with(work, [start]), passes=4)
    found = whole.model
    # At its end the base does not know how late they are, nor how well.
    told = [
        robot_of(work.training.predictor, one, work.robot).robot.standard_deviations
        for one in (work.base, whole)
    ]
    assert ["command_delay" in deviations for deviations in told] == [False, True]
    expected = [CYCLE_S + lag_s[0] - lag_s[1], CYCLE_S]
    assert found.delays_s == pytest.approx(expected, abs=1.5e-5)
    assert found.delays_s[1] == pytest.approx(CYCLE_S, abs=1.0e-9)
    assert float(found.terms[0].parameters[0]) == pytest.approx(late_s + lag_s[1], abs=5.0e-5)


def test_a_valve_without_pressures_says_nothing_of_the_others_delay(
    make_run: Make, lay_out: Callable[..., Residuals]
) -> None:
    """Its delay is not fitted: what all the others are late by is no shorter for it."""
    true_crane, simulated_run = make_run
    run = simulated_run(replace(true_crane(), command_delay_s=1.6 * CYCLE_S), 13.0)
    p_a, p_b = run.p_a.copy(), run.p_b.copy()
    p_a[:, 1] = p_b[:, 1] = np.nan
    work = lay_out(replace(run, p_a=p_a, p_b=p_b))
    assert list(work.training.predictor.delay_columns) == [0]
    noise = work.base.bench.noise
    start = replace(LATE, parameters={"delay": 0.5 * CYCLE_S})
    [found] = Contest(work.training).fitted(work.base, _with(work, [start]).terms, noise)
    late_s = found.term.parameters[0] + found.fitted.model.delays_s[0]
    assert late_s == pytest.approx(1.6 * CYCLE_S, abs=1e-4)
    assert resolved(work.training, work.base, found)


@pytest.mark.thorough
def test_spools_that_lag_stay_as_they_are(
    make_run: Make, lay_out: Callable[..., Residuals]
) -> None:
    true_crane, simulated_run = make_run
    work = lay_out(simulated_run(replace(true_crane(), effects=LAGS), 13.0))
    contest, lags, whole = _lagging(work, LAGS)
    found, after = as_one_delay(contest, lags, whole)
    assert found == lags
    assert after is whole


def test_one_lag_is_never_made_a_delay(late: Residuals) -> None:
    contest, lags, whole = _lagging(late, (LATE, BENT), BENT)
    found, after = as_one_delay(contest, lags[:1], whole)
    assert found == lags[:1]
    assert after is whole


def test_a_lag_is_told_from_its_valves_delay(
    make_run: Make, lay_out: Callable[..., Residuals]
) -> None:
    """From beside the valley a fit stays halfway; from the other valve's delay it arrives."""
    true_crane, simulated_run = make_run
    work = lay_out(simulated_run(replace(true_crane(), effects=LAGS[:1]), 13.0))
    noise = fit(work.training, _with(work, LAGS[:1]), passes=8).bench.noise
    quick = replace(LAGS[0], parameters={"frequency": 140.0, "damping": 1.95})
    beside = _with(work, [quick])
    beside = replace(beside, delays_s=(1.25 * CYCLE_S, beside.delays_s[1]))
    stuck = fit(work.training, beside, noise, passes=12)
    anew = from_one_delay(work.training, stuck)
    true_s = 0.8 / (np.pi * 60.0)
    assert abs(_lag_s(anew) - true_s) < abs(_lag_s(stuck) - true_s) / 3.0
    # What both come to is told well, however they share it.
    both_s = true_s + true_crane().command_delay_s
    assert _lag_s(anew) + anew.model.delays_s[0] == pytest.approx(both_s, abs=1.0e-4)
    # Once there, it is no better from elsewhere; and without a lag there is nothing to begin.
    assert from_one_delay(work.training, work.base) is work.base


def _lag_s(one: Fitted) -> float:
    frequency, damping = one.model.terms[0].parameters[:2]
    return float(damping / (np.pi * frequency))


def test_a_delay_that_the_robot_file_states_is_the_bases(make_run: Make) -> None:
    """Ten cycles of a slow bus keep no other number of the base from being fitted."""
    true_crane, simulated_run = make_run
    truth = replace(true_crane(), command_delay_s=10.0 * CYCLE_S)
    stated = replace(load_robot("xs031"), command_delay_s=10.0 * CYCLE_S)
    given = replace(simulated_run(truth, 13.0).recording(), robot=stated)
    (source,) = sources_of([given])
    work = residuals(stated, [source], [], [survey_source(source, stated)], DiagnosisSettings())
    assert work is not None
    model = work.base.model
    assert model.delays_s == pytest.approx([10.0 * CYCLE_S] * 2, abs=1e-4)
    found = [c.bulk_modulus_pa for c in model.robot.cylinders]
    assert found == pytest.approx([c.bulk_modulus_pa for c in truth.cylinders], rel=0.02)
