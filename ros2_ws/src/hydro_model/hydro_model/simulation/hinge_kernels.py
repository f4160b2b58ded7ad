"""Compiled hinges in a roll-out: links that bend under all that they carry.

The equations are those of `hydro_model.effects.bending.bent`, the mass matrix M and the bias b
those of the links as they are bent. With loads ``l = h M s + r u_i / (1 - d)`` and the inertia
``B = h mu + r`` on each hinge's spring, the joints' accelerations and the hinges' follow together
from

- ``M q'' + sum l e'' = T - b``
- ``l^T q'' + B e'' + sum h h_o s^T M s_o e_o'' = -J W^2 e - 2 zeta W J e' - h s^T b``

where the second sum is over the other hinges. The matrix is symmetric, and positive definite for
whatever could be built.

Arguments are described in `hydro_model.simulation.solver_kernels`; `a` is a row of
`ModelArrays.hinges`, `dy` the rate of the state `y`.
"""

from __future__ import annotations

import math
from typing import Any

from hydro_model.effects.bending import on_spring
from hydro_model.numerics.kernel import kernel
from hydro_model.simulation.simulate_arrays import REST

Array = Any  # numba types the kernels; mypy follows no numba import

#: Most of the inertia that a joint usually moves which swings: the joint itself does not. A fit
#: beside noise may come out at more, which rolls nothing out.
MOST_SWUNG = 0.98


@kernel
def _shape(model: Any, a: int, j: int) -> float:
    """How far joint j moves with a hinge's deflection."""
    if j == model.hinges[a, 1]:
        return float(1.0 - model.bends[a, 0])
    return float(model.bends[a, 0]) if j == model.hinges[a, 3] else 0.0


@kernel
def _along(model: Any, work: Any, a: int, j: int) -> float:
    """Torque at joint j per acceleration of a hinge's deflection, ``(M s)_j``."""
    i, after = model.hinges[a, 1], model.hinges[a, 3]
    total = _shape(model, a, i) * work.mass[j, i]
    if after >= 0:
        total += model.bends[a, 0] * work.mass[j, after]
    return float(total)


@kernel
def _between(model: Any, work: Any, a: int, b: int) -> float:
    """What two hinges' deflections have in common, ``s^T M s'``; of one with itself, ``mu``."""
    total = 0.0
    for j in range(work.mass.shape[0]):
        if _shape(model, a, j) != 0.0:
            total += _shape(model, a, j) * _along(model, work, b, j)
    return total


@kernel
def _swinging(model: Any, a: int) -> tuple[float, float]:
    """Inertia of a hinge's mode, and the share of the load that moves with it."""
    p, usual = model.parameters[model.hinges[a, 0]], model.bends[a, 1]
    inertia = min(p[0], MOST_SWUNG * usual)
    return inertia, min(p[3] * inertia / usual, 1.0)


@kernel
def bend_links(model: Any, work: Any, y: Array) -> None:
    """Positions and velocities in `work.q` and `work.qd` moved to where the links are bent."""
    n = work.mass.shape[0]
    for a in range(model.hinges.shape[0]):
        i, first, share = model.hinges[a, 1], model.hinges[a, 2], _swinging(model, a)[1]
        for j in range(n):
            work.q[j] += share * _shape(model, a, j) * y[first]
            work.qd[j] += share * _shape(model, a, j) * (y[first + 1] - y[n + i])


@kernel
def _pull(model: Any, work: Any, y: Array, a: int) -> float:
    """Torque on a hinge by its spring, its damper and what it carries at rest, less sign."""
    n = work.mass.shape[0]
    p, i, first = model.parameters[model.hinges[a, 0]], model.hinges[a, 1], model.hinges[a, 2]
    omega, weight = 2.0 * math.pi * p[1], 0.0
    inertia, share = _swinging(model, a)
    for j in range(n):
        weight += _shape(model, a, j) * work.bias[j]
    spring = omega * y[first] + 2.0 * p[2] * (y[first + 1] - y[n + i])
    return float(inertia * omega * spring + share * weight)


@kernel
def put_hinges(model: Any, work: Any, y: Array) -> None:
    """Rows of the hinges in `work.factor` and `work.force`, behind those of the joints."""
    n = work.mass.shape[0]
    for a in range(model.hinges.shape[0]):
        i, row, usual = model.hinges[a, 1], n + a, model.bends[a, 1]
        inertia, share = _swinging(model, a)
        work.force[row] = -_pull(model, work, y, a)
        for j in range(n):
            load = share * _along(model, work, a, j)
            if j == i:
                load += (inertia - share * usual) / _shape(model, a, i)
            work.factor[row, j] = work.factor[j, row] = load
        for b in range(a):
            both = share * _swinging(model, b)[1] * _between(model, work, a, b)
            work.factor[row, n + b] = work.factor[n + b, row] = both
        work.factor[row, row] = on_spring(inertia, share, _between(model, work, a, a), usual)


@kernel
def rate_hinges(model: Any, work: Any, y: Array, dy: Array, mode: int) -> None:
    """Rates of the hinges' states at the accelerations in `work.force`, or their rest (`REST`)."""
    n = work.mass.shape[0]
    for a in range(model.hinges.shape[0]):
        i, first = model.hinges[a, 1], model.hinges[a, 2]
        if mode == REST:
            omega = 2.0 * math.pi * model.parameters[model.hinges[a, 0], 1]
            y[first], y[first + 1] = 0.0, y[n + i]
            stiffness = _swinging(model, a)[0] * omega * omega
            if stiffness > 0.0:
                y[first] = -_pull(model, work, y, a) / stiffness
        else:
            dy[first + 1] = work.force[n + a] + work.force[i]
