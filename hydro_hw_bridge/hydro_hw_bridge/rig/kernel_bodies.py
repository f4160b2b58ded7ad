"""Equations of motion of the compiled truth plant: Kane's, in the base frame.

Each body contributes ``m Jv^T Jv + Jw^T I Jw`` to the mass matrix and its velocity-product
accelerations to the bias (Kane and Levinson, Dynamics: Theory and Applications, 1985, ch. 4-6).
Barrel and rod of a cylinder are slender bodies on the line between its two pins, written with
the unit vector of that line, so a stroke is a distance between points and not a law of cosines.
Arguments as in `hydro_hw_bridge.rig.kernel_records`.
"""

from __future__ import annotations

import numpy as np

from hydro_hw_bridge.rig.compiled import compiled, inlined
from hydro_hw_bridge.rig.kernel_frames import (
    apply,
    apply_transposed,
    cross,
    move_frames,
    point_columns,
    point_motion,
)


@inlined
def _add_body(last, weight, rows, ax, ay, az, matrix, bias):  # type: ignore[no-untyped-def]
    """Add weight J J^T and weight J a, with the rows of J below `last`."""
    for k in range(last):
        jx, jy, jz = weight * rows[k, 0], weight * rows[k, 1], weight * rows[k, 2]
        bias[k] += jx * ax + jy * ay + jz * az
        for j in range(k + 1):
            matrix[k, j] += jx * rows[j, 0] + jy * rows[j, 1] + jz * rows[j, 2]


@inlined
def _add_link(i, links, frames, world, rows, turned, matrix, bias):  # type: ignore[no-untyped-def]
    link, frame = links[i], frames[i + 1]
    rotation, inertia, gravity = frame.rotation, link.inertia, world.gravity
    rx, ry, rz = apply(rotation, link.com[0], link.com[1], link.com[2])
    _, _, _, ax, ay, az = point_motion(frame, rx, ry, rz)
    origin = frame.origin
    point_columns(i + 1, origin[0] + rx, origin[1] + ry, origin[2] + rz, links, frames, rows)
    ax, ay, az = ax - gravity[0], ay - gravity[1], az - gravity[2]
    _add_body(i + 1, link.mass, rows, ax, ay, az, matrix, bias)
    # The turning part in the link's own axes, where its inertia is constant.
    wx, wy, wz = apply_transposed(rotation, frame.spin[0], frame.spin[1], frame.spin[2])
    ex, ey, ez = apply_transposed(
        rotation, frame.spin_rate[0], frame.spin_rate[1], frame.spin_rate[2]
    )
    hx, hy, hz = apply(inertia, wx, wy, wz)
    kx, ky, kz = cross(wx, wy, wz, hx, hy, hz)
    tx, ty, tz = apply(inertia, ex, ey, ez)
    for k in range(i + 1):
        axis = frames[k + 1].axis
        bx, by, bz = apply_transposed(rotation, axis[0], axis[1], axis[2])
        if links[k].prismatic == 1:
            bx, by, bz = 0.0, 0.0, 0.0
        turned[k, 0], turned[k, 1], turned[k, 2] = bx, by, bz
        bias[k] += bx * (tx + kx) + by * (ty + ky) + bz * (tz + kz)
        hx, hy, hz = apply(inertia, bx, by, bz)
        for j in range(k + 1):
            matrix[k, j] += hx * turned[j, 0] + hy * turned[j, 1] + hz * turned[j, 2]


@inlined
def _pin(frame, pin):  # type: ignore[no-untyped-def]
    """Position, velocity and bias acceleration of a pin."""
    rx, ry, rz = apply(frame.rotation, pin[0], pin[1], pin[2])
    vx, vy, vz, ax, ay, az = point_motion(frame, rx, ry, rz)
    origin = frame.origin
    return origin[0] + rx, origin[1] + ry, origin[2] + rz, vx, vy, vz, ax, ay, az


@inlined
def _to_centres(last, ex, ey, ez, length, barrel_d, rod_d, barrel, rod, line):  # type: ignore[no-untyped-def]
    """Rows of the pins' velocities become those of barrel, rod and the line's direction."""
    for k in range(last):
        ux, uy, uz = rod[k, 0] - barrel[k, 0], rod[k, 1] - barrel[k, 1], rod[k, 2] - barrel[k, 2]
        along = ex * ux + ey * uy + ez * uz
        ux, uy, uz = ux - ex * along, uy - ey * along, uz - ez * along
        ux, uy, uz = ux / length, uy / length, uz / length
        line[k, 0], line[k, 1], line[k, 2] = ux, uy, uz
        barrel[k, 0] += barrel_d * ux
        barrel[k, 1] += barrel_d * uy
        barrel[k, 2] += barrel_d * uz
        rod[k, 0] -= rod_d * ux
        rod[k, 1] -= rod_d * uy
        rod[k, 2] -= rod_d * uz


@inlined
def _add_cylinder(cyl, links, frames, world, jac, matrix, bias):  # type: ignore[no-untyped-def]
    """Stroke and lever of a cylinder, and what its barrel and rod weigh."""
    j = cyl.joint
    barrel, rod, line = jac[0], jac[1], jac[2]
    px, py, pz, pvx, pvy, pvz, pax, pay, paz = _pin(frames[j], cyl.parent_pin)
    cx, cy, cz, cvx, cvy, cvz, cax, cay, caz = _pin(frames[j + 1], cyl.child_pin)
    # The line between the pins: e = r / L, e' and the bias part of e''.
    rx, ry, rz, vx, vy, vz = cx - px, cy - py, cz - pz, cvx - pvx, cvy - pvy, cvz - pvz
    length = np.sqrt(rx * rx + ry * ry + rz * rz)
    ex, ey, ez = rx / length, ry / length, rz / length
    rate = ex * vx + ey * vy + ez * vz
    point_columns(j + 1, cx, cy, cz, links, frames, rod)
    cyl.x = length - cyl.closed_length
    cyl.v = rate
    cyl.lever = ex * rod[j, 0] + ey * rod[j, 1] + ez * rod[j, 2]
    if cyl.heavy == 0:
        return
    point_columns(j, px, py, pz, links, frames, barrel)
    barrel[j, 0], barrel[j, 1], barrel[j, 2] = 0.0, 0.0, 0.0
    ux, uy, uz = (vx - ex * rate) / length, (vy - ey * rate) / length, (vz - ez * rate) / length
    sx, sy, sz = cax - pax, cay - pay, caz - paz
    second = ux * vx + uy * vy + uz * vz + ex * sx + ey * sy + ez * sz
    sx = (sx - ex * second - 2.0 * ux * rate) / length
    sy = (sy - ey * second - 2.0 * uy * rate) / length
    sz = (sz - ez * second - 2.0 * uz * rate) / length
    barrel_d, rod_d = cyl.barrel[1], cyl.rod[1]
    _to_centres(j + 1, ex, ey, ez, length, barrel_d, rod_d, barrel, rod, line)
    gx, gy, gz = world.gravity[0], world.gravity[1], world.gravity[2]
    pax, pay, paz = pax + barrel_d * sx - gx, pay + barrel_d * sy - gy, paz + barrel_d * sz - gz
    cax, cay, caz = cax - rod_d * sx - gx, cay - rod_d * sy - gy, caz - rod_d * sz - gz
    _add_body(j + 1, cyl.barrel[0], barrel, pax, pay, paz, matrix, bias)
    _add_body(j + 1, cyl.rod[0], rod, cax, cay, caz, matrix, bias)
    _add_body(j + 1, cyl.barrel[2] + cyl.rod[2], line, sx, sy, sz, matrix, bias)


@compiled
def equations_of_motion(q, qd, links, frames, cyls, world, jac, matrix, bias):  # type: ignore[no-untyped-def]
    """Fill mass matrix (lower triangle) and bias, and each cylinder's x, v and lever."""
    move_frames(q, qd, links, frames)
    for i in range(q.shape[0]):
        bias[i] = 0.0
        for k in range(i + 1):
            matrix[i, k] = 0.0
    for i in range(q.shape[0]):
        _add_link(i, links, frames, world[0], jac[0], jac[1], matrix, bias)
    for n in range(cyls.shape[0]):
        cyl = cyls[n]
        if cyl.direct == 1:
            cyl.x = q[cyl.joint] - cyl.closed_length
            cyl.v = qd[cyl.joint]
            cyl.lever = 1.0
        else:
            _add_cylinder(cyl, links, frames, world[0], jac, matrix, bias)


@inlined
def solve_in_place(matrix, rhs):  # type: ignore[no-untyped-def]
    """Cholesky solution of the lower-stored matrix, which is overwritten; `rhs` becomes it."""
    n = rhs.shape[0]
    for j in range(n):
        for k in range(j):
            matrix[j, j] -= matrix[j, k] * matrix[j, k]
        matrix[j, j] = np.sqrt(matrix[j, j])
        for i in range(j + 1, n):
            for k in range(j):
                matrix[i, j] -= matrix[i, k] * matrix[j, k]
            matrix[i, j] /= matrix[j, j]
    for i in range(n):
        for k in range(i):
            rhs[i] -= matrix[i, k] * rhs[k]
        rhs[i] /= matrix[i, i]
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, n):
            rhs[i] -= matrix[k, i] * rhs[k]
        rhs[i] /= matrix[i, i]
