"""Findings that are weighed again with the others in place."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from hydro_ident.mismatch.fitting.fitting import fit
from hydro_ident.mismatch.naming.name import Searcher
from hydro_ident.mismatch.naming.named import named_of
from hydro_ident.mismatch.naming.revision import Revision
from hydro_ident.mismatch.split.residuals import Residuals
from hydro_ident.mismatch.trials.contender import Contender
from hydro_model.effects.catalogue import resolve
from hydro_model.robot import EffectSpec
from hydro_model.robot_files import load_robot

FRICTION_N = 2500.0


def _rubbing(crane_run: Any, lay_out: Callable[..., Residuals]) -> Residuals:
    """A crane whose lift cylinder rubs."""
    speed = np.gradient(np.convolve(crane_run.q[:, 0], np.ones(25) / 25.0, "same"), 0.002)
    p_a = crane_run.p_a.copy()
    p_a[:, 0] += FRICTION_N * np.tanh(speed / 0.01) / crane_run.robot.cylinders[0].area_a_m2
    return lay_out(replace(crane_run, p_a=p_a))


@pytest.mark.parametrize(("found_with", "least", "most"), [(400.0, 1.0, 20.0), (1.0, 1.0, 1.0)])
def test_how_far_sums_spread_is_taken_anew_with_the_others_in_place(
    crane_run: Any,
    lay_out: Callable[..., Residuals],
    found_with: float,
    least: float,
    most: float,
) -> None:
    """What was found beside much that has been named since; never more than it was found with."""
    work = _rubbing(crane_run, lay_out)
    spec = EffectSpec("coulomb_friction", "lift_cylinder", {"force": FRICTION_N})
    one = resolve(replace(load_robot("xs031"), effects=(spec,)))[0]
    whole = fit(work.training, work.base.model.with_term(one))
    gain = work.base.squares - whole.squares
    named = named_of([Contender(whole.model.terms[-1], whole, gain, gain, 4.0)], 1e-3, found_with)
    _, fresh = Revision(Searcher(work.scan, work.base).contest).again(named, whole)
    assert fresh is not None
    assert least <= fresh.spread <= most
    assert fresh.names == named.names


@pytest.mark.parametrize(
    ("beside", "held_out", "stands"),
    [
        (EffectSpec("internal_leakage", "tilt_cylinder", {"coefficient": 1e-13}), 1.0, True),
        # Another law of the same friction could do most of it as well.
        (
            EffectSpec("pressure_dependent_friction", "lift_cylinder", {"coefficient": 5e-5}),
            1.0,
            False,
        ),
        # What held-out blocks said of it would not pay for what is left of it.
        (EffectSpec("internal_leakage", "tilt_cylinder", {"coefficient": 1e-13}), 1e-6, False),
    ],
)
def test_what_nothing_since_has_touched_is_left_as_it_was(
    crane_run: Any,
    lay_out: Callable[..., Residuals],
    monkeypatch: pytest.MonkeyPatch,
    beside: EffectSpec,
    held_out: float,
    stands: bool,
) -> None:
    work, contenders = _rubbing(crane_run, lay_out), list[Contender]()
    first = EffectSpec("coulomb_friction", "lift_cylinder", {"force": FRICTION_N})
    whole, before = work.base, work.base.squares
    for spec in (first, beside):
        (one,) = resolve(replace(load_robot("xs031"), effects=(spec,)))
        whole = fit(work.training, whole.model.with_term(one))
        gain = max(before - whole.squares, 100.0)
        contenders.append(
            Contender(whole.model.terms[-1], whole.weighed, gain, held_out * gain, 4.0)
        )
        before = whole.squares
    named = [named_of([c], 1e-3, 1.0) for c in contenders]
    contest, asked = Searcher(work.scan, work.base).contest, list[Any]()
    revision = Revision(contest)

    def again(one: Any, current: Any) -> Any:
        asked.append(one)
        return current, one

    monkeypatch.setattr(revision, "again", again)
    monkeypatch.setattr(revision, "_reach", lambda *_: frozenset({0}))
    revision.revised(named, whole)
    assert (named[0] in asked) == (not stands)
