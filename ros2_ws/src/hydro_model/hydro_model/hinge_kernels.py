"""Compiled hinges in a roll-out: links that bend under all that they carry.

The equations are those of `hydro_model.effects.bending.bent`, the mass matrix M and the bias b
those of the links as they are bent, ``c J / U s`` of the deflection ahead of their joints. With
the joints' accelerations q'' they are

``e'' = -r - (1 - c) q''_i / (1 - d) - c s^T (M q'' + b) / mu``

with r what spring and damper pull, and ``M q'' + b + l e''`` is the joints' torque, where the load
l is ``c J / U M s`` and, at the hinge's own joint, ``(J m - c J mu / U) / (1 - d)`` more. Put into
each other, a hinge takes ``l ((1 - c) u_i / (1 - d) + c M s / mu)^T`` off M and adds
``l (r + c s^T b / mu)`` to the torques.

Arguments are described in `hydro_model.solver_kernels`; `h` is a row of `ModelArrays.hinges`.
"""

from __future__ import annotations

import math
from typing import Any

from hydro_model.kernel import kernel
from hydro_model.simulate_arrays import REST

Array = Any  # numba types the kernels; mypy follows no numba import

#: Most of the inertia that a deflection moves which swings: the joint itself has some left.
MOST_SWUNG = 0.98


@kernel
def _shape(model: Any, h: int, j: int) -> float:
    """How far joint j moves with a hinge's deflection."""
    if j == model.hinges[h, 1]:
        return float(1.0 - model.bends[h, 0])
    return float(model.bends[h, 0]) if j == model.hinges[h, 3] else 0.0


@kernel
def _along(model: Any, work: Any, h: int, j: int) -> float:
    """Torque at joint j per acceleration of a hinge's deflection, ``(M s)_j``."""
    i, after = model.hinges[h, 1], model.hinges[h, 3]
    total = _shape(model, h, i) * work.mass[j, i]
    if after >= 0:
        total += model.bends[h, 0] * work.mass[j, after]
    return float(total)


@kernel
def _moved(model: Any, work: Any, h: int) -> tuple[float, float]:
    """Inertia that a hinge's deflection moves, ``mu``, and torque that it carries, ``s^T b``."""
    mass, bias = 0.0, 0.0
    for j in range(work.mass.shape[0]):
        shape = _shape(model, h, j)
        if shape != 0.0:
            mass += shape * _along(model, work, h, j)
            bias += shape * work.bias[j]
    return mass, bias


@kernel
def _grown(model: Any, h: int, mass: float) -> float:
    carried, usual = model.parameters[model.hinges[h, 0], 3], model.bends[h, 1]
    return float(1.0 + min(carried, 1.0) * (mass / usual - 1.0))


@kernel
def _pull(model: Any, work: Any, y: Array, h: int, mass: float, bias: float) -> float:
    """Acceleration by spring and damper, and by what the load weighs, of a hinge, less sign."""
    p, i, first = model.parameters[model.hinges[h, 0]], model.hinges[h, 1], model.hinges[h, 2]
    omega = 2.0 * math.pi * p[1]
    rate = y[first + 1] - y[work.mass.shape[0] + i]
    spring = omega * (omega * y[first] + 2.0 * p[2] * rate) / _grown(model, h, mass)
    return float(spring + p[3] * bias / mass)


@kernel
def _drive(model: Any, work: Any, h: int, k: int, mass: float) -> float:
    """What joint k's acceleration does to a hinge's, less sign."""
    carried = model.parameters[model.hinges[h, 0], 3]
    drive = carried * _along(model, work, h, k) / mass
    if k == model.hinges[h, 1]:
        drive += (1.0 - carried) / _shape(model, h, k)
    return float(drive)


@kernel
def bend_links(model: Any, work: Any, y: Array) -> None:
    """Positions and velocities in `work.q` and `work.qd` moved to where the links are bent."""
    n = work.mass.shape[0]
    for h in range(model.hinges.shape[0]):
        effect, i, first = model.hinges[h, 0], model.hinges[h, 1], model.hinges[h, 2]
        share = model.parameters[effect, 3] * model.parameters[effect, 0] / model.bends[h, 1]
        for j in range(n):
            work.q[j] += share * _shape(model, h, j) * y[first]
            work.qd[j] += share * _shape(model, h, j) * (y[first + 1] - y[n + i])


@kernel
def put_hinges(model: Any, work: Any, y: Array) -> None:
    """What hinges make of the mass matrix in `work.factor` and the torques in `work.force`."""
    n = work.mass.shape[0]
    for h in range(model.hinges.shape[0]):
        p, i = model.parameters[model.hinges[h, 0]], model.hinges[h, 1]
        mass, bias = _moved(model, work, h)
        own, share = p[0] * _grown(model, h, mass), p[3] * p[0] / model.bends[h, 1]
        less = min(MOST_SWUNG * mass / own, 1.0) if own > 0.0 else 1.0
        pull = _pull(model, work, y, h, mass, bias)
        for j in range(n):
            load = less * share * _along(model, work, h, j)
            if j == i:
                load += less * (own - share * mass) / _shape(model, h, i)
            work.force[j] += load * pull
            for k in range(n):
                work.factor[j, k] -= load * _drive(model, work, h, k, mass)


@kernel
def rate_hinges(model: Any, work: Any, y: Array, dy: Array, mode: int) -> None:
    """Rates of the hinges' states at the accelerations in `work.force`, or their rest (`REST`)."""
    n = work.mass.shape[0]
    for h in range(model.hinges.shape[0]):
        effect, i, first = model.hinges[h, 0], model.hinges[h, 1], model.hinges[h, 2]
        p = model.parameters[effect]
        mass, bias = _moved(model, work, h)
        if mode == REST:
            omega = 2.0 * math.pi * p[1]
            y[first] = -p[3] * bias / mass * _grown(model, h, mass) / (omega * omega)
            y[first + 1] = y[n + i]
            continue
        swing = -_pull(model, work, y, h, mass, bias)
        for k in range(n):
            swing -= _drive(model, work, h, k, mass) * work.force[k]
        dy[first + 1] = swing + work.force[i]
