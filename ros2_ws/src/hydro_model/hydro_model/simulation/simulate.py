"""The model as an ordinary differential equation, and its roll-outs.

State: joint positions and velocities, two gauge pressures per cylinder, and the internal states of
the effects the robot lists. Chamber by chamber (eq. 10 before the pressures are summed):

``pdot_a = (q_a - A1 xdot) / (V_a (1/beta))``,  ``pdot_b = (q_b + A2 xdot) / (V_b (1/beta))``

and ``M(q) qdd + h(q, qd) = lever (p_a A1 - p_b A2 - friction) + torque``. Effects add to flows,
volumes, compliances, friction and supply as `hydro_model.effects` says. Pressures are not kept
above vapour pressure: laws are finite for any pressure, and cavitation is not part of the base.

Effects that change the robot (payload, tilt, delay) are applied to it before the roll-out; one
that starts or ends within it (`payload_change`) does so at the first sample at or after its
time. Effects of instruments act on no machine: `hydro_model.effects.read_with` applies them to
what was simulated.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from hydro_model.effects import resolve
from hydro_model.effects.catalogue import end_s, start_s
from hydro_model.errors import SimulationError
from hydro_model.hydraulics import cylinder as geometry
from hydro_model.robot import FloatArray, Robot
from hydro_model.simulation.simulate_model import Model, equilibrium_pressures, shaped

__all__ = ["TOLERANCE", "Model", "Rollout", "equilibrium_pressures", "simulate"]

#: Relative error per step, with states counted in units of 1 rad, 1 rad/s and 1 MPa.
TOLERANCE = 1.0e-6


@dataclass(frozen=True, slots=True)
class Rollout:
    """A simulated recording on the input's time grid; N samples, n joints, m cylinders.

    Attributes
    ----------
    time_s : (N,) array
    q, qd : (N, n) array
    p_a, p_b : (N, m) array
        Gauge pressures, Pa.
    supply, tank : (N,) array
        At the valves, after effects; gauge, Pa.
    valve_signal : (N, m) array
        Opening that the edges see, after delay and effects.
    piston_force, friction : (N, m) array
        ``p_a A1 - p_b A2`` and what opposes the piston, N.
    effect_states : (N, k) array
        In the order of `hydro_model.effects.resolve`.
    steps : int
        Steps the integrator tried.
    """

    time_s: FloatArray
    q: FloatArray
    qd: FloatArray
    p_a: FloatArray
    p_b: FloatArray
    supply: FloatArray
    tank: FloatArray
    valve_signal: FloatArray
    piston_force: FloatArray
    friction: FloatArray
    effect_states: FloatArray
    steps: int


def simulate(
    robot: Robot,
    time_s: ArrayLike,
    voltages: ArrayLike,
    q0: ArrayLike,
    qd0: ArrayLike | None = None,
    p0: ArrayLike | None = None,
    *,
    supply: ArrayLike | None = None,
    tank: ArrayLike | None = None,
    torque: ArrayLike | None = None,
    oil_c: ArrayLike | None = None,
    tolerance: float = TOLERANCE,
) -> Rollout:
    """Roll the model out from recorded voltages.

    Parameters
    ----------
    robot : Robot
        With the effects it lists.
    time_s : (N,) array
        Sample times, increasing.
    voltages : (N, m) array
        Valve voltages. Row j acts from ``time_s[j] + robot.command_delay_s`` until the next row
        does, the first row also before; limited to the rated voltage.
    q0, qd0 : (n,) or (k, n) array
        Start; at rest by default. Of the first k samples, where they are known of more than one:
        there the effects' internal states follow what is given, and from the last of them on the
        model moves by itself. So it remembers what came before: commands on their way, a spool
        off its place, a supply that has given way.
    p0 : (m, 2) or (k, m, 2) array, optional
        Gauge pressures of chambers A and B, Pa; of a single start `equilibrium_pressures` by
        default.
    supply, tank : (N,) array, optional
        Measured at the valves, gauge, Pa. Default: the robot's constants with the robot's
        effects on them.
    torque : (N, n) array, optional
        Further joint torques, each row held until the next sample.
    oil_c : (N,) array, optional
        Measured temperature of the oil, deg C, each held until the next sample. Without it
        effects that look at it go by time.
    tolerance : float
        Relative error per step.

    Returns
    -------
    Rollout

    Raises
    ------
    SimulationError
        Shapes do not fit, the robot's delay is negative, or the integration fails: a piston
        leaves its stroke, something becomes infinite or the step collapses.
    RobotError
        An effect does not resolve.
    """
    n, m, times = robot.dof, len(robot.cylinders), _times(robot, time_s)
    count = len(times)
    commands = _commands(robot, shaped("voltages", voltages, (count, m)))
    rails = np.column_stack(
        [
            _rail("supply", supply, robot.supply_pressure_pa, count),
            _rail("tank", tank, robot.tank_pressure_pa, count),
        ]
    )
    torques = shaped("torque", np.zeros((count, n)) if torque is None else torque, (count, n))
    oil = np.full(count, np.nan) if oil_c is None else shaped("oil_c", oil_c, (count,))
    rails_known = {"measured_supply": supply is not None, "measured_tank": tank is not None}
    models = [
        (begin, Model(robot, time_s=times[max(begin - 1, 0)], **rails_known))
        for begin in _beginnings(robot, times)
    ]
    seen = _seen(models[0][1].robot, rails, q0, qd0, p0)
    late = _late(models[0][1].robot, times, commands)
    return _run(models, times, late, rails, torques, oil, seen, tolerance)


def _seen(
    robot: Robot, rails: FloatArray, q0: ArrayLike, qd0: ArrayLike | None, p0: ArrayLike | None
) -> FloatArray:
    """Motion and pressures at the first samples, (k, 2 n + 2 m)."""
    n, m, rows = robot.dof, len(robot.cylinders), np.shape(q0)[:-1]
    if len(rows) == 1 and not 1 <= rows[0] <= len(rails):
        raise SimulationError(
            f"simulate: q0 should have 1 to {len(rails)} rows, one per sample, found {rows[0]}"
        )
    lead = rows[:1]
    q = shaped("q0", q0, (*lead, n))
    qd = shaped("qd0", np.zeros((*lead, n)) if qd0 is None else qd0, (*lead, n))
    if p0 is None and not lead:
        p0 = equilibrium_pressures(robot, q, rails[0, 0], rails[0, 1])
    elif p0 is None:
        raise SimulationError(
            "simulate: where q0 is known of several samples, p0 should be as well; found none"
        )
    chambers = np.swapaxes(shaped("p0", p0, (*lead, m, 2)), -1, -2).reshape(*lead, 2 * m)
    return np.ascontiguousarray(np.atleast_2d(np.concatenate([q, qd, chambers], axis=-1)))


def _late(robot: Robot, times: FloatArray, commands: FloatArray) -> FloatArray:
    """Commands of valves that are later than the others: each sample has their mean over it."""
    delays = [robot.valve_of(cylinder.name).command_delay_s for cylinder in robot.cylinders]
    if not any(delays) or len(times) < 2:
        return commands
    result, ends = commands.copy(), np.append(times, 2.0 * times[-1] - times[-2])
    for i, delay_s in enumerate(delays):
        # The integral of what is held, before the first sample as at it.
        whole = np.append(0.0, np.cumsum(commands[:, i] * np.diff(ends)))
        at = ends - delay_s
        early = np.minimum(at - ends[0], 0.0) * commands[0, i]
        result[:, i] = np.diff(np.interp(at, ends, whole) + early) / np.diff(ends)
    return np.ascontiguousarray(result)


def _beginnings(robot: Robot, times: FloatArray) -> list[int]:
    """Samples whose step another robot makes: the first, and those after a change came or went."""
    instants = [instant for one in resolve(robot) for instant in (start_s(one), end_s(one))]
    firsts = np.searchsorted(times, [t for t in instants if times[0] < t < times[-1]])
    return sorted({0, *(int(first) + 1 for first in firsts if first + 1 < len(times))})


def _run(
    models: Sequence[tuple[int, Model]],
    times: FloatArray,
    commands: FloatArray,
    rails: FloatArray,
    torques: FloatArray,
    oil: FloatArray,
    seen: FloatArray,
    tolerance: float,
) -> Rollout:
    from hydro_model.simulation.rollout_kernels import DONE, roll_out
    from hydro_model.simulation.solver_kernels import new_solver

    count, m = commands.shape
    model = models[0][1]
    solver = new_solver(model.state_size, model.arrays.known.size)
    solver.y[: seen.shape[1]] = seen[0]
    states = np.empty((count, model.state_size))
    results = (states, np.empty((count, 2)), np.empty((count, m)), np.empty((count, m)))
    inputs = np.empty(m + 2 + torques.shape[1])
    ends = [first for first, _ in models[1:]] + [count]
    for (first, model), end in zip(models, ends, strict=True):
        status, reached = roll_out(
            model.arrays,
            model.work,
            solver,
            times,
            commands,
            rails,
            torques,
            oil,
            seen,
            float(model.robot.command_delay_s),
            float(tolerance),
            inputs,
            results,
            np.int64(first),
            np.int64(end),
        )
        if status != DONE:
            raise _failure(model.robot, status, reached, solver.z * model.arrays.scale)
    return _rollout(model.robot, times, results, int(solver.tried[0]))


def _times(robot: Robot, time_s: ArrayLike) -> FloatArray:
    times = shaped("time_s", time_s, (np.size(time_s),))
    if len(times) < 1 or not np.all(np.diff(times) > 0.0):
        raise SimulationError(f"robot {robot.name}: time_s should be increasing samples")
    return times


def _rail(name: str, measured: ArrayLike | None, constant: float, count: int) -> FloatArray:
    if measured is None:
        return np.full(count, float(constant))
    return shaped(name, measured, (count,))


def _commands(robot: Robot, voltages: FloatArray) -> FloatArray:
    if robot.command_delay_s < 0.0:
        raise SimulationError(
            f"robot {robot.name}: expected a command_delay_s of 0 or more, found"
            f" {robot.command_delay_s:g}: no command acts before it is given"
        )
    rated = [robot.valve_of(cylinder.name).rated_voltage_v for cylinder in robot.cylinders]
    return np.ascontiguousarray(np.clip(voltages / np.array(rated), -1.0, 1.0))


def _rollout(
    robot: Robot, times: FloatArray, results: tuple[FloatArray, ...], steps: int
) -> Rollout:
    n, m = robot.dof, len(robot.cylinders)
    states, rails, openings, friction = results
    q, qd, p_a, p_b, internal = np.split(states, [n, 2 * n, 2 * n + m, 2 * n + 2 * m], axis=1)
    force = [
        geometry.piston_force(cylinder, p_a[:, i], p_b[:, i])
        for i, cylinder in enumerate(robot.cylinders)
    ]
    return Rollout(
        time_s=times,
        q=q,
        qd=qd,
        p_a=p_a,
        p_b=p_b,
        supply=rails[:, 0],
        tank=rails[:, 1],
        valve_signal=openings,
        piston_force=np.column_stack(force) if force else np.empty((len(times), 0)),
        friction=friction,
        effect_states=internal,
        steps=steps,
    )


def _failure(robot: Robot, status: int, time_s: float, state: FloatArray) -> SimulationError:
    from hydro_model.simulation.rollout_kernels import NOT_FINITE, OUT_OF_STROKE, STEP_TOO_SMALL

    start = f"robot {robot.name}: simulation failed at t = {time_s:.4f} s"
    if status == OUT_OF_STROKE:
        for cylinder in robot.cylinders:
            x = float(geometry.stroke(cylinder, state[robot.joint_index(cylinder.joint)]))
            if not 0.0 < x < cylinder.stroke_m:
                return SimulationError(
                    f"{start}: '{cylinder.name}' at {x:.4f} m left its stroke 0 to"
                    f" {cylinder.stroke_m} m"
                )
    if status == NOT_FINITE:
        return SimulationError(
            f"{start}: not finite, or a mass matrix that is not positive definite"
        )
    if status == STEP_TOO_SMALL:
        return SimulationError(f"{start}: no step is small enough for the tolerance")
    return SimulationError(f"{start}: too many steps between two samples")
