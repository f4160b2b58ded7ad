"""Compiled hinges in a roll-out: links that bend under all that they carry.

The equations are those of `hydro_model.effects.bending.bent`, the mass matrix M and the bias b
those of the links as they are bent, ``c J / M`` of the deflection ahead of their joints. With the
joints' accelerations a they are ``e'' = -r - (1 - c) a_i - c (M a + b)_i / M_ii`` with r what the spring and its damper
pull, and ``M a + b + l e''`` is the joints' torque, where the load l is ``c J / M M_ji`` at the
others and ``J m`` at the hinge's own joint. Put into each other, a hinge takes
``l ((1 - c) u_i + c M_i / M_ii)^T`` off M and adds ``l (r + c b_i / M_ii)`` to the torques.

Arguments are described in `hydro_model.solver_kernels`.
"""

from __future__ import annotations

import math
from typing import Any

from hydro_model.kernel import kernel
from hydro_model.simulate_arrays import REST

Array = Any  # numba types the kernels; mypy follows no numba import

#: Most of the inertia about a joint that swings: the joint itself has some left.
MOST_SWUNG = 0.98


@kernel
def _weights(model: Any, work: Any, h: int) -> tuple[float, float, float]:
    """What a hinge's own joint and the others carry of its deflection, and how it has grown."""
    p, i = model.parameters[model.hinges[h, 0]], model.hinges[h, 1]
    mass, usual = work.mass[i, i], model.usual[h]
    grown = 1.0 + min(p[3], 1.0) * (mass / usual - 1.0)
    own = p[0] * grown
    less = min(MOST_SWUNG * mass / own, 1.0) if own > 0.0 else 1.0
    return less * own, less * p[3] * p[0] / usual, grown


@kernel
def _pull(model: Any, work: Any, y: Array, h: int, grown: float) -> float:
    """Acceleration by spring and damper, and by what the load weighs, of a hinge, less sign."""
    p, i, first = model.parameters[model.hinges[h, 0]], model.hinges[h, 1], model.hinges[h, 2]
    omega = 2.0 * math.pi * p[1]
    rate = y[first + 1] - y[work.mass.shape[0] + i]
    spring = omega * (omega * y[first] + 2.0 * p[2] * rate) / grown
    return float(spring + p[3] * work.bias[i] / work.mass[i, i])


@kernel
def bend_links(model: Any, work: Any, y: Array) -> None:
    """Positions and velocities in `work.q` and `work.qd` moved to where the links are bent."""
    n = work.mass.shape[0]
    for h in range(model.hinges.shape[0]):
        effect, i, first = model.hinges[h]
        share = model.parameters[effect, 3] * model.parameters[effect, 0] / model.usual[h]
        work.q[i] += share * y[first]
        work.qd[i] += share * (y[first + 1] - y[n + i])


@kernel
def put_hinges(model: Any, work: Any, y: Array) -> None:
    """What hinges make of the mass matrix in `work.factor` and the torques in `work.force`."""
    n = work.mass.shape[0]
    for h in range(model.hinges.shape[0]):
        carried, i = model.parameters[model.hinges[h, 0], 3], model.hinges[h, 1]
        own, share, grown = _weights(model, work, h)
        pull = _pull(model, work, y, h, grown)
        for j in range(n):
            load = own if j == i else share * work.mass[j, i]
            work.force[j] += load * pull
            for k in range(n):
                drive = carried * work.mass[i, k] / work.mass[i, i]
                if k == i:
                    drive += 1.0 - carried
                work.factor[j, k] -= load * drive


@kernel
def rate_hinges(model: Any, work: Any, y: Array, dy: Array, mode: int) -> None:
    """Rates of the hinges' states at the accelerations in `work.force`, or their rest (`REST`)."""
    n = work.mass.shape[0]
    for h in range(model.hinges.shape[0]):
        effect, i, first = model.hinges[h]
        p = model.parameters[effect]
        grown = _weights(model, work, h)[2]
        if mode == REST:
            omega = 2.0 * math.pi * p[1]
            y[first] = -p[3] * work.bias[i] / work.mass[i, i] * grown / (omega * omega)
            y[first + 1] = y[n + i]
            continue
        drive = (1.0 - p[3]) * work.force[i]
        for k in range(n):
            drive += p[3] * work.mass[i, k] / work.mass[i, i] * work.force[k]
        swing = -_pull(model, work, y, h, grown) - drive
        dy[first + 1] = swing + work.force[i]
