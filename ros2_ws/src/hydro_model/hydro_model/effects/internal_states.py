"""Internal states of an effect along a recording, integrated between its samples.

Steps are as long as the error of the Runge-Kutta formula (`hydro_model.numerics.dormand_prince`)
allows: how fast the states are follows from the effect's parameters and the motion and differs by
orders of magnitude, so no fixed step would do. Errors are measured against the largest value that
a state had so far, which makes them free of units.

Where the states have a closed form, or those of held signals linear rates, they are followed
exactly (`InternalState.after`, `InternalState.linear`), in one step per sample.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from hydro_model.effects.compiled import call_law, law_address, signals_read
from hydro_model.effects.law import InternalState, Law
from hydro_model.effects.signals import (
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
from hydro_model.numerics.dormand_prince import AT, ERROR, STAGES, WEIGHTS
from hydro_model.numerics.kernel import copy, kernel
from hydro_model.robot import FloatArray

Array = Any  # numba types the kernels; mypy follows no numba import

#: Signals that are held from row to row: they jump with the command.
HELD_SIGNALS = (VALVE_SIGNAL, VALVE_RATE, VALVE_FLOW_A, VALVE_FLOW_B, SUPPLY_FLOW, RETURN_FLOW)
#: Error of a step, relative to the largest value of the state so far.
_TOLERANCE = 1e-6
#: Steps are not made shorter than this share of a sample, whatever the error.
_SHORTEST = 1.0 / 4096.0
#: How much smaller the error of half a step is, and by how much it should be for a double one.
#: Steps are samples divided by powers of two: so rounding does not change which ones are taken.
_HALVED, _DOUBLED = 32.0, 64.0
#: Parts of a sample over which the mean of a law is taken: a hysteresis of 0.5 ms trails a step by
#: 2 % too much at 500 samples a second. And rows that are split at a time.
_PARTS, _ROWS = 8, 256
#: Responses of linear states that are kept: chambers, stretches and trials share them.
_KEPT_RESPONSES = 256
#: As many laws with states are kept as addresses: the catalogue has some dozens.
_KEPT_LAWS = 256


class _Laws(NamedTuple):
    """What is integrated: addresses of laws, their parameters, the signals that they look at."""

    value: Any  # (1,) int, the law whose values are wanted
    rate: Any  # (k,) int
    initial: Any  # (k,) int
    parameters: FloatArray
    read: Any  # int
    moving: Any  # int, those of them that are not held


class _Memory(NamedTuple):
    row: FloatArray  # (SIGNAL_COUNT,)
    start: FloatArray  # (k,) states before the step
    largest: FloatArray  # (k,) that they were so far
    stages: FloatArray  # (STAGES, k) rates


@kernel
def _rates(laws: Any, row: Array, out: Array) -> None:
    for i in range(laws.rate.shape[0]):
        out[i] = call_law(laws.rate[i], row, laws.parameters)


@kernel
def _try_step(
    laws: Any, memory: Any, now: Array, after: Array, begin: float, length: float, step: float
) -> None:
    """Stages of a step, whose first is known; the states after it are left in the row.

    The step begins at a part of the sample, has a length in samples and one in seconds.
    """
    row, stages = memory.row, memory.stages
    for j in range(1, STAGES):
        for i in range(laws.rate.shape[0]):
            total = 0.0
            for b in range(j):
                total += WEIGHTS[j, b] * stages[b, i]
            row[STATE_0 + i] = memory.start[i] + step * total
        part = begin + AT[j] * length
        for c in laws.moving:
            row[c] = now[c] + part * (after[c] - now[c])
        _rates(laws, row, stages[j])


@kernel
def _error(memory: Any, step: float) -> float:
    """Error of a step over what is allowed; NaN where a signal is unknown."""
    worst = 0.0
    for i in range(memory.largest.shape[0]):
        error = 0.0
        for j in range(STAGES):
            error += ERROR[j] * memory.stages[j, i]
        if error != 0.0:
            size = max(memory.largest[i], abs(memory.row[STATE_0 + i]))
            ratio = abs(step * error) / (_TOLERANCE * size)
            if not ratio <= worst:
                worst = ratio
    return worst


@kernel
def _to_next(
    laws: Any, memory: Any, now: Array, after: Array, sample_time: float, length: float
) -> float:
    """States from one sample to the next, in the row; returns the length to try after it."""
    start, largest, stages = memory.start, memory.largest, memory.stages
    states = memory.row[STATE_0 : STATE_0 + start.shape[0]]
    begin = 0.0
    _rates(laws, memory.row, stages[0])
    while begin < 1.0:
        tried = min(length, 1.0 - begin)
        copy(states, start)
        _try_step(laws, memory, now, after, begin, tried, tried * sample_time)
        error = _error(memory, tried * sample_time)
        if math.isnan(error):
            return length
        if error > 1.0 and tried > _SHORTEST:
            length = 0.5 * tried if error < _HALVED else 0.25 * tried
            copy(start, states)
            continue
        begin += tried
        if error * _DOUBLED < 1.0:
            # A step cut short by the sample's end says nothing against a longer one.
            length = max(length, min(2.0 * tried, 1.0))
        copy(stages[STAGES - 1], stages[0])
        for i in range(start.shape[0]):
            largest[i] = max(largest[i], abs(states[i]))
    return length


@kernel
def _some_unknown(values: Array) -> bool:
    unknown = False
    for i in range(values.shape[0]):
        unknown = unknown or math.isnan(values[i])
    return unknown


@kernel
def _look(laws: Any, memory: Any, signals: Array) -> float:
    """Take a sample's signals into the row, states at rest where none were; the law's value."""
    row = memory.row
    for c in laws.read:
        row[c] = signals[c]
    for i in range(memory.start.shape[0]):
        if math.isnan(row[STATE_0 + i]):
            row[STATE_0 + i] = call_law(laws.initial[i], row, laws.parameters)
            memory.largest[i] = max(memory.largest[i], abs(row[STATE_0 + i]))
    return float(call_law(laws.value[0], row, laws.parameters))


@kernel
def _follow(laws: Any, memory: Any, signals: Array, sample_time: float, out: Array) -> None:
    row = memory.row
    states = row[STATE_0 : STATE_0 + memory.start.shape[0]]
    length = 1.0
    for k in range(signals.shape[0]):
        out[k] = _look(laws, memory, signals[k])
        if k + 1 < signals.shape[0]:
            length = _to_next(laws, memory, signals[k], signals[k + 1], sample_time, length)
            if _some_unknown(states):
                copy(memory.start, states)


@kernel
def _follow_later(
    laws: Any, memory: Any, signals: Array, after: Array, later: Array, out: Array
) -> None:
    """As `_follow`, by laws of what the states are a sample later."""
    states = memory.row[STATE_0 : STATE_0 + memory.start.shape[0]]
    ahead = later[-SIGNAL_COUNT:]
    for k in range(signals.shape[0]):
        out[k] = _look(laws, memory, signals[k])
        if k + 1 == signals.shape[0]:
            break
        for c in laws.moving:
            ahead[c] = signals[k + 1, c]
        for i in range(states.shape[0]):
            memory.start[i] = call_law(after[i], memory.row, later)
        if not _some_unknown(memory.start):
            copy(memory.start, states)


@kernel
def _follow_linear(
    laws: Any,
    memory: Any,
    signals: Array,
    response: Array,
    mean: Array,
    averaged: bool,
    out: Array,
) -> None:
    """As `_follow`, by what linear states make of their rates until the next sample."""
    states, rates = memory.row[STATE_0 : STATE_0 + memory.start.shape[0]], memory.stages[0]
    now = memory.stages[1]
    for k in range(signals.shape[0]):
        out[k] = _look(laws, memory, signals[k])
        _rates(laws, memory.row, rates)
        copy(states, now)
        _moved(now, response, rates, memory.start)
        if averaged:
            _moved(now, mean, rates, states)
            out[k] = call_law(laws.value[0], memory.row, laws.parameters)
            copy(now, states)
        if k + 1 < signals.shape[0] and not _some_unknown(memory.start):
            copy(memory.start, states)


@kernel
def _moved(states: Array, response: Array, rates: Array, out: Array) -> None:
    """States with what their rates come to by a response."""
    for i in range(states.shape[0]):
        out[i] = states[i]
        for j in range(states.shape[0]):
            out[i] += response[i, j] * rates[j]


def follow_states(
    states: Sequence[InternalState],
    law: Law,
    signals: FloatArray,
    parameters: FloatArray,
    sample_time_s: float,
) -> FloatArray:
    """A law with internal states over a recording, from rest at its first sample.

    Between two samples, what the valve's command makes jump is held (`HELD_SIGNALS`), as the
    valve holds it; the rest moves evenly. Where signals are unknown (NaN), states stay as they
    were; where they never were known, they are at rest.

    Parameters
    ----------
    states : sequence of InternalState
    law : callable
    signals : (N, SIGNAL_COUNT) array
    parameters : array
    sample_time_s : float

    Returns
    -------
    (N,) array
    """
    out = np.empty(len(signals))
    _follower(states, law, parameters, float(sample_time_s))(signals, out)
    return out


def held_means(
    states: Sequence[InternalState],
    law: Law,
    signals: FloatArray,
    parameters: FloatArray,
    sample_time_s: float,
) -> FloatArray:
    """A law with internal states, averaged from each sample to the next.

    All signals are held meanwhile, so that it moves by its states alone; the last sample's are
    held for one more interval. Otherwise as `follow_states`, whose parameters these are.

    Parameters
    ----------
    states : sequence of InternalState
    law : callable
    signals : (N, SIGNAL_COUNT) array
    parameters : array
    sample_time_s : float

    Returns
    -------
    (N,) array
    """
    follow = _follower(states, law, parameters, float(sample_time_s) / _PARTS)
    fine = np.empty(_PARTS * len(signals) + 1)
    # Some rows at a time: all of them, so many times over, would be larger than the recording. The
    # first part of the next ones is looked at with them, as the end of their last.
    split = np.empty((_ROWS + 1, _PARTS, SIGNAL_COUNT))
    parts = split.reshape(-1, SIGNAL_COUNT)
    for begin in range(0, len(signals), _ROWS):
        rows = signals[begin : begin + _ROWS + 1]
        split[: len(rows)] = rows[:, None]
        count = min(len(rows), _ROWS) * _PARTS + (len(rows) > _ROWS)
        follow(parts[:count], fine[_PARTS * begin : _PARTS * begin + count])
    if len(signals):
        fine[-1] = fine[-2]
    middle = 0.5 * (fine[1:] + fine[:-1])
    return np.asarray(middle.reshape(-1, _PARTS).mean(axis=1))


def _follower(
    states: Sequence[InternalState], law: Law, parameters: FloatArray, step_s: float
) -> Callable[[FloatArray, FloatArray], None]:
    """What follows a law over rows of signals and fills in its values.

    It goes on where it was: the last row of one call is the first of the next.
    """
    size = len(states)
    memory = _Memory(
        row=np.full(SIGNAL_COUNT, np.nan),
        start=np.empty(size),
        largest=np.zeros(size),
        stages=np.empty((STAGES, size)),
    )
    laws = _laws(tuple(states), law)._replace(parameters=parameters)
    if all(state.after for state in states):
        after = np.array([law_address(state.after) for state in states if state.after])
        later = np.concatenate([parameters, [step_s], np.full(SIGNAL_COUNT, np.nan)])
        return lambda signals, out: _follow_later(laws, memory, signals, after, later, out)
    if all(state.linear for state in states):
        response, mean = _responses(tuple(laws.rate.tolist()), tuple(parameters.tolist()), step_s)
        averaged = all(state.averaged for state in states)
        return lambda signals, out: _follow_linear(
            laws, memory, signals, response, mean, averaged, out
        )
    return lambda signals, out: _follow(laws, memory, signals, step_s, out)


@lru_cache(maxsize=_KEPT_RESPONSES)
def _responses(
    rate: tuple[int, ...], parameters: tuple[float, ...], step_s: float
) -> tuple[FloatArray, FloatArray]:
    """What linear states x with rates r(x) are a step later and in its mean, less x, per r(x).

    ``x(h) = x + (exp(A h) - 1) / A r(x)`` with the rates' slopes A in the states; (k, k) each, not
    to be changed. Rates are given by the addresses of their laws.
    """
    from scipy.linalg import expm

    size, nothing = len(rate), np.zeros(0, dtype=np.int64)
    laws = _Laws(nothing, np.array(rate), nothing, np.array(parameters), nothing, nothing)
    still = np.zeros(SIGNAL_COUNT)
    whole = np.zeros((3 * size, 3 * size))
    whole[:size, size : 2 * size] = whole[size : 2 * size, 2 * size :] = step_s * np.eye(size)
    start, moved = np.empty(size), np.empty(size)
    _rates(laws, still, start)
    for i in range(size):
        still[STATE_0 + i] = 1.0
        _rates(laws, still, moved)
        still[STATE_0 + i] = 0.0
        whole[:size, i] = step_s * (moved - start)
    grown = expm(whole)[:size]
    later, mean = grown[:, size : 2 * size], grown[:, 2 * size :] / step_s
    return np.ascontiguousarray(later), np.ascontiguousarray(mean)


@lru_cache(maxsize=_KEPT_LAWS)
def _laws(states: tuple[InternalState, ...], law: Law) -> _Laws:
    """What a law with its states looks at, without parameters."""
    rates, initials = [state.rate for state in states], [state.initial for state in states]
    named = frozenset().union(*(signals_read(one) for one in (law, *rates, *initials)))
    read = sorted(named.difference(range(STATE_0, STATE_0 + MAX_STATES)))
    return _Laws(
        value=np.array([law_address(law)]),
        rate=np.array([law_address(rate) for rate in rates]),
        initial=np.array([law_address(initial) for initial in initials]),
        parameters=np.zeros(0),
        read=np.array(read, dtype=np.int64),
        moving=np.array([c for c in read if c not in HELD_SIGNALS], dtype=np.int64),
    )
