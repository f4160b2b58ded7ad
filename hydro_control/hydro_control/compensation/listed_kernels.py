"""Compiled compensation of the listed effects, between and behind equations 22 to 24.

The laws are the catalogue's own, called by their addresses (`hydro_model.effects.compiled`). The
readable counterpart, which the tests compare with, is
`hydro_control.compensation.compensation_reference`. `listed` and `work` are as of
`hydro_control.compensation.listed_arrays`; pressures are gauge. Arrays are (n,), one number per
axis, where nothing else is said.
"""

from __future__ import annotations

import math
from typing import Any

from hydro_control.compensation.listed_arrays import (
    ADDRESS,
    AREA_A,
    AREA_B,
    AXIS,
    BULK,
    CYLINDER,
    EFFECT,
    FIRST_STATE,
    INITIAL,
    OTHER,
    RATE,
    START,
    STATE_COUNT,
    STEP,
)
from hydro_control.state.state_kernels import average
from hydro_model.effects.compiled import call_law
from hydro_model.effects.signals import (
    JOINT_POSITION,
    JOINT_VELOCITY,
    LEVER,
    OTHER_ACCELERATION,
    OTHER_POSITION,
    OTHER_VELOCITY,
    PISTON_FORCE,
    PISTON_POSITION,
    PISTON_VELOCITY,
    PRESSURE_A,
    PRESSURE_B,
    STATE_0,
    SUPPLY_PRESSURE,
    TANK_PRESSURE,
    TIME,
    VALVE_SIGNAL,
)
from hydro_model.numerics.kernel import inlined, kernel
from hydro_model.simulation.simulate_arrays import (
    COMPLIANCE_A,
    COMPLIANCE_B,
    FLOW_A,
    FLOW_B,
    FRICTION,
    VOLUME_A,
    VOLUME_B,
)

#: Weight of the newest flow past the valve: laws of the opening see that of the sample before,
#: and half a step towards them cannot overshoot.
FLOW_WEIGHT = 0.5

Array = Any  # numba types the kernels; mypy follows no numba import


@inlined
def _total(listed: Any, work: Any, i: int, stage: int) -> float:
    """Sum of the laws of a stage at axis i and the signals observed last."""
    s, out = work.signals[i], 0.0
    for t in range(listed.spans[i, stage, 0], listed.spans[i, stage, 1]):
        effect = listed.terms[t, EFFECT]
        first = listed.effects[effect, FIRST_STATE]
        for k in range(listed.effects[effect, STATE_COUNT]):
            s[STATE_0 + k] = work.states[first + k]
        out += call_law(listed.terms[t, ADDRESS], s, listed.parameters[effect])
    return out


@kernel
def _advance(listed: Any, work: Any, effect: int, step_s: float) -> None:
    """Internal states of an effect follow one sample's signals; the first lets them be at rest.

    By the linearly implicit Euler method, ``z += h r / (1 - h dr/dz)``: right at rest and stable
    however stiff.
    """
    s, p = work.signals[listed.effects[effect, AXIS]], listed.parameters[effect]
    first, count = listed.effects[effect, FIRST_STATE], listed.effects[effect, STATE_COUNT]
    if count > 0 and math.isnan(work.states[first]):
        for k in range(first, first + count):
            work.states[k] = call_law(listed.laws[k, INITIAL], s, p)
        return
    for k in range(count):
        s[STATE_0 + k] = work.states[first + k]
    for k in range(count):
        z, law, nudge = s[STATE_0 + k], listed.laws[first + k, RATE], listed.nudge[first + k]
        rate = call_law(law, s, p)
        s[STATE_0 + k] = z + nudge
        slope = (call_law(law, s, p) - rate) / nudge
        s[STATE_0 + k] = z
        work.states[first + k] = z + step_s * rate / (1.0 - step_s * min(slope, 0.0))


@kernel
def observe_kernel(
    listed: Any,
    work: Any,
    time_s: float,
    q: Array,
    qd: Array,
    qdd: Array,
    arm: Array,
    x: Array,
    pressures: Array,
    p_s: float,
    p_t: float,
    force: Array,
    step_s: float,
) -> None:
    """Take one sample, of the parts of `hydro_control.compensation.compensation.Motion`.

    `time_s` is its time, `q`, `qd` and `qdd` are the joints' motion that laws are asked for, `arm`
    and `x` levers and piston positions, `pressures` (2, m) the chambers', `p_s` and `p_t` supply
    and tank, `force` the pistons' forces, `step_s` the time from sample to sample.
    """
    for i in range(q.shape[0]):
        s, at, other = work.signals[i], listed.at[i, CYLINDER], listed.at[i, OTHER]
        s[TIME], s[JOINT_POSITION], s[JOINT_VELOCITY] = time_s, q[i], qd[i]
        s[PISTON_POSITION], s[PISTON_VELOCITY] = x[i], arm[i] * qd[i]
        s[LEVER], s[PISTON_FORCE] = arm[i], force[i]
        s[PRESSURE_A], s[PRESSURE_B] = pressures[0, at], pressures[1, at]
        s[SUPPLY_PRESSURE], s[TANK_PRESSURE] = p_s, p_t
        if other >= 0:
            s[OTHER_POSITION], s[OTHER_VELOCITY] = q[other], qd[other]
            s[OTHER_ACCELERATION] = qdd[other]
    for effect in range(listed.effects.shape[0]):
        _advance(listed, work, effect, step_s)


@kernel
def friction_kernel(listed: Any, work: Any, force: Array) -> None:
    """Add the listed friction at the motion observed last to `force`, the forces required."""
    for i in range(force.shape[0]):
        force[i] += _total(listed, work, i, FRICTION)


@kernel
def columns_kernel(listed: Any, work: Any, a: Array, b: Array) -> None:
    """Oil columns `a` and `b` become those with the listed volumes, compliances and flows.

    The flow term of what passes the valve is averaged into the working memory.
    """
    for i in range(a.shape[0]):
        oil = listed.oil[i]
        a[i] += _total(listed, work, i, VOLUME_A) / oil[AREA_A]
        b[i] += _total(listed, work, i, VOLUME_B) / oil[AREA_B]
        a[i] *= 1.0 + oil[BULK] * _total(listed, work, i, COMPLIANCE_A)
        b[i] *= 1.0 + oil[BULK] * _total(listed, work, i, COMPLIANCE_B)
        flow = _total(listed, work, i, FLOW_A) / a[i] - _total(listed, work, i, FLOW_B) / b[i]
        work.leak[i] = average(work.leak[i], flow, 1.0 - FLOW_WEIGHT)


@kernel
def signals_kernel(listed: Any, work: Any, opening: Array, past: float, signal: Array) -> None:
    """Signals (n,) to give for openings, through the valves' inverse of the averaged opening.

    Both may be the same array. `past` is the weight that the average of the openings before is
    left with.
    """
    for i in range(opening.shape[0]):
        work.signals[i, VALVE_SIGNAL] = opening[i]
        work.slow[i] = slow = average(work.slow[i], opening[i], past)
        signal[i] = opening[i]
        if listed.inverted[i]:
            signal[i] += _given(listed.wanted[i], listed.given[i], slow) - slow


@inlined
def _given(wanted: Array, given: Array, opening: float) -> float:
    """`hydro_control.compensation.signal_inverse.SignalInverse.signal`, openings evenly spaced."""
    last = given.shape[0] - 1
    at = (opening - wanted[START]) / wanted[STEP]
    if not at > 0.0:  # so that what is no number stays none
        return float(given[0] + opening - wanted[START])
    if at >= last:
        return float(given[last] + opening - (wanted[START] + last * wanted[STEP]))
    k = int(at)
    return float(given[k] + (given[k + 1] - given[k]) * (at - k))
