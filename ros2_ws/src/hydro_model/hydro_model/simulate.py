"""The model as an ordinary differential equation, and its roll-outs.

State: joint positions and velocities, two gauge pressures per cylinder, and the internal states of
the effects the robot lists. Chamber by chamber (eq. 10 before the pressures are summed):

``pdot_a = (q_a - A1 xdot) / (V_a (1/beta))``,  ``pdot_b = (q_b + A2 xdot) / (V_b (1/beta))``

and ``M(q) qdd + h(q, qd) = lever (p_a A1 - p_b A2 - friction) + torque``. Effects add to flows,
volumes, compliances, friction and supply as `hydro_model.effects` says. Pressures are not kept
above vapour pressure: laws are finite for any pressure, and cavitation is not part of the base.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from hydro_model import cylinder as geometry
from hydro_model.effects import ActiveEffect, Stage, resolve
from hydro_model.errors import SimulationError
from hydro_model.rigid_body import inverse_dynamics
from hydro_model.robot import FloatArray, Robot

if TYPE_CHECKING:
    from hydro_model.simulate_arrays import ModelArrays, Work

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


class Model:
    """The right-hand side of a robot with its effects, for integrators of one's own.

    Parameters
    ----------
    robot : Robot
    measured_supply, measured_tank : bool
        The rail's pressure is given as an input: effects that would change it are left out.

    Raises
    ------
    RobotError
        An effect does not resolve, or a cylinder has no valve.
    """

    def __init__(
        self, robot: Robot, *, measured_supply: bool = False, measured_tank: bool = False
    ) -> None:
        from hydro_model.simulate_arrays import model_arrays, new_work

        left_out = {Stage.SUPPLY} if measured_supply else set()
        left_out |= {Stage.TANK} if measured_tank else set()
        self.robot = robot
        self.active: tuple[ActiveEffect, ...] = tuple(
            one for one in resolve(robot) if one.effect.terms[0].stage not in left_out
        )
        self.arrays: ModelArrays = model_arrays(robot, self.active)
        self.work: Work = new_work(robot)

    @property
    def state_size(self) -> int:
        """Entries of ``[q (n), qd (n), p_a (m), p_b (m), effect states]``."""
        return len(self.arrays.scale)

    def inputs(
        self, signals: ArrayLike, supply: float, tank: float, torque: ArrayLike | None = None
    ) -> FloatArray:
        """The input vector: normalised valve signals (m,), rails, joint torques (n,)."""
        extra = np.zeros(self.robot.dof) if torque is None else np.asarray(torque, dtype=float)
        return np.concatenate([np.asarray(signals, dtype=float), [supply, tank], extra])

    def rates(self, time_s: float, state: ArrayLike, inputs: ArrayLike) -> FloatArray:
        """Time derivative of the state, compiled.

        Parameters
        ----------
        time_s : float
        state : (state_size,) array
        inputs : (m + 2 + n,) array
            As `inputs` makes it.

        Returns
        -------
        (state_size,) array

        Raises
        ------
        SimulationError
            The mass matrix is not positive definite at this state.
        """
        from hydro_model.simulate_kernels import right_hand_side

        y = np.array(state, dtype=float)
        out = np.zeros_like(y)
        given = np.asarray(inputs, dtype=float)
        if not right_hand_side(self.arrays, self.work, time_s, given, y, out, False, False):
            raise SimulationError(
                f"robot {self.robot.name}: mass matrix not positive definite at"
                f" q = {y[: self.robot.dof]}"
            )
        return out

    def rest(self, q: ArrayLike, qd: ArrayLike, p0: ArrayLike, inputs: ArrayLike) -> FloatArray:
        """A state with the effects' internal states at rest.

        Parameters
        ----------
        q, qd : (n,) array
        p0 : (m, 2) array
            Gauge pressures of chambers A and B, Pa.
        inputs : (m + 2 + n,) array

        Returns
        -------
        (state_size,) array
        """
        from hydro_model.simulate_kernels import right_hand_side

        y = np.zeros(self.state_size)
        pressures = np.asarray(p0, dtype=float).T.ravel()
        known = np.concatenate([np.asarray(q, float), np.asarray(qd, float), pressures])
        y[: len(known)] = known
        given = np.asarray(inputs, dtype=float)
        right_hand_side(self.arrays, self.work, 0.0, given, y, np.zeros_like(y), False, True)
        return y


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
    q0, qd0 : (n,) array
        Start; at rest by default.
    p0 : (m, 2) array, optional
        Gauge pressures of chambers A and B, Pa; `equilibrium_pressures` by default.
    supply, tank : (N,) array, optional
        Measured at the valves, gauge, Pa. Default: the robot's constants with the robot's
        effects on them.
    torque : (N, n) array, optional
        Further joint torques, each row held until the next sample.
    tolerance : float
        Relative error per step.

    Returns
    -------
    Rollout

    Raises
    ------
    SimulationError
        Shapes do not fit, or the integration fails: a piston leaves its stroke, something
        becomes infinite or the step collapses.
    RobotError
        An effect does not resolve.
    """
    from hydro_model.rollout_kernels import DONE, roll_out
    from hydro_model.rosenbrock_kernels import new_solver

    n, m = robot.dof, len(robot.cylinders)
    times = _shaped("time_s", time_s, (np.size(time_s),))
    count = len(times)
    if count < 1 or not np.all(np.diff(times) > 0.0):
        raise SimulationError(f"robot {robot.name}: time_s should be increasing samples")
    commands = _commands(robot, _shaped("voltages", voltages, (count, m)))
    rails = np.column_stack(
        [
            _rail("supply", supply, robot.supply_pressure_pa, count),
            _rail("tank", tank, robot.tank_pressure_pa, count),
        ]
    )
    torques = _shaped("torque", np.zeros((count, n)) if torque is None else torque, (count, n))
    q_start = _shaped("q0", q0, (n,))
    if p0 is None:
        p0 = equilibrium_pressures(robot, q_start, rails[0, 0], rails[0, 1])
    model = Model(robot, measured_supply=supply is not None, measured_tank=tank is not None)
    solver = new_solver(model.state_size)
    solver.y[: 2 * n + 2 * m] = np.concatenate(
        [
            q_start,
            _shaped("qd0", np.zeros(n) if qd0 is None else qd0, (n,)),
            _shaped("p0", p0, (m, 2)).T.ravel(),
        ]
    )
    states = np.empty((count, model.state_size))
    results = (states, np.empty((count, 2)), np.empty((count, m)), np.empty((count, m)))
    status, reached = roll_out(
        model.arrays,
        model.work,
        solver,
        times,
        commands,
        rails,
        torques,
        float(robot.command_delay_s),
        float(tolerance),
        np.empty(m + 2 + n),
        results,
    )
    if status != DONE:
        raise _failure(robot, status, reached, solver.z * model.arrays.scale)
    return _rollout(robot, times, results, int(solver.tried[0]))


def equilibrium_pressures(
    robot: Robot,
    q: ArrayLike,
    supply_pa: float | None = None,
    tank_pa: float | None = None,
) -> FloatArray:
    """Chamber pressures that hold the load at rest behind closed valves.

    The load fixes ``p_a A1 - p_b A2`` only. The other condition is that of equal leakage over
    the four edges of a closed valve: ``p_a + p_b = p_s + p_t``.

    Parameters
    ----------
    robot : Robot
    q : (n,) array
    supply_pa, tank_pa : float, optional
        Gauge; the robot's constants by default.

    Returns
    -------
    (m, 2) array
        Gauge pressures of chambers A and B, Pa.

    Raises
    ------
    SimulationError
        The load would need a pressure outside tank to supply.
    """
    p_s = robot.supply_pressure_pa if supply_pa is None else float(supply_pa)
    p_t = robot.tank_pressure_pa if tank_pa is None else float(tank_pa)
    position = _shaped("q", q, (robot.dof,))
    still = np.zeros(robot.dof)
    torque = inverse_dynamics(robot, position, still, still)
    out = np.empty((len(robot.cylinders), 2))
    for row, cylinder in zip(out, robot.cylinders, strict=True):
        joint = robot.joint_index(cylinder.joint)
        force = torque[joint] / float(geometry.lever(cylinder, position[joint]))
        area = cylinder.area_a_m2 + cylinder.area_b_m2
        row[0] = (force + cylinder.area_b_m2 * (p_s + p_t)) / area
        row[1] = p_s + p_t - row[0]
        if not p_t <= row[0] <= p_s:
            raise SimulationError(
                f"robot {robot.name}: '{cylinder.name}' cannot hold {force:.0f} N at rest between"
                f" tank at {p_t:.4g} Pa and supply at {p_s:.4g} Pa"
            )
    return out


def _shaped(name: str, value: ArrayLike, shape: tuple[int, ...]) -> FloatArray:
    array = np.ascontiguousarray(value, dtype=float)
    if array.shape != shape:
        raise SimulationError(f"simulate: {name} should have shape {shape}, found {array.shape}")
    if not np.all(np.isfinite(array)):
        raise SimulationError(f"simulate: {name} holds values that are not finite")
    return array


def _rail(name: str, measured: ArrayLike | None, constant: float, count: int) -> FloatArray:
    if measured is None:
        return np.full(count, float(constant))
    return _shaped(name, measured, (count,))


def _commands(robot: Robot, voltages: FloatArray) -> FloatArray:
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
    from hydro_model.rollout_kernels import NOT_FINITE, OUT_OF_STROKE, STEP_TOO_SMALL

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
