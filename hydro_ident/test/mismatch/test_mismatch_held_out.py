"""What held-out rows say of a finding: for it, against it, or nothing that they could show."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.stats import norm

from hydro_ident.commands.diagnose import summary_text
from hydro_ident.identify.results import Provenance
from hydro_ident.mismatch.answer.channel_results import channels_of
from hydro_ident.mismatch.answer.diagnosis import _verdict
from hydro_ident.mismatch.answer.diagnosis_file import result_dict
from hydro_ident.mismatch.answer.notes import silent_notes, unverified_notes
from hydro_ident.mismatch.answer.outcome import (
    MATCHES,
    NO_IMPROVEMENT,
    PARTLY,
    ChannelResult,
    Diagnosis,
    Finding,
)
from hydro_ident.mismatch.fitting.fitted import Fitted
from hydro_ident.mismatch.fitting.fitting import fit
from hydro_ident.mismatch.fitting.whitening import Noise
from hydro_ident.mismatch.naming.named import Named, named_of
from hydro_ident.mismatch.settings import FAMILY_ERROR_UNNAMED
from hydro_ident.mismatch.split.check import Check
from hydro_ident.mismatch.split.held_out import STANDS, HeldOut, held_out
from hydro_ident.mismatch.split.residuals import Residuals
from hydro_ident.mismatch.trials.contender import Contender
from hydro_ident.mismatch.verifying.looks import Look, looked, missed, objection
from hydro_ident.mismatch.verifying.verify import Verification, verify
from hydro_ident.report.diagnosis_verdict import diagnosis_verdict
from hydro_model.effects.catalogue import resolve
from hydro_model.robot import EffectSpec, Robot
from hydro_model.robot_files import load_robot

COULOMB = EffectSpec("coulomb_friction", "lift_cylinder", {"force": 2500.0})


@pytest.fixture(scope="module")
def work(
    make_run: tuple[Callable[..., Robot], Callable[..., Any]], lay_out: Callable[..., Residuals]
) -> Residuals:
    """A machine with dry friction in its lift cylinder, beside the datasheet's structure."""
    true_crane, simulated_run = make_run
    return lay_out(simulated_run(replace(true_crane(), effects=(COULOMB,)), 13.0))


@pytest.fixture(scope="module")
def rows(work: Residuals) -> HeldOut:
    """Held-out rows of white noise of unit size, as they are predicted."""
    count = len(work.check.predictor.material.channels)
    white = Noise(tuple(np.zeros(0) for _ in range(count)), np.ones(count))
    found = held_out(work.check, work.base, white)[1]
    # The base's own error is put in where a test is about it.
    return replace(found, doubt=np.zeros((found.bench.measured, 0)))


def _drawn(rows: HeldOut, rng: np.random.Generator, size: float) -> tuple[np.ndarray, np.ndarray]:
    """Noise on all rows, and another draw whose held-out rows are so large together."""
    noise, column = rng.normal(size=(2, rows.used.size))
    return noise, size * column / np.linalg.norm(column[rows.used])


def _seen(
    rows: HeldOut, plain: np.ndarray, column: np.ndarray, acting: Sequence[str] = ()
) -> Look:
    channels = acting or rows.check.predictor.material.channels
    return looked(rows, plain, plain - column, [], channels)


# Products -------------------------------------------------------------------------------------


def test_what_predicts_nothing_better_does_not_stand(rows: HeldOut) -> None:
    """In force rows that go with it, and are no better for it as its size is far off."""
    rng = np.random.default_rng(4)
    force = rows.used & (rows.check.predictor.material.channel == 0)
    column, plain = np.zeros(force.size), rng.normal(size=force.size)
    column[force] = rng.normal(size=int(force.sum()))
    plain = plain + 0.4 * column
    right, far = (_seen(rows, plain, size * column, ["lift/force"]) for size in (0.4, 2.0))
    assert objection(right, STANDS) == ""
    assert objection(far, STANDS).endswith("lift/force are predicted no better with it")


@pytest.mark.parametrize(("taken_off", "no_better"), [(1e-4, True), (1e-3, False)])
def test_what_nobody_can_see_improve_does_not_stand(
    rows: HeldOut, taken_off: float, no_better: bool
) -> None:
    """A ten thousandth of a channel's rmse, however surely, is what any model is off by."""
    force = rows.used & (rows.check.predictor.material.channel == 0)
    plain = np.random.default_rng(5).normal(size=force.size)
    said = objection(_seen(rows, plain, taken_off * plain * force, ["lift/force"]), STANDS)
    assert said.endswith("lift/force are predicted no better with it") is no_better


def test_a_true_finding_of_four_deviations_is_confirmed(rows: HeldOut) -> None:
    """Its product has four deviations; its gain, of 16 +- 8, would have two."""
    rng, stands, draws = np.random.default_rng(1), 0, 60
    for _ in range(draws):
        noise, column = _drawn(rows, rng, 4.0)
        one = _seen(rows, noise + column, column)
        assert one.shown == pytest.approx(16.0)
        stands += not objection(one, STANDS)
    assert stands >= 0.85 * draws


@pytest.mark.parametrize("size", [0.1, 2.0])
def test_a_false_finding_is_confirmed_no_more_often_than_said(rows: HeldOut, size: float) -> None:
    rng, stands, draws = np.random.default_rng(2), 0, 150
    for _ in range(draws):
        stands += not objection(_seen(rows, *_drawn(rows, rng, size)), 0.1)
    assert stands <= 0.1 * draws + 3.0 * np.sqrt(0.1 * 0.9 * draws)


def test_what_makes_the_error_larger_has_no_chance_of_standing(rows: HeldOut) -> None:
    """Of the right sign, and more than twice too large."""
    noise, column = _drawn(rows, np.random.default_rng(3), 8.0)
    one = _seen(rows, 0.01 * noise + column, 2.5 * column)
    assert one.p_value == 1.0
    assert objection(one, STANDS)


def test_what_changes_nothing_is_silent_and_not_confirmed(rows: HeldOut) -> None:
    noise, column = _drawn(rows, np.random.default_rng(4), 1.0)
    one = _seen(rows, noise, 0.0 * column)
    assert (one.shown, one.p_value, one.placebo) == (0.0, 1.0, 0.0)


def test_what_the_models_own_error_makes_is_not_confirmed(rows: HeldOut) -> None:
    """A change along what the base is off by has one draw behind it, and no block another."""
    rng, wrong, draws = np.random.default_rng(6), 0, 60
    direction = rng.normal(size=rows.used.size)
    direction /= np.linalg.norm(direction[rows.used])
    doubting = replace(rows, doubt=rows.left(30.0 * direction)[:, None])
    plain_wrong = 0
    for _ in range(draws):
        noise = rng.normal(size=rows.used.size)
        off = noise + 30.0 * rng.normal() * direction
        change = 5.0 * direction
        plain_wrong += not objection(_seen(rows, off, change), 0.1)
        wrong += not objection(_seen(doubting, off, change), 0.1)
    assert plain_wrong > 0.3 * draws
    assert wrong <= 0.1 * draws + 3.0 * np.sqrt(0.1 * 0.9 * draws)
    other = rng.normal(size=rows.used.size)
    other *= 6.0 / np.linalg.norm(other[rows.used])
    noise = rng.normal(size=rows.used.size)
    assert not objection(_seen(doubting, noise + other, other), STANDS)


def test_what_no_error_of_the_model_makes_is_told_beside_what_it_may_be_off_by(
    rows: HeldOut,
) -> None:
    """A finding most of whose change is what a hardly known base may be off by, too.

    By products on the rows alone it stands out by two deviations of that error; its other part,
    of six deviations, is neither noise nor the base's. One draw of the base's error in six makes
    the whole prediction worse with it: then it does not stand.
    """
    rng, stands, wrong, draws = np.random.default_rng(8), 0, 0, 60
    direction, own = rng.normal(size=(2, rows.used.size))
    direction /= np.linalg.norm(direction[rows.used])
    own *= 6.0 / np.linalg.norm(own[rows.used])
    doubting = replace(rows, doubt=rows.left(20.0 * direction)[:, None])
    column = 40.0 * direction + own
    for _ in range(draws):
        off = rng.normal(size=rows.used.size) + 20.0 * rng.normal() * direction
        stands += not objection(_seen(doubting, off + column, column), STANDS)
        wrong += not objection(_seen(doubting, off, column), STANDS)
    assert stands >= 0.75 * draws
    assert wrong <= STANDS * draws + 3.0 * np.sqrt(STANDS * (1.0 - STANDS) * draws)
    assert _seen(doubting, off, column).shown == pytest.approx(36.0, rel=0.15)


def test_what_acts_in_a_few_blocks_is_confirmed(
    work: Residuals, make_run: Any, lay_out: Callable[..., Residuals]
) -> None:
    """A work cycle's second recording may exercise an effect for three seconds: signs of three
    blocks are alike by chance once in eight, but what a true one leaves there is noise."""
    true_crane, simulated_run = make_run
    again = lay_out(simulated_run(true_crane(), 13.0), [simulated_run(true_crane(), 18.0, 3)])
    count = len(again.check.predictor.material.channels)
    white = Noise(tuple(np.zeros(0) for _ in range(count)), np.ones(count))
    long_rows = held_out(again.check, again.base, white)[1]
    long_rows = replace(long_rows, doubt=np.zeros((long_rows.bench.measured, 0)))
    time_s = again.check.predictor.material.time_s
    rng = np.random.default_rng(11)
    noise, course, other = rng.normal(size=(3, long_rows.used.size))
    during = (time_s > 5.0) & (time_s < 7.5)
    course *= during
    course *= 8.0 / np.linalg.norm(course[long_rows.used])
    assert _seen(long_rows, noise + course, course).p_value < 0.001
    # Where other things are left there, they may be what the blocks have in common.
    assert _seen(long_rows, noise + course + 10.0 * other * during, course).p_value > 0.05


def test_rows_that_say_nothing_refuse_nothing(work: Residuals) -> None:
    """What takes the place of a name that was dropped unheard has no debt to pay."""
    both = []
    for name in ("coulomb_friction", "asymmetric_friction"):
        spec = EffectSpec(name, "lift_cylinder", {"force": 2500.0})
        term = resolve(replace(load_robot("xs031"), effects=(spec,)))[0]
        both.append(Contender(term, work.base, 100.0, 100.0, 4.0))
    named = named_of(both, 0.001, 1.0)
    heard, unheard = named.alternative(), named.alternative(unheard=True)
    assert heard is not None
    assert unheard is not None
    assert heard.names == unheard.names
    assert (heard.refused, unheard.refused) == (1, 0)


def test_a_faint_finding_needs_no_more_than_a_true_one_gives() -> None:
    """A true finding of so many units falls short of it once in forty times."""
    rng = np.random.default_rng(7)
    for shown in (4.0, 9.0, 14.0):
        products = shown + np.sqrt(shown) * rng.standard_normal(40000)
        chances = norm.sf(products / np.sqrt(shown))
        assert np.mean(chances > missed(shown)) == pytest.approx(0.025, abs=0.004)
    assert missed(0.0) > 0.9
    assert missed(16.0) < STANDS


def test_few_rows_are_cut_into_blocks_enough_for_a_small_chance(rows: HeldOut) -> None:
    """No flip of fewer than six signs is rarer than 2.5 %."""
    assert np.unique(rows.blocks()).size >= 10
    assert np.unique(rows.blocks(0.2)).size >= np.unique(rows.blocks()).size


# Silence --------------------------------------------------------------------------------------


def _named(work: Residuals, p_value: float, held_share: float = 1.0) -> tuple[Fitted, Named]:
    """The machine's friction fitted to the training rows, as a search would hand it on."""
    one = resolve(replace(load_robot("xs031"), effects=(COULOMB,)))[0]
    whole = fit(work.training, work.base.model.with_term(one))
    gain = work.base.squares - whole.squares
    contender = Contender(whole.model.terms[-1], whole, gain, held_share * gain, 4.0)
    return whole, named_of([contender], p_value, 1.0)


def _unseen(work: Residuals) -> Check:
    """Nothing to check on, as where held-out rows lie beyond the fitted positions."""
    return replace(work.check, mask=np.zeros_like(work.check.mask))


def _verified(work: Residuals, named: tuple[Fitted, Named], check: Check) -> Verification:
    return verify(work.training, *named, check)


def test_rows_that_show_a_finding_are_not_silent(work: Residuals) -> None:
    found = _verified(work, _named(work, 0.0005), work.check)
    assert found.stands
    assert not found.silent


def test_errors_that_are_told_are_of_predictions(work: Residuals) -> None:
    """And of no fit to the very rows that are to verify it, whichever look speaks for it."""
    whole, named = _named(work, 0.0005)
    found = _verified(work, (whole, named), work.check)
    rest = replace(whole.model, terms=())
    without = fit(work.training, rest, whole.bench.noise, 2)
    material, used = work.check.predictor.material, work.check.rows_in_motion
    for told, model in ((found.before, without.model), (found.after, whole.model)):
        residual = work.check.residual(model)
        for k, name in enumerate(material.channels):
            rows = work.check.rows(k, name) & used
            assert told[name] == pytest.approx(np.sqrt(np.mean(residual[rows] ** 2)), rel=1e-9)


def test_rows_to_verify_on_share_delays_out_by_the_cycle_that_was_fitted(work: Residuals) -> None:
    slower = replace(work.training, cycle_s=5.0 * work.training.cycle_s)
    assert work.check.training(slower).cycle_s == slower.cycle_s


def test_a_channel_that_nothing_verifies_is_named(work: Residuals) -> None:
    material, check = work.check.predictor.material, work.check
    lift = material.channel == material.channels.index("lift/force")
    for mask, missing in ((check.mask, ""), (check.mask & ~lift, "lift/force: nothing")):
        seen = replace(work, check=replace(check, mask=mask))
        notes = unverified_notes(seen, channels_of(seen, work.base, seen.check))
        assert len(notes) == bool(missing)
        assert all(note.startswith(missing) for note in notes)


@pytest.mark.parametrize(
    ("p_value", "held_share", "stands"),
    [(0.0005, 1.0, True), (2.0 * FAMILY_ERROR_UNNAMED, 1.0, False), (0.0005, 0.0, False)],
)
def test_silent_rows_leave_it_to_the_training_rows(
    work: Residuals, p_value: float, held_share: float, stands: bool
) -> None:
    """No flip may reach it and its own held-out blocks have to pay for it."""
    found = _verified(work, _named(work, p_value, held_share), _unseen(work))
    assert found.silent
    assert found.stands is stands
    assert stands or "training rows leave doubts" in found.reason
    assert not found.agreement


def test_silent_rows_of_few_motions_confirm_nothing(work: Residuals) -> None:
    """Blocks of one motion are no independent witnesses: its own rows always leave a doubt."""
    whole, named = _named(work, 0.0005)
    found = _verified(work, (whole, replace(named, few=8.0)), _unseen(work))
    assert found.silent
    assert not found.stands
    assert "too few motions" in found.reason


def test_other_channels_do_not_speak_for_a_finding(work: Residuals) -> None:
    """Without it the base is off in all channels: of friction in the lift, tilt says nothing."""
    material = work.check.predictor.material
    lift = material.channel == material.channels.index("lift/force")
    found = _verified(work, _named(work, 0.01), replace(work.check, mask=work.check.mask & ~lift))
    assert found.silent
    assert not found.stands


def test_what_stands_out_nowhere_is_no_failed_improvement(work: Residuals) -> None:
    """Refused by held-out rows it is one; what its own recording does not show never was one."""
    whole, named = _named(work, 0.0005)
    faint = whole, replace(named, spread=1.0e9)
    for one, check, verdict in (
        (faint, work.check, MATCHES),
        ((whole, replace(named, p_value=1.0)), _unseen(work), NO_IMPROVEMENT),
    ):
        refused = _verified(work, one, check)
        assert not refused.stands
        at = np.arange(9.0)
        left = ChannelResult("lift/force", "N", at, at, 0.0 * at, 0.0 * at, 0.1)
        finding = Finding(named, refused, ("lift/force",))
        assert _verdict([], [finding], [left], [], False) == verdict


def test_silent_findings_are_said_to_be(work: Residuals) -> None:
    """In the result file, in a note, in the report's verdict; and never `explained`."""
    named = _named(work, 0.0005)
    origin = Provenance("diagnose", "0", "xs031", {}, {})
    for check, exercised in ((work.check, True), (_unseen(work), False)):
        finding = Finding(named[1], _verified(work, named, check), ("lift/force",))
        verdict = _verdict([finding], [], [], [], False)
        assert (verdict == PARTLY) is not exercised
        notes = silent_notes([finding])
        assert bool(notes) is not exercised
        said = Diagnosis(verdict, work.robot, work.robot, (finding,), notes=tuple(notes))
        entry = result_dict(said, origin)["findings"][0]
        assert entry["heldout_exercised"] is exercised
        cards = " ".join(line for _, lines in diagnosis_verdict(said, []).cards for line in lines)
        assert ("do not exercise Coulomb friction" in cards) is not exercised


@pytest.mark.parametrize(
    ("p_value", "after", "freed"), [(1e-4, 80.0, True), (0.1, 80.0, False), (1e-4, 140.0, False)]
)
def test_a_base_that_a_silent_finding_frees_is_said_to_predict_better(
    work: Residuals, p_value: float, after: float, freed: bool
) -> None:
    """A ground that is never met on these rows, which the base had taken up as weight."""
    sides = {"lift/force": 140.0}, {"lift/force": after}
    found = Verification(p_value, *sides, 0.0, True, "", silent=True)
    finding = Finding(_named(work, 0.0005)[1], found, ("lift/force",))
    (note,) = silent_notes([finding])
    assert ("the base that it frees predicts them better" in note) is freed
    assert "do not exercise it" in note
    assert "only cross-validation within the training rows speaks" in note
    said = Diagnosis(PARTLY, work.robot, work.robot, (finding,), notes=(note,))
    cards = " ".join(line for _, lines in diagnosis_verdict(said, []).cards for line in lines)
    assert ("Beside Coulomb friction" in cards) is freed
    assert ("the base that it frees predicts them better" in summary_text(said)) is freed
    # Rows that exercise it say so themselves.
    assert not replace(found, silent=False).by_base("lift/force")
