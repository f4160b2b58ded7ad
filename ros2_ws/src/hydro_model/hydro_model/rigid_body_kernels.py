"""Compiled kernels of the rigid-body recursions, for any serial chain.

Plain arrays in, plain arrays out, nothing allocated, so that other compiled code (the simulator)
may call them. Readable counterparts, which the tests compare with, are in
`hydro_model.rigid_body_reference`.

Arguments shared by all kernels, n joints:

- `q`, `qd`, `qdd` (n,): joint positions, velocities, accelerations;
- `rotation` (n, 3, 3), `translation` (n, 3), `axis` (n, 3), `prismatic` (n,) bool: where each
  child frame sits in its parent at q = 0, and its joint;
- `gravity` (3,): in the base frame, m/s^2;
- `theta` (n, 10): standard parameters of the links (eq. 28);
- `parts` (k, PART_COLUMNS): barrels and rods, see `hydro_model.part_kernels`;
- `scratch` (n + k, SCRATCH): working memory, contents irrelevant before and after.
"""

from __future__ import annotations

from hydro_model.chain_kernels import (
    ACC,
    COLUMN,
    FORCE,
    REQ,
    SCRATCH,
    VEL,
    Array,
    add_wrench_to_parent,
    move,
    on_axis,
    place,
)
from hydro_model.composite_kernels import mass_matrix_placed, solve_spd
from hydro_model.kernel import kernel
from hydro_model.part_kernels import (
    add_part_forces,
    carry_inwards,
    move_parts,
    part_regressor,
    place_parts,
)

__all__ = [
    "SCRATCH",
    "inverse_dynamics_kernel",
    "mass_matrix_and_bias",
    "mass_matrix_kernel",
    "place",
    "regressor_kernel",
    "required_torque_kernel",
    "solve_spd",
]


@kernel
def _net_force(theta: Array, k_v: float, scratch: Array, i: int) -> None:
    """Net force of link i: ``Y(vdot_d, v) theta + k_v (v_d - v)`` (eqs. 8, 20 and 29)."""
    m, h0, h1, h2 = theta[i, 0], theta[i, 1], theta[i, 2], theta[i, 3]
    xx, xy, xz = theta[i, 4], theta[i, 5], theta[i, 6]
    yy, yz, zz = theta[i, 7], theta[i, 8], theta[i, 9]
    w0, w1, w2 = scratch[i, VEL], scratch[i, VEL + 1], scratch[i, VEL + 2]
    v0, v1, v2 = scratch[i, VEL + 3], scratch[i, VEL + 4], scratch[i, VEL + 5]
    d0, d1, d2 = scratch[i, ACC], scratch[i, ACC + 1], scratch[i, ACC + 2]
    a0 = scratch[i, ACC + 3] + w1 * v2 - w2 * v1
    a1 = scratch[i, ACC + 4] + w2 * v0 - w0 * v2
    a2 = scratch[i, ACC + 5] + w0 * v1 - w1 * v0
    l0, l1, l2 = xx * w0 + xy * w1 + xz * w2, xy * w0 + yy * w1 + yz * w2, 0.0
    l2 = xz * w0 + yz * w1 + zz * w2
    u0, u1, u2 = w1 * h2 - w2 * h1, w2 * h0 - w0 * h2, w0 * h1 - w1 * h0
    f = FORCE
    scratch[i, f] = xx * d0 + xy * d1 + xz * d2 + w1 * l2 - w2 * l1 + h1 * a2 - h2 * a1
    scratch[i, f + 1] = xy * d0 + yy * d1 + yz * d2 + w2 * l0 - w0 * l2 + h2 * a0 - h0 * a2
    scratch[i, f + 2] = xz * d0 + yz * d1 + zz * d2 + w0 * l1 - w1 * l0 + h0 * a1 - h1 * a0
    scratch[i, f + 3] = m * a0 + d1 * h2 - d2 * h1 + w1 * u2 - w2 * u1
    scratch[i, f + 4] = m * a1 + d2 * h0 - d0 * h2 + w2 * u0 - w0 * u2
    scratch[i, f + 5] = m * a2 + d0 * h1 - d1 * h0 + w0 * u1 - w1 * u0
    for k in range(6):
        scratch[i, f + k] += k_v * (scratch[i, REQ + k] - scratch[i, VEL + k])


@kernel
def required_torque_kernel(
    q: Array,
    qd: Array,
    qd_r: Array,
    qdd_r: Array,
    k_v: float,
    rotation: Array,
    translation: Array,
    axis: Array,
    prismatic: Array,
    gravity: Array,
    theta: Array,
    parts: Array,
    scratch: Array,
    out: Array,
) -> None:
    """Joint torques of eqs. 20 and 22 without friction, into `out` (n,).

    With `qd_r` = `qd` and `k_v` = 0 this is the recursive Newton-Euler inverse dynamics.
    """
    place(q, rotation, translation, axis, prismatic, scratch)
    place_parts(q, parts, scratch)
    move(qd, qd_r, qdd_r, axis, prismatic, gravity, scratch)
    move_parts(qd, qd_r, qdd_r, gravity, parts, scratch)
    n = q.shape[0]
    for i in range(n):
        out[i] = 0.0
        _net_force(theta, k_v, scratch, i)
    add_part_forces(parts, scratch, out)
    for i in range(n - 1, -1, -1):
        out[i] += on_axis(scratch, i, FORCE, axis, i, 3 if prismatic[i] else 0)
        if i > 0:
            add_wrench_to_parent(scratch, i, FORCE)


@kernel
def inverse_dynamics_kernel(
    q: Array,
    qd: Array,
    qdd: Array,
    rotation: Array,
    translation: Array,
    axis: Array,
    prismatic: Array,
    gravity: Array,
    theta: Array,
    parts: Array,
    scratch: Array,
    out: Array,
) -> None:
    """Joint torques (N m, N) of the recursive Newton-Euler equations, into `out` (n,)."""
    required_torque_kernel(
        q,
        qd,
        qd,
        qdd,
        0.0,
        rotation,
        translation,
        axis,
        prismatic,
        gravity,
        theta,
        parts,
        scratch,
        out,
    )


@kernel
def _body_column(p: int, scratch: Array, i: int) -> None:
    """Column p of the body regressor of link i into the working memory (eq. 29)."""
    w0, w1, w2 = scratch[i, VEL], scratch[i, VEL + 1], scratch[i, VEL + 2]
    v0, v1, v2 = scratch[i, VEL + 3], scratch[i, VEL + 4], scratch[i, VEL + 5]
    d0, d1, d2 = scratch[i, ACC], scratch[i, ACC + 1], scratch[i, ACC + 2]
    a0 = scratch[i, ACC + 3] + w1 * v2 - w2 * v1
    a1 = scratch[i, ACC + 4] + w2 * v0 - w0 * v2
    a2 = scratch[i, ACC + 5] + w0 * v1 - w1 * v0
    c = COLUMN
    t0, t1, t2, f0, f1, f2 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    if p == 0:
        f0, f1, f2 = a0, a1, a2
    elif p == 1:
        t0, t1, t2 = 0.0, -a2, a1
        f0, f1, f2 = -w1 * w1 - w2 * w2, d2 + w0 * w1, -d1 + w0 * w2
    elif p == 2:
        t0, t1, t2 = a2, 0.0, -a0
        f0, f1, f2 = -d2 + w0 * w1, -w0 * w0 - w2 * w2, d0 + w1 * w2
    elif p == 3:
        t0, t1, t2 = -a1, a0, 0.0
        f0, f1, f2 = d1 + w0 * w2, -d0 + w1 * w2, -w0 * w0 - w1 * w1
    elif p == 4:
        t0, t1, t2 = d0, w2 * w0, -w1 * w0
    elif p == 5:
        t0, t1, t2 = d1 - w2 * w0, d0 + w2 * w1, w0 * w0 - w1 * w1
    elif p == 6:
        t0, t1, t2 = d2 + w1 * w0, w2 * w2 - w0 * w0, d0 - w1 * w2
    elif p == 7:
        t0, t1, t2 = -w2 * w1, d1, w0 * w1
    elif p == 8:
        t0, t1, t2 = w1 * w1 - w2 * w2, d2 - w0 * w1, d1 + w0 * w2
    else:
        t0, t1, t2 = w1 * w2, -w0 * w2, d2
    scratch[i, c], scratch[i, c + 1], scratch[i, c + 2] = t0, t1, t2
    scratch[i, c + 3], scratch[i, c + 4], scratch[i, c + 5] = f0, f1, f2


@kernel
def regressor_kernel(
    q: Array,
    qd: Array,
    qdd: Array,
    rotation: Array,
    translation: Array,
    axis: Array,
    prismatic: Array,
    gravity: Array,
    parts: Array,
    scratch: Array,
    out: Array,
) -> None:
    """Joint torque regressor (eq. 18 without friction) into `out` (n, 10 n + 3 k), k parts."""
    place(q, rotation, translation, axis, prismatic, scratch)
    place_parts(q, parts, scratch)
    move(qd, qd, qdd, axis, prismatic, gravity, scratch)
    move_parts(qd, qd, qdd, gravity, parts, scratch)
    n = q.shape[0]
    for link in range(n):
        for p in range(10):
            column = 10 * link + p
            for i in range(n):
                out[i, column] = 0.0
            _body_column(p, scratch, link)
            carry_inwards(link, column, axis, prismatic, scratch, out)
    part_regressor(axis, prismatic, parts, scratch, out)


@kernel
def mass_matrix_kernel(
    q: Array,
    rotation: Array,
    translation: Array,
    axis: Array,
    prismatic: Array,
    theta: Array,
    parts: Array,
    scratch: Array,
    mass: Array,
) -> None:
    """Joint-space mass matrix into `mass` (n, n)."""
    place(q, rotation, translation, axis, prismatic, scratch)
    place_parts(q, parts, scratch)
    mass_matrix_placed(axis, prismatic, theta, parts, scratch, mass)


@kernel
def mass_matrix_and_bias(
    q: Array,
    qd: Array,
    rotation: Array,
    translation: Array,
    axis: Array,
    prismatic: Array,
    gravity: Array,
    theta: Array,
    parts: Array,
    scratch: Array,
    mass: Array,
    bias: Array,
) -> None:
    """M(q) into `mass` (n, n) and h(q, qd) into `bias` (n,): ``tau = M qdd + h``.

    The bias holds the velocity products and gravity.
    """
    n = q.shape[0]
    for i in range(n):
        # Borrowed as the zero acceleration: `mass` is only written afterwards.
        mass[0, i] = 0.0
    inverse_dynamics_kernel(
        q,
        qd,
        mass[0],
        rotation,
        translation,
        axis,
        prismatic,
        gravity,
        theta,
        parts,
        scratch,
        bias,
    )
    mass_matrix_placed(axis, prismatic, theta, parts, scratch, mass)
