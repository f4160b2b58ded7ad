"""What shows by a slight tilt of an axis alone spoils no result."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from hydro_ident.design.prediction import expected_trace
from hydro_ident.estimate.effects.listed_effects import ListedEffects
from hydro_ident.estimate.forces.inertial import InertialFit, fit_inertial, force_model
from hydro_ident.estimate.forces.tilts import tilted_names
from hydro_ident.identify.verdict import IDENTIFIED, NOT_ENOUGH, judge
from hydro_model.robot import FloatArray, Robot

H = 0.002
#: Of the tilt's inertia: across its axis, and with it.
SQUARES, FIRST = {"tilt_link.ixx", "tilt_link.ixz"}, {"tilt_link.ixy", "tilt_link.iyz"}


def tilted(robot: Robot, angle_rad: float) -> Robot:
    """The second axis turned about the boom, or nearly so."""
    turn = Rotation.from_euler("x", angle_rad).as_matrix()
    second = replace(robot.joints[1], rotation=robot.joints[1].rotation @ turn)
    return replace(robot, joints=(robot.joints[0], second))


def motion(time: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    q = np.array([0.8, -1.2]) * np.ones((time.size, 2))
    qd, qdd = np.zeros_like(q), np.zeros_like(q)
    for joint, terms in enumerate((((0.3, 0.9), (0.05, 3.1)), ((0.4, 1.3), (0.06, 4.2)))):
        for size, w in terms:
            q[:, joint] += size * np.sin(w * time)
            qd[:, joint] += size * w * np.cos(w * time)
            qdd[:, joint] -= size * w * w * np.sin(w * time)
    return q, qd, qdd


def fitted(robot: Robot, noise_pa: float) -> InertialFit:
    """The robot fitted to its own motion with noise of the pressures."""
    rng, time = np.random.default_rng(0), np.arange(0.0, 24.0, H)
    _, trace = expected_trace(ListedEffects.of(robot), motion(time), H)
    p_a = trace.p_a + noise_pa * rng.normal(size=trace.p_a.shape)
    found = fit_inertial(force_model(robot), [replace(trace, p_a=p_a)])
    assert found is not None
    return found


def verdict(found: InertialFit) -> str:
    """By the forces alone."""
    return judge(replace(found.model.robot, valves=()), [], found, None).verdict


@pytest.mark.parametrize("angle_rad", [7.3e-6, 3.6e-9])
def test_a_rounded_angle_changes_no_name(robot: Robot, angle_rad: float) -> None:
    exact, rounded = force_model(robot), force_model(tilted(robot, angle_rad))
    assert rounded.names == exact.names
    assert force_model(tilted(robot, 0.0)).base.combination.tobytes() == (
        exact.base.combination.tobytes()
    )
    found = fitted(tilted(robot, angle_rad), 2e4)
    assert not found.missing
    assert verdict(found) == IDENTIFIED


@pytest.mark.parametrize("angle_rad", [1.6e-3, 0.0175])
def test_a_tilt_too_slight_to_be_seen_is_held_and_vetoes_nothing(
    robot: Robot, angle_rad: float
) -> None:
    slight = tilted(robot, angle_rad)
    assert tilted_names(force_model(slight)) == SQUARES | FIRST
    found = fitted(slight, 2e6)
    held = {found.model.names[part.index]: part for part in found.held}
    assert set(held) >= SQUARES
    assert not found.missing
    assert verdict(found) == IDENTIFIED
    given = found.model.base.combination @ slight.parameter_vector
    for name in SQUARES:
        part = held[name]
        assert part.value == found.fit.theta[part.index] == given[part.index]
        assert part.reason.startswith("stays the robot file's")


def test_what_the_data_show_of_a_tilt_is_fitted(robot: Robot) -> None:
    """A degree, and no noise to speak of."""
    slight = tilted(robot, 0.0175)
    found = fitted(slight, 1.0)
    held = {found.model.names[part.index] for part in found.held}
    assert not held & (SQUARES | FIRST)
    assert set(found.model.names) >= (SQUARES | FIRST)


def test_too_little_motion_is_told_all_the_same(robot: Robot) -> None:
    slight = tilted(robot, 1.6e-3)
    time = np.arange(0.0, 24.0, H)
    q, qd, qdd = motion(time)
    q[:, 1], qd[:, 1], qdd[:, 1] = -1.2, 0.0, 0.0
    _, trace = expected_trace(ListedEffects.of(slight), (q, qd, qdd), H)
    found = fit_inertial(force_model(slight), [trace])
    assert found is not None
    assert found.missing == ("tilt_cylinder.viscous_friction",)
    assert verdict(found) == NOT_ENOUGH
