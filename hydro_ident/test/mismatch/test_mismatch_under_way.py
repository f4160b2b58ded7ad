"""Modes that are under way when a recording begins: their state there is told, and no more."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from hydro_ident.mismatch.rows.contributions import contribution
from hydro_ident.mismatch.split.residuals import Residuals
from hydro_model.effects.catalogue import resolve
from hydro_model.effects.targets import ActiveEffect
from hydro_model.robot import EffectSpec, Robot
from hydro_model.robot_files import load_robot

Make = tuple[Callable[..., Robot], Callable[..., Any]]
#: Rings for half a minute.
MODE = {"inertia": 250.0, "frequency": 4.0, "damping": 0.004}
SPRING = EffectSpec("structural_flexibility", "lift_cylinder", MODE)
HEAD_S = 4.0


@pytest.fixture(scope="module")
def swung(make_run: Make) -> Any:
    true_crane, simulated_run = make_run
    return simulated_run(replace(true_crane(), effects=(SPRING,)), 18.0)


def _from(run: Any, sample: int) -> Any:
    """What is recorded from a sample on."""
    own = {name: getattr(run, name)[sample:] for name in ("q", "p_a", "p_b", "voltage")}
    return replace(run, **own)


def _mode() -> ActiveEffect:
    (one,) = resolve(replace(load_robot("xs031"), effects=(SPRING,)))
    return one


def _left(work: Residuals, one: ActiveEffect, at_rest: bool) -> tuple[float, float]:
    """Rms of the lift's force at the head and behind it, beside the truth and a refitted base."""
    predictor, mask = work.training.predictor, work.training.mask
    model, material = work.base.model, work.training.predictor.material
    own = (
        contribution(predictor.signals, model, one)
        if at_rest
        else predictor.contribution(model, one)
    )
    y, x = predictor.base(model)
    rows = mask & (material.channel == material.channels.index("lift/force"))
    columns = x[rows][:, x[rows].any(axis=0)]
    columns = columns / np.linalg.norm(columns, axis=0)
    left = y[rows] - own[rows]
    left = left - columns @ np.linalg.lstsq(columns, left, rcond=None)[0]
    head = material.time_s[rows] - material.time_s[rows][0] < HEAD_S
    return float(np.sqrt(np.mean(left[head] ** 2))), float(np.sqrt(np.mean(left[~head] ** 2)))


@pytest.mark.parametrize("cut", [1000, 4000])
def test_a_mode_under_way_is_followed_from_the_first_sample(
    cut: int, swung: Any, lay_out: Callable[..., Residuals]
) -> None:
    """From rest its ringing is missed for seconds, whatever a refit takes of it."""
    noise, _ = _left(lay_out(swung), _mode(), at_rest=True)
    work = lay_out(_from(swung, cut))
    head, behind = _left(work, _mode(), at_rest=True)
    assert head > 5.0 * noise
    assert behind > 3.0 * noise
    assert max(_left(work, _mode(), at_rest=False)) < 1.3 * noise


def test_what_is_tried_in_another_size_has_the_same_state(
    swung: Any, lay_out: Callable[..., Residuals]
) -> None:
    """A scan tries a tenth of a mode, of which what is there is a multiple."""
    predictor, model = (work := lay_out(_from(swung, 1000))).training.predictor, work.base.model
    whole, part = _mode(), replace(_mode(), parameters=_mode().parameters * [0.1, 1, 1, 1, 1])
    both = [predictor.contribution(model, one) for one in (whole, part)]
    np.testing.assert_allclose(both[1], 0.1 * both[0], atol=1e-3 * np.abs(both[0]).max())


def test_a_mode_at_rest_and_one_that_is_not_there_begin_at_rest(
    swung: Any, make_run: Make, lay_out: Callable[..., Residuals]
) -> None:
    true_crane, simulated_run = make_run
    for run in (swung, _from(simulated_run(true_crane(), 14.0), 1000)):
        work = lay_out(run)
        predictor, model = work.training.predictor, work.base.model
        for frequency_hz in (1.2, 4.0, 9.0):
            values = _mode().parameters.copy()
            values[1] = frequency_hz
            one = replace(_mode(), parameters=values)
            plain = contribution(predictor.signals, model, one)
            assert np.array_equal(predictor.contribution(model, one), plain)
