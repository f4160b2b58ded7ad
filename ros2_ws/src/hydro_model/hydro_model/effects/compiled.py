"""Laws compiled: called by address, so that one cached kernel serves every set of effects.

A kernel specialised to a set of effects would be compiled anew for each set. Here each law is
compiled (and cached) on its own and the kernels call through its address.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np
from llvmlite import ir  # type: ignore[import-untyped]
from numba import cfunc, njit, types
from numba.extending import intrinsic
from numpy.typing import NDArray

from hydro_model.effects.effect import InternalState, Law
from hydro_model.robot import FloatArray
from hydro_model.signals import (
    MAX_STATES,
    RETURN_FLOW,
    SIGNAL_COUNT,
    STATE_0,
    SUPPLY_FLOW,
    VALVE_FLOW_A,
    VALVE_FLOW_B,
    VALVE_RATE,
    VALVE_SIGNAL,
)

_POINTER = types.CPointer(types.float64)
#: Longest Runge-Kutta step of `integrate_states`, s: a 150 Hz spool stays accurate.
_LONGEST_STEP_S = 1.25e-4
#: Step times rate of decay that a step keeps to (stable below 2.78), and most steps a sample.
_STIFFEST, _MOST_STEPS = 1.5, 4096


#: Signals that are held from row to row: they jump with the command.
HELD_SIGNALS = (VALVE_SIGNAL, VALVE_RATE, VALVE_FLOW_A, VALVE_FLOW_B, SUPPLY_FLOW, RETURN_FLOW)
_HELD = np.zeros(SIGNAL_COUNT, dtype=np.bool_)
_HELD[[*HELD_SIGNALS, *range(STATE_0, STATE_0 + MAX_STATES)]] = True


@cache
def _compiled(law: Law) -> Any:
    return cfunc(types.float64(_POINTER, _POINTER), cache=True, error_model="numpy")(law)


def law_address(law: Law) -> int:
    """Address of a law compiled as ``double law(const double *s, const double *p)``."""
    return int(_compiled(law).address)


@intrinsic
def call_law(typing_context: Any, address: Any, signals: Any, parameters: Any) -> Any:
    """Call a law by its address with two contiguous float64 arrays, from compiled code."""
    signature = types.float64(types.int64, signals, parameters)

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        double = ir.DoubleType()
        function = ir.FunctionType(double, [double.as_pointer(), double.as_pointer()])
        target = builder.inttoptr(arguments[0], function.as_pointer())
        data = [
            context.make_array(kind)(context, builder, value).data
            for kind, value in zip(signature.args[1:], arguments[1:], strict=True)
        ]
        return builder.call(target, data)

    return signature, generate


@njit(cache=True, error_model="numpy")
def _evaluate(address: int, signals: FloatArray, parameters: FloatArray, out: FloatArray) -> None:
    for k in range(signals.shape[0]):
        out[k] = call_law(address, signals[k], parameters)


@njit(cache=True, error_model="numpy")
def _decay(rate: Any, row: FloatArray, parameters: FloatArray, scale: FloatArray) -> float:
    """The fastest rate at which a state falls back by itself, 1/s."""
    fastest = 0.0
    for i in range(rate.shape[0]):
        kept = row[STATE_0 + i]
        before = call_law(rate[i], row, parameters)
        row[STATE_0 + i] = kept + 1e-6 * scale[i]
        after = call_law(rate[i], row, parameters)
        row[STATE_0 + i] = kept
        fastest = max(fastest, abs(after - before) / (1e-6 * scale[i]))
    return fastest


@njit(cache=True, error_model="numpy")
def _step(rate: Any, row: FloatArray, parameters: FloatArray, step: float, work: Any) -> None:
    """One classical Runge-Kutta step of the states in a row."""
    size = rate.shape[0]
    start, stage = work[4], work[:4]
    for i in range(size):
        start[i] = row[STATE_0 + i]
    for j in range(4):
        for i in range(size):
            stage[j, i] = call_law(rate[i], row, parameters)
        reach = step if j == 2 else 0.5 * step
        for i in range(size):
            row[STATE_0 + i] = start[i] + reach * stage[j, i]
    for i in range(size):
        total = stage[0, i] + 2.0 * (stage[1, i] + stage[2, i]) + stage[3, i]
        row[STATE_0 + i] = start[i] + step / 6.0 * total


@njit(cache=True, error_model="numpy")
def _bridge(initial: Any, before: FloatArray, row: FloatArray, parameters: FloatArray) -> None:
    """States over a gap: unknown signals leave them as they were, or at rest after the gap."""
    size = initial.shape[0]
    known = True
    for i in range(size):
        known = known and row[STATE_0 + i] == row[STATE_0 + i]
    if known:
        return
    for i in range(size):
        row[STATE_0 + i] = before[STATE_0 + i]
    for i in range(size):
        if row[STATE_0 + i] != row[STATE_0 + i]:
            row[STATE_0 + i] = call_law(initial[i], row, parameters)


@njit(cache=True, error_model="numpy")
def _integrate(
    initial: Any,
    rate: Any,
    scale: FloatArray,
    held: NDArray[np.bool_],
    signals: FloatArray,
    parameters: FloatArray,
    sample_time: float,
    count: int,
) -> None:
    size = initial.shape[0]
    for i in range(size):
        signals[0, STATE_0 + i] = call_law(initial[i], signals[0], parameters)
    work = np.empty((5, size))
    for k in range(signals.shape[0] - 1):
        row = signals[k].copy()
        stiff = _decay(rate, row, parameters, scale) * sample_time / _STIFFEST
        steps = count
        if stiff > count:  # false where it is NaN
            steps = int(min(stiff + 1.0, float(_MOST_STEPS)))
        for part in range(steps):
            for c in range(held.shape[0]):
                if not held[c]:
                    change = signals[k + 1, c] - signals[k, c]
                    row[c] = signals[k, c] + change * (part + 0.5) / steps
            _step(rate, row, parameters, sample_time / steps, work)
        for i in range(size):
            signals[k + 1, STATE_0 + i] = row[STATE_0 + i]
        _bridge(initial, signals[k], signals[k + 1], parameters)


def evaluate_law(law: Law, signals: FloatArray, parameters: FloatArray) -> FloatArray:
    """A law row by row: (N, SIGNAL_COUNT) signals to (N,) values."""
    out = np.empty(len(signals))
    _evaluate(law_address(law), signals, parameters, out)
    return out


def integrate_states(
    states: Sequence[InternalState],
    signals: FloatArray,
    parameters: FloatArray,
    sample_time_s: float,
) -> FloatArray:
    """A copy of the signals with internal states filled in.

    Between two rows, what the valve's command makes jump is held (`HELD_SIGNALS`), as the valve
    holds it; the rest moves evenly.
    Classical fourth-order Runge-Kutta from rest at the first row, in as many steps per sample as
    the fastest decay needs. Where signals are unknown (NaN), states stay as they were.
    """
    filled = signals.copy()
    if len(filled):
        initial = np.array([law_address(state.initial) for state in states])
        rate = np.array([law_address(state.rate) for state in states])
        scale = np.array([state.scale for state in states])
        count = max(1, math.ceil(sample_time_s / _LONGEST_STEP_S - 1e-9))
        _integrate(initial, rate, scale, _HELD, filled, parameters, sample_time_s, np.int64(count))
    return filled
