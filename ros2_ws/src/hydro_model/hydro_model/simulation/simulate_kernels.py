"""Compiled right-hand side; `hydro_model.simulation.simulate_reference` is its readable twin."""

from __future__ import annotations

from typing import Any

from hydro_model.effects.compiled import call_law
from hydro_model.effects.signals import (
    JOINT_POSITION,
    JOINT_VELOCITY,
    LEVER,
    PISTON_FORCE,
    PISTON_POSITION,
    PISTON_VELOCITY,
    PRESSURE_A,
    PRESSURE_B,
    RETURN_FLOW,
    STATE_0,
    SUPPLY_FLOW,
    SUPPLY_PRESSURE,
    TANK_PRESSURE,
    TIME,
    VALVE_FLOW_A,
    VALVE_FLOW_B,
    VALVE_SIGNAL,
)
from hydro_model.hydraulics.root_kernels import root
from hydro_model.multibody.rigid_body_kernels import mass_matrix_and_bias
from hydro_model.numerics.kernel import inlined, kernel
from hydro_model.numerics.linear_kernels import solve_spd
from hydro_model.simulation.hinge_kernels import bend_links, put_hinges, rate_hinges
from hydro_model.simulation.signal_kernels import look, look_aside, look_at_tip
from hydro_model.simulation.simulate_arrays import (
    ADDRESS,
    AREA_A,
    AREA_B,
    COMPLIANCE_A,
    COMPLIANCE_B,
    EFFECT,
    FIRST_STATE,
    FLOW_A,
    FLOW_B,
    FRICTION,
    INVERSE_BULK,
    KEEP_MASS,
    OWNER,
    REST,
    ROBOT_WIDE,
    SIGNAL,
    STATE_COUNT,
    STROKE,
    SUPPLY,
    TANK,
    THROUGH_VALVE,
    VISCOUS,
    VOLUME_A,
    VOLUME_B,
)

Array = Any  # numba types the kernels; mypy follows no numba import


@inlined
def states_of(
    model: Any, s: Array, effect: int, y: Array, dy: Array, drive: int, mode: int
) -> None:
    """Internal states of an effect of `model` into its signals; if driven, their rates or rests.

    `s` is the row of signals that the effect's laws see, `effect` its row of `owners`, `y` and
    `dy` the state and its rates in SI units; `drive` is 0 where they stay as they are, and `mode`
    says whether their rates or (`REST`) their values at rest are asked for.
    """
    first = model.owners[effect, FIRST_STATE]
    count = model.owners[effect, STATE_COUNT]
    for i in range(count):
        s[STATE_0 + i] = y[first + i]
    if drive == 0:
        return
    base = first - (y.shape[0] - model.rates.shape[0])
    for i in range(count):
        if mode == REST:
            y[first + i] = call_law(model.initials[base + i], s, model.parameters[effect])
            s[STATE_0 + i] = y[first + i]
        else:
            dy[first + i] = call_law(model.rates[base + i], s, model.parameters[effect])


@kernel
def _apply(
    model: Any,
    work: Any,
    y: Array,
    dy: Array,
    row: int,
    stage: int,
    start: float,
    mode: int,
) -> float:
    """Laws of one stage at one cylinder: `start` plus their sum, or mapped by them (SIGNAL)."""
    value = start
    s = work.signals[row]
    for t in range(model.spans[row, stage, 0], model.spans[row, stage, 1]):
        effect = model.terms[t, EFFECT]
        states_of(model, s, effect, y, dy, model.terms[t, OWNER], mode)
        law = call_law(model.terms[t, ADDRESS], s, model.parameters[effect])
        if stage == SIGNAL:
            value = law
            s[VALVE_SIGNAL] = law
        else:
            value += law
    return value


@inlined
def _valve(model: Any, work: Any, i: int, u: float) -> tuple[float, float]:
    """Flows into the chambers of cylinder i through its edges (eqs. 11 to 13)."""
    s, edges = work.signals[i], model.edges[i]
    up, down = max(u, 0.0), min(u, 0.0)
    p_s, p_t, p_a, p_b = s[SUPPLY_PRESSURE], s[TANK_PRESSURE], s[PRESSURE_A], s[PRESSURE_B]
    from_pump_a = edges[0] * root(p_s - p_a) * up
    to_tank_a = -edges[1] * root(p_a - p_t) * down
    from_pump_b = -edges[2] * root(p_s - p_b) * down
    to_tank_b = edges[3] * root(p_b - p_t) * up
    return from_pump_a - to_tank_a, from_pump_b - to_tank_b


@inlined
def _through_laws(model: Any, work: Any, y: Array, dy: Array, i: int, mode: int) -> None:
    """Flows into the chambers of cylinder i behind its flow laws, into `work.flows`.

    Effect by effect, of both chambers: what one takes from the valve's flow the next has no more
    of, as restrictions in series have it. Behind them stand the flows at the valve itself, by
    which rails give way: what a hose's oil stores for milliseconds is not in them.
    """
    s = work.signals[i]
    at_a, end_a = model.spans[i, FLOW_A, 0], model.spans[i, FLOW_A, 1]
    at_b, end_b = model.spans[i, FLOW_B, 0], model.spans[i, FLOW_B, 1]
    work.flows[0] = work.flows[2] = s[VALVE_FLOW_A]
    work.flows[1] = work.flows[3] = s[VALVE_FLOW_B]
    while at_a < end_a or at_b < end_b:
        effect = model.owners.shape[0]
        if at_a < end_a:
            effect = model.terms[at_a, EFFECT]
        if at_b < end_b:
            effect = min(effect, model.terms[at_b, EFFECT])
        on_a = at_a < end_a and model.terms[at_a, EFFECT] == effect
        on_b = at_b < end_b and model.terms[at_b, EFFECT] == effect
        drive = model.terms[at_a, OWNER] if on_a else model.terms[at_b, OWNER]
        states_of(model, s, effect, y, dy, drive, mode)
        more_a, more_b, parameters = 0.0, 0.0, model.parameters[effect]
        if on_a:
            more_a = call_law(model.terms[at_a, ADDRESS], s, parameters)
            at_a += 1
        if on_b:
            more_b = call_law(model.terms[at_b, ADDRESS], s, parameters)
            at_b += 1
        work.flows[0] += more_a
        work.flows[1] += more_b
        if model.owners[effect, THROUGH_VALVE] == 1:
            s[VALVE_FLOW_A] += more_a
            s[VALVE_FLOW_B] += more_b
            if model.owners[effect, STATE_COUNT] == 0:
                work.flows[2] += more_a
                work.flows[3] += more_b


@inlined
def _draw(model: Any, work: Any, opening: float) -> None:
    """Add the latest cylinder's flows at its valve to those of the robot's rails."""
    robot = work.signals[model.joint.shape[0]]
    if opening > 0.0:
        robot[SUPPLY_FLOW] += work.flows[2]
        robot[RETURN_FLOW] -= work.flows[3]
    elif opening < 0.0:
        robot[SUPPLY_FLOW] += work.flows[3]
        robot[RETURN_FLOW] -= work.flows[2]


@inlined
def _cylinder(
    model: Any, work: Any, y: Array, dy: Array, i: int, time: float, u: float, mode: int
) -> None:
    """Pressure rates of cylinder i (eq. 10, per chamber) and its force on the joint."""
    n, m = model.axis.shape[0], model.joint.shape[0]
    look(model, work, y, i, time, u)
    s, g = work.signals[i], model.geometry[i]
    opening = _apply(model, work, y, dy, i, SIGNAL, u, mode)
    q_a, q_b = _valve(model, work, i, opening)
    s[VALVE_FLOW_A], s[VALVE_FLOW_B] = q_a, q_b
    _through_laws(model, work, y, dy, i, mode)
    _draw(model, work, opening)
    q_a, q_b = work.flows[0], work.flows[1]
    x, v = s[PISTON_POSITION], s[PISTON_VELOCITY]
    volume_a = _apply(model, work, y, dy, i, VOLUME_A, g[AREA_A] * x, mode)
    volume_b = _apply(model, work, y, dy, i, VOLUME_B, g[AREA_B] * (g[STROKE] - x), mode)
    soft_a = _apply(model, work, y, dy, i, COMPLIANCE_A, g[INVERSE_BULK], mode)
    soft_b = _apply(model, work, y, dy, i, COMPLIANCE_B, g[INVERSE_BULK], mode)
    dy[2 * n + i] = (q_a - g[AREA_A] * v) / (volume_a * soft_a)
    dy[2 * n + m + i] = (q_b + g[AREA_B] * v) / (volume_b * soft_b)
    work.friction[i] = _apply(model, work, y, dy, i, FRICTION, g[VISCOUS] * v, mode)
    work.force[model.joint[i]] += s[LEVER] * (s[PISTON_FORCE] - work.friction[i])


@inlined
def _dry(model: Any, work: Any, y: Array, dy: Array, d: int, time: float, mode: int) -> None:
    """Friction of a joint without cylinder, on which the piston is the joint itself."""
    n, m = model.axis.shape[0], model.joint.shape[0]
    j = model.dry_joint[d]
    s = work.signals[m + 1 + d]
    s[TIME] = time
    s[JOINT_POSITION], s[JOINT_VELOCITY] = y[j], y[n + j]
    s[PISTON_POSITION], s[PISTON_VELOCITY], s[LEVER] = y[j], y[n + j], 1.0
    s[PISTON_FORCE] = work.force[j]
    look_aside(model, work, s, y, j)
    viscous = model.dry_viscous[d] * y[n + j]
    work.force[j] -= _apply(model, work, y, dy, m + 1 + d, FRICTION, viscous, mode)


@kernel
def right_hand_side(
    model: Any,
    work: Any,
    time: float,
    inputs: Array,
    y: Array,
    dy: Array,
    mode: int,
) -> bool:
    """Time derivative of the state into `dy`.

    Parameters
    ----------
    model : ModelArrays
    work : Work
    time : float
    inputs : (m + 2 + n,) array
        Normalised valve signals, supply and tank pressure before effects, joint torques.
    y, dy : (2 n + 2 m + k,) array
    mode : int
        `RATES`; or `KEEP_MASS` where joint positions and velocities, and what links are bent by,
        are those of the call before; or `REST`, which sets the effects' states in `y` to rest
        instead of computing their rates.

    Returns
    -------
    bool
        False where the mass matrix is not positive definite or something is not finite.
    """
    n, m = model.axis.shape[0], model.joint.shape[0]
    robot = work.signals[m]
    robot[TIME], robot[SUPPLY_FLOW], robot[RETURN_FLOW] = time, 0.0, 0.0
    robot[SUPPLY_PRESSURE] = _apply(model, work, y, dy, m, SUPPLY, inputs[m], mode)
    robot[TANK_PRESSURE] = _apply(model, work, y, dy, m, TANK, inputs[m + 1], mode)
    for j in range(n):
        work.force[j] = inputs[m + 2 + j]
    if model.tip_used[0]:
        look_at_tip(model, work, y)
    for i in range(m):
        _cylinder(model, work, y, dy, i, time, inputs[i], mode)
    for d in range(model.dry_joint.shape[0]):
        _dry(model, work, y, dy, d, time, mode)
    for effect in range(model.owners.shape[0]):
        wide = model.owners[effect, ROBOT_WIDE]
        if wide == 1:
            states_of(model, robot, effect, y, dy, wide, mode)
    if mode != KEEP_MASS:
        for j in range(n):
            work.q[j], work.qd[j] = y[j], y[n + j]
        bend_links(model, work, y)
        mass_matrix_and_bias(
            work.q,
            work.qd,
            model.rotation,
            model.translation,
            model.axis,
            model.prismatic,
            model.gravity,
            model.theta,
            model.parts,
            work.chain,
            work.mass,
            work.bias,
        )
    for j in range(n):
        work.force[j] -= work.bias[j]
        for k in range(n):
            work.factor[j, k] = work.mass[j, k]
    put_hinges(model, work, y)
    if not solve_spd(work.factor, work.force):
        return False
    rate_hinges(model, work, y, dy, mode)
    for j in range(n):
        dy[j] = y[n + j]
        dy[n + j] = work.force[j]
    return True
