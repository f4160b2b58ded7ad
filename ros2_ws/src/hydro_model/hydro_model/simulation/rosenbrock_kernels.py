"""Compiled integration of the model: RODAS, a stiffly accurate Rosenbrock method of order 4(3).

Hairer and Wanner, Solving Ordinary Differential Equations II, section IV.7 (code RODAS, method 1):
L-stable, six stages, one factorisation a step: for the stretches that are stiff.

Arguments are described in `hydro_model.simulation.solver_kernels`.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from hydro_model.numerics.kernel import copy, inlined, kernel
from hydro_model.numerics.linear_kernels import factorise, solve_factored
from hydro_model.simulation.simulate_arrays import KEEP_MASS, RATES
from hydro_model.simulation.solver_kernels import scaled_rates

Array = Any  # numba types the kernels; mypy follows no numba import

STAGES = 6
GAMMA = 0.25
# Weights of earlier stages in the argument of the function (A) and in its right-hand side (C).
A = np.array(
    [
        [0.0, 0.0, 0.0, 0.0, 0.0],
        [1.544, 0.0, 0.0, 0.0, 0.0],
        [0.9466785280815826, 0.2557011698983284, 0.0, 0.0, 0.0],
        [3.314825187068521, 2.896124015972201, 0.9986419139977817, 0.0, 0.0],
        [1.221224509226641, 6.019134481288629, 12.53708332932087, -0.6878860361058950, 0.0],
        [1.221224509226641, 6.019134481288629, 12.53708332932087, -0.6878860361058950, 1.0],
    ]
)
C = np.array(
    [
        [0.0, 0.0, 0.0, 0.0, 0.0],
        [-5.6688, 0.0, 0.0, 0.0, 0.0],
        [-2.430093356833875, -0.2063599157091915, 0.0, 0.0, 0.0],
        [-0.1073529058151375, -9.594562251023355, -20.47028614809616, 0.0, 0.0],
        [7.496443313967647, -10.24680431464352, -33.99990352819905, 11.70890893206160, 0.0],
        [
            8.083246795921522,
            -7.981132988064893,
            -31.52159432874371,
            16.31930543123136,
            -6.058818238834054,
        ],
    ]
)


_DIFFERENCE = 1.5e-8  # square root of the rounding unit


@kernel
def jacobian(model: Any, work: Any, solver: Any, time: float, inputs: Array) -> bool:
    """Forward differences around `z`, whose right-hand side `f` was evaluated just before."""
    z = solver.z
    rigid = 2 * model.axis.shape[0]
    # From the last state to the first: while only pressures move, the mass matrix stands, and so
    # it does for states of effects but where they bend links.
    moved = rigid if model.hinges.shape[0] == 0 else z.shape[0]
    for j in range(z.shape[0] - 1, -1, -1):
        kept = z[j]
        z[j] = kept + _DIFFERENCE * max(abs(kept), 1.0)
        step = z[j] - kept
        mode = KEEP_MASS if j >= moved else RATES
        good = scaled_rates(model, work, time, inputs, z, solver.column, solver.y, mode)
        z[j] = kept
        if not good:
            return False
        for i in range(z.shape[0]):
            solver.jacobian[i, j] = (solver.column[i] - solver.f[i]) / step
    return True


@inlined
def _stage(
    model: Any, work: Any, solver: Any, time: float, inputs: Array, h: float, stage: int
) -> bool:
    """Right-hand side of a stage's linear system into its row of `k`."""
    z, new, k = solver.z, solver.new, solver.k
    if stage == 0:
        copy(solver.f, k[0])
        return True
    for i in range(z.shape[0]):
        total = z[i]
        for j in range(stage):
            total += A[stage, j] * k[j, i]
        new[i] = total
    if not scaled_rates(model, work, time, inputs, new, k[stage], solver.y, RATES):
        return False
    for i in range(z.shape[0]):
        total = 0.0
        for j in range(stage):
            total += C[stage, j] * k[j, i]
        k[stage, i] += total / h
    return True


@kernel
def try_step(model: Any, work: Any, solver: Any, time: float, inputs: Array, h: float) -> float:
    """One step from `z` into `new`, with `f` and `jacobian` those at `z`.

    Returns
    -------
    float
        Error norm, the largest of ``|error| / (1 + |z|)``; inf where the step fails.
    """
    z, new, matrix = solver.z, solver.new, solver.matrix
    for i in range(z.shape[0]):
        for j in range(z.shape[0]):
            matrix[i, j] = -solver.jacobian[i, j]
        matrix[i, i] += 1.0 / (GAMMA * h)
    if not factorise(matrix, solver.pivot):
        return math.inf
    for stage in range(STAGES):
        if not _stage(model, work, solver, time, inputs, h, stage):
            return math.inf
        solve_factored(matrix, solver.pivot, solver.k[stage])
    error = 0.0
    for i in range(z.shape[0]):
        # Stiffly accurate: the last increment is the difference to the embedded third order.
        last = solver.k[STAGES - 1, i]
        new[i] += last
        ratio = abs(last) / (1.0 + max(abs(z[i]), abs(new[i])))
        if not ratio <= error:
            error = ratio
            if not ratio < math.inf:
                return math.inf
    return error
