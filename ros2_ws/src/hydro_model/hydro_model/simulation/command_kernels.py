"""Compiled integration, ahead of the model's, of what follows from the commands alone.

Between command and opening of a valve stand its quickest states, which every new command sets in
motion again: they would hold each step of the model short. But they see nothing of the model, so
that a held command says what they do for as long as it is held. They go ahead, in as many steps as
they need, and the model's steps read them off polynomials: the formula's own of order 4 (Hairer,
Norsett and Wanner, Solving Ordinary Differential Equations I, section II.6), whose error is of the
order of the one that is held below the tolerance.

Arguments are described in `hydro_model.simulation.solver_kernels`; `known` of `ModelArrays` lists
the states.
"""

from __future__ import annotations

import math
from typing import Any

from hydro_model.effects.compiled import call_law
from hydro_model.effects.signals import VALVE_SIGNAL
from hydro_model.numerics.dormand_prince import BETWEEN, ERROR, STAGES, WEIGHTS
from hydro_model.numerics.kernel import copy, kernel
from hydro_model.simulation.simulate_arrays import ADDRESS, EFFECT, OWNER, RATES
from hydro_model.simulation.simulate_kernels import states_of

Array = Any  # numba types the kernels; mypy follows no numba import

#: A step so short is taken whatever its error: the corner of a law lies within.
SHORTEST_S = 1.0e-9
_ORDER = 5.0


@kernel
def _rates(model: Any, work: Any, solver: Any, inputs: Array, values: Array, out: Array) -> None:
    """Rates of the known states at their (scaled) `values`, valve by valve."""
    y, dy = solver.y, solver.column
    for c in range(model.known.shape[0]):
        y[model.known[c]] = values[c] * model.scale[model.known[c]]
    for i in range(model.commanded.shape[0]):
        s = work.signals[i]
        s[VALVE_SIGNAL] = inputs[i]
        begin, end = model.commanded[i, 0], model.commanded[i, 1]
        for t in range(begin, end):
            effect = model.terms[t, EFFECT]
            states_of(model, s, effect, y, dy, model.terms[t, OWNER], RATES)
            if t + 1 < end:
                parameters = model.parameters[effect]
                s[VALVE_SIGNAL] = call_law(model.terms[t, ADDRESS], s, parameters)
    for c in range(model.known.shape[0]):
        out[c] = dy[model.known[c]] / model.scale[model.known[c]]


@kernel
def _try_step(model: Any, work: Any, solver: Any, inputs: Array, h: float) -> float:
    """A step from `now` into `new`; its error as of `hydro_model.simulation.explicit_kernels`."""
    ahead = solver.ahead
    now, new, k = ahead.now, ahead.new, ahead.stages
    for stage in range(1, STAGES):
        for c in range(now.shape[0]):
            total = 0.0
            for j in range(stage):
                total += WEIGHTS[stage, j] * k[j, c]
            new[c] = now[c] + h * total
        _rates(model, work, solver, inputs, new, k[stage])
    worst = 0.0
    for c in range(now.shape[0]):
        error = 0.0
        for j in range(STAGES):
            error += ERROR[j] * k[j, c]
        ratio = abs(h * error) / (1.0 + max(abs(now[c]), abs(new[c])))
        if not ratio <= worst:
            worst = ratio
    return worst


@kernel
def _keep_piece(ahead: Any, h: float) -> None:
    """The polynomial of a step of length `h`, in the shape in which it is read."""
    now, new, k = ahead.now, ahead.new, ahead.stages
    piece = ahead.pieces[ahead.kept[0]]
    for c in range(now.shape[0]):
        rise, bend = new[c] - now[c], 0.0
        for j in range(STAGES):
            bend += BETWEEN[j] * k[j, c]
        piece[0, c], piece[1, c] = now[c], rise
        piece[2, c] = h * k[0, c] - rise
        piece[3, c] = rise - h * k[STAGES - 1, c] - piece[2, c]
        piece[4, c] = h * bend


@kernel
def look_ahead(
    model: Any, work: Any, solver: Any, time: float, end: float, inputs: Array, tolerance: float
) -> float:
    """Have the known states from `time` on; returns until when, at most `end`.

    They start from `z` where nothing is kept of them (`kept` 0), and go on where that ends; each
    of their steps is as exact as `tolerance` asks.
    """
    ahead = solver.ahead
    count = ahead.kept[0]
    if count > 0 and ahead.ends[count] - time > SHORTEST_S:
        return float(ahead.ends[count])
    for c in range(model.known.shape[0]):
        ahead.now[c] = solver.z[model.known[c]]
    ahead.kept[0], ahead.ends[0] = 0, time
    _rates(model, work, solver, inputs, ahead.now, ahead.stages[0])
    # A new command sets them in motion much as the last one did: its first step is tried again.
    h = ahead.first[0]
    while ahead.kept[0] < ahead.pieces.shape[0] and end - time > SHORTEST_S:
        rest = end - time
        step = rest / math.ceil(rest / h - 1e-9) if rest > h else rest
        error = _try_step(model, work, solver, inputs, step) / tolerance
        growth = 5.0 if error == 0.0 else min(5.0, max(0.2, 0.9 * error ** (-1.0 / _ORDER)))
        h = max(step * growth, h) if error <= 1.0 and step < h else step * growth
        if error > 1.0 and step > SHORTEST_S:
            continue
        _keep_piece(ahead, step)
        time += step
        ahead.kept[0] += 1
        ahead.ends[ahead.kept[0]] = time
        if ahead.kept[0] == 1:
            ahead.first[0] = h
        copy(ahead.new, ahead.now)
        copy(ahead.stages[STAGES - 1], ahead.stages[0])
    return time


@kernel
def place_known(model: Any, solver: Any, time: float, z: Array) -> None:
    """The known states at a time that was looked ahead to, into their places of `z`."""
    ahead, p = solver.ahead, 0
    while p + 1 < ahead.kept[0] and time > ahead.ends[p + 1]:
        p += 1
    part = (time - ahead.ends[p]) / (ahead.ends[p + 1] - ahead.ends[p])
    left, piece = 1.0 - part, ahead.pieces[p]
    for c in range(model.known.shape[0]):
        inner = piece[2, c] + part * (piece[3, c] + left * piece[4, c])
        z[model.known[c]] = piece[0, c] + part * (piece[1, c] + left * inner)
