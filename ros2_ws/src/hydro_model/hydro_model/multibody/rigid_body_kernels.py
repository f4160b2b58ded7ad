"""Compiled kernels of the rigid-body recursions, for any serial chain.

Plain arrays in, plain arrays out, nothing allocated, so that other compiled code (the simulator)
may call them. Readable counterparts, which the tests compare with, are in
`hydro_model.multibody.rigid_body_reference`.

Arguments shared by all kernels, n joints:

- `q`, `qd`, `qdd` (n,): joint positions, velocities, accelerations;
- `rotation` (n, 3, 3), `translation` (n, 3), `axis` (n, 3), `prismatic` (n,) bool: where each
  child frame sits in its parent at q = 0, and its joint;
- `gravity` (3,): in the base frame, m/s^2;
- `theta` (n, 11): standard parameters of the links (eq. 28), and each joint's armature;
- `parts` (k, PART_COLUMNS): barrels and rods, see `hydro_model.multibody.part_kernels`;
- `scratch` (n + k, SCRATCH): working memory, contents irrelevant before and after.
"""

from __future__ import annotations

from hydro_model.multibody.chain_kernels import (
    ACC,
    COLUMN,
    FORCE,
    REQ,
    SCRATCH,
    SHIFT,
    VEL,
    Array,
    add_wrench_to_parent,
    move,
    on_axis,
    place,
)
from hydro_model.multibody.composite_kernels import ARMATURE, mass_matrix_placed
from hydro_model.multibody.part_kernels import (
    add_part_forces,
    move_parts,
    part_regressor,
    place_parts,
)
from hydro_model.numerics.kernel import inlined, kernel
from hydro_model.numerics.triple_kernels import cross, dot, plus, to_child, triple

__all__ = [
    "SCRATCH",
    "inverse_dynamics_kernel",
    "mass_matrix_and_bias",
    "mass_matrix_kernel",
    "place",
    "regressor_kernel",
    "required_torque_kernel",
]


@inlined
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
    if k_v != 0.0:
        for k in range(6):
            scratch[i, f + k] += k_v * (scratch[i, REQ + k] - scratch[i, VEL + k])


@inlined
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

    `k_v` is the gain on the required velocity's error, N s/m or N m s/rad.
    """
    place(q, rotation, translation, axis, prismatic, scratch)
    place_parts(q, parts, scratch)
    move(qd, qd_r, qdd_r, axis, prismatic, gravity, scratch)
    move_parts(qd, qd_r, qdd_r, gravity, parts, scratch)
    n = q.shape[0]
    for i in range(n):
        out[i] = theta[i, ARMATURE] * qdd_r[i]
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
def _turn_axes(link: int, axis: Array, prismatic: Array, scratch: Array) -> None:
    """Joint axes up to that of `link`, so far in its parent's frame, turned into its own."""
    shift = triple(scratch, link, SHIFT)
    for j in range(link + 1):
        if j < link:
            turn, slide = triple(scratch, j, COLUMN), triple(scratch, j, COLUMN + 3)
            slide = to_child(scratch, link, plus(slide, 1.0, cross(turn, shift)))
            turn = to_child(scratch, link, turn)
        elif prismatic[j]:
            turn, slide = (0.0, 0.0, 0.0), triple(axis, j, 0)
        else:
            turn, slide = triple(axis, j, 0), (0.0, 0.0, 0.0)
        for k in range(3):
            scratch[j, COLUMN + k], scratch[j, COLUMN + 3 + k] = turn[k], slide[k]


@inlined
def _link_regressor(link: int, scratch: Array, out: Array) -> None:
    """Columns of one link: its body regressor (eq. 29) on every joint axis before it."""
    w0, w1, w2 = w = triple(scratch, link, VEL)
    d0, d1, d2 = triple(scratch, link, ACC)
    a = plus(triple(scratch, link, ACC + 3), 1.0, cross(w, triple(scratch, link, VEL + 3)))
    # Forces of the first moments and torques of the inertias, column by column.
    f_x = (-w1 * w1 - w2 * w2, d2 + w0 * w1, -d1 + w0 * w2)
    f_y = (-d2 + w0 * w1, -w0 * w0 - w2 * w2, d0 + w1 * w2)
    f_z = (d1 + w0 * w2, -d0 + w1 * w2, -w0 * w0 - w1 * w1)
    t_xx, t_xy = (d0, w2 * w0, -w1 * w0), (d1 - w2 * w0, d0 + w2 * w1, w0 * w0 - w1 * w1)
    t_xz, t_yy = (d2 + w1 * w0, w2 * w2 - w0 * w0, d0 - w1 * w2), (-w2 * w1, d1, w0 * w1)
    t_yz, t_zz = (w1 * w1 - w2 * w2, d2 - w0 * w1, d1 + w0 * w2), (w1 * w2, -w0 * w2, d2)
    at = 10 * link
    for j in range(link + 1):
        turn, slide = triple(scratch, j, COLUMN), triple(scratch, j, COLUMN + 3)
        lifted = cross(a, turn)
        out[j, at] = dot(slide, a)
        out[j, at + 1] = dot(slide, f_x) + lifted[0]
        out[j, at + 2] = dot(slide, f_y) + lifted[1]
        out[j, at + 3] = dot(slide, f_z) + lifted[2]
        out[j, at + 4] = dot(turn, t_xx)
        out[j, at + 5] = dot(turn, t_xy)
        out[j, at + 6] = dot(turn, t_xz)
        out[j, at + 7] = dot(turn, t_yy)
        out[j, at + 8] = dot(turn, t_yz)
        out[j, at + 9] = dot(turn, t_zz)
    for j in range(link + 1, out.shape[0]):
        for p in range(10):
            out[j, at + p] = 0.0


@inlined
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
    for link in range(q.shape[0]):
        _turn_axes(link, axis, prismatic, scratch)
        _link_regressor(link, scratch, out)
    part_regressor(axis, prismatic, parts, scratch, out)


@inlined
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
