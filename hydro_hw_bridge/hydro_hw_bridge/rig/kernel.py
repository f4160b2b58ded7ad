"""The compiled truth plant: rates of its state, and its way through a cycle.

Arguments as in `hydro_hw_bridge.rig.kernel_records`.
"""

from __future__ import annotations

import numpy as np

from hydro_hw_bridge.rig.compiled import compiled, inlined
from hydro_hw_bridge.rig.kernel_bodies import equations_of_motion, solve_in_place
from hydro_hw_bridge.rig.kernel_forces import (
    add_contact,
    extra_force,
    friction,
    loosen,
    mounted,
    stop_force,
    swing,
)
from hydro_hw_bridge.rig.kernel_hydraulics import (
    bend_flows,
    bulk_modulus,
    chamber_rates,
    hose_rates,
    line_rates,
    spool_openings,
    spool_rates,
    valve_flows,
)

#: Absolute pressure below which oil boils: no chamber falls under it. The cavity's volume is not
#: remembered, so a cavity collapses at once when oil flows in again.
_VAPOUR_PRESSURE_PA = 2.0e3


@inlined
def _fill_hoses(h, m, y, in_a, in_b, modulus_a, modulus_b, p_a, p_b, cyl, out):  # type: ignore[no-untyped-def]
    """Fill the rates of a cylinder's two hoses; return what flows out of them."""
    g = h + 2 * m
    out[h], out[h + m] = hose_rates(y[h], p_a, y[h + m], in_a, modulus_a, cyl)
    out[g], out[g + m] = hose_rates(y[g], p_b, y[g + m], in_b, modulus_b, cyl)
    return y[h + m], y[g + m]


@inlined
def _cylinder_rates(i, n, m, y, asked, q, qd, cyl, oil, out):  # type: ignore[no-untyped-def]
    """Fill the rates of a cylinder's own states.

    Return the flows that it draws and returns, m^3/s, and its force on the joint's lever, N.
    """
    a, s = 2 * n + i, 2 * n + 5 * m
    b, z, p, w = a + m, a + 2 * m, a + 3 * m, a + 4 * m
    h = s + 2 + m + 2 * n + i
    p_s, p_t, p_a, p_b, x, v = y[s], y[s + 1], y[a], y[b], cyl.x, cyl.v
    p_va, p_vb = p_a, p_b
    if cyl.extra == 1 and cyl.line_inertance > 0.0:
        p_va, p_vb = y[h], y[h + 2 * m]
    spool = asked if cyl.spool_rate == 0.0 else y[p]
    opening, back = spool_openings(spool, cyl, oil.time)
    q_pa, q_at, q_pb, q_bt = valve_flows(opening, back, p_va, p_vb, p_s, p_t, cyl)
    rub, out[z] = friction(v, y[z], cyl)
    if cyl.extra == 1:
        q_pa, q_at, q_pb, q_bt = bend_flows(
            q_pa, q_at, q_pb, q_bt, opening, p_va, p_vb, p_s, p_t, x, cyl
        )
        rub += extra_force(x, v, p_a, p_b, q, qd, cyl, oil.time)
    in_a, in_b = q_pa - q_at, q_pb - q_bt
    modulus_a, modulus_b = bulk_modulus(p_a, oil), bulk_modulus(p_b, oil)
    if cyl.extra == 1 and cyl.line_inertance > 0.0:
        in_a, in_b = _fill_hoses(h, m, y, in_a, in_b, modulus_a, modulus_b, p_a, p_b, cyl, out)
    push = p_a * cyl.area_a - p_b * cyl.area_b - rub
    if cyl.extra == 1:
        if cyl.mount_stiffness > 0.0:
            bent = s + 2 + i
            push, out[bent] = mounted(y[bent], push, cyl)
            x, v = x + y[bent], v + out[bent]
        wave = 1.0 + cyl.stiffness_ripple * np.cos(cyl.stiffness_count * x)
        modulus_a, modulus_b = modulus_a * wave, modulus_b * wave
    out[a], out[b] = chamber_rates(in_a, in_b, modulus_a, modulus_b, x, v, p_a, p_b, cyl)
    out[p], out[w] = 0.0, 0.0
    if cyl.spool_rate > 0.0:
        out[p], out[w] = spool_rates(asked, y[p], y[w], cyl)
    return q_pa + q_pb, q_at + q_bt, push + stop_force(x, v, 0.0, cyl.full_stroke)


@compiled
def rates(y, asked, pump, links, frames, cyls, world, jac, matrix, bias, out):  # type: ignore[no-untyped-def]
    """Right-hand side: d/dt of the state laid out as `Plant` says, into `out`."""
    n, m, oil = links.shape[0], cyls.shape[0], world[0]
    q, qd, force = y[:n], y[n : 2 * n], out[n : 2 * n]
    equations_of_motion(q, qd, links, frames, cyls, world, jac, matrix, bias)
    for i in range(n):
        out[i] = qd[i]
        force[i] = -bias[i]
        if links[i].stopped == 1:
            force[i] += stop_force(q[i], qd[i], links[i].lower, links[i].upper)
    drawn, returned = 0.0, 0.0
    for i in range(m):
        cyl = cyls[i]
        from_supply, to_tank, push = _cylinder_rates(i, n, m, y, asked[i], q, qd, cyl, oil, out)
        drawn += from_supply
        returned += to_tank
        force[cyl.joint] += cyl.lever * push
    s, sprung = 2 * n + 5 * m, 2 * n + 6 * m + 2
    if oil.extra == 1:
        if oil.contact_stiffness > 0.0:
            add_contact(links, frames, oil, jac[0], qd, force)
        loosen(links, y, sprung, matrix, force)
    solve_in_place(matrix, force)
    if oil.extra == 1:
        swing(links, y, sprung, force, out)
    out[s], out[s + 1] = line_rates(y[s], y[s + 1], drawn, returned, pump, oil)


@compiled
def advance(y, asked, pump, steps, step, links, frames, cyls, world, jac, matrix, bias, work):  # type: ignore[no-untyped-def]
    """Advance `y` in place by fixed steps of the classical Runge-Kutta method.

    `work` is a (3, size) scratch array. The asked spool positions (m,) hold throughout.
    """
    slope, total, probe = work[0], work[1], work[2]
    size, first = y.shape[0], 2 * links.shape[0]
    lowest = _VAPOUR_PRESSURE_PA - world[0].atmosphere
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


@inlined
def _hysteresis(asked, memory, width):  # type: ignore[no-untyped-def]
    """Mean of plays of half widths around `width` (Prandtl and Ishlinskii), memory updated."""
    total, plays = 0.0, memory.shape[0]
    for k in range(plays):
        radius = width * (0.4 + 1.2 * k / (plays - 1))
        memory[k] = min(max(memory[k], asked - radius), asked + radius)
        total += memory[k]
    return total / plays


@compiled
def cycle(  # type: ignore[no-untyped-def]
    y, older, newer, share, memory, pump, steps, cycle_s, work, links, frames, cyls, world,
    jac, matrix, bias, asked,
):  # fmt: skip
    """One cycle of a machine with extras: the older command for a share of it, then the newer.

    `asked` (m,) returns what the spools were asked over the cycle, on average; `memory` is that
    of the plays.
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
