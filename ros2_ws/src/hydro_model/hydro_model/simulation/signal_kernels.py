"""Compiled signals of cylinders, joints and the tip from the state of a roll-out.

Arguments are described in `hydro_model.simulation.solver_kernels`; `s` is a row of `Work.signals`.
"""

from __future__ import annotations

import math
from typing import Any

from hydro_model.effects.signals import (
    JOINT_POSITION,
    JOINT_VELOCITY,
    LEVER,
    OTHER_POSITION,
    OTHER_VELOCITY,
    PISTON_FORCE,
    PISTON_POSITION,
    PISTON_VELOCITY,
    PRESSURE_A,
    PRESSURE_B,
    SUPPLY_PRESSURE,
    TANK_PRESSURE,
    TIME,
    TIP_HEIGHT,
    TIP_RATE,
    TIP_SLOPE,
    VALVE_SIGNAL,
)
from hydro_model.multibody.chain_kernels import SHIFT, VEL, place
from hydro_model.numerics.kernel import copy, kernel
from hydro_model.numerics.triple_kernels import cross, dot, plus, to_child, to_parent, triple
from hydro_model.simulation.simulate_arrays import AREA_A, AREA_B, L1, L2, Q0, X0

Array = Any  # numba types the kernels; mypy follows no numba import


@kernel
def look_at_tip(model: Any, work: Any, y: Array) -> None:
    """Height of the tip and its rate into the robot's signals, and its slope with every joint.

    The direction against gravity is carried outwards into each joint's frame, the tip inwards; a
    revolute joint moves it by ``axis x tip``.
    """
    n, s = model.axis.shape[0], work.chain
    copy(y[:n], work.q)
    place(work.q, model.rotation, model.translation, model.axis, model.prismatic, s)
    up = (model.up[0], model.up[1], model.up[2])
    for i in range(n):
        up = to_child(s, i, up)
        s[i, VEL], s[i, VEL + 1], s[i, VEL + 2] = up
    tip, rate = (model.tip[0], model.tip[1], model.tip[2]), 0.0
    for i in range(n - 1, -1, -1):
        axis = triple(model.axis, i, 0)
        motion = axis if model.prismatic[i] else cross(axis, tip)
        work.tip_slope[i] = dot(triple(s, i, VEL), motion)
        rate += work.tip_slope[i] * y[n + i]
        tip = plus(triple(s, i, SHIFT), 1.0, to_parent(s, i, tip))
    height = model.up[0] * tip[0] + model.up[1] * tip[1] + model.up[2] * tip[2]
    m = model.joint.shape[0]
    work.signals[m, TIP_HEIGHT], work.signals[m, TIP_RATE] = height, rate


@kernel
def look_aside(model: Any, work: Any, s: Array, y: Array, joint: int) -> None:
    """Signals of the other joint and of the tip."""
    other = model.other[joint]
    if other >= 0:
        s[OTHER_POSITION], s[OTHER_VELOCITY] = y[other], y[model.axis.shape[0] + other]
    if model.tip_used[0]:
        m = model.joint.shape[0]
        s[TIP_HEIGHT], s[TIP_RATE] = work.signals[m, TIP_HEIGHT], work.signals[m, TIP_RATE]
        s[TIP_SLOPE] = work.tip_slope[joint]


@kernel
def look(model: Any, work: Any, y: Array, i: int, time: float, u: float) -> None:
    """Signals of cylinder i from the state (eqs. 9, 16, 17 corrected)."""
    n, m = model.axis.shape[0], model.joint.shape[0]
    s, g = work.signals[i], model.geometry[i]
    q, qd = y[model.joint[i]], y[n + model.joint[i]]
    lever, x = 1.0, q - g[X0]
    if g[L1] != 0.0:
        product = g[L1] * g[L2]
        angle = q + g[Q0]
        length = math.sqrt(g[L1] * g[L1] + g[L2] * g[L2] - 2.0 * product * math.cos(angle))
        lever, x = product * math.sin(angle) / length, length - g[X0]
    p_a, p_b = y[2 * n + i], y[2 * n + m + i]
    s[TIME], s[VALVE_SIGNAL] = time, u
    s[JOINT_POSITION], s[JOINT_VELOCITY] = q, qd
    s[PISTON_POSITION], s[PISTON_VELOCITY], s[LEVER] = x, lever * qd, lever
    s[PRESSURE_A], s[PRESSURE_B] = p_a, p_b
    s[PISTON_FORCE] = p_a * g[AREA_A] - p_b * g[AREA_B]
    s[SUPPLY_PRESSURE] = work.signals[m, SUPPLY_PRESSURE]
    s[TANK_PRESSURE] = work.signals[m, TANK_PRESSURE]
    look_aside(model, work, s, y, model.joint[i])
