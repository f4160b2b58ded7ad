"""The compiled truth plant: Kane's equations in the base frame, cylinders, valves and oil.

Each body contributes ``m Jv^T Jv + Jw^T I Jw`` to the mass matrix and its velocity-product
accelerations to the bias (Kane and Levinson, Dynamics: Theory and Applications, 1985, ch. 4-6).
Barrel and rod of a cylinder are slender bodies on the line between its two pins, written with
the unit vector of that line, so a stroke is a distance between points and not a law of cosines.
The hydraulic forms differ on purpose from those of hydro_model: rounded dead zone,
laminar-turbulent edges, bristle friction, spool with a speed limit. Pressures are gauge, flows
positive into a chamber.

All compiled code is in this one file, because the compiler's cache watches only the file that a
function is in. Records carry the names; in numba they cost no reference counts, as tuples of
arrays would.

Arguments shared by the kernels: `links`, `frames`, `cyls` and `world` are records of the types
above, filled by `hydro_hw_bridge.rig.plant`; `jac`, `matrix`, `bias` and `work` are working
memory; `y` is the state as `Plant` lays it out, `memory` that of the plays; `pump` is False while
it is off; a cycle of `cycle_s` has `steps` fixed steps.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from hydro_hw_bridge.rig.extras import CYLINDER_FIELDS, JOINT_FIELDS

#: Swept volume below which a chamber is not allowed to shrink, and its largest share of what the
#: piston sweeps: keeps the oil's stiffness within what the fixed step integrates, and lies beyond
#: the joint limits of a sound machine, small cylinders' too.
SMALLEST_VOLUME_M3, _SMALLEST_SHARE = 2.0e-4, 0.05
#: Absolute pressure below which oil boils: no chamber falls under it. The cavity's volume is not
#: remembered, so a cavity collapses at once when oil flows in again.
VAPOUR_PRESSURE_PA = 2.0e3
#: Piston against the cylinder's end, or a joint without a cylinder against its limit.
STOP_STIFFNESS = 5.0e7
STOP_DAMPING = 5.0e5

_MATRIX, _VECTOR = ("f8", (3, 3)), ("f8", (3,))

#: A moving link and the joint that moves it: child axes in the parent frame are
#: ``turn_0 + sin q turn_sin + (1 - cos q) turn_cos``; offset and axis are in the parent frame,
#: centre of mass and central inertia in the link's.
LINK = np.dtype(
    [
        ("turn_0", *_MATRIX),
        ("turn_sin", *_MATRIX),
        ("turn_cos", *_MATRIX),
        ("offset", *_VECTOR),
        ("axis", *_VECTOR),
        ("prismatic", "i8"),
        ("stopped", "i8"),
        ("lower", "f8"),
        ("upper", "f8"),
        ("mass", "f8"),
        ("com", *_VECTOR),
        ("inertia", *_MATRIX),
        *((name, "f8") for name in JOINT_FIELDS),
    ]
)

#: A frame in motion, in base axes; the two rates leave out joint accelerations. Frame 0 is the
#: base, frame i + 1 link i, whose joint turns about `axis`.
FRAME = np.dtype(
    [
        ("rotation", *_MATRIX),
        ("origin", *_VECTOR),
        ("spin", *_VECTOR),
        ("velocity", *_VECTOR),
        ("spin_rate", *_VECTOR),
        ("acceleration", *_VECTOR),
        ("axis", *_VECTOR),
    ]
)

#: A cylinder with its valve. Pins are in the frames of the links before and after the joint;
#: barrel and rod have mass, distance from their own pin and transverse central inertia;
#: `spool_rate` is the natural frequency in rad/s. `lever`, `x` and `v` are results.
CYLINDER = np.dtype(
    [
        ("joint", "i8"),
        ("direct", "i8"),
        ("heavy", "i8"),
        ("extra", "i8"),
        ("parent_pin", *_VECTOR),
        ("child_pin", *_VECTOR),
        ("barrel", *_VECTOR),
        ("rod", *_VECTOR),
        *(
            (name, "f8")
            for name in (
                *("closed_length", "full_stroke", "area_a", "area_b", "dead_a", "dead_b"),
                *("leak", "leak_a", "leak_b", "viscous", "coulomb", "static"),
                *("stribeck_velocity", "bristle", "bristle_damping"),
                *("c_pa", "c_at", "c_pb", "c_bt", "deadband", "rounding", "null"),
                *("spool_rate", "spool_damping", "spool_limit", "transition"),
                *("lever", "x", "v"),
                *CYLINDER_FIELDS,
                *("disturbance", "shake"),
            )
        ),
    ]
)

#: What all share: gravity in the base frame, the oil and the lines.
WORLD = np.dtype(
    [
        ("gravity", *_VECTOR),
        ("tip", *_VECTOR),
        ("extra", "i8"),
        *(
            (name, "f8")
            for name in (
                *("time", "contact_stiffness", "contact_height", "contact_damping"),
                *("supply_ripple", "supply_ripple_rate"),
                *("bulk_modulus", "low_pressure_loss", "low_pressure_scale", "atmosphere"),
                *("supply", "tank", "droop", "droop_quadratic", "droop_lag"),
                *("tank_resistance", "tank_lag"),
            )
        ),
    ]
)

_helper = njit(cache=True, error_model="numpy", forceinline=True)
_kernel = njit(cache=True, error_model="numpy")


@_helper
def _cross(ax, ay, az, bx, by, bz):  # type: ignore[no-untyped-def]
    return ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx


@_helper
def _apply(a, x, y, z):  # type: ignore[no-untyped-def]
    return (
        a[0, 0] * x + a[0, 1] * y + a[0, 2] * z,
        a[1, 0] * x + a[1, 1] * y + a[1, 2] * z,
        a[2, 0] * x + a[2, 1] * y + a[2, 2] * z,
    )


@_helper
def _apply_transposed(a, x, y, z):  # type: ignore[no-untyped-def]
    return (
        a[0, 0] * x + a[1, 0] * y + a[2, 0] * z,
        a[0, 1] * x + a[1, 1] * y + a[2, 1] * z,
        a[0, 2] * x + a[1, 2] * y + a[2, 2] * z,
    )


@_helper
def _point(frame, rx, ry, rz):  # type: ignore[no-untyped-def]
    """Velocity and bias acceleration of the point at r (base axes) from the frame's origin."""
    spin, rate = frame.spin, frame.spin_rate
    velocity, acceleration = frame.velocity, frame.acceleration
    vx, vy, vz = _cross(spin[0], spin[1], spin[2], rx, ry, rz)
    ax, ay, az = _cross(spin[0], spin[1], spin[2], vx, vy, vz)
    bx, by, bz = _cross(rate[0], rate[1], rate[2], rx, ry, rz)
    return (
        velocity[0] + vx,
        velocity[1] + vy,
        velocity[2] + vz,
        acceleration[0] + ax + bx,
        acceleration[1] + ay + by,
        acceleration[2] + az + bz,
    )


@_kernel
def move_frames(q, qd, links, frames):  # type: ignore[no-untyped-def]
    """Positions, velocities and velocity-product accelerations of all frames, base outwards."""
    for i in range(q.shape[0]):
        link, before, after = links[i], frames[i], frames[i + 1]
        a, b, c = link.turn_0, link.turn_sin, link.turn_cos
        slides = link.prismatic == 1
        sine, versine = 0.0, 0.0
        if not slides:
            sine, versine = np.sin(q[i]), 1.0 - np.cos(q[i])
        for k in range(3):
            x, y, z = _apply(
                before.rotation,
                a[0, k] + sine * b[0, k] + versine * c[0, k],
                a[1, k] + sine * b[1, k] + versine * c[1, k],
                a[2, k] + sine * b[2, k] + versine * c[2, k],
            )
            after.rotation[0, k], after.rotation[1, k], after.rotation[2, k] = x, y, z
        zx, zy, zz = _apply(before.rotation, link.axis[0], link.axis[1], link.axis[2])
        after.axis[0], after.axis[1], after.axis[2] = zx, zy, zz
        rx, ry, rz = _apply(before.rotation, link.offset[0], link.offset[1], link.offset[2])
        slide, rate, turn = 0.0, 0.0, qd[i]
        if slides:
            slide, rate, turn = q[i], qd[i], 0.0
        rx, ry, rz = rx + zx * slide, ry + zy * slide, rz + zz * slide
        vx, vy, vz, ax, ay, az = _point(before, rx, ry, rz)
        wx, wy, wz = before.spin[0], before.spin[1], before.spin[2]
        # Sliding adds Coriolis 2 w x z qd; turning adds w x z qd to the spin's rate.
        cx, cy, cz = _cross(wx, wy, wz, zx, zy, zz)
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


@_helper
def _columns(last, px, py, pz, links, frames, rows):  # type: ignore[no-untyped-def]
    """Rows k < last: velocity of the point p, moved by joints before `last`, per unit rate."""
    for k in range(last):
        axis, origin = frames[k + 1].axis, frames[k + 1].origin
        x, y, z = axis[0], axis[1], axis[2]
        if links[k].prismatic == 0:
            x, y, z = _cross(x, y, z, px - origin[0], py - origin[1], pz - origin[2])
        rows[k, 0], rows[k, 1], rows[k, 2] = x, y, z


@_helper
def _add_body(last, weight, rows, ax, ay, az, matrix, bias):  # type: ignore[no-untyped-def]
    """Add weight J J^T and weight J a, with the rows of J below `last`."""
    for k in range(last):
        jx, jy, jz = weight * rows[k, 0], weight * rows[k, 1], weight * rows[k, 2]
        bias[k] += jx * ax + jy * ay + jz * az
        for j in range(k + 1):
            matrix[k, j] += jx * rows[j, 0] + jy * rows[j, 1] + jz * rows[j, 2]


@_helper
def _add_link(i, links, frames, world, rows, turned, matrix, bias):  # type: ignore[no-untyped-def]
    link, frame = links[i], frames[i + 1]
    rotation, inertia, gravity = frame.rotation, link.inertia, world.gravity
    rx, ry, rz = _apply(rotation, link.com[0], link.com[1], link.com[2])
    _, _, _, ax, ay, az = _point(frame, rx, ry, rz)
    origin = frame.origin
    _columns(i + 1, origin[0] + rx, origin[1] + ry, origin[2] + rz, links, frames, rows)
    ax, ay, az = ax - gravity[0], ay - gravity[1], az - gravity[2]
    _add_body(i + 1, link.mass, rows, ax, ay, az, matrix, bias)
    # The turning part in the link's own axes, where its inertia is constant.
    wx, wy, wz = _apply_transposed(rotation, frame.spin[0], frame.spin[1], frame.spin[2])
    ex, ey, ez = _apply_transposed(
        rotation, frame.spin_rate[0], frame.spin_rate[1], frame.spin_rate[2]
    )
    hx, hy, hz = _apply(inertia, wx, wy, wz)
    kx, ky, kz = _cross(wx, wy, wz, hx, hy, hz)
    tx, ty, tz = _apply(inertia, ex, ey, ez)
    for k in range(i + 1):
        axis = frames[k + 1].axis
        bx, by, bz = _apply_transposed(rotation, axis[0], axis[1], axis[2])
        if links[k].prismatic == 1:
            bx, by, bz = 0.0, 0.0, 0.0
        turned[k, 0], turned[k, 1], turned[k, 2] = bx, by, bz
        bias[k] += bx * (tx + kx) + by * (ty + ky) + bz * (tz + kz)
        hx, hy, hz = _apply(inertia, bx, by, bz)
        for j in range(k + 1):
            matrix[k, j] += hx * turned[j, 0] + hy * turned[j, 1] + hz * turned[j, 2]


@_helper
def _pin(frame, pin):  # type: ignore[no-untyped-def]
    """Position, velocity and bias acceleration of a pin."""
    rx, ry, rz = _apply(frame.rotation, pin[0], pin[1], pin[2])
    vx, vy, vz, ax, ay, az = _point(frame, rx, ry, rz)
    origin = frame.origin
    return origin[0] + rx, origin[1] + ry, origin[2] + rz, vx, vy, vz, ax, ay, az


@_helper
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
    _columns(j + 1, cx, cy, cz, links, frames, rod)
    cyl.x = length - cyl.closed_length
    cyl.v = rate
    cyl.lever = ex * rod[j, 0] + ey * rod[j, 1] + ez * rod[j, 2]
    if cyl.heavy == 0:
        return
    _columns(j, px, py, pz, links, frames, barrel)
    barrel[j, 0], barrel[j, 1], barrel[j, 2] = 0.0, 0.0, 0.0
    ux, uy, uz = (vx - ex * rate) / length, (vy - ey * rate) / length, (vz - ez * rate) / length
    sx, sy, sz = cax - pax, cay - pay, caz - paz
    second = ux * vx + uy * vy + uz * vz + ex * sx + ey * sy + ez * sz
    sx = (sx - ex * second - 2.0 * ux * rate) / length
    sy = (sy - ey * second - 2.0 * uy * rate) / length
    sz = (sz - ez * second - 2.0 * uz * rate) / length
    barrel_d, rod_d = cyl.barrel[1], cyl.rod[1]
    for k in range(j + 1):
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
    gx, gy, gz = world.gravity[0], world.gravity[1], world.gravity[2]
    pax, pay, paz = pax + barrel_d * sx - gx, pay + barrel_d * sy - gy, paz + barrel_d * sz - gz
    cax, cay, caz = cax - rod_d * sx - gx, cay - rod_d * sy - gy, caz - rod_d * sz - gz
    _add_body(j + 1, cyl.barrel[0], barrel, pax, pay, paz, matrix, bias)
    _add_body(j + 1, cyl.rod[0], rod, cax, cay, caz, matrix, bias)
    _add_body(j + 1, cyl.barrel[2] + cyl.rod[2], line, sx, sy, sz, matrix, bias)


@_kernel
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


@_helper
def _solve_in_place(matrix, rhs):  # type: ignore[no-untyped-def]
    """Cholesky solution of the lower-stored matrix, both arguments overwritten."""
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


@_kernel
def dead_zone(u, half_width, rounding):  # type: ignore[no-untyped-def]
    """Opening of a spool with overlap: 0 inside +-half_width, ``|u| - half_width`` outside.

    Smooth: the corners are hyperbolas of the given radius.

    The radius is `rounding`, in the unit of `u`.
    """
    if half_width == 0.0:
        return u
    over, under = u - half_width, u + half_width
    square = rounding * rounding
    return u + 0.5 * (np.sqrt(over * over + square) - np.sqrt(under * under + square))


@_kernel
def edge_flow(coefficient, opening, drop, transition):  # type: ignore[no-untyped-def]
    """Flow over one edge, m^3/s: linear in the drop (Pa) below `transition`, its root above.

    `coefficient` in m^3/(s sqrt(Pa)), `opening` from 0 to 1.
    """
    if opening <= 0.0 or coefficient == 0.0:
        return 0.0
    scale = np.sqrt(np.sqrt(drop * drop + transition * transition))
    return coefficient * opening * drop / scale


@_helper
def _bulk_modulus(pressure, world):  # type: ignore[no-untyped-def]
    """Stiffness of the oil at a gauge pressure, Pa."""
    absolute = pressure + world.atmosphere
    modulus = world.bulk_modulus
    if world.low_pressure_loss > 0.0:
        loss = np.exp(-max(absolute, 0.0) / world.low_pressure_scale)
        modulus *= 1.0 - world.low_pressure_loss * loss
    return modulus


@_helper
def _friction(v, z, cyl):  # type: ignore[no-untyped-def]
    """Friction force against the motion, N, and the bristle's rate, m/s."""
    force = cyl.viscous * v
    if cyl.coulomb == 0.0:
        return force, 0.0
    ratio = v / cyl.stribeck_velocity
    steady = cyl.coulomb
    if ratio * ratio < 40.0:
        steady += (cyl.static - cyl.coulomb) * np.exp(-ratio * ratio)
    rate = v - cyl.bristle * abs(v) * z / steady
    return force + cyl.bristle * z + cyl.bristle_damping * rate, rate


@_helper
def _stop_force(x, v, lower, upper):  # type: ignore[no-untyped-def]
    """Force of the end stops, positive towards larger x, N or N m; never pulls."""
    if x < lower:
        return max(STOP_STIFFNESS * (lower - x) - STOP_DAMPING * v, 0.0)
    if x > upper:
        return min(STOP_STIFFNESS * (upper - x) - STOP_DAMPING * v, 0.0)
    return 0.0


@_helper
def _spool_rates(asked, position, speed, cyl):  # type: ignore[no-untyped-def]
    """Rates of spool position and speed towards the asked position."""
    rate, limit = cyl.spool_rate, cyl.spool_limit
    moving = min(max(speed, -limit), limit)
    if (position >= 1.0 and moving > 0.0) or (position <= -1.0 and moving < 0.0):
        moving = 0.0
    acceleration = rate * rate * (asked - position) - 2.0 * cyl.spool_damping * rate * moving
    # Past the speed limit the drive pushes no further.
    if (speed > limit and acceleration > 0.0) or (speed < -limit and acceleration < 0.0):
        acceleration = 0.0
    return moving, acceleration


@_helper
def _line_rates(p_s, p_t, drawn, returned, pump, world):  # type: ignore[no-untyped-def]
    """Rates of supply and tank pressure for the flows drawn and returned, Pa/s."""
    drawn, returned = max(drawn, 0.0), max(returned, 0.0)
    target, back = 0.0, world.tank_resistance * returned * returned
    if pump:
        target = world.supply - world.droop * drawn - world.droop_quadratic * drawn * drawn
        back += world.tank
        if world.supply_ripple != 0.0:
            target += world.supply_ripple * np.sin(world.supply_ripple_rate * world.time)
    return (max(target, 0.0) - p_s) / world.droop_lag, (back - p_t) / world.tank_lag


@_helper
def _sign(v, cyl):  # type: ignore[no-untyped-def]
    """Smooth sign of a velocity."""
    return v / np.sqrt(v * v + cyl.sign_velocity * cyl.sign_velocity)


@_helper
def _extra_force(x, v, p_a, p_b, q, qd, cyl, time):  # type: ignore[no-untyped-def]
    """What pulls at the piston beside friction, stops and oil, N, positive against +v."""
    sign, speed = _sign(v, cyl), abs(v)
    level = cyl.seal * (max(p_a, 0.0) + 0.7 * max(p_b, 0.0))
    level += cyl.turbulent * speed**1.75
    if cyl.slow_force != 0.0:
        ratio = v / cyl.slow_velocity
        level += cyl.slow_force / (1.0 + ratio * ratio)
    if cyl.local_force != 0.0:
        ratio = (x - cyl.local_center) / cyl.local_width
        level += cyl.local_force * np.exp(-ratio * ratio)
    if cyl.pin_radius != 0.0:
        oil = p_a * cyl.area_a - p_b * cyl.area_b
        level += cyl.pin_radius * abs(oil / cyl.lever)
    if (
        cyl.drag_force != 0.0
        and np.sin(cyl.drag_rate * time) + np.sin(1.7 * cyl.drag_rate * time) > 0.3
    ):
        level += cyl.drag_force
    pull = level * sign + cyl.even_force * sign * sign + cyl.even_viscous * v * sign
    pull += cyl.offset_force
    if cyl.cooling != 0.0:
        pull -= cyl.cooling * (1.0 - np.exp(-time / cyl.cooling_time)) * v
    if cyl.gas_force != 0.0:
        pull -= cyl.gas_force * (1.0 + max(x, 0.0) / cyl.full_stroke) ** -1.3
    if cyl.vibration_force != 0.0:
        pull -= cyl.vibration_force * np.sin(cyl.vibration_rate * time)
    torque = 0.0
    if cyl.ripple_torque != 0.0:
        torque += cyl.ripple_torque * np.cos(cyl.ripple_count * q[cyl.joint] + cyl.ripple_phase)
    if cyl.coupling != 0.0:
        rate = qd[int(cyl.coupling_joint)]
        torque += cyl.coupling * rate / np.sqrt(1.0 + rate * rate)
    return pull + torque / cyl.lever - cyl.disturbance


@_helper
def _balance(inflow, coefficient, opening, drop, pilot, cyl):  # type: ignore[no-untyped-def]
    """Outflow of chamber A over its edge and the load-holding valve in series, m^3/s."""
    share = min(max((pilot - cyl.balance_pressure) / cyl.balance_range, 0.0), 1.0)
    share = share * share * (3.0 - 2.0 * share)
    edge = coefficient * opening
    valve = cyl.balance_flow * max(share, 1.0e-4)
    if drop <= 0.0 or edge <= 0.0:
        return inflow
    return inflow / np.sqrt(1.0 + edge * edge / (valve * valve))


@_helper
def _extra_flows(q_pa, q_at, q_pb, q_bt, opening, p_va, p_vb, p_s, p_t, x, cyl):  # type: ignore[no-untyped-def]
    """The four edge flows with what bends them beyond the square root."""
    if cyl.compensation != 0.0:
        half = 0.5 * cyl.compensation
        q_pa *= (cyl.compensation_pressure / max(p_s - p_va, 1.0e5)) ** half
        q_pb *= (cyl.compensation_pressure / max(p_s - p_vb, 1.0e5)) ** half
    if cyl.balance_flow != 0.0:
        pilot = p_va + cyl.balance_ratio * p_vb
        q_at = _balance(q_at, cyl.c_at, -opening, p_va - p_t, pilot, cyl)
    if cyl.cushion_length > 0.0:
        near = min(max(x / cyl.cushion_length, 0.0), 1.0)
        q_at *= cyl.cushion_share + (1.0 - cyl.cushion_share) * np.sqrt(near)
        near = min(max((cyl.full_stroke - x) / cyl.cushion_length, 0.0), 1.0)
        q_bt *= cyl.cushion_share + (1.0 - cyl.cushion_share) * np.sqrt(near)
    return q_pa, q_at, q_pb, q_bt


@_helper
def _mount_force(bent, cyl):  # type: ignore[no-untyped-def]
    """Force of the spring with play between rod and pin, N."""
    if bent > cyl.mount_gap:
        return cyl.mount_stiffness * (bent - cyl.mount_gap)
    if bent < -cyl.mount_gap:
        return cyl.mount_stiffness * (bent + cyl.mount_gap)
    return 0.0


@_helper
def _contact(links, frames, world, rows, qd, force):  # type: ignore[no-untyped-def]
    """Add the ground's force on the tip."""
    n = links.shape[0]
    frame = frames[n]
    x, y, z = _apply(frame.rotation, world.tip[0], world.tip[1], world.tip[2])
    origin = frame.origin
    depth = world.contact_height - (origin[2] + z)
    if depth <= 0.0:
        return
    _columns(n, origin[0] + x, origin[1] + y, origin[2] + z, links, frames, rows)
    rising = 0.0
    for k in range(n):
        rising += rows[k, 2] * qd[k]
    push = world.contact_stiffness * depth**1.5 * max(1.0 - world.contact_damping * rising, 0.0)
    for k in range(n):
        force[k] += rows[k, 2] * push


@_helper
def _loosen(links, y, first, matrix, force):  # type: ignore[no-untyped-def]
    """Hang part of the load's inertia on springs, before the accelerations are solved for."""
    n = links.shape[0]
    for i in range(n):
        inertia, rate = links[i].flex_inertia, links[i].flex_rate
        if inertia > 0.0:
            bend, speed = y[first + i], y[first + n + i]
            matrix[i, i] -= inertia
            force[i] += inertia * (rate * rate * bend + 2.0 * links[i].flex_damping * rate * speed)


@_helper
def _swing(links, y, first, qdd, out):  # type: ignore[no-untyped-def]
    """Rates of the sprung parts, relative to their joints."""
    n = links.shape[0]
    for i in range(n):
        out[first + i], out[first + n + i] = 0.0, 0.0
        if links[i].flex_inertia > 0.0:
            rate, speed = links[i].flex_rate, y[first + n + i]
            pull = rate * rate * y[first + i] + 2.0 * links[i].flex_damping * rate * speed
            out[first + i], out[first + n + i] = speed, -pull - qdd[i]


@_helper
def _volume(dead, area, swept, full):  # type: ignore[no-untyped-def]
    """Volume of a chamber whose piston is so far from its end."""
    return max(dead + area * swept, min(SMALLEST_VOLUME_M3, _SMALLEST_SHARE * area * full))


@_helper
def _hose(p_v, p, flow, inflow, modulus, cyl):  # type: ignore[no-untyped-def]
    """Rates of the pressure at the valve and of the flow in the hose, damped by its wall."""
    rise = modulus * (inflow - flow) / cyl.line_volume
    return rise, (p_v - p + cyl.line_loss * (inflow - flow)) / cyl.line_inertance


@_kernel
def rates(y, asked, pump, links, frames, cyls, world, jac, matrix, bias, out):  # type: ignore[no-untyped-def]
    """Right-hand side: d/dt of the state laid out as `Plant` says, into `out`."""
    n, m, oil = links.shape[0], cyls.shape[0], world[0]
    q, qd, force = y[:n], y[n : 2 * n], out[n : 2 * n]
    equations_of_motion(q, qd, links, frames, cyls, world, jac, matrix, bias)
    for i in range(n):
        out[i] = qd[i]
        force[i] = -bias[i]
        if links[i].stopped == 1:
            force[i] += _stop_force(q[i], qd[i], links[i].lower, links[i].upper)
    s = 2 * n + 5 * m
    p_s, p_t, drawn, returned = y[s], y[s + 1], 0.0, 0.0
    for i in range(m):
        cyl, a = cyls[i], 2 * n + i
        b, z, p, w = a + m, a + 2 * m, a + 3 * m, a + 4 * m
        spool = asked[i] if cyl.spool_rate == 0.0 else y[p]
        if cyl.extra == 1:
            spool += cyl.shake
        signal = min(max(spool + cyl.null, -1.0), 1.0)
        opening = dead_zone(signal, cyl.deadband, cyl.rounding)
        x, v, p_va, p_vb, back = cyl.x, cyl.v, y[a], y[b], -opening
        if cyl.extra == 1:
            if cyl.hum != 0.0:
                opening += cyl.hum * np.sin(cyl.hum_rate * oil.time)
            opening *= (1.0 + cyl.bend) / (1.0 + cyl.bend * abs(opening))
            back = -opening
            if cyl.underlap > 0.0:
                # Both edges stand open at null; worn rims let them shut gradually.
                near, far, rim = cyl.underlap + opening, cyl.underlap - opening, 0.3 * cyl.underlap
                opening = 0.5 * (near + np.sqrt(near * near + rim * rim))
                back = 0.5 * (far + np.sqrt(far * far + rim * rim))
            if cyl.line_inertance > 0.0:
                h = s + 2 + m + 2 * n + i
                p_va, p_vb = y[h], y[h + 2 * m]
        q_pa = edge_flow(cyl.c_pa, opening, p_s - p_va, cyl.transition)
        q_at = edge_flow(cyl.c_at, back, p_va - p_t, cyl.transition)
        q_pb = edge_flow(cyl.c_pb, back, p_s - p_vb, cyl.transition)
        q_bt = edge_flow(cyl.c_bt, opening, p_vb - p_t, cyl.transition)
        rub, out[z] = _friction(v, y[z], cyl)
        if cyl.extra == 1:
            q_pa, q_at, q_pb, q_bt = _extra_flows(
                q_pa, q_at, q_pb, q_bt, opening, p_va, p_vb, p_s, p_t, x, cyl
            )
            rub += _extra_force(x, v, y[a], y[b], q, qd, cyl, oil.time)
        drawn += q_pa + q_pb
        returned += q_at + q_bt
        in_a, in_b, hold, slip = q_pa - q_at, q_pb - q_bt, 0.0, 0.0
        modulus_a, modulus_b = _bulk_modulus(y[a], oil), _bulk_modulus(y[b], oil)
        if cyl.extra == 1:
            if cyl.line_inertance > 0.0:
                h = s + 2 + m + 2 * n + i
                out[h], out[h + m] = _hose(p_va, y[a], y[h + m], in_a, modulus_a, cyl)
                g = h + 2 * m
                out[g], out[g + m] = _hose(p_vb, y[b], y[g + m], in_b, modulus_b, cyl)
                in_a, in_b = y[h + m], y[g + m]
            if cyl.mount_stiffness > 0.0:
                hold = _mount_force(y[s + 2 + i], cyl)
                drive = y[a] * cyl.area_a - y[b] * cyl.area_b - rub - hold
                slip = drive / (cyl.viscous + cyl.mount_damping)
                out[s + 2 + i] = slip
                x, v = x + y[s + 2 + i], v + slip
            wave = 1.0 + cyl.stiffness_ripple * np.cos(cyl.stiffness_count * x)
            modulus_a, modulus_b = modulus_a * wave, modulus_b * wave
        leak = cyl.leak * (y[a] - y[b])
        volume_a = _volume(cyl.dead_a, cyl.area_a, x, cyl.full_stroke)
        volume_b = _volume(cyl.dead_b, cyl.area_b, cyl.full_stroke - x, cyl.full_stroke)
        net_a = in_a - leak - cyl.leak_a * y[a] - cyl.area_a * v
        net_b = in_b + leak - cyl.leak_b * y[b] + cyl.area_b * v
        out[a] = modulus_a * net_a / volume_a
        out[b] = modulus_b * net_b / volume_b
        out[p], out[w] = 0.0, 0.0
        if cyl.spool_rate > 0.0:
            out[p], out[w] = _spool_rates(asked[i], y[p], y[w], cyl)
        stop = _stop_force(x, v, 0.0, cyl.full_stroke)
        push = y[a] * cyl.area_a - y[b] * cyl.area_b - rub + stop
        if cyl.mount_stiffness > 0.0:
            push = hold + cyl.mount_damping * slip + stop
        force[cyl.joint] += cyl.lever * push
    if oil.extra == 1:
        if oil.contact_stiffness > 0.0:
            _contact(links, frames, oil, jac[0], qd, force)
        _loosen(links, y, s + 2 + m, matrix, force)
    _solve_in_place(matrix, force)
    if oil.extra == 1:
        _swing(links, y, s + 2 + m, force, out)
    out[s], out[s + 1] = _line_rates(p_s, p_t, drawn, returned, pump, oil)


@_kernel
def advance(y, asked, pump, steps, step, links, frames, cyls, world, jac, matrix, bias, work):  # type: ignore[no-untyped-def]
    """Advance `y` in place by fixed steps of the classical Runge-Kutta method.

    `work` is a (3, size) scratch array. The asked spool positions (m,) hold throughout.
    """
    slope, total, probe = work[0], work[1], work[2]
    size, first = y.shape[0], 2 * links.shape[0]
    lowest = VAPOUR_PRESSURE_PA - world[0].atmosphere
    for _ in range(steps):
        rates(y, asked, pump, links, frames, cyls, world, jac, matrix, bias, slope)
        world[0].time += 0.5 * step
        for i in range(size):
            total[i] = slope[i]
            probe[i] = y[i] + 0.5 * step * slope[i]
        rates(probe, asked, pump, links, frames, cyls, world, jac, matrix, bias, slope)
        for i in range(size):
            total[i] += 2.0 * slope[i]
            probe[i] = y[i] + 0.5 * step * slope[i]
        rates(probe, asked, pump, links, frames, cyls, world, jac, matrix, bias, slope)
        for i in range(size):
            total[i] += 2.0 * slope[i]
            probe[i] = y[i] + step * slope[i]
        world[0].time += 0.5 * step
        rates(probe, asked, pump, links, frames, cyls, world, jac, matrix, bias, slope)
        for i in range(size):
            y[i] += step / 6.0 * (total[i] + slope[i])
        for i in range(first, first + 2 * cyls.shape[0]):
            y[i] = max(y[i], lowest)
    for i in range(cyls.shape[0]):
        # A spool without dynamics stands where it is asked to.
        if cyls[i].spool_rate == 0.0:
            y[first + 3 * cyls.shape[0] + i] = asked[i]


@_helper
def _hysteresis(asked, memory, width):  # type: ignore[no-untyped-def]
    """Mean of plays of half widths around `width` (Prandtl and Ishlinskii), memory updated."""
    total, plays = 0.0, memory.shape[0]
    for k in range(plays):
        radius = width * (0.4 + 1.2 * k / (plays - 1))
        memory[k] = min(max(memory[k], asked - radius), asked + radius)
        total += memory[k]
    return total / plays


@_kernel
def cycle(  # type: ignore[no-untyped-def]
    y,
    older,
    newer,
    share,
    memory,
    pump,
    steps,
    cycle_s,
    work,
    links,
    frames,
    cyls,
    world,
    jac,
    matrix,
    bias,
    asked,
):
    """One cycle of a machine with extras: the older command for a share of it, then the newer.

    `asked` (m,) returns what the spools were asked over the cycle, on average.
    """
    m = cyls.shape[0]
    spools = work[3]
    for i in range(m):
        asked[i] = 0.0
    for part in range(2):
        length = share if part == 0 else 1.0 - share
        if length <= 0.0:
            continue
        for i in range(m):
            spools[i] = older[i] if part == 0 else newer[i]
            if cyls[i].hysteresis > 0.0:
                spools[i] = _hysteresis(spools[i], memory[i], cyls[i].hysteresis)
            asked[i] += length * spools[i]
        count = max(1, int(np.ceil(steps * length)))
        span = length * cycle_s / count
        advance(
            y, spools[:m], pump, count, span, links, frames, cyls, world, jac, matrix, bias, work
        )


@_helper
def _servo(i, slow, target, rate, seen, y, gains, cyls, cycle_s, n, p_s, p_t):  # type: ignore[no-untyped-def]
    """Spool position that a plain position servo asks for, with washed-out force feedback."""
    cyl, m = cyls[i], cyls.shape[0]
    p_a, p_b = y[2 * n + i], y[2 * n + m + i]
    force = p_a * cyl.area_a - p_b * cyl.area_b
    slow[i] += cycle_s / gains[i, 2] * (force - slow[i])
    v = cyl.lever * (rate + gains[i, 0] * (target - seen)) - gains[i, 1] * (force - slow[i])
    if v > 0.0:
        u = v * cyl.area_a / (gains[i, 3] * np.sqrt(max(p_s - p_a, 1.0e5)))
    else:
        u = v * cyl.area_a / (gains[i, 4] * np.sqrt(max(p_a - p_t, 1.0e5)))
    return min(max(u, -0.95), 0.95)


@_kernel
def follow(  # type: ignore[no-untyped-def]
    y,
    targets,
    rates_wanted,
    jitter,
    encoder,
    pushes,
    shakes,
    gains,
    delay,
    payload,
    memory,
    steps,
    cycle_s,
    work,
    links,
    frames,
    cyls,
    world,
    jac,
    matrix,
    bias,
    states,
    commands,
    applied,
    seen,
):
    """Drive the machine along joint targets (N, n) by the servo, cycle by cycle, compiled.

    `encoder` (n, 4) has each encoder's offset, swing, swing count and resolution; `jitter` (N, n)
    its noise in counts, `pushes` and `shakes` (N, m) what disturbs pistons and spools, `payload`
    (14,) the cycle from which the last link has another mass, centre of mass and inertia. The
    rest is filled in: states before each cycle, commands, what the spools were asked, positions
    as read.

    `gains` are the servo's, `delay` is that of the commands in cycles, `rates_wanted` the
    targets' velocities; `applied` and `seen` are the last two that are filled.
    """
    count, n, m = targets.shape[0], links.shape[0], cyls.shape[0]
    s, slow = 2 * n + 5 * m, np.zeros(m)
    late = int(np.floor(delay))
    share = delay - late
    older, newer, zero = np.zeros(m), np.zeros(m), np.zeros(m)
    for i in range(m):
        slow[i] = y[2 * n + i] * cyls[i].area_a - y[2 * n + m + i] * cyls[i].area_b
    for k in range(count):
        equations_of_motion(y[:n], y[n : 2 * n], links, frames, cyls, world, jac, matrix, bias)
        for j in range(y.shape[0]):
            states[k, j] = y[j]
        for j in range(n):
            shown = y[j] + encoder[j, 0] + encoder[j, 1] * np.sin(encoder[j, 2] * y[j])
            seen[k, j] = np.rint(shown / encoder[j, 3] + jitter[k, j]) * encoder[j, 3]
        for i in range(m):
            j = cyls[i].joint
            commands[k, i] = _servo(
                i, slow, targets[k, j], rates_wanted[k, j], seen[k, j], y, gains, cyls, cycle_s, n,
                y[s], y[s + 1],
            )  # fmt: skip
            cyls[i].disturbance, cyls[i].shake = pushes[k, i], shakes[k, i]
            newer[i] = commands[k - late, i] if k >= late else zero[i]
            older[i] = commands[k - late - 1, i] if k > late else zero[i]
        if k == payload[0]:
            _exchange(links[n - 1], payload)
        cycle(
            y, older, newer, share, memory, True, steps, cycle_s, work, links, frames, cyls, world,
            jac, matrix, bias, applied[k],
        )  # fmt: skip


@_helper
def _exchange(link, payload):  # type: ignore[no-untyped-def]
    """Give the last link another mass, centre of mass and inertia."""
    link.mass = payload[1]
    for a in range(3):
        link.com[a] = payload[2 + a]
        for b in range(3):
            link.inertia[a, b] = payload[5 + 3 * a + b]


@_kernel
def rates_along(  # type: ignore[no-untyped-def]
    states, asked, start_s, cycle_s, links, frames, cyls, world, jac, matrix, bias, out
):
    """`rates` at the states (N, size) of a run, the first at `start_s`, without disturbance."""
    for i in range(cyls.shape[0]):
        cyls[i].disturbance, cyls[i].shake = 0.0, 0.0
    for k in range(states.shape[0]):
        world[0].time = start_s + k * cycle_s
        rates(states[k], asked[k], True, links, frames, cyls, world, jac, matrix, bias, out[k])


@_kernel
def balances(  # type: ignore[no-untyped-def]
    q,
    qd,
    qdd,
    p_a,
    p_b,
    rise_a,
    rise_b,
    lines,
    asked,
    links,
    frames,
    cyls,
    world,
    jac,
    matrix,
    bias,
    out,
):
    """What is left of the balances of a machine without extras when signals are put into it.

    Signals are (N, n) and (N, m), supply and tank in `lines` (N, 2); `out` (N, 3 m) holds per
    cylinder the force (N, oil less load and viscous friction) and the flows into chambers A and
    B (m^3/s, valve less displacement and compression).

    `rise_a` and `rise_b` are the chamber pressures' rates, Pa/s.
    """
    n, m, oil = links.shape[0], cyls.shape[0], world[0]
    for k in range(q.shape[0]):
        equations_of_motion(q[k], qd[k], links, frames, cyls, world, jac, matrix, bias)
        p_s, p_t = lines[k, 0], lines[k, 1]
        for i in range(m):
            cyl = cyls[i]
            j = cyl.joint
            load = bias[j]
            for c in range(n):
                load += (matrix[j, c] if c <= j else matrix[c, j]) * qdd[k, c]
            a, b, x, v = p_a[k, i], p_b[k, i], cyl.x, cyl.v
            oil_force = a * cyl.area_a - b * cyl.area_b
            out[k, 3 * i] = oil_force - cyl.viscous * v - load / cyl.lever
            u = min(max(asked[k, i] + cyl.null, -1.0), 1.0)
            in_a = edge_flow(cyl.c_pa, u, p_s - a, cyl.transition)
            in_a -= edge_flow(cyl.c_at, -u, a - p_t, cyl.transition)
            in_b = edge_flow(cyl.c_pb, -u, p_s - b, cyl.transition)
            in_b -= edge_flow(cyl.c_bt, u, b - p_t, cyl.transition)
            volume_a = _volume(cyl.dead_a, cyl.area_a, x, cyl.full_stroke)
            volume_b = _volume(cyl.dead_b, cyl.area_b, cyl.full_stroke - x, cyl.full_stroke)
            stored_a = volume_a / _bulk_modulus(a, oil) * rise_a[k, i]
            stored_b = volume_b / _bulk_modulus(b, oil) * rise_b[k, i]
            out[k, 3 * i + 1] = in_a - cyl.area_a * v - stored_a
            out[k, 3 * i + 2] = in_b + cyl.area_b * v - stored_b
