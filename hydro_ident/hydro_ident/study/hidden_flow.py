"""Effects that show in the mass balances of the chambers, as the truth plant has them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from hydro_ident.study.hidden import (
    FLOW_M3_S,
    PRESSURE_PA,
    Hidden,
    Machine,
    Scene,
    axis,
    cylinder,
    sign,
    unrecorded,
    valve,
    with_truth,
)

Random = np.random.Generator


def _deadband(m: Machine, s: Scene, i: int, size: float, r: Random) -> Machine:
    return valve(m, i, deadband=size, deadband_rounding=size * r.uniform(0.05, 0.2))


def _underlap(m: Machine, s: Scene, i: int, size: float, r: Random) -> Machine:
    return axis(m, i, underlap=size)


def _null(m: Machine, s: Scene, i: int, size: float, r: Random) -> Machine:
    return valve(m, i, null_bias=size * sign(r))


def _bend(m: Machine, s: Scene, i: int, size: float, r: Random) -> Machine:
    # Saturating or progressive: either way the opening is off by `size` at half signal.
    if r.random() < 0.5:
        return axis(m, i, bend=2.0 * size / (1.0 - size))
    return axis(m, i, bend=-2.0 * size / (1.0 + size))


def _lag(m: Machine, s: Scene, i: int, size: float, r: Random) -> Machine:
    damping = r.uniform(0.6, 1.1)
    frequency = damping / (np.pi * size)
    return valve(
        m,
        i,
        natural_frequency_hz=float(frequency),
        damping_ratio=float(damping),
        rate_limit_1_s=1.0e3,
    )


def _slew(m: Machine, s: Scene, i: int, size: float, r: Random) -> Machine:
    # The spool behind the limit lags by a quarter of a millisecond: not what is hidden.
    return valve(m, i, natural_frequency_hz=1.0e3, damping_ratio=0.8, rate_limit_1_s=1.0 / size)


def _hysteresis(m: Machine, s: Scene, i: int, size: float, r: Random) -> Machine:
    return axis(m, i, hysteresis=size)


def _leak(m: Machine, s: Scene, i: int, size: float, r: Random) -> Machine:
    return cylinder(m, i, internal_leakage=size / PRESSURE_PA)


def _drip(m: Machine, s: Scene, i: int, size: float, r: Random) -> Machine:
    side = r.choice(["external_leakage_a", "external_leakage_b"])
    return cylinder(m, i, **{str(side): size / PRESSURE_PA})


def _dead(m: Machine, s: Scene, i: int, size: float, r: Random) -> Machine:
    a, b = r.uniform(0.6, 1.4, 2)
    volumes = size * 2.0 * a / (a + b), size * 2.0 * b / (a + b)
    return cylinder(m, i, dead_volume_a_m3=volumes[0], dead_volume_b_m3=volumes[1])


def _air(m: Machine, s: Scene, i: int, size: float, r: Random) -> Machine:
    scale = r.uniform(1.5e6, 4.0e6)
    loss = min(size / float(np.exp(-1.1e6 / scale)), 0.95)
    fluid = replace(m.truth.fluid, low_pressure_loss=loss, low_pressure_scale_pa=scale)
    return with_truth(m, fluid=fluid)


def _droop(m: Machine, s: Scene, i: int, size: float, r: Random) -> Machine:
    supply = replace(
        m.truth.supply, droop=size / FLOW_M3_S, droop_lag_s=float(r.uniform(0.03, 0.12))
    )
    return with_truth(m, supply=supply)


def _back(m: Machine, s: Scene, i: int, size: float, r: Random) -> Machine:
    supply = replace(
        m.truth.supply,
        tank_resistance=size / FLOW_M3_S**2,
        tank_lag_s=float(r.uniform(0.01, 0.05)),
    )
    return with_truth(m, supply=supply)


def _holding(m: Machine, s: Scene, i: int, size: float, r: Random) -> Machine:
    ratio = float(r.uniform(2.0, 5.0))
    pilot = s.pressure_a[:, i] + ratio * s.pressure_b[:, i]
    low, high = np.percentile(pilot, [10.0, 80.0])
    edge = next(
        t.c_at
        for v, t in zip(m.robot.valves, m.truth.valves, strict=True)
        if v.cylinder == m.robot.cylinders[i].name
    )
    return axis(
        m,
        i,
        balance_flow=edge / size,
        balance_pressure=float(low - 0.3 * (high - low)),
        balance_range=float(1.3 * (high - low)),
        balance_ratio=ratio,
    )


def _compensated(m: Machine, s: Scene, i: int, size: float, r: Random) -> Machine:
    return axis(m, i, compensation=size)


def _cushion(m: Machine, s: Scene, i: int, size: float, r: Random) -> Machine:
    x, full = s.stroke_m[:, i], m.robot.cylinders[i].stroke_m
    near = np.percentile(x, 15.0), full - np.percentile(x, 85.0)
    return axis(m, i, cushion_length=float(min(near)), cushion_share=1.0 - size)


def _line(m: Machine, s: Scene, i: int, size: float, r: Random) -> Machine:
    volume = 1.0e-4 * m.robot.cylinders[i].area_a_m2 / 5.0e-3
    ratio = r.uniform(0.05, 0.2)
    loss = 2.0 * ratio * np.sqrt(size * m.truth.fluid.bulk_modulus_pa / volume)
    # The hose's oil is the chamber's: what is hidden is its inertia, not a dead volume.
    whole = cylinder(m, i, dead_volume_a_m3=-float(volume), dead_volume_b_m3=-float(volume))
    return axis(whole, i, line_inertance=size, line_volume=float(volume), line_loss=float(loss))


FLOW_EFFECTS = (
    Hidden("valve_deadband", 1.0e-3, 0.06, "1", "half width", _deadband),
    Hidden("valve_underlap", 1.0e-3, 0.04, "1", "half width", _underlap),
    Hidden("valve_null_bias", 5.0e-4, 0.03, "1", "anywhere", _null),
    Hidden("valve_gain_nonlinearity", 5.0e-3, 0.35, "1", "at half signal", _bend),
    Hidden("valve_spool_lag", 3.0e-3, 0.025, "s", "delay at low frequency", _lag),
    Hidden("valve_rate_limit", 5.0e-3, 2.0, "s", "time over full opening", _slew, linear=False),
    Hidden("valve_hysteresis", 1.0e-3, 0.04, "1", "mean half width", _hysteresis),
    Hidden("internal_leakage", 2.0e-8, 2.0e-5, "m^3/s", "5 MPa across the piston", _leak),
    Hidden("external_leakage", 2.0e-8, 2.0e-5, "m^3/s", "5 MPa in the chamber", _drip),
    Hidden("dead_volume", 2.0e-5, 3.0e-3, "m^3", "mean of both chambers", _dead),
    Hidden("entrained_air", 0.01, 0.55, "1", "stiffness lost at 1 MPa", _air, "robot"),
    Hidden("supply_droop", 2.0e4, 3.0e6, "Pa", "60 l/min", _droop, "robot", needs=unrecorded),
    Hidden(
        "tank_back_pressure", 2.0e4, 1.5e6, "Pa", "60 l/min", _back, "robot", needs=unrecorded
    ),
    Hidden(
        "counterbalance_valve", 0.02, 2.0, "1", "valve edge over it, fully open", _holding,
        linear=False,
    ),
    Hidden("pressure_compensation", 0.02, 1.0, "1", "share of the load ignored", _compensated),
    Hidden("end_cushion", 0.03, 0.95, "1", "share of outflow lost at the stop", _cushion),
    Hidden("line_dynamics", 1.0e6, 1.5e8, "Pa s^2/m^3", "inertance", _line),
)  # fmt: skip
