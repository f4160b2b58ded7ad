"""Findings that undo one another are no causes."""

from __future__ import annotations

from dataclasses import replace

import pytest

from hydro_ident.mismatch.answer import confirmation
from hydro_ident.mismatch.answer.cancelling import cancelled
from hydro_ident.mismatch.answer.outcome import Finding
from hydro_ident.mismatch.fitting.fitted import Fitted
from hydro_ident.mismatch.fitting.fitting import fit
from hydro_ident.mismatch.naming.name import Search
from hydro_ident.mismatch.naming.named import Named, named_of
from hydro_ident.mismatch.split.residuals import Residuals
from hydro_ident.mismatch.trials.contender import Contender
from hydro_ident.mismatch.verifying.verify import Verification
from hydro_model.effects.catalogue import resolve
from hydro_model.effects.targets import ActiveEffect
from hydro_model.robot import EffectSpec
from hydro_model.robot_files import load_robot

ROBOT = load_robot("xs031")
BIAS_PA = 5.0e4
STANDS = Verification(1.0e-4, {}, {}, 1.0, True, "")


def _active(name: str, target: str, **parameters: float) -> ActiveEffect:
    return resolve(replace(ROBOT, effects=(EffectSpec(name, target, parameters),)))[0]


def _bias() -> ActiveEffect:
    return _active("pressure_sensor_bias", "lift_cylinder/a", bias=BIAS_PA)


def _offset(share: float) -> ActiveEffect:
    """A force that holds so much of the transducer's zero."""
    force = -share * ROBOT.cylinders[0].area_a_m2 * BIAS_PA
    return _active("constant_force_offset", "lift_cylinder", force=force)


def _findings(
    work: Residuals, *terms: ActiveEffect, channel: str = "lift/force"
) -> tuple[Fitted, list[Finding]]:
    model = work.base.model
    for term in terms:
        model = model.with_term(term)
    whole = replace(work.base, model=model)
    named = [named_of([Contender(t, whole, 50.0, 50.0, 4.0)], 1e-3, 1.0) for t in terms]
    return whole, [Finding(n, STANDS, (channel,)) for n in named]


@pytest.mark.parametrize(
    ("share", "goes"), [(1.0, True), (0.95, True), (0.7, False), (-1.0, False)]
)
def test_a_zero_that_a_force_holds_is_neither(
    rubbing: Residuals, share: float, goes: bool
) -> None:
    whole, found = _findings(rubbing, _bias(), _offset(share))
    refused = cancelled(rubbing, whole, found)
    assert [f.named for f in refused] == ([f.named for f in found] if goes else [])
    assert not any(f.verification.stands for f in refused)
    if goes:
        assert refused[0].verification.reason == (
            "constant_force_offset of lift_cylinder undoes it in lift/force: neither is told by"
            " that"
        )


def test_what_acts_elsewhere_or_not_at_all_undoes_nothing(rubbing: Residuals) -> None:
    whole, found = _findings(rubbing, _bias(), _offset(1.0), channel="tilt/force")
    assert cancelled(rubbing, whole, found) == []
    whole, found = _findings(rubbing, _bias(), _offset(0.0))
    assert cancelled(rubbing, whole, found) == []


def test_of_two_that_undo_one_another_the_weaker_goes_first(
    rubbing: Residuals, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Though held-out rows would confirm each beside the other; what is left is checked alone."""
    whole, found = _findings(rubbing, _bias(), _offset(1.0))
    whole = replace(fit(rubbing.training, whole.model), model=whole.model)
    beside: list[int] = []

    def checked(work: Residuals, now: Fitted, there: object, named: Named, tried: int) -> Finding:
        beside.append(len(now.model.terms))
        return Finding(named, STANDS, ("lift/force",))

    monkeypatch.setattr(confirmation, "_checked", checked)
    monkeypatch.setattr(confirmation, "settled", lambda training, fitted: fitted)
    monkeypatch.setattr(confirmation, "from_one_delay", lambda training, fitted: fitted)
    monkeypatch.setattr(confirmation, "fit", lambda training, model, passes: whole)
    search = Search(rubbing.base, whole, tuple(f.named for f in found), ())
    _, findings, rejected = confirmation._confirmed(rubbing, search)
    assert [f.named.term.effect.name for f in findings] == ["constant_force_offset"]
    [gone] = rejected
    assert gone.named.term.effect.name == "pressure_sensor_bias"
    assert "undoes it" in gone.verification.reason
    assert beside == [2, 2, 1]
