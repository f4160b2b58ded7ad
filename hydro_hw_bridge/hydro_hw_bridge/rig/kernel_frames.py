"""Frames of the compiled truth plant's links in motion, and velocities of points on them.

All in base axes, with components as numbers of their own: `x`, `y`, `z` of a vector, `ax`, `ay`,
`az` of a first and `bx`, `by`, `bz` of a second. Arguments as in
`hydro_hw_bridge.rig.kernel_records`.
"""

from __future__ import annotations

import numpy as np

from hydro_hw_bridge.rig.compiled import compiled, inlined


@inlined
def cross(ax, ay, az, bx, by, bz):  # type: ignore[no-untyped-def]
    """Cross product a x b."""
    return ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx


@inlined
def apply(a, x, y, z):  # type: ignore[no-untyped-def]
    """The matrix `a` times a vector."""
    return (
        a[0, 0] * x + a[0, 1] * y + a[0, 2] * z,
        a[1, 0] * x + a[1, 1] * y + a[1, 2] * z,
        a[2, 0] * x + a[2, 1] * y + a[2, 2] * z,
    )


@inlined
def apply_transposed(a, x, y, z):  # type: ignore[no-untyped-def]
    """The transpose of the matrix `a` times a vector."""
    return (
        a[0, 0] * x + a[1, 0] * y + a[2, 0] * z,
        a[0, 1] * x + a[1, 1] * y + a[2, 1] * z,
        a[0, 2] * x + a[1, 2] * y + a[2, 2] * z,
    )


@inlined
def point_motion(frame, rx, ry, rz):  # type: ignore[no-untyped-def]
    """Velocity and bias acceleration of the point at `rx`, `ry`, `rz` from a frame's origin."""
    spin, rate = frame.spin, frame.spin_rate
    velocity, acceleration = frame.velocity, frame.acceleration
    vx, vy, vz = cross(spin[0], spin[1], spin[2], rx, ry, rz)
    ax, ay, az = cross(spin[0], spin[1], spin[2], vx, vy, vz)
    bx, by, bz = cross(rate[0], rate[1], rate[2], rx, ry, rz)
    return (
        velocity[0] + vx,
        velocity[1] + vy,
        velocity[2] + vz,
        acceleration[0] + ax + bx,
        acceleration[1] + ay + by,
        acceleration[2] + az + bz,
    )


@inlined
def _turn(angle, link, before, after):  # type: ignore[no-untyped-def]
    """Rotation of a link's frame, `after`, turned by its joint from the frame `before` it."""
    a, b, c = link.turn_0, link.turn_sin, link.turn_cos
    sine, versine = np.sin(angle), 1.0 - np.cos(angle)
    for k in range(3):
        x, y, z = apply(
            before,
            a[0, k] + sine * b[0, k] + versine * c[0, k],
            a[1, k] + sine * b[1, k] + versine * c[1, k],
            a[2, k] + sine * b[2, k] + versine * c[2, k],
        )
        after[0, k], after[1, k], after[2, k] = x, y, z


@compiled
def move_frames(q, qd, links, frames):  # type: ignore[no-untyped-def]
    """Positions, velocities and velocity-product accelerations of all frames, base outwards."""
    for i in range(q.shape[0]):
        link, before, after = links[i], frames[i], frames[i + 1]
        slides = link.prismatic == 1
        _turn(0.0 if slides else q[i], link, before.rotation, after.rotation)
        zx, zy, zz = apply(before.rotation, link.axis[0], link.axis[1], link.axis[2])
        after.axis[0], after.axis[1], after.axis[2] = zx, zy, zz
        rx, ry, rz = apply(before.rotation, link.offset[0], link.offset[1], link.offset[2])
        slide, rate, turn = 0.0, 0.0, qd[i]
        if slides:
            slide, rate, turn = q[i], qd[i], 0.0
        rx, ry, rz = rx + zx * slide, ry + zy * slide, rz + zz * slide
        vx, vy, vz, ax, ay, az = point_motion(before, rx, ry, rz)
        wx, wy, wz = before.spin[0], before.spin[1], before.spin[2]
        # Sliding adds Coriolis 2 w x z qd; turning adds w x z qd to the spin's rate.
        cx, cy, cz = cross(wx, wy, wz, zx, zy, zz)
        origin, spin, spin_rate = after.origin, after.spin, after.spin_rate
        velocity, acceleration = after.velocity, after.acceleration
        origin[0] = before.origin[0] + rx
        origin[1] = before.origin[1] + ry
        origin[2] = before.origin[2] + rz
        velocity[0], velocity[1], velocity[2] = vx + zx * rate, vy + zy * rate, vz + zz * rate
        acceleration[0] = ax + 2.0 * rate * cx
        acceleration[1] = ay + 2.0 * rate * cy
        acceleration[2] = az + 2.0 * rate * cz
        spin[0], spin[1], spin[2] = wx + zx * turn, wy + zy * turn, wz + zz * turn
        spin_rate[0] = before.spin_rate[0] + turn * cx
        spin_rate[1] = before.spin_rate[1] + turn * cy
        spin_rate[2] = before.spin_rate[2] + turn * cz


@inlined
def point_columns(last, px, py, pz, links, frames, rows):  # type: ignore[no-untyped-def]
    """Rows k < `last`: velocity of the point at `px`, `py`, `pz` per unit rate of joint k."""
    for k in range(last):
        axis, origin = frames[k + 1].axis, frames[k + 1].origin
        x, y, z = axis[0], axis[1], axis[2]
        if links[k].prismatic == 0:
            x, y, z = cross(x, y, z, px - origin[0], py - origin[1], pz - origin[2])
        rows[k, 0], rows[k, 1], rows[k, 2] = x, y, z
