"""Oil of the compiled truth plant: spool, edges, chambers, hoses, supply and tank line.

The forms differ on purpose from those of hydro_model: rounded dead zone, laminar-turbulent
edges, spool with a speed limit. Arguments as in `hydro_hw_bridge.rig.kernel_records`.
"""

from __future__ import annotations

import numpy as np

from hydro_hw_bridge.rig.compiled import compiled, inlined

#: Swept volume below which a chamber is not allowed to shrink, and its largest share of what the
#: piston sweeps: keeps the oil's stiffness within what the fixed step integrates, and lies beyond
#: the joint limits of a sound machine, small cylinders' too.
_SMALLEST_VOLUME_M3, _SMALLEST_SHARE = 2.0e-4, 0.05


@compiled
def dead_zone(u, half_width, rounding):  # type: ignore[no-untyped-def]
    """Opening of a spool with overlap: 0 inside +-half_width, ``|u| - half_width`` outside.

    Smooth: the corners are hyperbolas of the radius `rounding`, in the unit of `u`.
    """
    if half_width == 0.0:
        return u
    over, under = u - half_width, u + half_width
    square = rounding * rounding
    return u + 0.5 * (np.sqrt(over * over + square) - np.sqrt(under * under + square))


@compiled
def edge_flow(coefficient, opening, drop, transition):  # type: ignore[no-untyped-def]
    """Flow over one edge, m^3/s: linear in the drop (Pa) below `transition`, its root above.

    `coefficient` in m^3/(s sqrt(Pa)), `opening` from 0 to 1.
    """
    if opening <= 0.0 or coefficient == 0.0:
        return 0.0
    scale = np.sqrt(np.sqrt(drop * drop + transition * transition))
    return coefficient * opening * drop / scale


@inlined
def spool_openings(spool, cyl, time):  # type: ignore[no-untyped-def]
    """Openings of the edges P-A and B-T, and of the edges A-T and P-B, at a spool position."""
    if cyl.extra == 1:
        spool += cyl.shake
    signal = min(max(spool + cyl.null, -1.0), 1.0)
    opening = dead_zone(signal, cyl.deadband, cyl.rounding)
    back = -opening
    if cyl.extra == 1:
        if cyl.hum != 0.0:
            opening += cyl.hum * np.sin(cyl.hum_rate * time)
        opening *= (1.0 + cyl.bend) / (1.0 + cyl.bend * abs(opening))
        back = -opening
        if cyl.underlap > 0.0:
            # Both edges stand open at null; worn rims let them shut gradually.
            near, far, rim = cyl.underlap + opening, cyl.underlap - opening, 0.3 * cyl.underlap
            opening = 0.5 * (near + np.sqrt(near * near + rim * rim))
            back = 0.5 * (far + np.sqrt(far * far + rim * rim))
    return opening, back


@inlined
def valve_flows(opening, back, p_va, p_vb, p_s, p_t, cyl):  # type: ignore[no-untyped-def]
    """Flows P-A, A-T, P-B and B-T over edges that are open by `opening` and by `back`."""
    return (
        edge_flow(cyl.c_pa, opening, p_s - p_va, cyl.transition),
        edge_flow(cyl.c_at, back, p_va - p_t, cyl.transition),
        edge_flow(cyl.c_pb, back, p_s - p_vb, cyl.transition),
        edge_flow(cyl.c_bt, opening, p_vb - p_t, cyl.transition),
    )


@inlined
def _balance(inflow, coefficient, opening, drop, pilot, cyl):  # type: ignore[no-untyped-def]
    """Outflow of chamber A over its edge and the load-holding valve in series, m^3/s."""
    share = min(max((pilot - cyl.balance_pressure) / cyl.balance_range, 0.0), 1.0)
    share = share * share * (3.0 - 2.0 * share)
    edge = coefficient * opening
    valve = cyl.balance_flow * max(share, 1.0e-4)
    if drop <= 0.0 or edge <= 0.0:
        return inflow
    return inflow / np.sqrt(1.0 + edge * edge / (valve * valve))


@inlined
def bend_flows(q_pa, q_at, q_pb, q_bt, opening, p_va, p_vb, p_s, p_t, x, cyl):  # type: ignore[no-untyped-def]
    """Edge flows `q_pa`, `q_at`, `q_pb`, `q_bt` with what bends them beyond the square root.

    `opening` is that of the edges P-A and B-T.
    """
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


@inlined
def spool_rates(asked, position, speed, cyl):  # type: ignore[no-untyped-def]
    """Rates of spool `position` and `speed` towards the asked position."""
    rate, limit = cyl.spool_rate, cyl.spool_limit
    moving = min(max(speed, -limit), limit)
    if (position >= 1.0 and moving > 0.0) or (position <= -1.0 and moving < 0.0):
        moving = 0.0
    acceleration = rate * rate * (asked - position) - 2.0 * cyl.spool_damping * rate * moving
    # Past the speed limit the drive pushes no further.
    if (speed > limit and acceleration > 0.0) or (speed < -limit and acceleration < 0.0):
        acceleration = 0.0
    return moving, acceleration


@inlined
def bulk_modulus(pressure, oil):  # type: ignore[no-untyped-def]
    """Stiffness of the oil at a gauge `pressure`, Pa."""
    absolute = pressure + oil.atmosphere
    modulus = oil.bulk_modulus
    if oil.low_pressure_loss > 0.0:
        loss = np.exp(-max(absolute, 0.0) / oil.low_pressure_scale)
        modulus *= 1.0 - oil.low_pressure_loss * loss
    return modulus


@inlined
def _volume(dead, area, swept, full):  # type: ignore[no-untyped-def]
    """Volume of a chamber whose piston is so far from its end."""
    return max(dead + area * swept, min(_SMALLEST_VOLUME_M3, _SMALLEST_SHARE * area * full))


@inlined
def chamber_volumes(x, cyl):  # type: ignore[no-untyped-def]
    """Volumes of the chambers A and B, m^3."""
    return (
        _volume(cyl.dead_a, cyl.area_a, x, cyl.full_stroke),
        _volume(cyl.dead_b, cyl.area_b, cyl.full_stroke - x, cyl.full_stroke),
    )


@inlined
def chamber_rates(in_a, in_b, modulus_a, modulus_b, x, v, p_a, p_b, cyl):  # type: ignore[no-untyped-def]
    """Rates of the chambers' pressures, Pa/s, for the flows `in_a` and `in_b` into them.

    `modulus_a` and `modulus_b` are the oil's stiffnesses.
    """
    leak = cyl.leak * (p_a - p_b)
    volume_a, volume_b = chamber_volumes(x, cyl)
    net_a = in_a - leak - cyl.leak_a * p_a - cyl.area_a * v
    net_b = in_b + leak - cyl.leak_b * p_b + cyl.area_b * v
    return modulus_a * net_a / volume_a, modulus_b * net_b / volume_b


@inlined
def hose_rates(p_v, p, flow, inflow, modulus, cyl):  # type: ignore[no-untyped-def]
    """Rates of the pressure at the valve, `p_v`, and of the flow in the hose, damped by its wall.

    `inflow` comes from the valve, `p` is the chamber's pressure, `modulus` the oil's stiffness.
    """
    rise = modulus * (inflow - flow) / cyl.line_volume
    return rise, (p_v - p + cyl.line_loss * (inflow - flow)) / cyl.line_inertance


@inlined
def line_rates(p_s, p_t, drawn, returned, pump, oil):  # type: ignore[no-untyped-def]
    """Rates of supply and tank pressure for the flows drawn and returned, Pa/s."""
    drawn, returned = max(drawn, 0.0), max(returned, 0.0)
    target, back = 0.0, oil.tank_resistance * returned * returned
    if pump:
        target = oil.supply - oil.droop * drawn - oil.droop_quadratic * drawn * drawn
        back += oil.tank
        if oil.supply_ripple != 0.0:
            target += oil.supply_ripple * np.sin(oil.supply_ripple_rate * oil.time)
    return (max(target, 0.0) - p_s) / oil.droop_lag, (back - p_t) / oil.tank_lag
