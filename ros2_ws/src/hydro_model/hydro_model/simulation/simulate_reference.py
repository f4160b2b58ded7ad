"""The right-hand side, readable: what `hydro_model.simulation.simulate_kernels` computes compiled.

Assembled from the public functions of the package, one cylinder at a time, as the equations say.
The tests compare the two, and hand this one to scipy's integrators.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from hydro_model.effects import ActiveEffect, Stage
from hydro_model.effects import signals as sig
from hydro_model.effects.bending import next_parallel
from hydro_model.effects.flexibility import STRUCTURAL_FLEXIBILITY, hinged
from hydro_model.effects.rows import constant_signals, other_joint, set_tip
from hydro_model.effects.targets import joint_of
from hydro_model.hydraulics import cylinder as geometry
from hydro_model.hydraulics.valve import edge_flows
from hydro_model.multibody.joint_ranges import middle
from hydro_model.multibody.rigid_body import inverse_dynamics, mass_matrix
from hydro_model.robot import FloatArray, Robot
from hydro_model.simulation.hinge_kernels import MOST_SWUNG

#: Stages of laws of the flow into a chamber.
_FLOWS = (Stage.FLOW_A, Stage.FLOW_B)


def reference_rates(
    robot: Robot,
    active: Sequence[ActiveEffect],
    time_s: float,
    inputs: FloatArray,
    state: FloatArray,
    plain: Robot | None = None,
) -> FloatArray:
    """Time derivative of the state ``[q, qd, p_a, p_b, effect states]``.

    Parameters
    ----------
    robot : Robot
    active : sequence of ActiveEffect
        Those with laws, in catalogue order.
    time_s : float
    inputs : (m + 2 + n,) array
        Normalised valve signals, supply and tank pressure before effects, joint torques.
    state : (2 n + 2 m + k,) array
    plain : Robot, optional
        Without what its effects change of it, as
        `hydro_model.simulation.simulate_arrays.model_arrays`; default: `robot`.

    Returns
    -------
    (2 n + 2 m + k,) array
    """
    n, m = robot.dof, len(robot.cylinders)
    rates = np.zeros_like(state)
    rates[:n] = state[n : 2 * n]
    common = np.full(sig.SIGNAL_COUNT, np.nan)
    common[sig.TIME] = time_s
    common[sig.ATMOSPHERIC_PRESSURE] = robot.atmospheric_pressure_pa
    effects = list(_with_states(active, 2 * n + 2 * m))
    wide = [(one, where) for one, where in effects if one.cylinder is None and one.joint is None]
    common[sig.SUPPLY_PRESSURE] = inputs[m] + _sum(Stage.SUPPLY, wide, common, state)
    common[sig.TANK_PRESSURE] = inputs[m + 1] + _sum(Stage.TANK, wide, common, state)

    torque = inputs[m + 2 :].copy()
    flows = np.zeros(2)
    for i in range(m):
        own = [(one, where) for one, where in effects if one.cylinder == i]
        force, lever, used = _cylinder(robot, i, own, common, inputs[i], state, rates)
        torque[robot.joint_index(robot.cylinders[i].joint)] += lever * force
        flows += used
    for j in robot.dry_joints:
        own = [(one, where) for one, where in effects if one.joint == j]
        torque[j] -= _dry_friction(robot, j, torque[j], own, common, state, rates)
    common[sig.SUPPLY_FLOW], common[sig.RETURN_FLOW] = flows
    for one, where in wide:
        _drive(one, where, common, state, rates)
    bends = [(o, where) for o, where in effects if o.effect.name == STRUCTURAL_FLEXIBILITY.name]
    bends = [(one, where) for one, where in bends if hinged(one.parameters)]
    _accelerate(robot, plain or robot, bends, torque, state, rates)
    return rates


def _accelerate(
    robot: Robot,
    plain: Robot,
    bends: list[tuple[ActiveEffect, slice]],
    torque: FloatArray,
    state: FloatArray,
    rates: FloatArray,
) -> None:
    """Accelerations of the joints, and of what hangs on hinges, solved for together."""
    n, count, usually = robot.dof, len(bends), mass_matrix(plain, middle(plain))
    q, qd = state[:n].copy(), state[n : 2 * n].copy()
    shapes = np.array([_shape(robot, one) for one, _ in bends]).reshape(count, n)
    usual = np.einsum("ai,ij,aj->a", shapes, usually, shapes)
    parameters = np.array([one.parameters for one, _ in bends]).reshape(count, 5)
    inertia = np.minimum(parameters[:, 0], MOST_SWUNG * usual)
    share = np.minimum(parameters[:, 3] * inertia / usual, 1.0)
    own = np.array([joint_of(robot, one) for one, _ in bends], dtype=int)
    e = np.array([state[where][0] for _, where in bends])
    rate = np.array([state[where][1] for _, where in bends]) - qd[own]
    q, qd = q + (share * e) @ shapes, qd + (share * rate) @ shapes
    mass, bias = mass_matrix(robot, q), inverse_dynamics(robot, q, qd, np.zeros(n))
    moved, omega = share[:, None] * shapes, 2.0 * np.pi * parameters[:, 1]
    rest = inertia - share * usual
    load = moved @ mass
    load[range(count), own] += rest / shapes[range(count), own]
    matrix = np.block([[mass, load.T], [load, moved @ mass @ moved.T]])
    on_springs = inertia + share * (np.einsum("ai,ij,aj->a", shapes, mass, shapes) - usual)
    matrix[range(n, n + count), range(n, n + count)] = np.maximum(on_springs, 0.02 * inertia)
    pull = inertia * omega * (omega * e + 2.0 * parameters[:, 2] * rate)
    solved = np.linalg.solve(matrix, np.concatenate([torque - bias, -pull - moved @ bias]))
    rates[n : 2 * n] = solved[:n]
    for swing, joint, (_, where) in zip(solved[n:], own, bends, strict=True):
        rates[where.start + 1] = swing + solved[joint]


def _shape(robot: Robot, one: ActiveEffect) -> FloatArray:
    """How far the joints move with a hinge's deflection, (n,)."""
    joint, shape = joint_of(robot, one), np.zeros(robot.dof)
    shape[joint] = 1.0
    if next_parallel(robot, joint) >= 0:
        shape[joint : joint + 2] = 1.0 - one.parameters[4], one.parameters[4]
    return shape


def _cylinder(
    robot: Robot,
    i: int,
    own: list[tuple[ActiveEffect, slice]],
    common: FloatArray,
    command: float,
    state: FloatArray,
    rates: FloatArray,
) -> tuple[float, float, FloatArray]:
    """Force on the joint through its lever, and flows from the pump and to tank."""
    n, m = robot.dof, len(robot.cylinders)
    cylinder = robot.cylinders[i]
    valve = robot.valve_of(cylinder.name)
    joint = robot.joint_index(cylinder.joint)
    q, qd, p_a, p_b = state[[joint, n + joint, 2 * n + i, 2 * n + m + i]]
    lever = float(geometry.lever(cylinder, q))
    x, v = float(geometry.stroke(cylinder, q)), lever * qd
    force = float(geometry.piston_force(cylinder, p_a, p_b))
    s = common.copy()
    _look_around(robot, s, i, None, state)
    s[[sig.JOINT_POSITION, sig.JOINT_VELOCITY, sig.PISTON_POSITION]] = q, qd, x
    s[[sig.PISTON_VELOCITY, sig.LEVER, sig.PISTON_FORCE]] = v, lever, force
    s[[sig.PRESSURE_A, sig.PRESSURE_B, sig.VALVE_SIGNAL]] = p_a, p_b, command
    for one, where in own:
        for term in one.terms:
            if term.stage is Stage.SIGNAL:
                _drive(one, where, s, state, rates)
                s[sig.VALVE_SIGNAL] = term.law(s, one.parameters)
    p_s, p_t = s[sig.SUPPLY_PRESSURE], s[sig.TANK_PRESSURE]
    q_a, q_b = edge_flows(valve, s[sig.VALVE_SIGNAL], p_a, p_b, p_s, p_t)
    s[[sig.VALVE_FLOW_A, sig.VALVE_FLOW_B]] = q_a, q_b
    (q_a, q_b), (port_a, port_b) = _behind_flow_laws(own, s, state, rates)
    # Seen from the pump: the supply edge feeds A while u > 0 and B while u < 0.
    used = np.array([port_a, -port_b] if s[sig.VALVE_SIGNAL] > 0.0 else [port_b, -port_a])
    used *= s[sig.VALVE_SIGNAL] != 0.0
    for one, where in own:
        if one.terms[0].stage not in (Stage.SIGNAL, *_FLOWS):
            _drive(one, where, s, state, rates)
    volume_a, volume_b = geometry.chamber_volumes(cylinder, x)
    soft = 1.0 / cylinder.bulk_modulus_pa
    soft_a = soft + _sum(Stage.COMPLIANCE_A, own, s, state)
    soft_b = soft + _sum(Stage.COMPLIANCE_B, own, s, state)
    into_a = q_a - cylinder.area_a_m2 * v
    into_b = q_b + cylinder.area_b_m2 * v
    rates[2 * n + i] = into_a / ((volume_a + _sum(Stage.VOLUME_A, own, s, state)) * soft_a)
    rates[2 * n + m + i] = into_b / ((volume_b + _sum(Stage.VOLUME_B, own, s, state)) * soft_b)
    friction = cylinder.viscous_friction * v + _sum(Stage.FRICTION, own, s, state)
    return force - friction, lever, used


def _behind_flow_laws(
    own: list[tuple[ActiveEffect, slice]], s: FloatArray, state: FloatArray, rates: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Flows into the chambers behind the flow laws of a cylinder, and those at its valve, (2,).

    What one takes from the valve's flow the next has no more of, as restrictions in series have
    it; `s` is left with the valve's flow behind the last. What a hose's oil stores passes it.
    """
    flows = np.array([s[sig.VALVE_FLOW_A], s[sig.VALVE_FLOW_B]])
    at_valve = flows.copy()
    for one, where in own:
        if one.terms[0].stage in _FLOWS:
            _drive(one, where, s, state, rates)
            more = np.array([_sum(stage, [(one, where)], s, state) for stage in _FLOWS])
            flows += more
            if one.effect.needs_valve:
                s[[sig.VALVE_FLOW_A, sig.VALVE_FLOW_B]] += more
                at_valve += 0.0 if one.effect.states else more
    return flows, at_valve


def _dry_friction(
    robot: Robot,
    j: int,
    torque: float,
    own: list[tuple[ActiveEffect, slice]],
    common: FloatArray,
    state: FloatArray,
    rates: FloatArray,
) -> float:
    """Friction of a joint without cylinder, on which the piston is the joint itself."""
    q, qd = state[[j, robot.dof + j]]
    s = common.copy()
    s[[sig.SUPPLY_PRESSURE, sig.TANK_PRESSURE]] = np.nan
    _look_around(robot, s, None, j, state)
    s[[sig.JOINT_POSITION, sig.JOINT_VELOCITY, sig.LEVER]] = q, qd, 1.0
    s[sig.PISTON_FORCE] = torque
    s[[sig.PISTON_POSITION, sig.PISTON_VELOCITY]] = q, qd
    for one, where in own:
        _drive(one, where, s, state, rates)
    return float(robot.joints[j].viscous_friction * qd + _sum(Stage.FRICTION, own, s, state))


def _look_around(
    robot: Robot, s: FloatArray, cylinder: int | None, joint: int | None, state: FloatArray
) -> None:
    """Constants of a cylinder or joint, the joint beside it and the tip."""
    for index, value in constant_signals(robot, cylinder, joint).items():
        s[index] = value
    own = robot.joint_index(robot.cylinders[cylinder].joint) if cylinder is not None else joint
    q, qd = state[None, : robot.dof], state[None, robot.dof : 2 * robot.dof]
    set_tip(s[None, :], robot, own or 0, q, qd)
    other = other_joint(robot, own or 0)
    if other >= 0:
        s[[sig.OTHER_POSITION, sig.OTHER_VELOCITY]] = state[other], state[robot.dof + other]


def _with_states(
    active: Sequence[ActiveEffect], first: int
) -> Iterator[tuple[ActiveEffect, slice]]:
    for one in active:
        size = len(one.effect.states)
        yield one, slice(first, first + size)
        first += size


def _load(where: slice, s: FloatArray, state: FloatArray) -> None:
    own = state[where]
    s[sig.STATE_0 : sig.STATE_0 + len(own)] = own


def _drive(
    one: ActiveEffect, where: slice, s: FloatArray, state: FloatArray, rates: FloatArray
) -> None:
    _load(where, s, state)
    rates[where] = [internal.rate(s, one.parameters) for internal in one.effect.states]


def _sum(
    stage: Stage,
    effects: list[tuple[ActiveEffect, slice]],
    s: FloatArray,
    state: FloatArray,
) -> float:
    total = 0.0
    for one, where in effects:
        _load(where, s, state)
        laws = [term.law for term in one.terms if term.stage is stage]
        total += sum(law(s, one.parameters) for law in laws)
    return total
