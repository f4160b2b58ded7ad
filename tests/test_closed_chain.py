"""Barrels and rods: the model against the rig's truth plant, which shares no physics code."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from hydro_hw_bridge.rig.plant import Plant
from hydro_hw_bridge.rig.truth import CylinderTruth, Truth
from hydro_model.multibody.rigid_body import inverse_dynamics, mass_matrix
from hydro_model.robot import CylinderPart, Robot
from hydro_model.robot_files import load_robot


@pytest.fixture(scope="module")
def robot() -> Robot:
    """The crane with parts that matter, gravity off its plane and a slewing base of its own."""
    crane = load_robot("xs031")
    slew = replace(
        crane.joints[0],
        name="slew",
        parent_link="ground",
        child_link="base_link",
        axis=np.array([0.0, 0.0, 1.0]),
        translation_m=np.array([0.1, -0.2, 0.3]),
    )
    base = np.array([[300.0, 30.0, -12.0, 60.0, 80.0, 2.0, -3.0, 90.0, 4.0, 70.0]])
    barrel, rod = CylinderPart(87.0, 0.4, 5.0), CylinderPart(52.0, 0.3, 3.0)
    return replace(
        crane,
        joints=(slew, *crane.joints),
        link_inertia=np.vstack([base, crane.link_inertia]),
        gravity_m_s2=np.array([0.6, 1.1, -9.7]),
        cylinders=tuple(replace(c, barrel=barrel, rod=rod) for c in crane.cylinders),
    )


def test_mass_matrix_and_bias_are_the_rigs(robot: Robot) -> None:
    rng = np.random.default_rng(3)
    plant = Plant(robot, Truth.ideal(robot), np.array([0.1, 0.5, -1.4]))
    for q, qd in rng.uniform([-0.3, 0.1, -1.9], [0.3, 0.9, -0.7], size=(20, 2, 3)):
        matrix, bias, _ = plant.equations(q, qd)
        scale = np.abs(bias).max()
        np.testing.assert_allclose(mass_matrix(robot, q), matrix, rtol=1e-10, atol=1e-8)
        found = inverse_dynamics(robot, q, qd, np.zeros(3))
        np.testing.assert_allclose(found, bias, rtol=0.0, atol=1e-11 * scale)


def test_an_ideal_machine_has_the_robots_parts() -> None:
    robot = load_robot("xs031")
    for cylinder, real in zip(robot.cylinders, Truth.ideal(robot).cylinders, strict=True):
        wanted = CylinderTruth(
            cylinder.name, cylinder.viscous_friction, barrel=cylinder.barrel, rod=cylinder.rod
        )
        assert real == wanted
