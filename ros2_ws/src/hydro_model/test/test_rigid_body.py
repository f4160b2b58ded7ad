"""Rigid-body dynamics against pinocchio, analytic truths, energy balances and invariants."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pinocchio
import pytest
from scipy.integrate import solve_ivp

from hydro_model.errors import RobotError
from hydro_model.multibody import rigid_body, rigid_body_kernels, rigid_body_reference, spatial
from hydro_model.multibody.chain_arrays import chain_arrays
from hydro_model.numerics import linear_kernels
from hydro_model.robot import FloatArray, Robot
from hydro_model.robot_files import load_robot

MakeChain = Callable[..., Robot]
CHAINS = [(seed, dof) for dof in range(1, 8) for seed in (0, 1, 2)]
# Pinocchio orders the inertia column-wise: xx, xy, yy, xz, yz, zz.
FROM_PINOCCHIO = [0, 1, 2, 3, 4, 5, 7, 6, 8, 9]


def oracle(robot: Robot) -> pinocchio.Model:
    """The same chain as a pinocchio model."""
    model = pinocchio.Model()
    model.gravity.linear = robot.gravity_m_s2
    parent = 0
    for i, joint in enumerate(robot.joints):
        kind = (
            pinocchio.JointModelPrismaticUnaligned
            if joint.prismatic
            else pinocchio.JointModelRevoluteUnaligned
        )
        placement = pinocchio.SE3(joint.rotation, joint.translation_m)
        parent = model.addJoint(parent, kind(joint.axis), placement, joint.name)
        inertia = pinocchio.Inertia.FromDynamicParameters(robot.link_inertia[i][FROM_PINOCCHIO])
        model.appendBodyToJoint(parent, inertia, pinocchio.SE3.Identity())
    return model


def motion(robot: Robot, count: int = 5) -> list[FloatArray]:
    rng = np.random.default_rng(robot.dof)
    return list(rng.uniform(-2.0, 2.0, size=(3, count, robot.dof)))


@pytest.mark.parametrize(("seed", "dof"), CHAINS)
def test_pinocchio_agrees(make_chain: MakeChain, seed: int, dof: int) -> None:
    robot = make_chain(seed, dof)
    model = oracle(robot)
    data = model.createData()
    for q, qd, qdd in zip(*motion(robot), strict=True):
        torque = pinocchio.rnea(model, data, q, qd, qdd)
        scale = 1.0 + np.abs(torque).max()
        assert np.allclose(rigid_body.inverse_dynamics(robot, q, qd, qdd), torque, 0, 1e-9 * scale)
        mass = pinocchio.crba(model, data, q)
        mass = np.triu(mass) + np.triu(mass, 1).T
        assert np.allclose(rigid_body.mass_matrix(robot, q), mass, 0, 1e-9 * scale)
        columns = pinocchio.computeJointTorqueRegressor(model, data, q, qd, qdd)
        columns = columns.reshape(dof, dof, 10)[:, :, FROM_PINOCCHIO].reshape(dof, -1)
        assert np.allclose(rigid_body.regressor(robot, q, qd, qdd), columns, 0, 1e-9 * scale)
        kinetic = pinocchio.computeKineticEnergy(model, data, q, qd)
        assert rigid_body.kinetic_energy(robot, q, qd) == pytest.approx(kinetic, rel=1e-9)
        potential = pinocchio.computePotentialEnergy(model, data, q)
        assert rigid_body.potential_energy(robot, q) == pytest.approx(potential, abs=1e-9 * scale)


@pytest.mark.parametrize(("seed", "dof"), CHAINS)
def test_compiled_equals_reference(make_chain: MakeChain, seed: int, dof: int) -> None:
    robot = make_chain(seed, dof)
    q, qd, qdd = motion(robot)
    qd_r = qd + 0.3 * qdd[::-1]
    pairs = [
        (
            rigid_body.inverse_dynamics(robot, q, qd, qdd),
            rigid_body_reference.inverse_dynamics(robot, q, qd, qdd),
        ),
        (
            rigid_body.required_torque(robot, q, qd, qd_r, qdd, 70.0),
            rigid_body_reference.required_torque(robot, q, qd, qd_r, qdd, 70.0),
        ),
        (
            rigid_body.regressor(robot, q, qd, qdd),
            rigid_body_reference.regressor(robot, q, qd, qdd),
        ),
        (rigid_body.mass_matrix(robot, q), rigid_body_reference.mass_matrix(robot, q)),
    ]
    for compiled, readable in pairs:
        assert np.allclose(compiled, readable, rtol=1e-12, atol=1e-12 * np.abs(readable).max())


@pytest.mark.parametrize(("seed", "dof"), [(0, 1), (1, 3), (2, 6)])
def test_armatures_are_pinocchios(make_chain: MakeChain, seed: int, dof: int) -> None:
    plain, armature = make_chain(seed, dof), np.random.default_rng(seed).uniform(-0.1, 9.0, dof)
    joints = zip(plain.joints, armature.tolist(), strict=True)
    robot = replace(plain, joints=tuple(replace(joint, armature=own) for joint, own in joints))
    model = oracle(plain)
    model.armature = armature
    data = model.createData()
    q, qd, qdd = motion(robot)
    torque = rigid_body.inverse_dynamics(robot, q, qd, qdd)
    assert np.allclose(rigid_body_reference.inverse_dynamics(robot, q, qd, qdd), torque, 1e-12)
    assert np.allclose(rigid_body.forward_dynamics(robot, q, qd, torque), qdd, atol=1e-9)
    matrices = rigid_body_reference.mass_matrix(robot, q)
    assert np.allclose(rigid_body.mass_matrix(robot, q), matrices, 1e-12)
    for k, mass in enumerate(matrices):
        expected = np.triu(pinocchio.crba(model, data, q[k]))
        assert np.allclose(np.triu(mass), expected, 0, 1e-9 * np.abs(mass).max())
        # Newer ones have armatures in `rnea` as well: M qdd + h says the same in all.
        h = pinocchio.nonLinearEffects(model, data, q[k], qd[k])
        assert np.allclose(torque[k], mass @ qdd[k] + h, 0, 1e-9 * np.abs(torque[k]).max())


@pytest.mark.parametrize(("seed", "dof"), CHAINS)
def test_regressor_times_parameters_is_inverse_dynamics(
    make_chain: MakeChain, seed: int, dof: int
) -> None:
    robot = make_chain(seed, dof)
    q, qd, qdd = motion(robot)
    torque = rigid_body.inverse_dynamics(robot, q, qd, qdd)
    product = rigid_body.regressor(robot, q, qd, qdd) @ robot.link_inertia.ravel()
    assert np.allclose(product, torque, rtol=0, atol=1e-12 * np.abs(torque).max())


@pytest.mark.parametrize(("seed", "dof"), CHAINS)
def test_mass_matrix_is_symmetric_positive_and_made_of_unit_accelerations(
    make_chain: MakeChain, seed: int, dof: int
) -> None:
    robot = make_chain(seed, dof)
    q = motion(robot, 1)[0][0]
    mass = rigid_body.mass_matrix(robot, q)
    assert np.array_equal(mass, mass.T)
    assert np.linalg.eigvalsh(mass).min() > 0.0
    still = np.zeros(dof)
    gravity = rigid_body.inverse_dynamics(robot, q, still, still)
    for i, unit in enumerate(np.eye(dof)):
        column = rigid_body.inverse_dynamics(robot, q, still, unit) - gravity
        assert np.allclose(mass[:, i], column, atol=1e-11 * np.abs(gravity).max())


@pytest.mark.parametrize(("seed", "dof"), [(4, 1), (4, 3), (4, 6)])
def test_forward_dynamics_inverts_inverse_dynamics(
    make_chain: MakeChain, seed: int, dof: int
) -> None:
    robot = make_chain(seed, dof)
    q, qd, qdd = motion(robot)
    torque = rigid_body.inverse_dynamics(robot, q, qd, qdd)
    back = rigid_body.forward_dynamics(robot, q, qd, torque)
    assert np.allclose(back, qdd, atol=1e-9)


@pytest.mark.parametrize(("seed", "dof"), [(0, 2), (1, 3), (2, 5)])
def test_free_motion_conserves_energy(make_chain: MakeChain, seed: int, dof: int) -> None:
    robot = make_chain(seed, dof, 0.0)
    idle = np.zeros(dof)

    def rates(_: float, state: FloatArray) -> FloatArray:
        q, qd = state[:dof], state[dof:]
        return np.concatenate([qd, rigid_body.forward_dynamics(robot, q, qd, idle)])

    start = np.random.default_rng(seed).uniform(-1.0, 1.0, 2 * dof)
    run = solve_ivp(rates, (0.0, 1.0), start, method="DOP853", rtol=1e-11, atol=1e-11)
    q, qd = np.ascontiguousarray(run.y[:dof].T), np.ascontiguousarray(run.y[dof:].T)
    kinetic = rigid_body.kinetic_energy(robot, q, qd)
    energy = kinetic + rigid_body.potential_energy(robot, q)
    assert np.ptp(kinetic) > 1.0
    assert np.ptp(energy) < 1e-8 * np.ptp(kinetic)


@pytest.mark.parametrize(("seed", "dof"), [(0, 1), (1, 4), (2, 7)])
def test_power_of_the_torques_is_the_rate_of_energy(
    make_chain: MakeChain, seed: int, dof: int
) -> None:
    robot = make_chain(seed, dof)
    q, qd, qdd = (stack[0] for stack in motion(robot))
    step = 1e-5

    def energy(t: float) -> float:
        at, speed = q + qd * t + 0.5 * qdd * t * t, qd + qdd * t
        kinetic = rigid_body.kinetic_energy(robot, at, speed)
        return float(kinetic + rigid_body.potential_energy(robot, at))

    rate = (energy(step) - energy(-step)) / (2.0 * step)
    power = float(qd @ rigid_body.inverse_dynamics(robot, q, qd, qdd))
    assert power == pytest.approx(rate, rel=1e-6)


def test_planar_two_link_truth() -> None:
    """The crane by Lagrange's equations written out by hand, joints about -Y, x = X, y = Z."""
    robot = replace(load_robot("xs031"), cylinders=())
    a, g = 1.6, 9.81
    inertia = robot.link_inertia
    (x1, y1, i1), (m2, x2, y2, i2) = inertia[0, [1, 3, 7]], inertia[1, [0, 1, 3, 7]]
    rng = np.random.default_rng(5)
    for (q1, q2), (w1, w2), (d1, d2) in rng.normal(size=(20, 3, 2)):
        c2, s2 = np.cos(q2), np.sin(q2)
        c1, s1, c12, s12 = np.cos(q1), np.sin(q1), np.cos(q1 + q2), np.sin(q1 + q2)
        coupling, slope = a * (x2 * c2 - y2 * s2), -a * (x2 * s2 + y2 * c2)
        m11, m12 = i1 + m2 * a * a + i2 + 2.0 * coupling, i2 + coupling
        load2 = g * (x2 * c12 - y2 * s12)
        load1 = g * ((x1 + m2 * a) * c1 - y1 * s1) + load2
        tau1 = m11 * d1 + m12 * d2 + slope * (2.0 * w1 * w2 + w2 * w2) + load1
        tau2 = m12 * d1 + i2 * d2 - slope * w1 * w1 + load2
        found = rigid_body.inverse_dynamics(robot, [q1, q2], [w1, w2], [d1, d2])
        assert np.allclose(found, [tau1, tau2], rtol=1e-12, atol=1e-9)


@pytest.mark.parametrize(("seed", "dof"), CHAINS)
def test_required_torque_of_the_actual_motion_is_inverse_dynamics(
    make_chain: MakeChain, seed: int, dof: int
) -> None:
    robot = make_chain(seed, dof)
    q, qd, qdd = motion(robot)
    expected = rigid_body.inverse_dynamics(robot, q, qd, qdd)
    assert np.array_equal(rigid_body.required_torque(robot, q, qd, qd, qdd, 0.0), expected)
    assert np.array_equal(rigid_body.required_torque(robot, q, qd, qd, qdd, 1e4), expected)


@pytest.mark.parametrize(("seed", "dof"), CHAINS)
def test_required_torque_is_passive(make_chain: MakeChain, seed: int, dof: int) -> None:
    """(qd_r - qd) . (tau_r - tau) = d/dt (e M e / 2) + k_v sum |v_d - v|^2, per link."""
    robot = make_chain(seed, dof)
    q, qd, qdd = (stack[0] for stack in motion(robot))
    qd_r, qdd_r = 0.7 * qd[::-1] - 0.2, np.cos(qdd)
    gain, step = 40.0, 1e-5
    error, error_rate = qd_r - qd, qdd_r - qdd

    def stored(t: float) -> float:
        at = q + qd * t + 0.5 * qdd * t * t
        return float(rigid_body.kinetic_energy(robot, at, error + error_rate * t))

    rate = (stored(step) - stored(-step)) / (2.0 * step)
    transforms = np.zeros((1, 6, dof))
    lost = 0.0
    for i, joint in enumerate(robot.joints):
        transforms = rigid_body_reference.joint_transform(joint, q[i : i + 1]) @ transforms
        transforms[:, :, i] += rigid_body_reference.joint_motion(joint)
        lost += gain * float(np.sum((transforms[0] @ error) ** 2))
    actual = rigid_body.inverse_dynamics(robot, q, qd, qdd)
    required = rigid_body.required_torque(robot, q, qd, qd_r, qdd_r, gain)
    assert float(error @ (required - actual)) == pytest.approx(rate + lost, rel=1e-6, abs=1e-5)
    damping = required - rigid_body.required_torque(robot, q, qd, qd_r, qdd_r, 0.0)
    assert float(error @ damping) == pytest.approx(lost, rel=1e-9)


def test_body_regressor_is_mass_times_acceleration_plus_velocity_products() -> None:
    """Eq. 29 against eqs. 25 to 27 for an arbitrary body and motion."""
    rng = np.random.default_rng(8)
    parameters, acceleration, velocity = rng.normal(size=10), *rng.normal(size=(2, 6))
    matrix = spatial.spatial_inertia(parameters)
    cross, first = spatial.skew(velocity[:3]), matrix[:3, 3:]
    coriolis = np.block(
        [
            [cross @ matrix[:3, :3] + matrix[:3, :3] @ cross, first @ cross],
            [-cross @ first, parameters[0] * cross],
        ]
    )
    force = matrix @ acceleration + coriolis @ velocity
    assert np.allclose(spatial.body_regressor(acceleration, velocity) @ parameters, force)


def test_a_stack_is_its_samples(make_chain: MakeChain) -> None:
    robot = make_chain(3, 4)
    q, qd, qdd = motion(robot)
    stacked = rigid_body.inverse_dynamics(robot, q, qd, qdd)
    columns = rigid_body.regressor(robot, q, qd, qdd)
    for k in range(len(q)):
        assert np.array_equal(stacked[k], rigid_body.inverse_dynamics(robot, q[k], qd[k], qdd[k]))
        assert np.array_equal(columns[k], rigid_body.regressor(robot, q[k], qd[k], qdd[k]))
    still = np.zeros(robot.dof)
    repeated = rigid_body.inverse_dynamics(robot, q, still, still)
    assert np.array_equal(repeated, rigid_body.inverse_dynamics(robot, q, 0 * q, 0 * q))
    strided = rigid_body.inverse_dynamics(robot, q[::2], qd[::2], qdd[::2])
    assert np.array_equal(strided, stacked[::2])
    assert rigid_body.inverse_dynamics(robot, q[:0], qd[:0], qdd[:0]).shape == (0, 4)


def test_another_robot_object_has_dynamics_of_its_own(make_chain: MakeChain) -> None:
    robot = make_chain(3, 2)
    q, qd, qdd = motion(robot)
    torque = rigid_body.inverse_dynamics(robot, q, qd, qdd)
    for factor in range(2, 80):
        heavier = replace(robot, link_inertia=factor * robot.link_inertia)
        assert np.allclose(rigid_body.inverse_dynamics(heavier, q, qd, qdd), factor * torque)
    assert np.array_equal(rigid_body.inverse_dynamics(robot, q, qd, qdd), torque)


@pytest.mark.parametrize("shape", [(3,), (4, 3), (1, 1, 2), ()])
def test_wrong_shapes_are_refused(shape: tuple[int, ...]) -> None:
    robot = load_robot("xs031")
    with pytest.raises(RobotError, match=r"expected joint vectors of shape \(2,\) or \(N, 2\)"):
        rigid_body.mass_matrix(robot, np.zeros(shape))


def test_stacks_of_different_length_are_refused() -> None:
    robot = load_robot("xs031")
    with pytest.raises(RobotError, match="stacks of equal length"):
        rigid_body.inverse_dynamics(robot, np.zeros((3, 2)), np.zeros((4, 2)), np.zeros(2))


def test_unphysical_inertia_is_refused_by_forward_dynamics() -> None:
    robot = load_robot("xs031")
    broken = replace(robot, link_inertia=-robot.link_inertia)
    with pytest.raises(RobotError, match="positive definite mass matrix"):
        rigid_body.forward_dynamics(broken, [0.5, -1.0], [0.0, 0.0], [0.0, 0.0])
    with pytest.raises(RobotError, match="positive definite mass matrix"):
        rigid_body.forward_dynamics(robot, [np.nan, -1.0], [0.0, 0.0], [0.0, 0.0])


@pytest.mark.parametrize("dof", range(1, 8))
def test_kernels_for_other_compiled_code(make_chain: MakeChain, dof: int) -> None:
    """M and h in one go, and the small solver, as a simulator calls them."""
    robot = make_chain(5, dof)
    chain = chain_arrays(robot)
    q, qd, qdd = (stack[0] for stack in motion(robot))
    scratch = np.full((dof, rigid_body_kernels.SCRATCH), np.nan)
    mass, bias = np.full((dof, dof), np.nan), np.full(dof, np.nan)
    rigid_body_kernels.mass_matrix_and_bias(
        q, qd, *chain.frames, *chain.bodies, scratch, mass, bias
    )
    assert np.array_equal(mass, rigid_body.mass_matrix(robot, q))
    assert np.array_equal(bias, rigid_body.inverse_dynamics(robot, q, qd, 0.0 * qd))
    solution = mass @ qdd
    factor = mass.copy()
    assert linear_kernels.solve_spd(factor, solution)
    assert np.allclose(solution, qdd, atol=1e-10)
    assert not linear_kernels.solve_spd(-mass, solution)
    assert not linear_kernels.solve_spd(np.full((dof, dof), np.nan), solution)
