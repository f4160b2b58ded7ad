"""Compiled steps along a serial chain: placements, velocities and accelerations, forces.

What `hydro_model.multibody.rigid_body_kernels` and `hydro_model.multibody.composite_kernels` are
made of; the shared arguments are described in the former.

`column` is where in a row of `scratch` a vector begins, `part` which of its six components.
"""

from __future__ import annotations

import math
from typing import Any

from hydro_model.numerics.kernel import inlined

# mypy follows no numba import: the arrays of the kernels are typed by numba itself.
Array = Any

#: Columns of the working memory: placement of the child frame in its parent (rotation row by
#: row, then translation), velocity, required velocity, acceleration, force, composite inertia.
SCRATCH = 52
PLACE, SHIFT, VEL, REQ, ACC, FORCE, BODY, COLUMN = 0, 9, 12, 18, 24, 30, 36, 46


@inlined
def place(
    q: Array, rotation: Array, translation: Array, axis: Array, prismatic: Array, scratch: Array
) -> None:
    """Placement of every child frame in its parent at `q`, into the working memory."""
    for i in range(q.shape[0]):
        x, y, z = axis[i, 0], axis[i, 1], axis[i, 2]
        if prismatic[i]:
            for r in range(3):
                along = rotation[i, r, 0] * x + rotation[i, r, 1] * y + rotation[i, r, 2] * z
                scratch[i, SHIFT + r] = translation[i, r] + along * q[i]
                for c in range(3):
                    scratch[i, PLACE + 3 * r + c] = rotation[i, r, c]
            continue
        s, c1 = math.sin(q[i]), math.cos(q[i])
        k = 1.0 - c1
        for r in range(3):
            a, b, d = rotation[i, r, 0], rotation[i, r, 1], rotation[i, r, 2]
            dot = (a * x + b * y + d * z) * k
            # Row r of `rotation` times Rodrigues' matrix of the joint.
            scratch[i, PLACE + 3 * r] = a * c1 + dot * x + s * (b * z - d * y)
            scratch[i, PLACE + 3 * r + 1] = b * c1 + dot * y + s * (d * x - a * z)
            scratch[i, PLACE + 3 * r + 2] = d * c1 + dot * z + s * (a * y - b * x)
            scratch[i, SHIFT + r] = translation[i, r]


@inlined
def to_child(scratch: Array, i: int, column: int, base: Array) -> None:
    """Motion vector of the parent (row i - 1, or the base) turned into frame i (eq. 3)."""
    if i == 0:
        w0, w1, w2, v0, v1, v2 = 0.0, 0.0, 0.0, base[0], base[1], base[2]
    else:
        w0, w1, w2 = scratch[i - 1, column], scratch[i - 1, column + 1], scratch[i - 1, column + 2]
        v0 = scratch[i - 1, column + 3]
        v1 = scratch[i - 1, column + 4]
        v2 = scratch[i - 1, column + 5]
    p0, p1, p2 = scratch[i, SHIFT], scratch[i, SHIFT + 1], scratch[i, SHIFT + 2]
    v0, v1, v2 = v0 + w1 * p2 - w2 * p1, v1 + w2 * p0 - w0 * p2, v2 + w0 * p1 - w1 * p0
    for c in range(3):
        a, b, d = scratch[i, c], scratch[i, 3 + c], scratch[i, 6 + c]
        scratch[i, column + c] = a * w0 + b * w1 + d * w2
        scratch[i, column + 3 + c] = a * v0 + b * v1 + d * v2


@inlined
def add_wrench_to_parent(scratch: Array, i: int, column: int) -> None:
    """Force vector of frame i added to that of frame i - 1 (eq. 4, the sum of eq. 7)."""
    t0, t1, t2 = scratch[i, column], scratch[i, column + 1], scratch[i, column + 2]
    f0, f1, f2 = scratch[i, column + 3], scratch[i, column + 4], scratch[i, column + 5]
    a0 = scratch[i, 0] * f0 + scratch[i, 1] * f1 + scratch[i, 2] * f2
    a1 = scratch[i, 3] * f0 + scratch[i, 4] * f1 + scratch[i, 5] * f2
    a2 = scratch[i, 6] * f0 + scratch[i, 7] * f1 + scratch[i, 8] * f2
    p0, p1, p2 = scratch[i, SHIFT], scratch[i, SHIFT + 1], scratch[i, SHIFT + 2]
    b0 = scratch[i, 0] * t0 + scratch[i, 1] * t1 + scratch[i, 2] * t2
    b1 = scratch[i, 3] * t0 + scratch[i, 4] * t1 + scratch[i, 5] * t2
    b2 = scratch[i, 6] * t0 + scratch[i, 7] * t1 + scratch[i, 8] * t2
    scratch[i - 1, column] += b0 + p1 * a2 - p2 * a1
    scratch[i - 1, column + 1] += b1 + p2 * a0 - p0 * a2
    scratch[i - 1, column + 2] += b2 + p0 * a1 - p1 * a0
    scratch[i - 1, column + 3] += a0
    scratch[i - 1, column + 4] += a1
    scratch[i - 1, column + 5] += a2


@inlined
def on_axis(scratch: Array, i: int, column: int, axis: Array, joint: int, part: int) -> float:
    """Component of a force vector along a joint, s^T f."""
    at = column + part
    return float(
        scratch[i, at] * axis[joint, 0]
        + scratch[i, at + 1] * axis[joint, 1]
        + scratch[i, at + 2] * axis[joint, 2]
    )


@inlined
def move(
    qd: Array,
    qd_r: Array,
    qdd_r: Array,
    axis: Array,
    prismatic: Array,
    gravity: Array,
    scratch: Array,
) -> None:
    """Velocities, required velocities and required accelerations outwards (eqs. 5, 6)."""
    still = (0.0, 0.0, 0.0)
    up = (-gravity[0], -gravity[1], -gravity[2])
    as_measured = True
    for i in range(qd.shape[0]):
        to_child(scratch, i, VEL, still)
        to_child(scratch, i, ACC, up)
        part = 3 if prismatic[i] else 0
        for k in range(3):
            scratch[i, VEL + part + k] += axis[i, k] * qd[i]
            scratch[i, ACC + part + k] += axis[i, k] * qdd_r[i]
        as_measured = as_measured and qd_r[i] == qd[i]
        if as_measured:
            for k in range(6):
                scratch[i, REQ + k] = scratch[i, VEL + k]
        else:
            to_child(scratch, i, REQ, still)
            for k in range(3):
                scratch[i, REQ + part + k] += axis[i, k] * qd_r[i]
        # d/dt of (5) for the required velocity: the frame turns with the measured joint rate.
        s0, s1, s2 = axis[i, 0] * qd[i], axis[i, 1] * qd[i], axis[i, 2] * qd[i]
        w0, w1, w2 = scratch[i, REQ], scratch[i, REQ + 1], scratch[i, REQ + 2]
        lin = ACC + 3
        if not prismatic[i]:
            scratch[i, ACC] += w1 * s2 - w2 * s1
            scratch[i, ACC + 1] += w2 * s0 - w0 * s2
            scratch[i, ACC + 2] += w0 * s1 - w1 * s0
            w0, w1, w2 = scratch[i, REQ + 3], scratch[i, REQ + 4], scratch[i, REQ + 5]
        scratch[i, lin] += w1 * s2 - w2 * s1
        scratch[i, lin + 1] += w2 * s0 - w0 * s2
        scratch[i, lin + 2] += w0 * s1 - w1 * s0
