"""Names that were taken back: which of them say more than what is told without them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from hydro_ident.mismatch.answer import spoilt
from hydro_ident.mismatch.answer.confirmation import _confirmed, _told_anew
from hydro_ident.mismatch.answer.outcome import Finding
from hydro_ident.mismatch.answer.spoilt import made_worse
from hydro_ident.mismatch.answer.withdrawal import (
    _better_answers,
    _explain_less,
    _variable,
    withdrawn,
)
from hydro_ident.mismatch.fitting.fitted import Fitted
from hydro_ident.mismatch.fitting.fitting import fit
from hydro_ident.mismatch.locating.dependence import Dependence
from hydro_ident.mismatch.modelling.model import robot_of
from hydro_ident.mismatch.naming.contest import Contest
from hydro_ident.mismatch.naming.name import Search
from hydro_ident.mismatch.naming.named import Named, named_of
from hydro_ident.mismatch.split.residuals import Residuals
from hydro_ident.mismatch.trials.contender import Contender
from hydro_ident.mismatch.unnamed.unknown import Unexplained
from hydro_ident.mismatch.verifying.verify import Verification
from hydro_model.effects.catalogue import resolve
from hydro_model.robot import EffectSpec
from hydro_model.robot_files import load_robot

#: As the machine has it that `rubbing` (conftest.py) is of.
FRICTION_N = 2500.0
EMPTY = np.zeros(0)


def _found(work: Residuals, name: str, parameters: dict[str, float]) -> tuple[Fitted, Finding]:
    """A model with an effect of the lift cylinder, as a search hands it on; nothing checked it."""
    spec = EffectSpec(name, "lift_cylinder", parameters)
    one = resolve(replace(load_robot("xs031"), effects=(spec,)))[0]
    whole = fit(work.training, work.base.model.with_term(one))
    gain = work.base.squares - whole.squares
    named = named_of([Contender(whole.model.terms[-1], whole, gain, gain, 4.0)], 0.001, 1.0)
    silent = Verification(1.0, {}, {}, 0.0, True, "", silent=True)
    return whole, Finding(named, silent, ("lift/force",))


def _told(variable: str) -> dict[str, Unexplained]:
    """Something in the lift's force that follows a variable."""
    one = Dependence(
        0, "lift/force", variable, "", 50.0, 8, 10.0, 0.0005, 0.5, 800.0, EMPTY, EMPTY, EMPTY
    )
    return {"lift/force": Unexplained("lift/force", (variable,), 0.5, 0.0005, "", one)}


def test_a_name_that_explains_most_stays_where_nothing_is_told(rubbing: Residuals) -> None:
    whole, finding = _found(rubbing, "coulomb_friction", {"force": FRICTION_N})
    assert _better_answers(rubbing, whole, [], [finding], {}) == [finding]


def test_a_name_that_explains_little_does_not(rubbing: Residuals) -> None:
    whole, finding = _found(rubbing, "joint_coupling", {"viscous": 500.0})
    assert _better_answers(rubbing, whole, [], [finding], {}) == []


def test_a_name_with_which_nothing_is_left_stays_by_its_variable_or_held_out_rows(
    rubbing: Residuals,
) -> None:
    little, coupling = _found(rubbing, "joint_coupling", {"viscous": 500.0})
    other = _variable(coupling)
    for variable, stays in ((other, [coupling]), ("piston_position", [])):
        assert _better_answers(rubbing, little, [], [coupling], _told(variable)) == stays
    much, friction = _found(rubbing, "coulomb_friction", {"force": FRICTION_N})
    for variable in ("piston_velocity", "piston_position"):
        assert _better_answers(rubbing, much, [], [friction], _told(variable)) == [friction]


def test_a_silent_name_is_not_taken_from_a_channel_that_it_describes(rubbing: Residuals) -> None:
    whole, finding = _found(rubbing, "coulomb_friction", {"force": FRICTION_N})
    _, findings, taken, _ = withdrawn(rubbing, whole, [finding])
    assert (findings, taken) == ([finding], [])


@pytest.mark.parametrize(("p_value", "taken"), [(1.0, True), (0.002, True), (1.0e-4, False)])
def test_a_name_that_held_out_rows_tell_is_not_taken_for_how_little_they_exercise_it(
    rubbing: Residuals, p_value: float, taken: bool
) -> None:
    """A coupling in a channel that dry friction still is far from its floor in."""
    whole, finding = _found(rubbing, "joint_coupling", {"viscous": 500.0})
    told = replace(finding, verification=replace(finding.verification, p_value=p_value))
    assert _explain_less(rubbing, whole, [told], []) == ([told] if taken else [])


@pytest.mark.parametrize(
    ("sides", "silent", "goes"),
    [
        ({"lift/force": (10.0, 10.3)}, False, True),
        ({"lift/force": (10.0, 10.1)}, False, False),
        ({"lift/force": (10.0, 10.3)}, True, False),
        ({"lift/force": (10.0, 10.3), "lift/flow_a": (1.0, 0.5)}, False, False),
        ({"lift/force": (10.0, 12.1), "lift/flow_a": (1.0, 0.5)}, False, True),
        # More is gained there than lost here.
        ({"lift/force": (1.0, 1.3), "lift/flow_a": (10.0, 5.0)}, False, False),
    ],
)
def test_a_name_that_leaves_no_channel_better_than_none_would_goes(
    rubbing: Residuals,
    monkeypatch: pytest.MonkeyPatch,
    sides: dict[str, tuple[float, float]],
    silent: bool,
    goes: bool,
) -> None:
    """Sides in units of what the sensors' noise leaves."""
    whole, finding = _found(rubbing, "coulomb_friction", {"force": FRICTION_N})
    verification = replace(finding.verification, silent=silent)
    finding = replace(finding, verification=verification, channels=tuple(sides))
    floors = rubbing.noise_floors()
    told = {n: (floors[n] * before, floors[n] * after) for n, (before, after) in sides.items()}
    monkeypatch.setattr(spoilt, "sides_of", lambda work, whole: told)
    failed = made_worse(rubbing, whole, [finding])
    assert [f.verification.stands for f in failed] == ([False] if goes else [])
    assert not failed or "lift/force are predicted worse (RMSE" in failed[0].verification.reason


# What comes in the place of a refused name -------------------------------------------------------

OFFSET = ("constant_force_offset", {"force": 300.0})
COUPLING = ("joint_coupling", {"viscous": 500.0})
COULOMB = ("coulomb_friction", {"force": FRICTION_N})
BRISTLES = ("presliding_friction", {"force": FRICTION_N, "distance": 2.0e-4})


def _searched(work: Residuals, *sets: Sequence[tuple[str, dict[str, float]]]) -> Search:
    """A search that names the first of each set, which the others came near to."""
    model, named = work.base.model, []
    for members in sets:
        tried = []
        for name, parameters in members:
            spec = EffectSpec(name, "lift_cylinder", parameters)
            (one,) = resolve(replace(load_robot("xs031"), effects=(spec,)))
            whole = fit(work.training, work.base.model.with_term(one))
            gain = work.base.squares - whole.squares
            tried.append(Contender(whole.model.terms[-1], whole, gain, gain, 4.0))
        model = model.with_term(tried[0].term)
        named.append(Named((tried[0],), (1.0,), 0.0005, tried[0].gain, tuple(tried), 1.0))
    return Search(work.base, fit(work.training, model), tuple(named), ())


@pytest.mark.parametrize(
    ("second", "instead"),
    [
        # Both refused ones had the same one near.
        ([OFFSET, COULOMB], "coulomb_friction"),
        # ... or one that holds the whole dry friction as well.
        pytest.param([OFFSET, BRISTLES], "coulomb_friction", marks=pytest.mark.thorough),
        # It is there already.
        ([COULOMB], "coulomb_friction"),
        ([BRISTLES], "presliding_friction"),
    ],
)
def test_refused_names_give_way_to_one_name_of_one_thing(
    rubbing: Residuals, second: Sequence[tuple[str, dict[str, float]]], instead: str
) -> None:
    search = _searched(rubbing, [COUPLING, COULOMB], second)
    whole, findings, rejected = _confirmed(rubbing, search)
    rubs = [t.effect.name for t in whole.model.terms if "friction" in t.effect.name]
    assert rubs == [instead]
    assert [f.named.term.effect.name for f in findings] == rubs
    assert "joint_coupling" in {f.named.term.effect.name for f in rejected}
    # A file that listed it twice could not be read.
    resolve(robot_of(rubbing.training.predictor, whole, rubbing.robot).robot)


@pytest.mark.parametrize(("few", "fresh"), [(8.0, True), (1.0, False)])
def test_in_few_motions_a_set_is_told_anew_without_what_was_refused(
    rubbing: Residuals, few: float, fresh: bool
) -> None:
    """Beside what was refused a coupling had fitted as well as the friction that is there."""
    whole, finding = _found(rubbing, *COULOMB)
    beside = _found(rubbing, *COUPLING)[1].named.modelled
    (own,) = finding.named.contenders
    alike = replace(beside, gain=own.gain, held_out=own.held_out)
    stale = named_of([own, alike], 0.001, 1.0, few)
    assert set(stale.names) == {"coulomb_friction", "joint_coupling"}
    contest = Contest(rubbing.scan)
    told = _told_anew(contest, rubbing, whole, replace(finding, named=stale))
    assert told.named.names == (("coulomb_friction",) if fresh else stale.names)
    assert told.verification is finding.verification
