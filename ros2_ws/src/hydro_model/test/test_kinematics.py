"""Tip kinematics against pinocchio, geometry by hand and finite differences."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pinocchio
import pytest

from hydro_model.errors import RobotError
from hydro_model.multibody.kinematics import (
    TipPlace,
    link_frames,
    tip_jacobian,
    tip_jacobian_rate,
    tip_position,
    tip_state,
)
from hydro_model.robot import Robot
from hydro_model.robot_files import load_robot

MakeChain = Callable[..., Robot]
CHAINS = [(seed, dof) for dof in range(1, 8) for seed in (0, 1)]


def test_the_crane_by_hand() -> None:
    robot = load_robot("xs031")
    assert np.allclose(tip_position(robot, [0.0, 0.0]), [1.6 + 2.106, 0.0, 0.0])
    # Joints turn about -Y: a positive angle raises the link.
    assert np.allclose(tip_position(robot, [np.pi / 2, 0.0]), [0.0, 0.0, 3.706])
    assert np.allclose(tip_position(robot, [np.pi / 2, -np.pi / 2]), [2.106, 0.0, 1.6])
    assert np.allclose(tip_jacobian(robot, [0.0, 0.0]), np.array([[0, 0], [0, 0], [3.706, 2.106]]))


@pytest.mark.parametrize(("seed", "dof"), CHAINS)
def test_pinocchio_agrees(make_chain: MakeChain, seed: int, dof: int) -> None:
    robot = make_chain(seed, dof)
    model = pinocchio.Model()
    parent = 0
    for joint in robot.joints:
        kind = (
            pinocchio.JointModelPrismaticUnaligned
            if joint.prismatic
            else pinocchio.JointModelRevoluteUnaligned
        )
        placement = pinocchio.SE3(joint.rotation, joint.translation_m)
        parent = model.addJoint(parent, kind(joint.axis), placement, joint.name)
    offset = pinocchio.SE3(np.eye(3), robot.tip_offset_m)
    tip = model.addFrame(pinocchio.Frame("tip", parent, 0, offset, pinocchio.FrameType.OP_FRAME))
    data = model.createData()
    aligned = pinocchio.ReferenceFrame.LOCAL_WORLD_ALIGNED
    pose_by_pose = TipPlace(robot)
    for q, qd in np.random.default_rng(dof).uniform(-2.0, 2.0, size=(5, 2, dof)):
        pinocchio.computeJointJacobiansTimeVariation(model, data, q, qd)
        pinocchio.updateFramePlacements(model, data)
        assert np.allclose(tip_position(robot, q), data.oMf[tip].translation, atol=1e-12)
        assert np.allclose(pose_by_pose.at(q), data.oMf[tip].translation, atol=1e-12)
        jacobian = pinocchio.getFrameJacobian(model, data, tip, aligned)[:3].reshape(3, dof)
        assert np.allclose(tip_jacobian(robot, q), jacobian, atol=1e-12)
        rate = pinocchio.getFrameJacobianTimeVariation(model, data, tip, aligned)[:3]
        rate = rate.reshape(3, dof)
        assert np.allclose(tip_jacobian_rate(robot, q, qd), rate, atol=1e-11)


@pytest.mark.parametrize(("seed", "dof"), CHAINS)
def test_jacobian_and_rate_are_derivatives(make_chain: MakeChain, seed: int, dof: int) -> None:
    robot = make_chain(seed, dof)
    q, qd = np.random.default_rng(seed).uniform(-2.0, 2.0, size=(2, dof))
    step = 1e-6
    nearby = q + step * np.vstack([np.eye(dof), -np.eye(dof)])
    points = tip_position(robot, nearby)
    slope = (points[:dof] - points[dof:]).T / (2.0 * step)
    assert np.allclose(tip_jacobian(robot, q), slope, atol=1e-7)
    after, before = tip_jacobian(robot, q + step * qd), tip_jacobian(robot, q - step * qd)
    rate = (after - before) / (2.0 * step)
    assert np.allclose(tip_jacobian_rate(robot, q, qd), rate, atol=1e-7)


def test_a_stack_is_its_samples_and_the_state_its_parts(make_chain: MakeChain) -> None:
    robot = make_chain(2, 5)
    q, qd = np.random.default_rng(0).uniform(-2.0, 2.0, size=(2, 6, 5))
    position, jacobian, rate = tip_state(robot, q, qd)
    assert position.shape == (6, 3)
    assert jacobian.shape == rate.shape == (6, 3, 5)
    for k in range(6):
        assert np.array_equal(position[k], tip_position(robot, q[k]))
        assert np.array_equal(jacobian[k], tip_jacobian(robot, q[k]))
        assert np.array_equal(rate[k], tip_jacobian_rate(robot, q[k], qd[k]))


def test_wrong_shapes_are_refused() -> None:
    with pytest.raises(RobotError, match="expected joint vectors"):
        tip_position(load_robot("xs031"), [0.0, 0.0, 0.0])
    for wrong in (np.zeros(3), np.zeros(1), np.zeros((1, 2))):
        with pytest.raises(RobotError, match="expected joint positions of shape"):
            TipPlace(load_robot("xs031")).at(wrong)


@pytest.mark.parametrize(("seed", "dof"), CHAINS)
def test_the_last_link_frame_carries_the_tip(make_chain: MakeChain, seed: int, dof: int) -> None:
    robot = make_chain(seed, dof)
    q = np.random.default_rng(seed).uniform(-2.0, 2.0, size=dof)
    origins, rotations = link_frames(robot, q)
    tip = origins[-1] + rotations[-1] @ robot.tip_offset_m
    assert np.allclose(tip, tip_position(robot, q), atol=1e-12)
    assert np.allclose(np.swapaxes(rotations, 1, 2) @ rotations, np.eye(3), atol=1e-12)
