"""What repeats a few times over a joint's range: an encoder off its centre."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from hydro_ident.mismatch.locating.dependence import Dependence
from hydro_ident.mismatch.locating.few_periods import POSITIONS
from hydro_ident.mismatch.locating.locate import dependences
from hydro_ident.mismatch.settings import FAMILY_ERROR_UNNAMED
from hydro_ident.mismatch.split.residuals import Residuals
from hydro_ident.mismatch.unnamed.unknown import unexplained
from hydro_ident.mismatch.verifying.confirm import Confirmer
from hydro_model.robot import Robot

PERIODS, MANY, SWING_RAD = 5.0, 40.0, 2.0e-4


def _off_centre(run: Any, count: float) -> Any:
    """A recording of the same motion whose lift angle is read with an error that repeats."""
    q = run.q.copy()
    q[:, 0] += SWING_RAD * np.sin(count * run.q[:, 0])
    return replace(run, q=q)


def _strongest(work: Residuals, channel: str) -> Dependence:
    """The strongest dependence of a channel on anything but time.

    The motion itself repeats in time.
    """
    names = work.training.predictor.material.channels
    found = dependences(work.training, work.base)
    return next(d for d in found if names[d.channel] == channel and d.variable != "time")


@pytest.fixture(scope="module")
def seen_again(make_run: tuple[Callable[..., Robot], Callable[..., object]]) -> Any:
    """The machine of `crane_run` on another path."""
    true_crane, simulated_run = make_run
    return simulated_run(true_crane(), 24.0, seed=3)


@pytest.fixture(scope="module")
def clean(crane_run: Any, lay_out: Callable[..., Residuals]) -> Residuals:
    return lay_out(crane_run)


@pytest.fixture(scope="module")
def count(crane_run: Any) -> float:
    """Turns of the error per turn of the joint."""
    return PERIODS * 2.0 * np.pi / float(np.ptp(crane_run.q[:, 0]))


@pytest.fixture(scope="module")
def turned(
    crane_run: Any, seen_again: Any, count: float, lay_out: Callable[..., Residuals]
) -> Residuals:
    return lay_out(_off_centre(crane_run, count), [_off_centre(seen_again, count)])


@pytest.mark.parametrize(
    ("channel", "times"),
    [("lift/flow_a", "velocity"), ("lift/flow_b", "velocity"), ("lift/force", "velocity_squared")],
)
def test_an_encoder_off_its_centre_is_told_by_velocity_and_acceleration(
    turned: Residuals, count: float, channel: str, times: str
) -> None:
    """``d/dt (q + e sin(k q)) = qd (1 + e k cos(k q))``, and its derivative has ``qd^2``."""
    found = _strongest(turned, channel)
    assert (found.variable, found.times) == ("joint_angle", times)
    assert found.p_value <= FAMILY_ERROR_UNNAMED
    assert found.period == pytest.approx(2.0 * np.pi / count, rel=0.06)
    assert Confirmer(turned.training, turned.check, turned.base).holds(found)


def test_its_size_is_that_of_the_error(turned: Residuals, count: float) -> None:
    """The flow's share that repeats is ``e k`` of the velocity's."""
    found = _strongest(turned, "lift/flow_a")
    material = turned.training.predictor.material
    y, _ = turned.training.predictor.base(turned.base.model)
    own = turned.training.mask & (material.channel == found.channel)
    expected = SWING_RAD * count / np.sqrt(2.0) * float(np.sqrt(np.mean(y[own] ** 2)))
    assert found.size == pytest.approx(expected, rel=0.1)


def test_it_is_reported_with_what_it_depends_on(turned: Residuals) -> None:
    left = dependences(turned.training, turned.base)
    holds = Confirmer(turned.training, turned.check, turned.base).holds
    found = {u.channel: u for u in unexplained(turned.training, turned.base, left, holds)}
    one = found["lift/flow_a"]
    assert one.depends_on == ("joint_angle", "piston_velocity")
    assert "times the piston's velocity" in one.text
    assert "a position sensor off its centre" in one.text
    assert one.confirmed


def test_a_sound_encoder_repeats_nothing(clean: Residuals) -> None:
    told = [
        d
        for d in dependences(clean.training, clean.base)
        if d.period and d.variable in POSITIONS and d.p_value <= FAMILY_ERROR_UNNAMED
    ]
    assert not told


@pytest.mark.thorough
def test_many_periods_are_lines_that_act_as_readings_do(
    make_run: tuple[Callable[..., Robot], Callable[..., Any]], lay_out: Callable[..., Residuals]
) -> None:
    """A motion that is slow beside the rows' distance has room for a spectrum over the angle."""
    true_crane, simulated_run = make_run
    run = simulated_run(true_crane(), 60.0, pace=0.15)
    seen = run.q[:, 0]
    count = MANY * 2.0 * np.pi / float(np.ptp(seen))
    q = run.q + np.array([1.0, 0.0]) * (SWING_RAD / 9.0 * np.sin(count * run.q))
    found = _strongest(lay_out(replace(run, q=q)), "lift/flow_a")
    assert (found.variable, found.times) == ("joint_angle", "velocity")
    assert found.p_value <= FAMILY_ERROR_UNNAMED
    assert found.period == pytest.approx(2.0 * np.pi / count, rel=0.02)
