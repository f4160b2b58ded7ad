"""A bending link over a recording, against pinocchio's chain with a joint more."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio
import pytest
from scipy.integrate import solve_ivp

from hydro_model.effects import CATALOGUE
from hydro_model.effects.bending import Load, bent, usual_inertia
from hydro_model.effects.law import Stage
from hydro_model.effects.rows import signal_rows
from hydro_model.errors import RobotError, SimulationError
from hydro_model.multibody.joint_ranges import middle
from hydro_model.multibody.rigid_body import inverse_dynamics
from hydro_model.robot import EffectSpec, FloatArray, Robot
from hydro_model.robot_files import load_robot
from hydro_model.simulation.simulate import Model, simulate
from hydro_model.simulation.simulate_reference import reference_rates

STEP = 0.002
FROM_PINOCCHIO = [0, 1, 2, 3, 4, 5, 7, 6, 8, 9]


def open_chain() -> Robot:
    """The crane without its cylinders' bodies, which move with the links in a way of their own."""
    robot = load_robot("xs031")
    bare = tuple(replace(c, barrel=None, rod=None) for c in robot.cylinders)
    return replace(robot, cylinders=bare)


def with_hub(robot: Robot, at: int, share: float) -> Robot:
    """The robot with so much of what turns about a joint in the joint itself."""
    hub = share / (1.0 - share) * usual_inertia(robot, at)
    joints = [replace(j, armature=hub if i == at else 0.0) for i, j in enumerate(robot.joints)]
    return replace(robot, joints=tuple(joints))


def motion(
    robot: Robot, seconds: float, shift: float = 0.0
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Some turns of all joints from rest, around the middle or, of the last one, beside it."""
    time = np.arange(round(seconds / STEP) + 1)[:, None] * STEP
    pace = np.array([2.1, 3.3, 4.7])[: robot.dof]
    q = 0.3 * np.sin(pace * time) ** 3
    qd = 0.9 * pace * np.sin(pace * time) ** 2 * np.cos(pace * time)
    qdd = 0.9 * pace**2 * np.sin(pace * time) * (2.0 - 3.0 * np.sin(pace * time) ** 2)
    q[:, -1] += shift
    return middle(robot) + q, qd, qdd


def hinged(robot: Robot, at: int, place: float = 0.0) -> pinocchio.Model:
    """The chain with a passive joint in link `at`, so far along it: the rest hangs on that."""
    model = pinocchio.Model()
    model.gravity.linear = robot.gravity_m_s2
    parent, behind = 0, np.zeros(3)
    for i, joint in enumerate(robot.joints):
        kind = pinocchio.JointModelRevoluteUnaligned(joint.axis)
        placement = pinocchio.SE3(joint.rotation, joint.translation_m - behind)
        parent, behind = model.addJoint(parent, kind, placement, joint.name), np.zeros(3)
        if i == at:
            kind = pinocchio.JointModelRevoluteUnaligned(joint.axis)
            if place > 0.0:
                behind = place * robot.joints[i + 1].translation_m
            parent = model.addJoint(parent, kind, pinocchio.SE3(np.eye(3), behind), "hinge")
        inertia = pinocchio.Inertia.FromDynamicParameters(robot.link_inertia[i][FROM_PINOCCHIO])
        model.appendBodyToJoint(parent, inertia, pinocchio.SE3.Identity())
    return model


def hinge_torques(
    model: pinocchio.Model, at: int, spring: tuple[float, float], moved: tuple[FloatArray, ...]
) -> FloatArray:
    """Torques at the joints that move as told while the hinge swings by itself, (N, n)."""
    data, (q, qd, qdd) = model.createData(), moved
    time = np.arange(len(q)) * STEP
    free = at + 1

    def full(row: FloatArray, own: float) -> FloatArray:
        return np.insert(row, free, own)

    def rates(t: float, y: FloatArray) -> FloatArray:
        k = min(int(t / STEP), len(time) - 2)
        part = t / STEP - k
        state = [values[k] + part * (values[k + 1] - values[k]) for values in moved]
        at_rest = pinocchio.rnea(
            model, data, full(state[0], y[0]), full(state[1], y[1]), full(state[2], 0.0)
        )
        mass = pinocchio.crba(model, data, full(state[0], y[0]))[free, free]
        return np.array([y[1], (-spring[0] * y[0] - spring[1] * y[1] - at_rest[free]) / mass])

    sag = pinocchio.rnea(model, data, full(q[0], 0.0), full(qd[0], 0.0), full(qdd[0], 0.0))
    start = [-sag[free] / spring[0], 0.0]
    out = solve_ivp(rates, (0.0, time[-1]), start, "LSODA", time, rtol=1e-6, atol=1e-8)
    torques = []
    for k, y in enumerate(out.y.T):
        own = full(q[k], y[0]), full(qd[k], y[1]), full(qdd[k], rates(time[k], y)[1])
        torques.append(np.delete(pinocchio.rnea(model, data, *own), free))
    return np.array(torques)


@pytest.mark.parametrize(("at", "hub", "shift"), [(0, 0.0, 0.0), (1, 0.0, 0.0), (0, 0.3, 0.6)])
def test_what_hangs_on_a_hinge_weighs_on_all_joints_before_it(
    at: int, hub: float, shift: float
) -> None:
    """4 Hz, all of the link on it or the joint's hub left out, to first order in the deflection.

    Shifted is the joint behind it: where the arm is stretched more hangs on the same spring.
    """
    robot = with_hub(open_chain(), at, hub)
    moved = motion(robot, 4.0, shift)
    usual = usual_inertia(robot, at)
    inertia, damping, omega = (1.0 - hub) * usual, 0.1, 2.0 * np.pi * 4.0
    spring = inertia * omega**2, 2.0 * damping * inertia * omega
    model = hinged(robot, at)
    model.armature = np.insert([joint.armature for joint in robot.joints], at + 1, 0.0)
    real = hinge_torques(model, at, spring, moved) - inverse_dynamics(robot, *moved)
    mode = np.array([inertia, 4.0, damping, usual / inertia, 0.0])
    told = bent(Load.of(robot, at, *moved), mode, STEP)
    missed, size = np.std(told - real, axis=0), np.std(real, axis=0)
    assert (missed < 0.02 * size.max()).all()


def test_a_hinge_along_the_link_turns_what_is_behind_it_more_than_it_moves_it() -> None:
    """A link without mass that bends two fifths of the way: the other one hangs on that."""
    robot = open_chain()
    link = robot.link_inertia.copy()
    link[0] *= 1e-6
    robot, place = replace(robot, link_inertia=link), 0.4
    moved = motion(robot, 4.0)
    inertia = usual_inertia(robot, 0, place)
    omega, damping = 2.0 * np.pi * 4.0, 0.1
    spring = inertia * omega**2, 2.0 * damping * inertia * omega
    real = hinge_torques(hinged(robot, 0, place), 0, spring, moved)
    real -= inverse_dynamics(robot, *moved)
    told = bent(Load.of(robot, 0, *moved), np.array([inertia, 4.0, damping, 1.0, place]), STEP)
    missed, size = np.std(told - real, axis=0), np.std(real, axis=0)
    assert (missed < 0.02 * size.max()).all()


def test_a_mode_of_its_joint_alone_is_the_law_of_roll_outs() -> None:
    robot, at = load_robot("xs031"), 0
    q, qd, qdd = motion(robot, 4.0)
    mode = np.array([400.0, 5.0, 0.05, 0.0, 0.0])
    told = bent(Load.of(robot, at, q, qd, qdd), mode, STEP)
    rows = signal_rows(robot, None, at, np.arange(len(q)) * STEP, q, qd, qdd)
    law = CATALOGUE["structural_flexibility"].evaluate(rows, mode, Stage.FRICTION, STEP)
    assert not told[:, 1].any()
    own = law - 400.0 * qdd[:, at]
    np.testing.assert_allclose(told[:, at], own, atol=3e-3 * np.abs(own).max())


def test_a_mode_that_is_under_way_rings_on_as_it_would_alone() -> None:
    """At rest but for its state at the first sample: a damped oscillation, of either unknown."""
    robot, at, count = load_robot("xs031"), 0, 2000
    still = np.zeros((count, robot.dof))
    load = Load.of(robot, at, np.full_like(still, 0.3), still, still)
    inertia, omega, zeta = 400.0, 2.0 * np.pi * 3.0, 0.02
    mode = np.array([inertia, 3.0, zeta, 0.0, 0.0])
    t, ringing = np.arange(count) * STEP, omega * np.sqrt(1.0 - zeta**2)
    rings, fades = np.exp(1j * ringing * t), np.exp(-zeta * omega * t)
    for begun, size in (
        ((1e-3, 0.0), 1e-3 * (1.0 - 1j * zeta * omega / ringing)),
        ((0.0, 2e-2), -1j * 2e-2 / ringing),
    ):
        deflection = fades * (size * rings).real
        rate = fades * (size * (1j * ringing - zeta * omega) * rings).real
        swung = -(omega**2) * deflection - 2.0 * zeta * omega * rate
        told = bent(load, mode, STEP, begun)[:, at] - bent(load, mode, STEP)[:, at]
        np.testing.assert_allclose(
            told, inertia * swung, atol=4e-3 * inertia * np.abs(swung).max()
        )


def test_nothing_hangs_on_a_hinge_of_links_without_mass() -> None:
    robot = open_chain()
    robot = replace(robot, link_inertia=0.0 * robot.link_inertia)
    load = Load.of(robot, 0, *motion(robot, 0.1))
    assert not bent(load, np.array([0.0, 5.0, 0.3, 1.0, 0.0]), STEP).any()
    with pytest.raises(RobotError, match="expected links with inertia"):
        bent(load, np.array([400.0, 5.0, 0.3, 1.0, 0.0]), STEP)


def test_unknown_samples_are_passed_over() -> None:
    """The mode goes on after a hole, and nothing of it is unknown beside the hole itself."""
    robot = load_robot("xs031")
    q, qd, qdd = motion(robot, 2.0)
    mode = np.array([400.0, 5.0, 0.3, 1.0, 0.2])
    whole = bent(Load.of(robot, 0, q, qd, qdd), mode, STEP)
    q[500:510] = np.nan
    told = bent(Load.of(robot, 0, q, qd, qdd), mode, STEP)
    assert np.isfinite(np.delete(told, range(500, 510), axis=0)).all()
    np.testing.assert_allclose(told[900:], whole[900:], atol=1e-2 * np.abs(whole).max())


# Roll-outs ---------------------------------------------------------------------------------------


def dry(share: float) -> Robot:
    """The crane as a chain under torques, `share` of the first joint's inertia on its hub."""
    return with_hub(replace(open_chain(), cylinders=(), valves=()), 0, share)


def test_hinges_of_a_roll_out_are_the_readable_equations() -> None:
    crane = load_robot("xs031")
    lift = {"inertia": 3000.0, "frequency": 4.0, "damping": 0.05, "carried": 0.9, "place": 0.3}
    tilt = {"inertia": 900.0, "frequency": 6.0, "damping": 0.1, "carried": 1.1}
    listed = [("lift_cylinder", lift), ("tilt_cylinder", tilt)]
    specs = tuple(EffectSpec("structural_flexibility", *one) for one in listed)
    model = Model(replace(crane, effects=specs))
    state = np.array([0.7, -1.1, 0.2, -0.3, 6e6, 5e6, 4e6, 3e6, 0.01, 0.3, -0.02, 0.1])
    inputs = model.inputs([0.3, -0.2], 18e6, 1e6)
    expected = reference_rates(model.robot, model.active, 0.0, inputs, state)
    np.testing.assert_allclose(model.rates(0.0, state, inputs), expected, rtol=1e-9)


@pytest.mark.parametrize("shift", [0.0, 0.6])
def test_a_hub_and_what_hangs_on_it_swing_as_the_chain_with_a_joint_more(shift: float) -> None:
    """With c = U / J the equations are those of a hub with the rest on a spring."""
    hub, omega, damping = 0.3, 2.0 * np.pi * 4.0, 0.05
    plain = dry(hub)
    usual = usual_inertia(plain, 0)
    inertia = (1.0 - hub) * usual
    mode = {"inertia": inertia, "frequency": 4.0, "damping": damping, "carried": usual / inertia}
    robot = replace(plain, effects=(EffectSpec("structural_flexibility", "lift", mode),))
    time, start = np.arange(501) * STEP, middle(robot) + np.array([0.0, shift])
    still = np.zeros(2)
    holds = inverse_dynamics(robot, start, still, still)
    torque = holds + np.outer(np.sin(9.0 * time), [2500.0, 0.0])
    run = simulate(robot, time, np.zeros((501, 0)), start, torque=torque)
    rigid = simulate(plain, time, np.zeros((501, 0)), start, torque=torque)

    model = hinged(plain, 0)
    model.armature = np.array([plain.joints[0].armature, 0.0, 0.0])
    data, spring = model.createData(), (inertia * omega**2, 2.0 * damping * inertia * omega)

    def rates(t: float, y: FloatArray) -> FloatArray:
        held = torque[min(int(t / STEP + 1e-9), 500)]
        passive = -spring[0] * y[1] - spring[1] * y[4]
        forces = np.array([held[0], passive, held[1]])
        return np.concatenate([y[3:], pinocchio.aba(model, data, y[:3], y[3:], forces)])

    sag = -holds[0] / spring[0]
    y0 = np.array([start[0], sag, start[1], 0.0, 0.0, 0.0])
    out = solve_ivp(rates, (0.0, 1.0), y0, "LSODA", time, rtol=1e-8, atol=1e-10, max_step=STEP)
    real = out.y.T[:, [0, 2]]
    missed, size = np.std(run.q - real, axis=0), np.std(rigid.q - real, axis=0)
    assert (missed < 1e-4 * size).all()
    np.testing.assert_allclose(run.effect_states[0], [sag, 0.0], rtol=1e-6)


@pytest.mark.parametrize(("inertia", "carried"), [(0.6, 0.8), (0.5, 1.0), (0.7, 1.1)])
def test_what_a_roll_out_shows_is_what_the_law_says_of_it(inertia: float, carried: float) -> None:
    """Torques that move the joints as the roll-out did, with parts of the load on the spring."""
    crane = replace(open_chain(), cylinders=(), valves=())
    # Torques are held from sample to sample: those of half a millisecond lag by a quarter.
    step, usual = 5e-4, usual_inertia(crane, 0, 0.3)
    mode = [inertia * usual, 4.0, 0.6, carried, 0.3]
    names = [spec.name for spec in CATALOGUE["structural_flexibility"].parameters]
    hinge = EffectSpec("structural_flexibility", "lift", dict(zip(names, mode, strict=True)))
    model, time = Model(replace(crane, effects=(hinge,))), np.arange(1601) * step
    start = middle(crane)
    holds = inverse_dynamics(crane, start, np.zeros(2), np.zeros(2))
    torque = holds + np.outer(np.sin(9.0 * time), [3000.0, 500.0])
    run = simulate(model.robot, time, np.zeros((time.size, 0)), start, torque=torque)
    states = np.concatenate([run.q, run.qd, run.effect_states], axis=1)
    rates = [
        model.rates(t, y, model.inputs([], 0.0, 0.0, u))
        for t, y, u in zip(time, states, torque, strict=True)
    ]
    moved = run.q, run.qd, np.array(rates)[:, 2:4]
    told = bent(Load.of(crane, 0, *moved), np.array(mode), step)
    rest = torque - inverse_dynamics(crane, *moved)
    later = slice(800, None)  # where each began has been forgotten
    missed = np.abs(told - rest)[later].max(axis=0)
    assert (missed < 0.06 * np.ptp(rest[later], axis=0).max()).all()


def test_a_load_leaves_the_spring_as_it_is() -> None:
    """At rest a hinge gives way by what is carried over its stiffness, with a load or without."""
    crane = replace(open_chain(), cylinders=(), valves=())
    usual = usual_inertia(crane, 0)
    mode = {"inertia": 0.9 * usual, "frequency": 4.0, "carried": 1.0 / 0.9}
    hinge = EffectSpec("structural_flexibility", "lift", mode)
    heavy = EffectSpec("payload_change", crane.name, {"mass": 300.0})
    stiffness = 0.9 * usual * (2.0 * np.pi * 4.0) ** 2
    for effects in ((hinge,), (hinge, heavy)):
        model = Model(replace(crane, effects=effects))
        q, still = middle(crane), np.zeros(2)
        holds = inverse_dynamics(model.robot, q, still, still)
        state = model.rest(q, still, np.zeros((0, 2)), model.inputs([], 0.0, 0.0, holds))
        assert state[4] == pytest.approx(-holds[0] / stiffness, rel=1e-9)


def test_what_cannot_be_built_is_no_roll_out(make_slider) -> None:
    """More on a spring than the joint moves at all: as for any mass that is not positive."""
    robot = make_slider(effects={"structural_flexibility": {"inertia": 1200.0, "frequency": 5.0}})
    with pytest.raises(SimulationError, match="positive definite"):
        simulate(robot, [0.0, 0.1], [[0.0], [0.0]], [0.3])
