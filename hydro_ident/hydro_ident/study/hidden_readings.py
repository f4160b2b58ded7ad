"""Effects of instruments and timing, and effects that no catalogue has."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from hydro_ident.study.hidden import (
    Hidden,
    Machine,
    Scene,
    axis,
    machine_extras,
    sensor_extras,
    sign,
    unrecorded,
    with_truth,
)

Random = np.random.Generator


def _side(r: Random, m: Machine, i: int) -> str:
    return f"{m.robot.cylinders[i].name}/{r.choice(['a', 'b'])}"


def _joint(m: Machine, i: int) -> str:
    return m.robot.cylinders[i].joint


def _encoder(m: Machine, s: Scene, i: int, size: float, r: Random) -> Machine:
    offset = {**m.truth.sensors.encoder_offset, _joint(m, i): size * sign(r)}
    return with_truth(m, sensors=replace(m.truth.sensors, encoder_offset=offset))


def _bias(m: Machine, s: Scene, i: int, size: float, r: Random) -> Machine:
    bias = {**m.truth.sensors.pressure_bias_pa, _side(r, m, i): size * sign(r)}
    return with_truth(m, sensors=replace(m.truth.sensors, pressure_bias_pa=bias))


def _span(m: Machine, s: Scene, i: int, size: float, r: Random) -> Machine:
    return sensor_extras(m, "pressure_gain", {_side(r, m, i): size * sign(r)})


def _late_pressure(m: Machine, s: Scene, i: int, size: float, r: Random) -> Machine:
    return sensor_extras(m, "pressure_delay_s", dict.fromkeys(m.robot.pressure_names, size))


def _late_command(m: Machine, s: Scene, i: int, size: float, r: Random) -> Machine:
    # `size` is what goes beyond the one cycle that every machine may have.
    return machine_extras(m, command_delay_s=size + 1.0 / m.robot.sensors.rate_hz)


def _swing(m: Machine, s: Scene, i: int, size: float, r: Random) -> Machine:
    turned = sensor_extras(m, "encoder_swing", {_joint(m, i): size})
    return sensor_extras(
        turned, "encoder_swing_count", {_joint(m, i): float(r.uniform(20.0, 60.0))}
    )


def _hum_pressure(m: Machine, s: Scene, i: int, size: float, r: Random) -> Machine:
    name = _side(r, m, i)
    hummed = sensor_extras(m, "hum_pa", {name: size})
    return sensor_extras(hummed, "hum_hz", {name: float(r.uniform(0.7, 4.0))})


def _ripple(m: Machine, s: Scene, i: int, size: float, r: Random) -> Machine:
    lever = float(np.median(np.abs(s.lever[:, i])))
    return axis(
        m,
        i,
        ripple_torque=size * lever,
        ripple_count=float(r.uniform(15.0, 40.0)),
        ripple_phase=float(r.uniform(0.0, 2.0 * np.pi)),
    )


def _vibration(m: Machine, s: Scene, i: int, size: float, r: Random) -> Machine:
    return axis(
        m, i, vibration_force=size, vibration_rate=float(2.0 * np.pi * r.uniform(0.6, 4.0))
    )


def _drag(m: Machine, s: Scene, i: int, size: float, r: Random) -> Machine:
    return axis(m, i, drag_force=size, drag_rate=float(2.0 * np.pi * r.uniform(0.05, 0.15)))


def _hose_ripple(m: Machine, s: Scene, i: int, size: float, r: Random) -> Machine:
    span = float(np.ptp(s.stroke_m[:, i]))
    count = 2.0 * np.pi * r.uniform(3.0, 6.0) / max(span, 0.05)
    return axis(m, i, stiffness_ripple=size, stiffness_count=float(count))


def _hum_valve(m: Machine, s: Scene, i: int, size: float, r: Random) -> Machine:
    return axis(m, i, hum=size, hum_rate=float(2.0 * np.pi * r.uniform(0.7, 4.0)))


def _pump(m: Machine, s: Scene, i: int, size: float, r: Random) -> Machine:
    return machine_extras(
        m, supply_ripple=size, supply_ripple_rate=float(2.0 * np.pi * r.uniform(0.2, 1.5))
    )


READING_EFFECTS = (
    Hidden("encoder_offset", 5.0e-4, 0.05, "rad", "anywhere", _encoder),
    Hidden("pressure_sensor_bias", 5.0e3, 6.0e5, "Pa", "one chamber", _bias),
    Hidden("pressure_sensor_gain", 1.0e-3, 0.05, "1", "one chamber", _span),
    Hidden("pressure_delay", 1.0e-3, 0.02, "s", "all transducers", _late_pressure, "robot"),
    Hidden("command_delay", 5.0e-4, 0.02, "s", "beyond one cycle", _late_command, "robot"),
)

#: Physics that no law of the catalogue mimics well.
OUTSIDE_EFFECTS = (
    Hidden("bearing_ripple", 30.0, 4.0e3, "N", "amplitude, median lever", _ripple, known=False),
    Hidden("vibration_force", 20.0, 4.0e3, "N", "amplitude", _vibration, known=False),
    Hidden("intermittent_drag", 50.0, 4.0e3, "N", "while it drags", _drag, known=False),
    Hidden("sensor_hum", 5.0e3, 8.0e5, "Pa", "amplitude, one chamber", _hum_pressure, known=False),
    Hidden("encoder_eccentricity", 5.0e-5, 4.0e-3, "rad", "amplitude", _swing, known=False),
    Hidden("stiffness_ripple", 0.05, 0.6, "1", "share of it", _hose_ripple, known=False),
    Hidden("valve_hum", 5.0e-4, 0.03, "1", "amplitude", _hum_valve, known=False),
    Hidden(
        "pump_ripple", 3.0e4, 2.0e6, "Pa", "amplitude", _pump, "robot", known=False,
        needs=unrecorded,
    ),
)  # fmt: skip
