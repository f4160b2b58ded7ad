"""Compiled integration of the model where it is not stiff: Dormand and Prince's formula.

A step costs six right-hand sides, where an implicit one costs one for every state and more. It
is held short by stability, not by accuracy, where the fastest rate times the step nears 3.3; there
the implicit method takes over (Hairer and Wanner, Solving Ordinary Differential Equations II,
section IV.2).

Arguments are described in `hydro_model.simulation.solver_kernels`.
"""

from __future__ import annotations

import math
from typing import Any

from hydro_model.numerics.dormand_prince import AT, ERROR, STAGES, WEIGHTS
from hydro_model.numerics.kernel import copy, kernel
from hydro_model.simulation.command_kernels import place_known
from hydro_model.simulation.simulate_arrays import RATES
from hydro_model.simulation.solver_kernels import scaled_rates

Array = Any  # numba types the kernels; mypy follows no numba import

#: Fastest rate times step from which a step counts as held short by stability.
_NEAR_LIMIT = 2.0
#: What a short step counts (any other counts -1), the count that calls the implicit method, and
#: for how many steps. At the limit of stability, short and other steps alternate.
_SHORT, _ENOUGH, IMPLICIT_STEPS = 4, 40, 100


@kernel
def _argument(solver: Any, stage: int, h: float) -> None:
    """Where a stage's right-hand side is taken, into `new`."""
    for i in range(solver.z.shape[0]):
        total = 0.0
        for j in range(stage):
            total += WEIGHTS[stage, j] * solver.k[j, i]
        solver.new[i] = solver.z[i] + h * total


@kernel
def try_explicit(
    model: Any, work: Any, solver: Any, time: float, inputs: Array, h: float
) -> float:
    """One step from `z` into `new`, with `f` that at `z`; afterwards the last of `k` is at `new`.

    What follows from the commands alone was looked ahead to (`look_ahead`).

    Returns
    -------
    float
        Error norm, the largest of ``|error| / (1 + |z|)``; inf where the step fails.
    """
    z, new, k = solver.z, solver.new, solver.k
    copy(solver.f, k[0])
    for stage in range(1, STAGES):
        if stage == STAGES - 1:
            copy(new, solver.column)
        _argument(solver, stage, h)
        at = time + AT[stage] * h
        if model.known.shape[0] > 0:
            place_known(model, solver, at, new)
        if not scaled_rates(model, work, at, inputs, new, k[stage], solver.y, RATES):
            return math.inf
    worst, change, distance = 0.0, 0.0, 0.0
    for i in model.judged:
        error = 0.0
        for j in range(STAGES):
            error += ERROR[j] * k[j, i]
        ratio = abs(h * error) / (1.0 + max(abs(z[i]), abs(new[i])))
        if not ratio <= worst:
            worst = ratio
            if not ratio < math.inf:
                return math.inf
        # The last two stages are at one time: their difference shows the fastest rate.
        change += (k[STAGES - 1, i] - k[STAGES - 2, i]) ** 2
        distance += (new[i] - solver.column[i]) ** 2
    solver.speed[0] = math.sqrt(change / distance) if distance > 0.0 else 0.0
    return worst


@kernel
def watch_stiffness(solver: Any, h: float, span: float) -> None:
    """Count an accepted step of length `h` within a span that one implicit step might cross.

    Only those count that are so short that implicit steps, at their price, would be quicker.
    """
    price = 1.0 + 0.25 * solver.z.shape[0]
    limited = solver.speed[0] * h > _NEAR_LIMIT and price * h < span
    solver.stiff[0] = max(0, solver.stiff[0] + (_SHORT if limited else -1))
    if solver.stiff[0] >= _ENOUGH:
        solver.stiff[0], solver.stiff[1] = 0, IMPLICIT_STEPS
