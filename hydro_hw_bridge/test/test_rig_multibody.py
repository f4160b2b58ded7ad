"""Rigid bodies of the truth plant against pinocchio, geometry and energy arguments."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from hydro_hw_bridge.errors import BridgeError
from hydro_hw_bridge.rig.plant import Plant, _pins
from hydro_hw_bridge.rig.pose import joints_for_tip, tip_frame
from hydro_hw_bridge.rig.truth import Truth
from hydro_model.hydraulics.cylinder import stroke
from hydro_model.robot import Cylinder, CylinderPart, FloatArray, Joint, Robot
from hydro_model.robot_files import load_robot


def _rotation(random: np.random.Generator) -> FloatArray:
    q, r = np.linalg.qr(random.normal(size=(3, 3)))
    q = q * np.sign(np.diag(r))
    return np.asarray(q * np.linalg.det(q))


def _random_chain(seed: int) -> tuple[Robot, pin.Model]:
    random = np.random.default_rng(seed)
    model, parent = pin.Model(), 0
    joints, rows = [], []
    for i in range(int(random.integers(1, 8))):
        axis = random.normal(size=3)
        axis /= np.linalg.norm(axis)
        prismatic = bool(random.random() < 0.3)
        rotation, translation = _rotation(random), random.normal(size=3)
        joints.append(
            Joint(
                *(f"j{i}", f"l{i}", f"l{i + 1}", prismatic, translation, rotation, axis),
                *(-10.0, 10.0, 1.0, 1.0),
            )
        )
        mass, com = random.uniform(1.0, 20.0), random.normal(size=3)
        axes = _rotation(random)
        moment = axes @ np.diag(random.uniform(0.1, 2.0, 3)) @ axes.T
        central = np.trace(moment) * np.eye(3) - moment
        about = central + mass * (com @ com * np.eye(3) - np.outer(com, com))
        rows.append([mass, *(mass * com), *about[[0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2]]])
        kind = pin.JointModelPrismaticUnaligned if prismatic else pin.JointModelRevoluteUnaligned
        parent = model.addJoint(parent, kind(axis), pin.SE3(rotation, translation), f"j{i}")
        model.appendBodyToJoint(parent, pin.Inertia(mass, com, central), pin.SE3.Identity())
    gravity = random.normal(size=3) * 5.0
    model.gravity.linear = gravity
    tip = random.normal(size=3)
    robot = Robot("chain", tuple(joints), np.array(rows), "tip", tip, gravity, (), ())
    return robot, model


@pytest.mark.parametrize("seed", range(12))
def test_forward_dynamics_of_random_chains_equal_pinocchio(seed: int) -> None:
    robot, model = _random_chain(seed)
    data = model.createData()
    random = np.random.default_rng(100 + seed)
    plant = Plant(robot, Truth.ideal(robot), np.zeros(robot.dof))
    for _ in range(5):
        q, qd, tau = random.normal(size=(3, robot.dof))
        matrix, bias, _ = plant.equations(q, qd)
        ours = np.linalg.solve(matrix, tau - bias)
        theirs = pin.aba(model, data, q, qd, tau)
        np.testing.assert_allclose(ours, theirs, rtol=1e-8, atol=1e-8)
        plant.state[: 2 * robot.dof] = [*q, *qd]
        unforced = plant.rates(np.zeros(0))[robot.dof : 2 * robot.dof]
        free = pin.aba(model, data, q, qd, np.zeros(robot.dof))
        np.testing.assert_allclose(unforced, free, rtol=1e-8, atol=1e-8)


@pytest.mark.parametrize("seed", range(4))
def test_tip_and_its_velocity_equal_pinocchio(seed: int) -> None:
    robot, model = _random_chain(seed)
    frame = pin.Frame("tip", robot.dof, 0, pin.SE3(np.eye(3), robot.tip_offset_m), pin.OP_FRAME)
    index = model.addFrame(frame)
    data = model.createData()
    q, qd = np.random.default_rng(seed).normal(size=(2, robot.dof))
    plant = Plant(robot, Truth.ideal(robot), np.zeros(robot.dof))
    plant.state[: 2 * robot.dof] = [*q, *qd]
    pin.forwardKinematics(model, data, q, qd)
    pin.updateFramePlacements(model, data)
    velocity = pin.getFrameVelocity(model, data, index, pin.LOCAL_WORLD_ALIGNED).linear
    expected = np.concatenate([data.oMf[index].translation, velocity])
    np.testing.assert_allclose(plant.tip(), expected, atol=1e-10)
    tip, jacobian = tip_frame(robot, q)
    np.testing.assert_allclose(np.concatenate([tip, jacobian @ qd]), expected, atol=1e-10)


def test_stroke_is_the_distance_between_the_pins() -> None:
    robot = load_robot("xs031")
    plant = Plant(robot, Truth.ideal(robot), np.array([0.8, -1.2]))
    for shares in np.random.default_rng(0).random((20, 2)):
        lower, upper = np.array([[j.lower, j.upper] for j in robot.joints]).T
        q = lower + shares * (upper - lower)
        plant.state[:2] = q
        expected = [float(stroke(c, angle)) for c, angle in zip(robot.cylinders, q, strict=True)]
        np.testing.assert_allclose(plant.strokes(), expected, atol=1e-12)


@pytest.mark.parametrize("off", [1e-9, 1e-6, 1e-4, 5e-3])
def test_an_axis_that_is_x_but_for_its_last_digits_turns_about_x(off: float) -> None:
    """Whatever of x is left across it would point anywhere."""
    robot = load_robot("xs031")
    cylinder, joint = robot.cylinders[0], robot.joints[0]
    exact = _pins(cylinder, replace(joint, axis=np.array([1.0, 0.0, 0.0])))
    for aside in ([0.0, off], [off, 0.0], [-off, off]):
        axis = np.array([1.0, *aside])
        near = _pins(cylinder, replace(joint, axis=axis / np.linalg.norm(axis)))
        np.testing.assert_allclose(near, exact, atol=4.0 * off)


def test_parts_of_a_cylinder_on_a_joint_that_slides_are_refused() -> None:
    """Its links carry them: the plant knows of no pins."""
    robot = load_robot("xs031")
    truth = Truth.ideal(robot)
    slide = replace(robot.joints[1], prismatic=True)
    seat = replace(robot.cylinders[1], l1_m=0.0, l2_m=0.0)
    sliding = replace(robot, joints=(robot.joints[0], slide), cylinders=(robot.cylinders[0], seat))
    with pytest.raises(BridgeError, match="'tilt_cylinder' is on a prismatic joint: expected"):
        Plant(sliding, truth, np.array([0.8, -1.2]))


def test_lever_is_the_derivative_of_the_stroke() -> None:
    robot = load_robot("xs031")
    q, step = np.array([0.6, -1.4]), 1e-6
    plant = Plant(robot, Truth.ideal(robot), q)
    _, _, lever = plant.equations(q, np.zeros(2))
    strokes = []
    for sign in (1, -1):
        plant.state[:2] = q + sign * step
        strokes.append(plant.strokes())
    np.testing.assert_allclose(lever, (strokes[0] - strokes[1]) / (2 * step), rtol=1e-8)


def _spatial_robot_with_cylinder() -> tuple[Robot, Truth]:
    """A slewing column, then a joint with a heavy cylinder, on tilted axes."""
    chain, _ = _random_chain(3)
    joints = tuple(replace(j, prismatic=False) for j in (*chain.joints, *chain.joints)[:3])
    rows = np.vstack([chain.link_inertia, chain.link_inertia])[:3]
    cylinder = Cylinder(
        *("c", joints[1].name, 0.08, 0.045, 2.0, 1.1, 0.4, 0.9, 0.1, 0.3),
        *(CylinderPart(17.0, 0.35, 0.9), CylinderPart(10.0, 0.3, 0.6), 1.2e9),
    )
    joints = tuple(replace(j, name=f"j{i}") for i, j in enumerate(joints))
    cylinder = replace(cylinder, joint="j1")
    robot = Robot(
        *("column", joints, rows, "tip", np.zeros(3), np.array([0.3, -1.0, -9.0])),
        *((cylinder,), ()),
        supply_pressure_pa=1.9e7,
        tank_pressure_pa=0.0,
    )
    ideal = Truth.ideal(robot)
    heavy = replace(ideal.cylinders[0], barrel=cylinder.barrel, rod=cylinder.rod)
    return robot, replace(ideal, cylinders=(heavy,))


def test_cylinder_bodies_follow_lagrange() -> None:
    """Bias of moving barrel and rod = d/dt(dT/dqd) - dT/dq + dU/dq, T from the mass matrix."""
    robot, truth = _spatial_robot_with_cylinder()
    light = replace(truth.cylinders[0], barrel=None, rod=None)
    q, qd = np.array([0.3, 0.7, -0.4]), np.array([0.5, -0.8, 0.6])
    heavy = Plant(robot, truth, q)
    bare = Plant(robot, replace(truth, cylinders=(light,)), q)

    def added(at: FloatArray) -> FloatArray:
        return heavy.equations(at, np.zeros(3))[0] - bare.equations(at, np.zeros(3))[0]

    step, n = 1e-6, robot.dof
    slopes = [(added(q + step * e) - added(q - step * e)) / (2 * step) for e in np.eye(n)]
    lagrange = sum(qd[k] * slopes[k] @ qd for k in range(n)) - np.array(
        [0.5 * qd @ slope @ qd for slope in slopes]
    )
    moving = heavy.equations(q, qd)[1] - bare.equations(q, qd)[1]
    resting = heavy.equations(q, np.zeros(n))[1] - bare.equations(q, np.zeros(n))[1]
    np.testing.assert_allclose(moving - resting, lagrange, rtol=1e-6, atol=1e-7)
    eigenvalues = np.linalg.eigvalsh(added(q))
    assert eigenvalues[-1] > 1.0
    assert eigenvalues[0] > -1e-9


def test_weight_of_cylinder_bodies_by_hand() -> None:
    """Crane upright by numbers: gravity torque of barrel and rod from their centres of mass."""
    robot = load_robot("xs031")
    ideal = Truth.ideal(robot)
    truth = replace(
        ideal, cylinders=tuple(replace(c, barrel=None, rod=None) for c in ideal.cylinders)
    )
    lift = robot.cylinders[0]
    heavy = replace(truth.cylinders[0], barrel=lift.barrel, rod=lift.rod)
    q = np.array([0.7, -1.0])
    bare = Plant(robot, truth, q)
    loaded = Plant(robot, replace(truth, cylinders=(heavy, truth.cylinders[1])), q)
    assert lift.barrel is not None
    assert lift.rod is not None
    barrel, rod = lift.barrel, lift.rod

    def energy(angle: float) -> float:
        at = angle + lift.child_pin_angle_rad
        child = lift.l2_m * np.array([np.cos(at), np.sin(at)])
        fixed = lift.child_pin_angle_rad - lift.q0_rad
        parent = lift.l1_m * np.array([np.cos(fixed), np.sin(fixed)])
        along = (child - parent) / np.linalg.norm(child - parent)
        height_barrel = (parent + barrel.com_from_pin_m * along)[1]
        height_rod = (child - rod.com_from_pin_m * along)[1]
        return float(9.81 * (barrel.mass_kg * height_barrel + rod.mass_kg * height_rod))

    torque = (energy(q[0] + 1e-6) - energy(q[0] - 1e-6)) / 2e-6
    difference = loaded.equations(q, np.zeros(2))[1] - bare.equations(q, np.zeros(2))[1]
    np.testing.assert_allclose(difference, [torque, 0.0], rtol=1e-7, atol=1e-7)


def test_tip_is_found_again() -> None:
    robot = load_robot("xs031")
    for corner in ([2.0, 0.0, -1.2], [3.5, 0.0, 0.8]):
        q = joints_for_tip(robot, np.array(corner))
        np.testing.assert_allclose(tip_frame(robot, q)[0], corner, atol=1e-9)
