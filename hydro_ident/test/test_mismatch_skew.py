"""Pressures read a tenth of a millisecond after positions: no law of acceleration."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from hydro_ident.mismatch.contest import Contest
from hydro_ident.mismatch.named import Contender
from hydro_ident.mismatch.residuals import Residuals
from hydro_ident.mismatch.worth import mere_skew, resolved
from hydro_model.effects.catalogue import resolve
from hydro_model.robot import EffectSpec, Robot
from hydro_model.robot_files import load_robot

Make = tuple[Callable[..., Robot], Callable[..., Any]]
STEP_S = 0.002
SOFT = {"inertia": 20.0, "frequency": 2.4, "damping": 1.0}
SPRING = EffectSpec("structural_flexibility", "lift_cylinder", SOFT)
MODE = {"inertia": 250.0, "frequency": 7.1, "damping": 0.1}


def _seen(
    make_run: Make, lay_out: Callable[..., Residuals], skew_s: float, *effects: EffectSpec
) -> Residuals:
    """A machine with some effects, whose pressures are read a little late."""
    true_crane, simulated_run = make_run
    run = simulated_run(replace(true_crane(), effects=effects), 18.0)
    p_a, p_b = (p - skew_s * np.gradient(p, STEP_S, axis=0) for p in (run.p_a, run.p_b))
    return lay_out(replace(run, p_a=p_a, p_b=p_b))


def _fitted(work: Residuals, spec: EffectSpec) -> Contender:
    one = resolve(replace(load_robot("xs031"), effects=(spec,)))[0]
    [found] = Contest(work.training, 1.0).fitted(work.base, [one], work.base.bench.noise)
    return found


def test_late_pressures_are_no_spring(make_run: Make, lay_out: Callable[..., Residuals]) -> None:
    """A soft, damped one explains some of a skew; the skew itself all of it, at its size."""
    work = _seen(make_run, lay_out, 3e-4)
    found = _fitted(work, SPRING)
    assert found.gain > 11.3  # chi-square of 3 at 1 %
    gain, skew_s = mere_skew(work.training, work.base, found.term)
    assert gain > found.gain
    assert skew_s == pytest.approx(3e-4, rel=0.3)
    assert not resolved(work.training, work.base, found)


def test_a_mode_is_more_than_late_pressures(
    make_run: Make, lay_out: Callable[..., Residuals]
) -> None:
    mode = EffectSpec("structural_flexibility", "lift_cylinder", MODE)
    work = _seen(make_run, lay_out, 1e-4, mode)
    assert resolved(work.training, work.base, _fitted(work, mode))
