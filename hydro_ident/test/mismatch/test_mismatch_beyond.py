"""Rows where a joint was never fitted: laws of flow are checked on there, of position not."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from hydro_ident.mismatch.answer.channel_results import channels_of
from hydro_ident.mismatch.answer.notes import beyond_notes
from hydro_ident.mismatch.fitting.fitting import fit
from hydro_ident.mismatch.naming.named import named_of
from hydro_ident.mismatch.split.residuals import Residuals
from hydro_ident.mismatch.trials.contender import Contender
from hydro_ident.mismatch.verifying.agreement import fitted_there
from hydro_ident.mismatch.verifying.verify import Verification, verify
from hydro_model.effects.catalogue import resolve
from hydro_model.effects.targets import ActiveEffect
from hydro_model.robot import EffectSpec, Robot
from hydro_model.robot_files import load_robot

LEAK = EffectSpec("internal_leakage", "lift_cylinder", {"coefficient": 3.0e-13})
FLOWS = ["lift/flow_a", "lift/flow_b"]
SECONDS = 13.0


def _laid(make_run: Any, lay_out: Callable[..., Residuals], leaks: tuple[bool, bool]) -> Residuals:
    """A small motion to learn from and one twice as wide to verify on; either may leak."""
    true_crane, simulated_run = make_run
    robots: list[Robot] = [
        replace(true_crane(), effects=(LEAK,)) if leaking else true_crane() for leaking in leaks
    ]
    check = simulated_run(robots[1], SECONDS, 3)
    return lay_out(simulated_run(robots[0], SECONDS, scale=0.5), [check])


@pytest.fixture(scope="module")
def leaking(make_run: Any, lay_out: Callable[..., Residuals]) -> Residuals:
    return _laid(make_run, lay_out, (True, True))


def _term(spec: EffectSpec) -> ActiveEffect:
    return resolve(replace(load_robot("xs031"), effects=(spec,)))[0]


def _verified(work: Residuals, *, beyond: bool) -> Verification:
    """The leak as found on the training rows, put to the others."""
    whole = fit(work.training, work.base.model.with_term(_term(LEAK)))
    gain = work.base.squares - whole.squares
    found = Contender(whole.model.terms[-1], whole, gain, gain, 4.0)
    check = work.check if beyond else replace(work.check, beyond=None)
    there = fitted_there(work.training, work.check, whole)
    return verify(work.training, whole, named_of([found], 0.001, 1.0), check, there)


def test_rows_beyond_are_those_of_balances_and_of_laws_that_are_the_same_there(
    leaking: Residuals,
) -> None:
    check = leaking.check
    material = check.predictor.material
    assert check.beyond is not None
    assert not (check.beyond & check.mask).any()
    flow = np.isin(material.channel, [k for k in range(6) if material.is_flow(k)])
    reached = check.reaching(_term(LEAK), FLOWS).mask
    assert np.array_equal(reached, check.mask | (check.beyond & flow))
    assert np.count_nonzero(reached & flow) > 1.3 * np.count_nonzero(check.mask & flow)
    spring = EffectSpec(
        "counterbalance_spring", "lift_cylinder", {"force": 100.0, "stiffness": 1.0e4}
    )
    assert check.reaching(_term(spring), FLOWS) is check
    assert check.reaching(_term(LEAK), [*FLOWS, "lift/force"]) is check


def test_a_leak_is_confirmed_by_rows_beyond(leaking: Residuals) -> None:
    near, far = (_verified(leaking, beyond=beyond) for beyond in (False, True))
    assert far.stands, far.reason
    assert far.p_value <= near.p_value


@pytest.mark.thorough
def test_rows_beyond_refuse_a_leak_that_they_do_not_have(
    make_run: Any, lay_out: Callable[..., Residuals]
) -> None:
    found = _verified(_laid(make_run, lay_out, (True, False)), beyond=True)
    assert not found.stands
    assert "coefficient is" in found.reason


def test_numbers_are_told_of_rows_beyond_where_hardly_any_lie_within(leaking: Residuals) -> None:
    """A recording of other poses, on whose balances alone findings are verified."""
    check = leaking.check
    material = check.predictor.material
    own = [n in FLOWS for n in material.channels]
    assert check.told(()) is check
    narrow = replace(check, mask=check.mask & ~np.isin(material.channel, np.flatnonzero(own)))
    assert check.beyond is not None
    wide = narrow.told((_term(LEAK),))
    told = {one.name: one for one in channels_of(leaking, leaking.base, wide)}
    for name in FLOWS:
        k = material.channels.index(name)
        assert np.array_equal(wide.rows(k, name), check.beyond & (material.channel == k))
        assert told[name].measured.size == np.count_nonzero(wide.rows(k, name)) > 0
    # Of forces none is told beyond, and where a flow's law is of the position no flow is.
    assert np.array_equal(
        wide.mask & ~narrow.mask, check.beyond & np.isin(material.channel, np.flatnonzero(own))
    )
    cushion = EffectSpec("end_cushion", "lift_cylinder", {"strength": 0.7, "length": 0.5})
    assert narrow.told((_term(cushion),)) is narrow
    assert beyond_notes(check, check) == []
    (note,) = beyond_notes(narrow, wide)
    assert note.startswith("lift/flow_a, lift/flow_b: verified on rows beyond")
