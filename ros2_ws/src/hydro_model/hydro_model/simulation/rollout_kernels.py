"""Compiled roll-out: the model driven by sampled inputs, its state at every sample."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from hydro_model.effects.signals import (
    OIL_TEMPERATURE,
    PISTON_POSITION,
    SUPPLY_PRESSURE,
    TANK_PRESSURE,
    VALVE_SIGNAL,
)
from hydro_model.numerics.dormand_prince import STAGES as EXPLICIT_STAGES
from hydro_model.numerics.kernel import copy, kernel, merged
from hydro_model.simulation.command_kernels import look_ahead
from hydro_model.simulation.explicit_kernels import IMPLICIT_STEPS, try_explicit, watch_stiffness
from hydro_model.simulation.rosenbrock_kernels import jacobian, try_step
from hydro_model.simulation.simulate_arrays import RATES, REST, STROKE
from hydro_model.simulation.simulate_kernels import right_hand_side
from hydro_model.simulation.solver_kernels import FIRST_STEP_S, scaled_rates

Array = Any  # numba types the kernels; mypy follows no numba import

# Share of the tolerance that an explicit step may take where states are left out of its error that
# follow from the commands alone (`look_ahead`): no valve holds it short, and errors add up.
MARGIN = 0.3
EXPLICIT_ORDER, IMPLICIT_ORDER = 5.0, 4.0  # of a step's error
SMALLEST_STEP_S = 1.0e-11
# Between two changes of input: steps after which the implicit method is tried whatever keeps
# them short (friction that is sharp within the tolerance does not show as a rate), and most steps.
MANY_STEPS, MOST_STEPS = 50, 100_000
DONE, NOT_FINITE, STEP_TOO_SMALL, TOO_MANY_STEPS, OUT_OF_STROKE = range(5)


@kernel
def _outside(model: Any, work: Any) -> bool:
    """Some piston is not within its stroke."""
    for i in range(model.joint.shape[0]):
        x = work.signals[i, PISTON_POSITION]
        if not 0.0 < x < model.geometry[i, STROKE]:
            return True
    return False


@merged
def _accepted_step(
    model: Any,
    work: Any,
    solver: Any,
    time: float,
    end: float,
    inputs: Array,
    h: float,
    tolerance: float,
    implicit: bool,
) -> tuple[float, float]:
    """A step that keeps the tolerance, its result in `new`: its length and the next to try.

    The length is 0 where no step above `SMALLEST_STEP_S` keeps it.
    """
    order = IMPLICIT_ORDER if implicit else EXPLICIT_ORDER
    allowed = tolerance if implicit or model.known.shape[0] == 0 else MARGIN * tolerance
    while h > SMALLEST_STEP_S:
        rest = end - time
        step = rest / math.ceil(rest / h - 1e-9) if rest > h else rest
        if implicit:
            error = try_step(model, work, solver, time, inputs, step) / allowed
        else:
            error = try_explicit(model, work, solver, time, inputs, step) / allowed
        solver.tried[0] += 1
        growth = 5.0 if error == 0.0 else min(5.0, max(0.2, 0.9 * error ** (-1.0 / order)))
        if error <= 1.0:
            # A step cut short by a change of input says nothing against a longer one.
            return step, max(step * growth, h) if step < h else step * growth
        h = step * growth
    return 0.0, h


@merged
def _advance(
    model: Any,
    work: Any,
    solver: Any,
    time: float,
    end: float,
    inputs: Array,
    h: float,
    tolerance: float,
    known: bool,
) -> tuple[int, float, float]:
    """From `time` to `end` with constant inputs: status, time reached, next step to try.

    `known`: the right-hand side was evaluated just before.
    """
    span = end - time
    solver.ahead.kept[0] = 0
    for count in range(MOST_STEPS):
        if count == MANY_STEPS:
            solver.stiff[1] = IMPLICIT_STEPS
        if not known and not scaled_rates(
            model, work, time, inputs, solver.z, solver.f, solver.y, RATES
        ):
            return NOT_FINITE, time, h
        if _outside(model, work):
            return OUT_OF_STROKE, time, h
        if end - time <= SMALLEST_STEP_S:
            return DONE, end, h
        implicit = solver.stiff[1] > 0
        if implicit and not jacobian(model, work, solver, time, inputs):
            return NOT_FINITE, time, h
        reach = end
        if not implicit and model.known.shape[0] > 0:
            reach = look_ahead(model, work, solver, time, end, inputs, tolerance)
        step, h = _accepted_step(model, work, solver, time, reach, inputs, h, tolerance, implicit)
        if step == 0.0:
            return STEP_TOO_SMALL, time, h
        copy(solver.new, solver.z)
        time += step
        known = not implicit
        if implicit:
            solver.stiff[1] -= 1
            solver.ahead.kept[0] = 0
        else:
            copy(solver.k[EXPLICIT_STAGES - 1], solver.f)
            watch_stiffness(solver, step, span)
    return TOO_MANY_STEPS, time, h


@kernel
def _held(times: Array, delay: float, now: float, held: int, last: int) -> int:
    """Index of the command that acts at `now`, at most `last`."""
    while held < last and times[held + 1] + delay <= now + SMALLEST_STEP_S:
        held += 1
    return held


@merged
def _to_sample(
    model: Any,
    work: Any,
    solver: Any,
    times: Array,
    commands: Array,
    delay: float,
    tolerance: float,
    inputs: Array,
    sample: int,
    held: int,
    h: float,
    known: bool,
) -> tuple[int, float, int, float]:
    """From the sample before to `sample`: status, time reached, command that acts, next step."""
    time, status = times[sample - 1], DONE
    while time < times[sample] and status == DONE:
        held = _held(times, delay, time, held, sample - 1)
        end = times[sample]
        if held + 1 < times.shape[0]:
            end = min(end, times[held + 1] + delay)
        copy(commands[held], inputs)
        status, time, h = _advance(model, work, solver, time, end, inputs, h, tolerance, known)
        known = False
    return status, time, held, h


@merged
def _record(model: Any, work: Any, solver: Any, sample: int, results: Any) -> None:
    states, rails, openings, friction = results
    m = model.joint.shape[0]
    copy(solver.y, states[sample])
    rails[sample, 0] = work.signals[m, SUPPLY_PRESSURE]
    rails[sample, 1] = work.signals[m, TANK_PRESSURE]
    for i in range(m):
        openings[sample, i] = work.signals[i, VALVE_SIGNAL]
        friction[sample, i] = work.friction[i]


@kernel
def _surround(work: Any, inputs: Array, torques: Array, oil_c: float) -> None:
    """Put joint torques (n,) behind the other inputs, and let all laws see the oil's warmth."""
    before = inputs.shape[0] - torques.shape[0]
    for j in range(torques.shape[0]):
        inputs[before + j] = torques[j]
    for i in range(work.signals.shape[0]):
        work.signals[i, OIL_TEMPERATURE] = oil_c


@kernel
def roll_out(
    model: Any,
    work: Any,
    solver: Any,
    times: Array,
    commands: Array,
    rails: Array,
    torques: Array,
    oil: Array,
    seen: Array,
    delay: float,
    tolerance: float,
    inputs: Array,
    results: Any,
    begin: int,
    end: int,
) -> tuple[int, float]:
    """The state at the samples from `begin` to before `end`.

    Where motion and pressures were seen they are put in the state's place at every sample: the
    effects' states alone go on from sample to sample, under what happened.

    Parameters
    ----------
    model, work, solver : ModelArrays, Work, Solver
        `solver.y` holds the state at the first sample, whose effect states are set to rest; or,
        with a later `begin`, `solver.z` that of the sample before.
    times : (N,) array
        Increasing.
    commands : (N, m) array
        Normalised valve signals; row j acts from ``times[j] + delay`` until the next does.
    rails : (N, 2) array
        Supply and tank pressure before effects; between samples their mean holds.
    torques : (N, n) array
        Joint torques, each row held until the next sample.
    oil : (N,) array
        Its temperature, deg C, each held until the next sample; NaN where it is not known.
    seen : (k, 2 n + 2 m) array
        Motion and pressures at the first samples, the first one's in `solver.y` as well.
    delay, tolerance : float
    inputs : (m + 2 + n,) array
        Working memory.
    results : tuple of (N, ...) arrays
        States, rails after effects, valve signals after effects, friction; filled.
    begin, end : int

    Returns
    -------
    int
        `DONE` or what went wrong.
    float
        Time reached.
    """
    m, held, h = model.joint.shape[0], np.int64(0), FIRST_STEP_S
    for sample in range(begin, end):
        if sample > 0:
            # Where the rails did not change, the rates recorded last are the step's first.
            known = sample > begin
            for i in range(2):
                known = known and rails[sample - 1, i] == rails[sample, i]
                inputs[m + i] = 0.5 * (rails[sample - 1, i] + rails[sample, i])
            _surround(work, inputs, torques[sample - 1], oil[sample - 1])
            status, time, held, h = _to_sample(
                model,
                work,
                solver,
                times,
                commands,
                delay,
                tolerance,
                inputs,
                sample,
                held,
                h,
                known,
            )
            if status != DONE:
                return status, time
        held = _held(times, delay, times[sample], held, sample)
        copy(commands[held], inputs)
        for i in range(2):
            inputs[m + i] = rails[sample, i]
        _surround(work, inputs, torques[sample], oil[sample])
        if sample == 0:
            right_hand_side(model, work, times[0], inputs, solver.y, solver.f, REST)
            for i in range(solver.z.shape[0]):
                solver.z[i] = solver.y[i] / model.scale[i]
        elif sample < seen.shape[0]:
            for i in range(seen.shape[1]):
                solver.z[i] = seen[sample, i] / model.scale[i]
        if not scaled_rates(
            model, work, times[sample], inputs, solver.z, solver.f, solver.y, RATES
        ):
            return NOT_FINITE, times[sample]
        _record(model, work, solver, sample, results)
    return DONE, times[end - 1]
