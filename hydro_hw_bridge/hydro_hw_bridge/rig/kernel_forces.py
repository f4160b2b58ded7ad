"""Forces of the compiled truth plant beside oil and inertia: friction, stops, springs, ground.

Friction is a bristle's; the other forms are described in `hydro_hw_bridge.rig.extras`. Arguments
as in `hydro_hw_bridge.rig.kernel_records`.
"""

from __future__ import annotations

import numpy as np

from hydro_hw_bridge.rig.compiled import inlined
from hydro_hw_bridge.rig.kernel_frames import apply, point_columns

#: Piston against the cylinder's end, or a joint without a cylinder against its limit.
_STOP_STIFFNESS = 5.0e7
_STOP_DAMPING = 5.0e5
#: What is left of a mount's damper while its pin touches neither side, N s/m.
_LOOSE_DAMPING = 2.0e4


@inlined
def friction(v, z, cyl):  # type: ignore[no-untyped-def]
    """Friction force against the motion, N, and the rate of the bristle's bend `z`, m/s."""
    force = cyl.viscous * v
    if cyl.coulomb == 0.0:
        return force, 0.0
    ratio = v / cyl.stribeck_velocity
    steady = cyl.coulomb
    if ratio * ratio < 40.0:
        steady += (cyl.static - cyl.coulomb) * np.exp(-ratio * ratio)
    rate = v - cyl.bristle * abs(v) * z / steady
    return force + cyl.bristle * z + cyl.bristle_damping * rate, rate


@inlined
def stop_force(x, v, lower, upper):  # type: ignore[no-untyped-def]
    """Force of the end stops, positive towards larger `x`, N or N m; never pulls.

    The ends are `lower` and `upper`.
    """
    if x < lower:
        return max(_STOP_STIFFNESS * (lower - x) - _STOP_DAMPING * v, 0.0)
    if x > upper:
        return min(_STOP_STIFFNESS * (upper - x) - _STOP_DAMPING * v, 0.0)
    return 0.0


@inlined
def _sign(v, cyl):  # type: ignore[no-untyped-def]
    """Smooth sign of a velocity."""
    return v / np.sqrt(v * v + cyl.sign_velocity * cyl.sign_velocity)


@inlined
def extra_force(x, v, p_a, p_b, q, qd, cyl, time):  # type: ignore[no-untyped-def]
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


@inlined
def _spring(bent, cyl):  # type: ignore[no-untyped-def]
    """Force of the spring with play between rod and pin, N."""
    if bent > cyl.mount_gap:
        return cyl.mount_stiffness * (bent - cyl.mount_gap)
    if bent < -cyl.mount_gap:
        return cyl.mount_stiffness * (bent + cyl.mount_gap)
    return 0.0


@inlined
def mounted(bent, push, cyl):  # type: ignore[no-untyped-def]
    """What a mount, `bent` by so much, passes on of a piston's `push`, N; the bend's rate, m/s."""
    hold = _spring(bent, cyl)
    damping = cyl.mount_damping if abs(bent) >= cyl.mount_gap else _LOOSE_DAMPING
    slip = (push - hold) / (cyl.viscous + damping)
    return hold + damping * slip, slip


@inlined
def add_contact(links, frames, oil, rows, qd, force):  # type: ignore[no-untyped-def]
    """Add the ground's force on the tip."""
    n = links.shape[0]
    frame = frames[n]
    x, y, z = apply(frame.rotation, oil.tip[0], oil.tip[1], oil.tip[2])
    origin = frame.origin
    depth = oil.contact_height - (origin[2] + z)
    if depth <= 0.0:
        return
    point_columns(n, origin[0] + x, origin[1] + y, origin[2] + z, links, frames, rows)
    rising = 0.0
    for k in range(n):
        rising += rows[k, 2] * qd[k]
    push = oil.contact_stiffness * depth**1.5 * max(1.0 - oil.contact_damping * rising, 0.0)
    for k in range(n):
        force[k] += rows[k, 2] * push


@inlined
def loosen(links, y, first, matrix, force):  # type: ignore[no-untyped-def]
    """Hang part of the load's inertia on springs, before the accelerations are solved for.

    `first` is where the springs' angles, then their rates, stand in `y`.
    """
    n = links.shape[0]
    for i in range(n):
        inertia, rate = links[i].flex_inertia, links[i].flex_rate
        if inertia > 0.0:
            bend, speed = y[first + i], y[first + n + i]
            matrix[i, i] -= inertia
            force[i] += inertia * (rate * rate * bend + 2.0 * links[i].flex_damping * rate * speed)


@inlined
def swing(links, y, first, qdd, out):  # type: ignore[no-untyped-def]
    """Rates of the sprung parts, relative to their joints; `first` as in `loosen`."""
    n = links.shape[0]
    for i in range(n):
        out[first + i], out[first + n + i] = 0.0, 0.0
        if links[i].flex_inertia > 0.0:
            rate, speed = links[i].flex_rate, y[first + n + i]
            pull = rate * rate * y[first + i] + 2.0 * links[i].flex_damping * rate * speed
            out[first + i], out[first + n + i] = speed, -pull - qdd[i]
