"""A load that is taken up at an instant, which is another one in every recording."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from hydro_ident.mismatch.answer.channel_results import channels_of, rows_of_training
from hydro_ident.mismatch.answer.diagnosis import diagnose
from hydro_ident.mismatch.answer.notes import instant_notes
from hydro_ident.mismatch.answer.outcome import MATCHES
from hydro_ident.mismatch.answer.spoilt import sides_of
from hydro_ident.mismatch.fitting.fitted import Fitted
from hydro_ident.mismatch.fitting.fitting import fit
from hydro_ident.mismatch.locating.precision import least_unconfirmed
from hydro_ident.mismatch.modelling.model import robot_of
from hydro_ident.mismatch.modelling.refinement import refine
from hydro_ident.mismatch.naming.instants import at_own_instants, begun, both_at_own_instants
from hydro_ident.mismatch.naming.named import named_of
from hydro_ident.mismatch.naming.worth import worthy
from hydro_ident.mismatch.rows.onset import beginning, begins
from hydro_ident.mismatch.settings import RefineSettings
from hydro_ident.mismatch.split.held_out import rms
from hydro_ident.mismatch.split.residuals import Residuals
from hydro_ident.mismatch.trials.contender import Contender
from hydro_ident.mismatch.trials.places import ends_of, instants_of
from hydro_ident.mismatch.verifying import verify as verify_module
from hydro_ident.mismatch.verifying.confirm import Confirmer
from hydro_ident.mismatch.verifying.verify import verify
from hydro_model.effects.catalogue import end_s, resolve, start_s
from hydro_model.robot import EffectSpec, FloatArray, Robot
from hydro_model.robot_files import load_robot

MASS_KG, SECONDS, HERE_S, THERE_S = 80.0, 18.0, 11.0, 5.0


def _load(start_s: float) -> EffectSpec:
    return EffectSpec("payload_change", "xs031", {"mass": MASS_KG, "start_s": start_s})


def _runs(
    make_run: tuple[Callable[..., Robot], Callable[..., Any]], *how: tuple[float, float, int]
) -> list[Any]:
    """Runs of one machine by when it takes its load up, their length and seed."""
    true_crane, simulated_run = make_run
    return [
        simulated_run(replace(true_crane(), effects=(_load(start_s),)), seconds, seed=seed)
        for start_s, seconds, seed in how
    ]


@pytest.fixture(scope="module")
def loaded(
    make_run: tuple[Callable[..., Robot], Callable[..., Any]], lay_out: Callable[..., Residuals]
) -> Residuals:
    """Two recordings of one machine, which takes its load up early in the second."""
    here, there = _runs(make_run, (HERE_S, SECONDS, 0), (THERE_S, SECONDS, 3))
    return lay_out(here, [there])


@pytest.fixture(scope="module")
def whole(loaded: Residuals) -> Fitted:
    """The model with the load, as the first recording has it."""
    one = resolve(replace(load_robot("xs031"), effects=(_load(HERE_S),)))[0]
    return fit(loaded.training, loaded.base.model.with_term(one))


def _start(term: Any) -> float:
    return float(term.parameters[1])


@pytest.mark.thorough
def test_a_load_begins_where_the_other_recording_has_it(loaded: Residuals, whole: Fitted) -> None:
    there, tried = at_own_instants(loaded.training, loaded.check, whole.model)
    assert _start(whole.model.terms[0]) == HERE_S
    assert _start(there.terms[0]) == pytest.approx(THERE_S, abs=0.1)
    assert tried["payload_change", "xs031"] > 3
    errors = [
        float(np.sqrt(np.mean(loaded.check.residual(m)[loaded.check.mask] ** 2)))
        for m in (whole.model, there)
    ]
    assert errors[1] < 0.5 * errors[0]


@pytest.mark.thorough
def test_a_load_counts_by_what_no_stepping_sensor_makes(loaded: Residuals) -> None:
    """Nine tenths of what sensors may step by: a load, which weighs by where the joints stand."""
    training, base = loaded.training, loaded.base
    one = resolve(replace(load_robot("xs031"), effects=(_load(HERE_S),)))[0]
    column = training.predictor.contribution(base.model, one)
    channel, mask = training.predictor.material.channel, training.mask
    fresh = column - base.columns @ training.bench(base.bench.noise, column, base.columns).solve()
    forces = [k for k in np.unique(channel[column != 0.0]) if column[channel == k].any()]
    ratios = [
        rms(fresh[mask & (channel == k)]) / least_unconfirmed(training, base.model, k)
        for k in forces
    ]
    load = column * (0.9 / max(ratios))
    step = np.zeros_like(load)
    for k in forces:
        own = (channel == k) & (column != 0.0)
        step[own] = rms(load[own])

    def counts(whole: FloatArray) -> bool:
        current = replace(base, residual=whole)
        return worthy(training, base, current, base.bench, one, whole, 1e9)

    assert counts(load)
    assert not counts(step)


@pytest.mark.parametrize("refused", [0, 2])
def test_an_alternative_can_pay_for_every_instant_that_was_tried(
    loaded: Residuals, whole: Fitted, refused: int
) -> None:
    """Others were refused before it, and its instants are many: held-out rows may still tell."""
    gain = loaded.base.squares - whole.squares
    named = named_of([Contender(whole.model.terms[0], whole, gain, gain, 4.0)], 0.0005, 1.0)
    found = verify(loaded.training, whole, replace(named, refused=refused), loaded.check)
    assert found.stands, found.reason
    assert not found.silent


@pytest.mark.thorough
@pytest.mark.parametrize("backwards", [False, True])
def test_each_pays_for_its_own_instants(
    loaded: Residuals, whole: Fitted, monkeypatch: pytest.MonkeyPatch, backwards: bool
) -> None:
    """Whatever was placed after it; oil that warms up pays for when it began to, as well."""
    drift = {"viscous": 3.0e4, "rise": 24.0, "time_constant": 12.0}
    warming = EffectSpec("temperature_drift", "lift_cylinder", drift)
    terms = resolve(replace(load_robot("xs031"), effects=(_load(HERE_S), warming)))
    model = replace(loaded.base.model, terms=tuple(terms[::-1] if backwards else terms))
    both, paid = fit(loaded.training, model, passes=1), list[int]()
    _, tried = at_own_instants(loaded.training, loaded.check, both.model)
    # Instants one after the other, or pairs of eight: half of what chance may do is either's.
    material = loaded.check.predictor.material
    count, few = len(instants_of(material)), len(ends_of(material))
    assert tried["payload_change", "xs031"] in (2 * (2 + count), few * (few + 1))
    assert tried["temperature_drift", "lift_cylinder"] == 10
    monkeypatch.setattr(verify_module, "paid_for", lambda looks, n: paid.append(n) or looks)
    for term in both.model.terms:
        named = named_of([Contender(term, both, 900.0, 900.0, 4.0)], 0.0005, 1.0)
        verify(loaded.training, both, named, loaded.check)
    assert paid == [tried[term.effect.name, term.target] for term in both.model.terms]


def test_two_loads_pay_for_every_choice_of_both(loaded: Residuals) -> None:
    robot = replace(loaded.robot, effects=(_load(9.0), _load(2.0)))
    model = replace(loaded.base.model, terms=tuple(resolve(robot)))
    _, both = at_own_instants(loaded.training, loaded.check, model)
    _, one = at_own_instants(loaded.training, loaded.check, replace(model, terms=model.terms[:1]))
    assert both["payload_change", "xs031"] >= one["payload_change", "xs031"] ** 2


def test_nothing_else_moves(loaded: Residuals, whole: Fitted) -> None:
    assert at_own_instants(loaded.training, loaded.check, loaded.base.model) == (
        loaded.base.model,
        {},
    )
    there, _ = at_own_instants(loaded.training, loaded.check, whole.model)
    assert there.terms[0].parameters[0] == whole.model.terms[0].parameters[0]
    assert there.theta is whole.model.theta


@pytest.mark.thorough
def test_a_load_of_another_recording_is_there_from_its_start_and_let_go(
    make_run: tuple[Callable[..., Robot], Callable[..., Any]],
    lay_out: Callable[..., Residuals],
    whole: Fitted,
) -> None:
    true_crane, simulated_run = make_run
    loads = (_load(HERE_S), EffectSpec("payload_change", "xs031", {"mass": MASS_KG, "end_s": 7.3}))
    here, there = (
        simulated_run(replace(true_crane(), effects=(load,)), SECONDS, seed=seed)
        for seed, load in enumerate(loads)
    )
    work = lay_out(here, [there])
    [one] = at_own_instants(work.training, work.check, whole.model)[0].terms
    assert not begins(one)
    assert end_s(one) == pytest.approx(7.3, abs=0.1)
    [note] = instant_notes(work, whole)
    assert "is there from the start and ends at 7." in note


def test_results_and_checks_see_it_there(loaded: Residuals, whole: Fitted) -> None:
    """As at its first instant it would seem to make the other recording worse."""
    before, after = sides_of(loaded, whole)["lift/force"]
    assert after < 0.5 * before
    [lift] = [c for c in channels_of(loaded, whole, loaded.check) if c.name == "lift/force"]
    left = [float(np.std(lift.measured - of)) for of in (lift.before, lift.after)]
    assert left[1] < 0.5 * left[0]


def test_a_robot_is_rolled_out_with_the_load_at_its_own_instant(
    loaded: Residuals, whole: Fitted
) -> None:
    robot = replace(loaded.robot, effects=(_load(HERE_S),))
    there, _ = at_own_instants(loaded.training, loaded.check, whole.model)
    [spec] = begun(robot, there.terms).effects
    assert spec.parameters["mass"] == MASS_KG
    assert spec.parameters["start_s"] == _start(there.terms[0])
    assert begun(robot, ()) is robot


def test_held_out_windows_of_a_refinement_have_the_load_at_their_own_instant(
    loaded: Residuals, whole: Fitted
) -> None:
    given = robot_of(loaded.training.predictor, whole, loaded.robot).robot
    settings = RefineSettings(windows=8, window_s=1.5, rollouts=400)
    found = refine(loaded, whole, given, settings, True)
    assert found.held_out_windows == 8
    # Rolled out over a second and a half 80 kg more or less are a centimetre at the tip.
    assert max(found.rmse[joint][0] for joint in ("lift", "tilt")) < 1.0e-3
    # The model stays that of the recordings that were fitted.
    assert _start(found.whole.model.terms[0]) == HERE_S
    assert found.robot.effects[0].parameters["start_s"] == HERE_S


def test_two_loads_of_one_tip_keep_their_own_instants(loaded: Residuals) -> None:
    loads = tuple(
        EffectSpec("payload_change", "xs031", {"mass": m, "start_s": s})
        for m, s in ((5.0, 9.0), (7.0, 2.0))
    )
    robot = replace(loaded.robot, effects=loads)
    later = [beginning(one, start_s(one) + 1.0, 0.0) for one in resolve(robot)]
    seen = begun(robot, later)
    assert [(e.parameters["mass"], e.parameters["start_s"]) for e in seen.effects] == [
        (5.0, 10.0),
        (7.0, 3.0),
    ]
    model = replace(loaded.base.model, terms=tuple(resolve(robot)))
    there, _ = at_own_instants(loaded.training, loaded.check, model)
    assert [float(t.parameters[0]) for t in there.terms] == [7.0, 5.0]


def test_the_other_instant_is_told(loaded: Residuals, whole: Fitted) -> None:
    [note] = instant_notes(loaded, whole)
    assert note.startswith("payload_change of xs031 begins at 11 s where it was fitted, and")
    assert instant_notes(loaded, loaded.base) == []


def test_a_base_has_it_when_the_model_has(loaded: Residuals, whole: Fitted) -> None:
    """It may lack what the model knows; the load is taken up once in a recording."""
    lighter = replace(_load(HERE_S), parameters={"mass": 0.5 * MASS_KG, "start_s": HERE_S})
    (one,) = resolve(replace(load_robot("xs031"), effects=(lighter,)))
    base = loaded.base.model.with_term(one)
    sides = both_at_own_instants(loaded.training, loaded.check, base, whole.model)
    assert [_start(model.terms[0]) for model in sides] == pytest.approx([THERE_S] * 2, abs=0.1)
    assert _start(sides[0].terms[0]) == _start(sides[1].terms[0])
    assert float(sides[0].terms[0].parameters[0]) == 0.5 * MASS_KG
    same = both_at_own_instants(loaded.training, rows_of_training(loaded), base, whole.model)
    assert same == (base, whole.model)


@pytest.mark.thorough
def test_a_load_of_the_robot_file_is_the_other_recordings_own(
    make_run: tuple[Callable[..., Robot], Callable[..., Any]],
) -> None:
    """What the file lists is held against rows to verify on as these have it, with or without."""
    here, there = _runs(make_run, (HERE_S, SECONDS, 0), (THERE_S, SECONDS, 3))
    listed = replace(load_robot("xs031"), effects=(_load(HERE_S),))
    found = diagnose(listed, [here.recording("run")], [there.recording("check")])
    assert (found.verdict, found.findings) == (MATCHES, ())
    assert found.work is not None
    assert found.free_run is not None
    for channel in found.channels:
        left = [float(np.std(channel.measured - of)) for of in (channel.before, channel.after)]
        assert left == pytest.approx([channel.noise_floor] * 2, rel=0.5), channel.name
    sides = [pair for one in found.free_run.joints for pair in (
        (one.rmse_before, one.rmse_after), (one.whole_before, one.whole_after)
    )]  # fmt: skip
    assert all(before == after for before, after in sides)
    # Without any finding the base is the model: neither predicts them worse.
    work, base = found.work, found.work.base
    for before, after in sides_of(work, base).values():
        assert before == after
    # What has no name is put to rows from which the load is gone, not to the load.
    noise = work.noise_floors()["lift/force"]
    confirmer = Confirmer(work.training, work.check, base)
    material = work.check.predictor.material
    lift = confirmer.training.mask & (material.channel == material.channels.index("lift/force"))
    assert float(np.std(confirmer.fitted.residual[lift])) == pytest.approx(noise, rel=0.5)


@pytest.mark.thorough
def test_a_load_that_comes_later_than_the_other_recording_ends_is_verified_there(
    make_run: tuple[Callable[..., Robot], Callable[..., Any]], lay_out: Callable[..., Residuals]
) -> None:
    """Its rows show the load at their own instant: they are not silent."""
    here, there = _runs(make_run, (19.0, 24.0, 0), (THERE_S, 14.0, 3))
    work = lay_out(here, [there])
    (one,) = resolve(replace(load_robot("xs031"), effects=(_load(19.0),)))
    whole = fit(work.training, work.base.model.with_term(one))
    gain = work.base.squares - whole.squares
    named = named_of([Contender(whole.model.terms[-1], whole, gain, gain, 4.0)], 0.0005, 1.0)
    found = verify(work.training, whole, named, work.check)
    assert found.stands, found.reason
    assert not found.silent
    # The same load at other times does not do as well.
    assert 0.0 != found.placebo < 0.5


@pytest.mark.thorough
def test_a_load_is_picked_up_and_put_down(
    make_run: tuple[Callable[..., Robot], Callable[..., Any]],
) -> None:
    """With the base refitted; the other recording carries it from its start and lets it go."""
    true_crane, simulated_run = make_run
    passages = ({"start_s": 8.3, "end_s": 19.6}, {"end_s": 11.0})
    train, check = (
        simulated_run(
            replace(
                true_crane(),
                effects=(EffectSpec("payload_change", "xs031", {"mass": 60.0, **when}),),
            ),
            seconds,
            seed=seed,
        ).recording(name)
        for when, name, seconds, seed in zip(
            passages, ("run", "check"), (30.0, 24.0), (2, 4), strict=True
        )
    )
    diagnosis = diagnose(load_robot("xs031"), [train], [check])
    assert diagnosis.verdict == "explained"
    (finding,) = diagnosis.findings
    assert finding.named.names == ("payload_change",)
    mass, start, _, end, _ = finding.named.term.parameters
    assert mass == pytest.approx(60.0, rel=0.01)
    assert (start, end) == pytest.approx((8.3, 19.6), abs=0.05)
    assert any("is there from the start and ends at 11" in note for note in diagnosis.notes)
