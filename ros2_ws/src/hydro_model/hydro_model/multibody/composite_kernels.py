"""Compiled mass matrix by composite bodies.

The shared arguments are described in `hydro_model.multibody.rigid_body_kernels`.
"""

from __future__ import annotations

from hydro_model.multibody.chain_kernels import (
    BODY,
    COLUMN,
    SHIFT,
    Array,
    add_wrench_to_parent,
    on_axis,
)
from hydro_model.multibody.part_kernels import add_part_bodies, add_part_rates
from hydro_model.numerics.kernel import kernel

#: Column of `theta` behind a link's standard parameters: its joint's armature.
ARMATURE = 10


@kernel
def _turned(scratch: Array, i: int, row: int, column: int) -> float:
    """Entry (row, column) of the composite inertia tensor along the parent's axes, R I R^T."""
    a0, a1, a2 = scratch[i, 3 * row], scratch[i, 3 * row + 1], scratch[i, 3 * row + 2]
    c0, c1, c2 = scratch[i, 3 * column], scratch[i, 3 * column + 1], scratch[i, 3 * column + 2]
    b = BODY + 4
    return float(
        a0 * (scratch[i, b] * c0 + scratch[i, b + 1] * c1 + scratch[i, b + 2] * c2)
        + a1 * (scratch[i, b + 1] * c0 + scratch[i, b + 3] * c1 + scratch[i, b + 4] * c2)
        + a2 * (scratch[i, b + 2] * c0 + scratch[i, b + 4] * c1 + scratch[i, b + 5] * c2)
    )


@kernel
def add_body_to_parent(scratch: Array, i: int) -> None:
    """Inertia of the composite body i, moved to frame i - 1 and added to the one there."""
    b = BODY
    m = scratch[i, b]
    p0, p1, p2 = scratch[i, SHIFT], scratch[i, SHIFT + 1], scratch[i, SHIFT + 2]
    h0 = (
        scratch[i, 0] * scratch[i, b + 1]
        + scratch[i, 1] * scratch[i, b + 2]
        + scratch[i, 2] * scratch[i, b + 3]
    )
    h1 = (
        scratch[i, 3] * scratch[i, b + 1]
        + scratch[i, 4] * scratch[i, b + 2]
        + scratch[i, 5] * scratch[i, b + 3]
    )
    h2 = (
        scratch[i, 6] * scratch[i, b + 1]
        + scratch[i, 7] * scratch[i, b + 2]
        + scratch[i, 8] * scratch[i, b + 3]
    )
    # Parallel axes with the first moment instead of the centre of mass, so that m = 0 is fine.
    dot = 2.0 * (p0 * h0 + p1 * h1 + p2 * h2) + m * (p0 * p0 + p1 * p1 + p2 * p2)
    up = i - 1
    scratch[up, b] += m
    scratch[up, b + 1] += h0 + m * p0
    scratch[up, b + 2] += h1 + m * p1
    scratch[up, b + 3] += h2 + m * p2
    scratch[up, b + 4] += _turned(scratch, i, 0, 0) + dot - 2.0 * p0 * h0 - m * p0 * p0
    scratch[up, b + 5] += _turned(scratch, i, 0, 1) - p0 * h1 - p1 * h0 - m * p0 * p1
    scratch[up, b + 6] += _turned(scratch, i, 0, 2) - p0 * h2 - p2 * h0 - m * p0 * p2
    scratch[up, b + 7] += _turned(scratch, i, 1, 1) + dot - 2.0 * p1 * h1 - m * p1 * p1
    scratch[up, b + 8] += _turned(scratch, i, 1, 2) - p1 * h2 - p2 * h1 - m * p1 * p2
    scratch[up, b + 9] += _turned(scratch, i, 2, 2) + dot - 2.0 * p2 * h2 - m * p2 * p2


@kernel
def axis_force(scratch: Array, i: int, axis: Array, prismatic: bool) -> None:
    """Force of the composite body i at unit acceleration of its joint, M s (eq. 26)."""
    b, c = BODY, COLUMN
    x, y, z = axis[i, 0], axis[i, 1], axis[i, 2]
    h0, h1, h2 = scratch[i, b + 1], scratch[i, b + 2], scratch[i, b + 3]
    if prismatic:
        scratch[i, c] = h1 * z - h2 * y
        scratch[i, c + 1] = h2 * x - h0 * z
        scratch[i, c + 2] = h0 * y - h1 * x
        scratch[i, c + 3] = scratch[i, b] * x
        scratch[i, c + 4] = scratch[i, b] * y
        scratch[i, c + 5] = scratch[i, b] * z
        return
    scratch[i, c] = scratch[i, b + 4] * x + scratch[i, b + 5] * y + scratch[i, b + 6] * z
    scratch[i, c + 1] = scratch[i, b + 5] * x + scratch[i, b + 7] * y + scratch[i, b + 8] * z
    scratch[i, c + 2] = scratch[i, b + 6] * x + scratch[i, b + 8] * y + scratch[i, b + 9] * z
    scratch[i, c + 3] = y * h2 - z * h1
    scratch[i, c + 4] = z * h0 - x * h2
    scratch[i, c + 5] = x * h1 - y * h0


@kernel
def mass_matrix_placed(
    axis: Array, prismatic: Array, theta: Array, parts: Array, scratch: Array, mass: Array
) -> None:
    """Joint-space mass matrix by composite bodies, into `mass` (n, n).

    After `place` and `place_parts`.
    """
    n = theta.shape[0]
    for i in range(n):
        for k in range(10):
            scratch[i, BODY + k] = theta[i, k]
    add_part_bodies(n, parts, scratch)
    for i in range(n - 1, 0, -1):
        add_body_to_parent(scratch, i)
    for i in range(n):
        axis_force(scratch, i, axis, prismatic[i])
        mass[i, i] = on_axis(scratch, i, COLUMN, axis, i, 3 if prismatic[i] else 0)
        mass[i, i] += theta[i, ARMATURE]
        for j in range(i, 0, -1):
            for k in range(6):
                scratch[j - 1, COLUMN + k] = 0.0
            add_wrench_to_parent(scratch, j, COLUMN)
            part = 3 if prismatic[j - 1] else 0
            mass[i, j - 1] = on_axis(scratch, j - 1, COLUMN, axis, j - 1, part)
            mass[j - 1, i] = mass[i, j - 1]
    add_part_rates(axis, prismatic, parts, scratch, mass)
