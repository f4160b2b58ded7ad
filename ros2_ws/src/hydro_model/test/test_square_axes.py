"""Axes that an angle's decimals tilt count as parallel or square; truly tilted ones do not."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from hydro_model.multibody.base_parameters import base_map
from hydro_model.multibody.rigid_body import regressor
from hydro_model.multibody.square_axes import ROUNDED_RAD, squared
from hydro_model.robot import Robot
from hydro_model.robot_files import load_robot

MakeChain = Callable[..., Robot]


def right_angled(robot: Robot, seed: int) -> Robot:
    """The chain with all axes and links along coordinate axes."""
    rng = np.random.default_rng([seed, robot.dof])
    angles = rng.integers(0, 4, size=(robot.dof, 3)) * np.pi / 2
    joints = tuple(
        replace(
            joint,
            rotation=rotation,
            axis=np.eye(3)[rng.integers(3)],
            translation_m=np.eye(3)[rng.integers(3)] * rng.choice([0.0, 0.4, 1.0]),
        )
        for joint, rotation in zip(
            robot.joints, Rotation.from_euler("xyz", angles).as_matrix(), strict=True
        )
    )
    return replace(robot, joints=joints, gravity_m_s2=np.array([0.0, 0.0, -9.81]))


def slipped(robot: Robot, size_rad: float, seed: int) -> Robot:
    """The robot with every joint's frame off by angles up to a size."""
    slips = np.random.default_rng(seed).uniform(-size_rad, size_rad, (robot.dof, 3))
    turns = Rotation.from_euler("xyz", slips).as_matrix()
    pairs = zip(robot.joints, turns, strict=True)
    return replace(robot, joints=tuple(replace(j, rotation=t @ j.rotation) for j, t in pairs))


def on_its_side() -> Robot:
    """The crane with gravity along its axes."""
    return replace(load_robot("xs031"), gravity_m_s2=np.array([0.0, -9.81, 0.0]))


@pytest.mark.parametrize("size_rad", [1e-9, 7e-6, 3e-5])
@pytest.mark.parametrize("seed", range(12))
def test_rounded_angles_make_no_parameters(
    make_chain: MakeChain, seed: int, size_rad: float
) -> None:
    exact = right_angled(make_chain(seed, 2 + seed % 5, 0.3), seed)
    rounded = slipped(exact, size_rad, seed)
    again, slips = squared(rounded)
    assert base_map(again).names == base_map(exact).names
    assert all(0.0 < slip.angle_rad < 2.0 * ROUNDED_RAD for slip in slips)


@pytest.mark.parametrize("make", [lambda: load_robot("xs031"), on_its_side])
def test_nor_do_they_of_barrels_and_rods(make: Callable[[], Robot]) -> None:
    exact = make()
    rounded = slipped(exact, 7e-6, 0)
    assert len(base_map(rounded).names) > len(base_map(exact).names)
    again, _ = squared(rounded)
    found = base_map(again)
    assert found.names == base_map(exact).names
    # The map is that of the straight robot, the forces are the rounded one's.
    motion = np.random.default_rng(1).uniform(-1.0, 1.0, size=(3, 60, exact.dof))
    columns, theta = regressor(rounded, *motion), rounded.parameter_vector
    torque = columns @ theta
    base = columns[..., found.leading] @ (found.combination @ theta)
    assert np.abs(base - torque).max() < 1e-4 * np.abs(torque).max()


@pytest.mark.parametrize("name", ["xs031", "emps", "patu655"])
def test_an_exact_robot_stays_the_same_object(name: str) -> None:
    robot = load_robot(name)
    assert squared(robot) == (robot, ())
    assert squared(robot)[0] is robot


@pytest.mark.parametrize("degrees", [0.02, 1.0, -1.0])
def test_a_tilt_that_somebody_made_stays(degrees: float) -> None:
    exact = load_robot("xs031")
    tilt = Rotation.from_euler("x", degrees, degrees=True).as_matrix()
    second = replace(exact.joints[1], rotation=exact.joints[1].rotation @ tilt)
    tilted = replace(exact, joints=(exact.joints[0], second))
    assert squared(tilted)[0] is tilted
    again, [slip] = squared(tilted, 0.02)
    assert slip.joint == "tilt"
    assert slip.angle_rad == pytest.approx(np.radians(abs(degrees)))
    assert base_map(again).names == base_map(exact).names


def test_a_slide_passes_on_what_stands_before_it() -> None:
    """Two axes with a slide between them are parallel in every position, or in none."""
    first, second = load_robot("xs031").joints
    slide = replace(
        second,
        name="slide",
        prismatic=True,
        rotation=Rotation.from_euler("x", 3e-5).as_matrix(),
        axis=np.array([1.0, 0.0, 0.0]),
    )
    robot = replace(
        load_robot("xs031"),
        joints=(first, slide, second),
        link_inertia=np.zeros((3, 10)),
        cylinders=(),
        valves=(),
    )
    # The slide is square to the axis; its own turn about itself tilts what it carries.
    again, [slip] = squared(robot)
    assert slip.joint == "tilt"
    turns = [joint.rotation for joint in again.joints]
    before, behind = turns[0] @ first.axis, turns[0] @ turns[1] @ turns[2] @ second.axis
    np.testing.assert_allclose(np.cross(before, behind), 0.0, atol=1e-15)
