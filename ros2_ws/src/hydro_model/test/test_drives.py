"""Joints that no cylinder moves: the rotor behind a measured torque, and a gear under load."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from hydro_model.effects import signals as sig
from hydro_model.effects.catalogue import CATALOGUE, resolve
from hydro_model.effects.drives import ROTOR_LAG_S
from hydro_model.effects.rows import signal_rows
from hydro_model.effects.targets import targets
from hydro_model.errors import RobotError
from hydro_model.robot import EffectSpec, Robot
from hydro_model.robot_files import load_robot
from hydro_model.simulation.simulate import simulate

CRANE = load_robot("xs031")
ROTOR, GEAR = CATALOGUE["rotor_inertia"], CATALOGUE["load_dependent_friction"]
FORCE_N, SHARE = 300.0, 0.2


@pytest.fixture(scope="module")
def axis() -> Robot:
    """The EMPS axis: a mass on a level screw, without friction."""
    robot = load_robot("emps")
    return replace(robot, joints=tuple(replace(j, viscous_friction=0.0) for j in robot.joints))


def _with(robot: Robot, name: str, **parameters: float) -> Robot:
    return replace(robot, effects=(EffectSpec(name, robot.name, parameters),))


def _pushed(robot: Robot, force: np.ndarray) -> np.ndarray:
    """Velocity of the axis under a force at 1 kHz."""
    time = 0.001 * np.arange(force.size)
    nothing = np.zeros((time.size, 0))
    return simulate(robot, time, nothing, [0.0], torque=force[:, None]).qd[:, 0]


def test_a_rotor_is_inertia_of_its_own_joint(axis: Robot) -> None:
    """A force moves the axis and the rotor: once that follows, v = F t / (m + J)."""
    mass = float(axis.link_inertia[0, 0])
    speed = _pushed(_with(axis, "rotor_inertia", inertia=mass), np.full(201, FORCE_N))
    after = slice(round(10.0 * ROTOR_LAG_S / 0.001), None)
    slope = np.diff(speed[after]) / 0.001
    np.testing.assert_allclose(slope, FORCE_N / (2.0 * mass), rtol=1e-4)


def test_a_rotor_gives_no_energy_of_its_own(axis: Robot) -> None:
    """However heavy it is beside its joint, a free joint comes to no motion by it."""
    mass = float(axis.link_inertia[0, 0])
    push = np.zeros(401)
    push[:20] = FORCE_N
    speed = _pushed(_with(axis, "rotor_inertia", inertia=50.0 * mass), push)
    end = FORCE_N * 0.020 / (51.0 * mass)
    assert speed[-1] == pytest.approx(end, rel=1e-3)
    assert np.all(np.diff(speed[21:]) <= 1e-12)


def test_recorded_motion_gives_its_torque_at_once(axis: Robot) -> None:
    time = 0.002 * np.arange(500)
    q, qd, qdd = (f[:, None] for f in (np.sin(time), np.cos(time), -np.sin(time)))
    rows = signal_rows(axis, None, 0, time, q, qd, qdd)
    torque = ROTOR.evaluate(rows, [3.0], sample_time_s=0.002)
    np.testing.assert_allclose(torque, 3.0 * qdd[:, 0], rtol=1e-12)


def test_cylinders_have_no_rotor(axis: Robot) -> None:
    assert targets(CRANE, ROTOR) == ()
    assert targets(axis, ROTOR) == axis.joint_names
    with pytest.raises(RobotError, match="rotor_inertia' has unknown target 'lift_cylinder'"):
        resolve(
            replace(
                CRANE, effects=(EffectSpec("rotor_inertia", "lift_cylinder", {"inertia": 1.0}),)
            )
        )


def test_friction_of_a_gear_takes_a_share_of_the_torque(axis: Robot) -> None:
    """On a joint without cylinder the drive's torque is what loads the gear."""
    assert targets(axis, GEAR) == axis.joint_names
    rubbing = _with(axis, "load_dependent_friction", share=SHARE, velocity_scale=1e-4)
    mass = float(axis.link_inertia[0, 0])
    slope = np.diff(_pushed(rubbing, np.full(201, FORCE_N))[50:]) / 0.001
    np.testing.assert_allclose(slope, FORCE_N * (1.0 - SHARE) / mass, rtol=1e-6)


def test_a_recording_has_the_measured_torque_for_it(axis: Robot) -> None:
    time = 0.002 * np.arange(100)
    velocity = np.where(time < 0.1, 0.5, -0.5)[:, None]
    rows = signal_rows(axis, None, 0, time, np.zeros_like(velocity), velocity)
    rows[:, sig.PISTON_FORCE] = -FORCE_N
    friction = GEAR.evaluate(rows, [SHARE, 1e-4])
    np.testing.assert_allclose(friction, SHARE * FORCE_N * np.sign(velocity[:, 0]))
