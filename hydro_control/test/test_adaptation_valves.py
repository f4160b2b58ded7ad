"""Adaptation beside listed flows of the valve: they are of its opening, and no error of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from hydro_control.adaptation.adaptation import Adaptation
from hydro_control.adaptation.adaptation_settings import AdaptationSettings
from hydro_control.compensation.compensation_plan import plan
from hydro_model.hydraulics.cylinder import lever, stroke
from hydro_model.multibody.rigid_body import inverse_dynamics
from hydro_model.robot import Cylinder, EffectSpec, FloatArray, Valve
from hydro_model.robot_files import load_robot

ROBOT = load_robot("xs031")
#: Positions, velocities and accelerations.
Motion = tuple[FloatArray, FloatArray, FloatArray]
P_S, P_T, DT = 19.0e6, 1.0e6, 0.002
DROP_PA, WIDTH = 7e5, 0.01


def signal_of(
    name: str, valve: Valve, c: Cylinder, x: float, xd: float, p_a: float, p_b: float
) -> float:
    """Signal that moves a piston at a constant force, by the effect's equation, by hand."""
    extends = xd > 0.0
    c_in, c_out = (valve.c_pa, valve.c_bt) if extends else (valve.c_pb, valve.c_at)
    fed, emptied = (p_a, p_b) if extends else (p_b, p_a)
    inward = min(P_S - fed, DROP_PA) if name == "pressure_compensation" else P_S - fed
    rest = c.stroke_m - x
    columns = (x, rest) if extends else (rest, x)
    conductance = c_in * np.sqrt(inward) / columns[0] + c_out * np.sqrt(emptied - P_T) / columns[1]
    opening = (c.area_a_m2 / x + c.area_b_m2 / rest) * abs(xd) / conductance
    less = WIDTH if name == "valve_underlap" else 0.0
    return float(np.copysign(max(opening - less, 0.0), xd))


def sample(name: str, motion: Motion) -> Motion:
    """Positions, gauge pressures and voltages of a motion."""
    q, qd, qdd = motion
    torque, p_b = inverse_dynamics(ROBOT, q, qd, qdd), np.full(2, 8.0e6)
    p_a, voltage = np.empty(2), np.empty(2)
    for i, (c, valve) in enumerate(zip(ROBOT.cylinders, ROBOT.valves, strict=True)):
        arm, x = float(lever(c, q[i])), float(stroke(c, q[i]))
        xd = arm * qd[i]
        force = torque[i] / arm + c.viscous_friction * xd
        p_a[i] = (force + p_b[i] * c.area_b_m2) / c.area_a_m2
        u = signal_of(name, valve, c, x, xd, p_a[i], p_b[i])
        voltage[i] = u * valve.rated_voltage_v
    return q, np.array([p_a, p_b]), voltage


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("pressure_compensation", {"share": 1.0, "margin": DROP_PA, "outflow": 0.0}),
        ("valve_underlap", {"width": WIDTH, "shift": 1.0}),
    ],
)
def test_listed_flows_of_the_valve_are_not_estimated_again(
    name: str, values: dict[str, float], slow_swing: Callable[[float, FloatArray], Motion]
) -> None:
    listed = tuple(EffectSpec(name, valve.name, values) for valve in ROBOT.valves)
    active = plan(replace(ROBOT, effects=listed)).active
    adaptation = Adaptation(ROBOT, AdaptationSettings(("null_bias",)), DT, active)
    for k in range(7500):
        q, p, voltage = sample(name, slow_swing(k * DT, np.array([0.2, 0.15])))
        adaptation.observe(q, p, P_S, P_T, voltage)
    for estimator in adaptation._valves:
        assert estimator.updates > 100
        bias, overlap, gain, _ = estimator.value
        assert abs(bias) < 1e-3
        assert abs(gain) < 0.05
        assert overlap < 2e-3
