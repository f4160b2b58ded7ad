"""Laws compiled: called by address, so that one cached kernel serves every set of effects.

A kernel specialised to a set of effects would be compiled anew for each set. Here each law is
compiled (and cached) on its own and the kernels call through its address.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np
from llvmlite import ir  # type: ignore[import-untyped]
from numba import cfunc, njit, types
from numba.extending import intrinsic

from hydro_model.effects.effect import InternalState, Law
from hydro_model.robot import FloatArray
from hydro_model.signals import STATE_0

_POINTER = types.CPointer(types.float64)
#: Runge-Kutta steps per sample of `integrate_states`: a 150 Hz spool at 500 Hz stays accurate.
_SUBSTEPS = 16


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
def _integrate(
    initial: Any, rate: Any, signals: FloatArray, parameters: FloatArray, step: float, count: int
) -> None:
    size = initial.shape[0]
    for i in range(size):
        signals[0, STATE_0 + i] = call_law(initial[i], signals[0], parameters)
    stage = np.empty((4, size))
    for k in range(signals.shape[0] - 1):
        row = signals[k].copy()
        for _ in range(count):
            start = row[STATE_0 : STATE_0 + size].copy()
            for j in range(4):
                for i in range(size):
                    stage[j, i] = call_law(rate[i], row, parameters)
                reach = step if j == 2 else 0.5 * step
                for i in range(size):
                    row[STATE_0 + i] = start[i] + reach * stage[j, i]
            for i in range(size):
                total = stage[0, i] + 2.0 * (stage[1, i] + stage[2, i]) + stage[3, i]
                row[STATE_0 + i] = start[i] + step / 6.0 * total
        for i in range(size):
            signals[k + 1, STATE_0 + i] = row[STATE_0 + i]


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
    """A copy of the signals with internal states filled in, each row held for one sample time.

    Classical fourth-order Runge-Kutta in `_SUBSTEPS` steps per sample, from rest at the first row.
    """
    filled = signals.copy()
    if len(filled):
        initial = np.array([law_address(state.initial) for state in states])
        rate = np.array([law_address(state.rate) for state in states])
        _integrate(initial, rate, filled, parameters, sample_time_s / _SUBSTEPS, _SUBSTEPS)
    return filled
