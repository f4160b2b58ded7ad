"""A joint that is parked at one angle while a base is fitted, and at another to verify on."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from hydro_ident.mismatch.split.held_out import rms
from hydro_ident.mismatch.split.residuals import Residuals
from hydro_model.hydraulics.cylinder import lever
from hydro_model.multibody.rigid_body import inverse_dynamics
from hydro_model.robot import Robot

PARKED, SECONDS, STEP_S = 1, 30.0, 0.002
ANGLES = (-1.0, -1.005, -1.3, -1.6)


def _run(run: Any, robot: Robot, angle: float, seed: int = 0) -> Any:
    """The lift to and fro by what forces that takes, the tilt joint parked at an angle."""
    rng, time = np.random.default_rng(seed), STEP_S * np.arange(round(SECONDS / STEP_S))
    q, qd, qdd = np.zeros((3, time.size, 2))
    q[:, 0], q[:, PARKED] = 0.5, angle
    for hz, size in ((0.13, 0.3), (0.41, 0.05)):
        w, phase = 2.0 * np.pi * hz, rng.uniform(0.0, 2.0 * np.pi)
        q[:, 0] += size * np.sin(w * time + phase)
        qd[:, 0] += size * w * np.cos(w * time + phase)
        qdd[:, 0] -= size * w**2 * np.sin(w * time + phase)
    torque = np.array([inverse_dynamics(robot, *one) for one in zip(q, qd, qdd, strict=True)])
    p_a, p_b = np.zeros_like(q), np.full_like(q, 5.0e6)
    for k, cylinder in enumerate(robot.cylinders):
        arm = np.array([float(lever(cylinder, angle)) for angle in q[:, k]])
        force = torque[:, k] / arm + cylinder.viscous_friction * arm * qd[:, k]
        p_a[:, k] = (force + cylinder.area_b_m2 * p_b[:, k]) / cylinder.area_a_m2
    noise = rng.normal(0.0, 4.0e3, (2, *q.shape))
    # Without valve signals there are force rows alone.
    return replace(
        run, q=q, p_a=p_a + noise[0], p_b=p_b + noise[1], voltage=np.full_like(q, np.nan)
    )


@pytest.fixture(scope="module")
def work(make_run: Any, crane_run: Any, lay_out: Callable[..., Residuals]) -> Residuals:
    true_crane, _ = make_run
    robot = true_crane(payload_kg=60.0)
    others = [_run(crane_run, robot, angle, 1 + k) for k, angle in enumerate(ANGLES)]
    return lay_out(_run(crane_run, robot, ANGLES[0]), others)


def _rows(work: Residuals, number: int) -> np.ndarray:
    """Rows of the lift's force in a recording to verify on."""
    material = work.check.predictor.material
    lift = material.channel == material.channels.index("lift/force")
    return np.asarray(lift & (material.recording == number))


@pytest.mark.thorough
def test_gravity_of_a_joint_parked_elsewhere_is_not_known(work: Residuals) -> None:
    """What the rows are left out for: a base fitted at one angle is wrong at another."""
    left = work.check.residual(work.base.model)
    here, near, far, further = (rms(left[_rows(work, k)]) for k in range(4))
    assert near < 0.1 * far
    assert further > far > 50.0 * here


def test_forces_are_verified_on_where_the_joint_is_parked_as_in_the_fit(work: Residuals) -> None:
    check = work.check
    for k, angle in enumerate(ANGLES):
        own = _rows(work, k)
        assert own.sum() > 100
        kept = abs(angle - ANGLES[0]) < 0.01
        assert (check.mask & own).any() == kept
        assert check.beyond is not None
        assert kept or not (check.beyond & own).any()


def test_a_note_says_which_joint_is_parked_elsewhere_and_how_far(work: Residuals) -> None:
    notes = [n for n in work.notes if "stands still" in n]
    assert [n.split(" from")[0] for n in notes] == [
        "check2: tilt stands still 0.3 rad",
        "check3: tilt stands still 0.6 rad",
    ]
