"""Compiled filters of the control law: over the sensors, and of the required force's rate.

Readable counterparts, which the tests compare with, are in `hydro_control.state.state_reference`
and `hydro_control.state.filters`. What is kept from sample to sample is NaN where there is no
past.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hydro_model.numerics.kernel import inlined, kernel
from hydro_model.robot import FloatArray

Array = Any  # numba types the kernels; mypy follows no numba import

# Entries of `StateArrays.alpha` and `.late`, rows of `StateArrays.area`, of what a difference
# keeps and of a state.
OF_Q, OF_QD, OF_P = range(3)
POSITION_LAG, POSITION_AGE, VELOCITY_LAG = range(3)
SIDE_A, SIDE_B = range(2)
LAST, MEAN = range(2)
Q, QD, FORCE = range(3)


class StateArrays(NamedTuple):
    """The filters over the sensors; n joints, m cylinders."""

    alpha: FloatArray  # (3,) weights of the newest position, velocity and pressure
    late: FloatArray  # (3,) in s, but in s^2 for the age of the positions
    force_lag_s: FloatArray  # (n,)
    area: FloatArray  # (2, n)
    cylinder: NDArray[np.int64]  # (n,) place among the robot's cylinders


class StateMemory(NamedTuple):
    """What the filters keep from sample to sample."""

    position: FloatArray  # (n,)
    velocity: FloatArray  # (2, n)
    pressure: FloatArray  # (2, m)


@inlined
def average(before: float, now: float, past: float) -> float:
    """As `hydro_control.state.filters.Ewma`: `before` counts by `past`, `now` by the rest.

    NaN as `before` is no past.
    """
    return now if math.isnan(before) else past * before + (1.0 - past) * now


@kernel
def difference_kernel(kept: Array, z: Array, past: float, span_s: float, out: Array) -> None:
    """As `hydro_control.state.filters.FilteredDifference`: rates of `z` into `out`, (n,) each.

    `kept` (2, n) is what it keeps; the average before counts by `past`, and the input before was
    `span_s` earlier.
    """
    for i in range(z.shape[0]):
        slope = 0.0 if math.isnan(kept[LAST, i]) else (z[i] - kept[LAST, i]) / span_s
        kept[LAST, i] = z[i]
        kept[MEAN, i] = out[i] = average(kept[MEAN, i], slope, past)


@kernel
def measured_kernel(
    filters: Any,
    memory: Any,
    q: Array,
    pressures: Array,
    steps: int,
    dt_s: float,
    out: Array,
    filtered: Array,
) -> None:
    """The state (3, n) at a sample and filtered pressures (2, m), into `out` and `filtered`.

    `filters` and `memory` are `StateArrays` and `StateMemory`; `q` (n,) and `pressures` (2, m) are
    measured, `steps` sample times `dt_s` after those before.
    """
    alpha, span_s = filters.alpha, steps * dt_s
    past = (1.0 - alpha[OF_Q]) ** steps
    for i in range(q.shape[0]):
        memory.position[i] = out[Q, i] = average(memory.position[i], q[i], past)
    difference_kernel(memory.velocity, q, (1.0 - alpha[OF_QD]) ** steps, span_s, out[QD])
    past = (1.0 - alpha[OF_P]) ** steps
    for side in range(2):
        for j in range(pressures.shape[1]):
            kept = average(memory.pressure[side, j], pressures[side, j], past)
            memory.pressure[side, j] = filtered[side, j] = kept
    area = filters.area
    for i in range(q.shape[0]):
        p_a, p_b = filtered[SIDE_A, filters.cylinder[i]], filtered[SIDE_B, filters.cylinder[i]]
        out[FORCE, i] = p_a * area[SIDE_A, i] - p_b * area[SIDE_B, i]  # eq. 9


@kernel
def predicted_kernel(
    filters: Any,
    q: Array,
    qd: Array,
    force: Array,
    lead_s: float,
    acceleration: Array,
    force_rate: Array,
    out: Array,
) -> None:
    """The state `lead_s` later than `q`, `qd` and `force`, (n,) each, into `out` (3, n).

    `filters` are `StateArrays`, by which measured states are late besides; `acceleration` and
    `force_rate` (n,) are what is asked for.
    """
    late, ahead = filters.late[VELOCITY_LAG], lead_s + filters.late[POSITION_LAG]
    bent_s2 = 0.5 * (lead_s * lead_s - filters.late[POSITION_AGE])
    for i in range(q.shape[0]):
        out[Q, i] = q[i] + ahead * qd[i] + (late * ahead + bent_s2) * acceleration[i]
        out[QD, i] = qd[i] + (lead_s + late) * acceleration[i]
        out[FORCE, i] = force[i] + (lead_s + filters.force_lag_s[i]) * force_rate[i]
