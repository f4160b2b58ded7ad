"""Listed effects that `identify` cannot fit are taken as listed: the rows then fit the truth."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from hydro_ident.estimate.effects.listed_effects import ListedEffects
from hydro_ident.estimate.forces.force_rows import force_rows
from hydro_ident.estimate.signals.derivatives import FilterSettings
from hydro_ident.estimate.signals.traces import Trace
from hydro_ident.identify.job import planned_force_model
from hydro_model.effects import Readings, read_with
from hydro_model.hydraulics.cylinder import stroke
from hydro_model.robot import EffectSpec, Robot
from hydro_model.simulation.simulate import simulate

H = 0.002
SPECS = {
    "payload_change": ("xs031", {"mass": 60.0, "start_s": 3.0}),
    "cylinder_inertia": ("tilt_cylinder", {"barrel_mass": 60.0, "rod_mass": 40.0}),
    "base_tilt": ("xs031", {"pitch": 0.03}),
    "structural_flexibility": ("lift", {"inertia": 400.0, "frequency": 1.5, "damping": 0.1}),
    "encoder_offset": ("tilt", {"offset": 0.02}),
    "pressure_sensor_bias": ("lift_cylinder/a", {"bias": 2e5}),
    "pressure_sensor_gain": ("tilt_cylinder", {"error": 0.01}),
    "presliding_friction": ("lift", {"force": 4e3, "distance": 3e-4}),
    "pin_friction": ("xs031", {"radius": 3e-3}),
}


def listed(robot: Robot, name: str) -> Robot:
    return replace(robot, effects=(EffectSpec(name, *SPECS[name]),))


def recorded(robot: Robot) -> Trace:
    """Six seconds along smooth voltages, as the robot's sensors show them."""
    time = np.arange(3001) * H
    ramp = np.clip(time / 0.5, 0.0, 1.0)[:, None]
    volts = ramp * np.sin(np.outer(time, [2.6, 3.4])) * [0.7, 0.9]
    run = simulate(robot, time, volts, [0.4, -1.1])
    shown = read_with(
        robot,
        Readings(
            *(H, run.q, run.p_a, run.p_b, run.supply, run.tank, volts / 10.0),
            np.full_like(run.q, np.nan),
        ),
    )
    columns = [stroke(c, shown.q[:, i]) for i, c in enumerate(robot.cylinders)]
    return Trace(
        label="bag#0",
        step_s=H,
        time_s=time,
        q=shown.q,
        stroke=np.column_stack(columns),
        p_a=shown.p_a,
        p_b=shown.p_b,
        supply=shown.supply,
        tank=shown.tank,
        valve_signal=shown.valve_signal,
        joint_torque=np.full((time.size, 2), np.nan),
    )


def residual(robot: Robot, trace: Trace, truth: Robot, factor: float) -> float:
    """RMS force in N that the true parameters leave over, effects at `factor` of their size."""
    effects = ListedEffects.of(robot)
    model = planned_force_model(robot, effects, ())
    rows = force_rows(model, trace, FilterSettings())
    assert rows is not None
    values = dict(
        zip(model.base.names, model.base.combination @ truth.parameter_vector, strict=True)
    )
    values |= {f"{c.name}.viscous_friction": c.viscous_friction for c in truth.cylinders}
    for one in effects.active:
        for p, value in zip(one.effect.parameters, one.parameters, strict=True):
            values[f"{one.target}.{one.effect.name}.{p.name}"] = factor * value
    theta = np.array([values[name] for name in model.names])
    return float(np.sqrt(np.mean((rows.y - rows.x @ theta) ** 2)))


@pytest.mark.parametrize("name", SPECS)
def test_rows_fit_the_truth_where_the_effect_is_listed(make_run, name) -> None:
    true_crane, _ = make_run
    truth = true_crane()
    trace = recorded(listed(truth, name))
    with_it = residual(listed(truth, name), trace, truth, 1.0)
    without = residual(truth, trace, truth, 1.0)
    floor = residual(truth, recorded(truth), truth, 1.0)
    assert without > 50.0
    assert with_it < max(0.1 * without, 2.0 * floor)


def test_a_payload_on_a_tilted_base_fits_the_truth(make_run) -> None:
    true_crane, _ = make_run
    truth = true_crane()
    both = {"payload_change": {"mass": 300.0}, "base_tilt": {"pitch": 0.0873}}
    specs = tuple(EffectSpec(name, truth.name, values) for name, values in both.items())
    robot = replace(truth, effects=specs)
    # By effect, what it alone leaves over: the error of the two together is to be no larger.
    alone = [replace(truth, effects=(one,)) for one in specs]
    floor = max(residual(one, recorded(one), truth, 1.0) for one in alone)
    assert residual(robot, recorded(robot), truth, 1.0) < 2.0 * floor


def test_what_is_fitted_held_or_ignored_is_said(make_run) -> None:
    true_crane, _ = make_run
    names = ["end_cushion", "coulomb_friction", "valve_deadband", "base_tilt", "valve_null_bias"]
    values = [
        {"strength": 0.9, "length": 0.02}, {"force": 1.0}, {"width": 0.01}, {"pitch": 0.01},
        {"bias": 0.01},
    ]  # fmt: skip
    robot = true_crane()
    specs = (EffectSpec(n, robot.name, v) for n, v in zip(names, values, strict=True))
    effects = ListedEffects.of(replace(robot, effects=tuple(specs)))
    assert effects.force_names == (
        "lift_cylinder.coulomb_friction.force",
        "tilt_cylinder.coulomb_friction.force",
    )
    assert effects.held == ("base_tilt", "valve_deadband")
    assert effects.ignored == ("end_cushion",)
