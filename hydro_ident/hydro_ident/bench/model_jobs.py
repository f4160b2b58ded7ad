"""Jobs of the model: regressor and inverse dynamics against pinocchio, roll-outs against scipy."""

from __future__ import annotations

import statistics
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from typing import Any, Literal, TypeAlias

import numpy as np
import scipy

from hydro_ident.bench.chains import PINOCCHIO_ORDER, chain, pinocchio_model
from hydro_ident.bench.job import Job, Row, against_limit, agree, seconds_of
from hydro_model.effects import CATALOGUE
from hydro_model.effects.targets import targets
from hydro_model.multibody.rigid_body import inverse_dynamics, regressor
from hydro_model.robot import EffectSpec, FloatArray, Robot
from hydro_model.robot_files import load_robot
from hydro_model.simulation.simulate import Model, equilibrium_pressures, simulate
from hydro_model.simulation.simulate_reference import reference_rates

SAMPLES = 100_000
STEP_S, SIMULATED_S = 0.002, 10.0
START = np.array([0.8, -1.2])
#: scipy solves so much of the roll-out: it would take minutes for all of it.
_SCIPY_S = 0.4
#: Methods of scipy's that are used, and those of them for stiff equations.
_Method: TypeAlias = Literal["LSODA", "Radau", "DOP853"]
_PEERS: tuple[_Method, ...] = ("LSODA", "Radau")
#: Of the solution that errors are counted from (the states' scale, MPa for pressures), those tried
#: for the peers, and what ours may be off by.
_TIGHT, _TOLERANCES = 1e-12, tuple(10.0 ** (-0.5 * k) for k in range(6, 25))
_LARGEST_ERROR = 1e-6


def dynamics_jobs(pin: Any) -> Iterator[Job]:
    """Regressor and inverse dynamics of chains with 2 and 6 joints; `pin` is pinocchio."""
    for dof in (2, 6):
        robot = chain(dof)
        motion = np.random.default_rng(dof).normal(size=(3, SAMPLES, dof))
        yield _regressor_job(pin, robot, motion)
        yield _torque_job(pin, robot, motion)


def _regressor_job(pin: Any, robot: Robot, motion: FloatArray) -> Job:
    model = pinocchio_model(pin, robot)
    data, (q, qd, qdd) = model.createData(), motion
    compute = pin.computeJointTorqueRegressor
    columns = [10 * link + p for link in range(robot.dof) for p in PINOCCHIO_ORDER]

    def theirs() -> FloatArray:
        out = np.empty((SAMPLES, robot.dof, 10 * robot.dof))
        for k in range(SAMPLES):
            out[k] = compute(model, data, q[k], qd[k], qdd[k])
        return out

    def check() -> None:
        ours = regressor(robot, q, qd, qdd)
        np.testing.assert_allclose(ours[:, :, columns], theirs(), rtol=1e-9, atol=1e-9)

    name = f"torque regressor, {SAMPLES} samples, {robot.dof} joints"
    peer = f"pinocchio {pin.__version__} in a loop"
    return Job(name, peer, 4.0, lambda: regressor(robot, q, qd, qdd), theirs, check)


def _torque_job(pin: Any, robot: Robot, motion: FloatArray) -> Job:
    model = pinocchio_model(pin, robot)
    data, (q, qd, qdd) = model.createData(), motion

    def theirs() -> FloatArray:
        out = np.empty((SAMPLES, robot.dof))
        for k in range(SAMPLES):
            out[k] = pin.rnea(model, data, q[k], qd[k], qdd[k])
        return out

    def check() -> None:
        ours = inverse_dynamics(robot, q, qd, qdd)
        np.testing.assert_allclose(ours, theirs(), rtol=1e-9, atol=1e-9)

    name = f"inverse dynamics, {SAMPLES} samples, {robot.dof} joints"
    peer = f"pinocchio {pin.__version__} in a loop"
    return Job(name, peer, 4.0, lambda: inverse_dynamics(robot, q, qd, qdd), theirs, check)


def base_robot() -> Robot:
    """The shipped crane without effects."""
    return replace(load_robot("xs031"), effects=())


def with_every_effect(robot: Robot) -> Robot:
    """The robot with every effect of the catalogue at its typical size."""
    specs = (
        EffectSpec(effect.name, robot.name, {p.name: p.typical for p in effect.parameters})
        for effect in CATALOGUE.values()
        if targets(robot, effect)
    )
    return replace(robot, effects=tuple(specs))


def _drive(seconds: float) -> tuple[FloatArray, FloatArray]:
    times = np.asarray(np.arange(round(seconds / STEP_S) + 1) * STEP_S, dtype=np.float64)
    slow, quick = np.outer(times, [2.0, 1.7]), np.outer(times, [20.0, 31.7])
    return times, 2.0 * np.sin(slow) + 0.3 * np.sin(quick)


def simulation_jobs() -> Iterator[Job]:
    """A roll-out of the base model against scipy's stiff solvers, with either right-hand side.

    Of scipy's tolerances the loosest is taken at which its error is no larger than ours.
    """
    robot = base_robot()
    times, volts = _drive(_SCIPY_S)
    rollout = partial(_scipy_rollout, robot, times, volts)
    exact = rollout("DOP853", _TIGHT, compiled=True)

    def ours() -> FloatArray:
        run = simulate(robot, times, volts, START)
        return np.column_stack([run.q, run.qd, run.p_a / 1e6, run.p_b / 1e6])

    def error(states: FloatArray) -> float:
        return float(np.max(np.abs(states - exact)))

    most = error(ours())
    for method in _PEERS:
        errors = ((t, error(rollout(method, t, compiled=True))) for t in _TOLERANCES)
        # Where none suffices, the check says by how much the tightest does not.
        tolerance = next((t for t, found in errors if found <= most), _TOLERANCES[-1])
        for text, compiled in (("numpy", False), ("our compiled", True)):
            theirs = partial(rollout, method, tolerance, compiled=compiled)

            def check(theirs: Any = theirs) -> None:
                agree(most <= _LARGEST_ERROR, f"our error is {most:.2g}")
                # Rounding in another order may move a step that both solvers choose freely.
                found = error(theirs())
                agree(found <= 2.0 * most, f"its error is {found:.2g}")

            name = f"simulation, two joints, {_SCIPY_S:g} s"
            peer = (
                f"scipy {scipy.__version__} solve_ivp {method} as exact, on {text} right-hand side"
            )
            yield Job(name, peer, 100.0, ours, theirs, check)


def _scipy_rollout(
    robot: Robot,
    times: FloatArray,
    volts: FloatArray,
    method: _Method,
    tolerance: float,
    *,
    compiled: bool,
) -> FloatArray:
    """Positions, velocities and pressures (MPa) at every sample by `solve_ivp`."""
    from scipy.integrate import solve_ivp

    model = Model(robot)
    scale, inputs = model.arrays.scale, model.inputs(volts[0] / 10.0, *_rails(robot))
    p0 = equilibrium_pressures(model.robot, START)
    states = [model.rest(START, np.zeros(2), p0, inputs) / scale]

    def rates(t: float, z: FloatArray) -> FloatArray:
        if compiled:
            return model.rates(t, z * scale, inputs) / scale
        return reference_rates(model.robot, model.active, t, inputs, z * scale) / scale

    for k in range(len(times) - 1):
        inputs = model.inputs(volts[k] / 10.0, *_rails(robot))
        span = (float(times[k]), float(times[k + 1]))
        solved = solve_ivp(rates, span, states[-1], method, rtol=tolerance, atol=tolerance)
        states.append(solved.y[:, -1])
    return np.array(states)


def _rails(robot: Robot) -> tuple[float, float]:
    return robot.supply_pressure_pa, robot.tank_pressure_pa


def real_time_rows(rounds: int) -> list[Row]:
    """How many times faster than real time roll-outs are.

    `rounds` is how often each is run: the median counts.
    """
    times, volts = _drive(SIMULATED_S)
    rows = []
    robots = (("base model", base_robot(), 200.0), ("every effect on", _every(), 50.0))
    for text, robot, goal in robots:
        simulate(robot, times[:50], volts[:50], START)
        work = partial(simulate, robot, times, volts, START)
        spent = statistics.median(seconds_of(work) for _ in range(rounds))
        name = f"simulation, two joints, {SIMULATED_S:g} s, {text}"
        rows.append(against_limit(name, "real time", spent, SIMULATED_S, goal, rounds=rounds))
    return rows


def _every() -> Robot:
    return with_every_effect(base_robot())
