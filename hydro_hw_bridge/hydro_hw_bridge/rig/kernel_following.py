"""The compiled truth plant along whole runs: under a plain servo, and what its balances leave.

Arguments as in `hydro_hw_bridge.rig.kernel_records`.
"""

from __future__ import annotations

import numpy as np

from hydro_hw_bridge.rig.compiled import allocating, compiled, inlined
from hydro_hw_bridge.rig.kernel import cycle, rates
from hydro_hw_bridge.rig.kernel_bodies import equations_of_motion
from hydro_hw_bridge.rig.kernel_hydraulics import bulk_modulus, chamber_volumes, valve_flows


@inlined
def _read_encoders(y, encoder, jitter, seen):  # type: ignore[no-untyped-def]
    """Joint positions as the encoders show them."""
    for j in range(seen.shape[0]):
        shown = y[j] + encoder[j, 0] + encoder[j, 1] * np.sin(encoder[j, 2] * y[j])
        seen[j] = np.rint(shown / encoder[j, 3] + jitter[j]) * encoder[j, 3]


@inlined
def _servo(i, slow, target, rate, seen, y, gains, cyls, cycle_s, n):  # type: ignore[no-untyped-def]
    """Spool position that a plain position servo asks for, with washed-out force feedback."""
    cyl, m = cyls[i], cyls.shape[0]
    p_a, p_b, p_s, p_t = y[2 * n + i], y[2 * n + m + i], y[2 * n + 5 * m], y[2 * n + 5 * m + 1]
    force = p_a * cyl.area_a - p_b * cyl.area_b
    slow[i] += cycle_s / gains[i, 2] * (force - slow[i])
    v = cyl.lever * (rate + gains[i, 0] * (target - seen)) - gains[i, 1] * (force - slow[i])
    if v > 0.0:
        u = v * cyl.area_a / (gains[i, 3] * np.sqrt(max(p_s - p_a, 1.0e5)))
    else:
        u = v * cyl.area_a / (gains[i, 4] * np.sqrt(max(p_a - p_t, 1.0e5)))
    return min(max(u, -0.95), 0.95)


@inlined
def _exchange(link, payload):  # type: ignore[no-untyped-def]
    """Give the last link another mass, centre of mass and inertia."""
    link.mass = payload[1]
    for a in range(3):
        link.com[a] = payload[2 + a]
        for b in range(3):
            link.inertia[a, b] = payload[5 + 3 * a + b]


@allocating
def follow(  # type: ignore[no-untyped-def]
    y, targets, rates_wanted, jitter, encoder, pushes, shakes, gains, delay, payload, memory,
    steps, cycle_s, work, links, frames, cyls, world, jac, matrix, bias, states, commands,
    applied, seen,
):  # fmt: skip
    """Drive the machine along joint targets (N, n) by the servo, cycle by cycle, compiled.

    `encoder` (n, 4) has each encoder's offset, swing, swing count and resolution; `jitter` (N, n)
    its noise in counts, `pushes` and `shakes` (N, m) what disturbs pistons and spools, `payload`
    (14,) the cycle from which the last link has another mass, centre of mass and inertia.
    `gains` are the servo's, `delay` is that of the commands in cycles, `rates_wanted` the
    targets' velocities, `memory` that of the plays. Filled in: `states` before each cycle,
    `commands`, what the spools were asked (`applied`), positions as read (`seen`).
    """
    count, n, m = targets.shape[0], links.shape[0], cyls.shape[0]
    slow, older, newer = np.zeros(m), np.zeros(m), np.zeros(m)
    late = int(np.floor(delay))
    share = delay - late
    for i in range(m):
        slow[i] = y[2 * n + i] * cyls[i].area_a - y[2 * n + m + i] * cyls[i].area_b
    for k in range(count):
        equations_of_motion(y[:n], y[n : 2 * n], links, frames, cyls, world, jac, matrix, bias)
        for j in range(y.shape[0]):
            states[k, j] = y[j]
        _read_encoders(y, encoder, jitter[k], seen[k])
        for i in range(m):
            j = cyls[i].joint
            commands[k, i] = _servo(
                i, slow, targets[k, j], rates_wanted[k, j], seen[k, j], y, gains, cyls, cycle_s, n
            )
            cyls[i].disturbance, cyls[i].shake = pushes[k, i], shakes[k, i]
            newer[i] = commands[k - late, i] if k >= late else 0.0
            older[i] = commands[k - late - 1, i] if k > late else 0.0
        if k == payload[0]:
            _exchange(links[n - 1], payload)
        cycle(
            y, older, newer, share, memory, True, steps, cycle_s, work, links, frames, cyls, world,
            jac, matrix, bias, applied[k],
        )  # fmt: skip


@compiled
def rates_along(  # type: ignore[no-untyped-def]
    states, asked, start_s, cycle_s, links, frames, cyls, world, jac, matrix, bias, out
):
    """`rates` at the states (N, size) of a run, the first at `start_s`, without disturbance."""
    for i in range(cyls.shape[0]):
        cyls[i].disturbance, cyls[i].shake = 0.0, 0.0
    for k in range(states.shape[0]):
        world[0].time = start_s + k * cycle_s
        rates(states[k], asked[k], True, links, frames, cyls, world, jac, matrix, bias, out[k])


@compiled
def balances(  # type: ignore[no-untyped-def]
    q, qd, qdd, p_a, p_b, rise_a, rise_b, lines, asked, links, frames, cyls, world, jac, matrix,
    bias, out,
):  # fmt: skip
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
            q_pa, q_at, q_pb, q_bt = valve_flows(u, -u, a, b, p_s, p_t, cyl)
            volume_a, volume_b = chamber_volumes(x, cyl)
            stored_a = volume_a / bulk_modulus(a, oil) * rise_a[k, i]
            stored_b = volume_b / bulk_modulus(b, oil) * rise_b[k, i]
            out[k, 3 * i + 1] = q_pa - q_at - cyl.area_a * v - stored_a
            out[k, 3 * i + 2] = q_pb - q_bt + cyl.area_b * v - stored_b
