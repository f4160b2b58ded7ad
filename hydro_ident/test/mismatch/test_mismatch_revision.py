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


@pytest.mark.parametrize(("found_with", "least", "most"), [(400.0, 1.0, 20.0), (1.0, 1.0, 1.0)])
def test_how_far_sums_spread_is_taken_anew_with_the_others_in_place(
    crane_run: Any,
    lay_out: Callable[..., Residuals],
    found_with: float,
    least: float,
    most: float,
) -> None:
    """What was found beside much that has been named since; never more than it was found with."""
    speed = np.gradient(np.convolve(crane_run.q[:, 0], np.ones(25) / 25.0, "same"), 0.002)
    p_a = crane_run.p_a.copy()
    p_a[:, 0] += FRICTION_N * np.tanh(speed / 0.01) / crane_run.robot.cylinders[0].area_a_m2
    work = lay_out(replace(crane_run, p_a=p_a))
    spec = EffectSpec("coulomb_friction", "lift_cylinder", {"force": FRICTION_N})
    one = resolve(replace(load_robot("xs031"), effects=(spec,)))[0]
    whole = fit(work.training, work.base.model.with_term(one))
    gain = work.base.squares - whole.squares
    named = named_of([Contender(whole.model.terms[-1], whole, gain, gain, 4.0)], 1e-3, found_with)
    _, fresh = Revision(Searcher(work.scan, work.base).contest).again(named, whole)
    assert fresh is not None
    assert least <= fresh.spread <= most
    assert fresh.names == named.names
