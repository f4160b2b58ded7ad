"""Listed effects that no motion tells from the base stay as listed, and the base is found."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from hydro_ident.design.prediction import expected_trace
from hydro_ident.estimate.effects.listed_effects import ListedEffects
from hydro_ident.estimate.forces.closed_chain import part_notes
from hydro_ident.estimate.forces.inertial import InertialFit, fit_inertial
from hydro_ident.estimate.signals.derivatives import FilterSettings
from hydro_ident.identify.job import planned_force_model
from hydro_model.robot import EffectSpec, Robot
from hydro_model.robot_files import load_robot

STEP_S, MASS_KG, ROTOR_KG, VISCOUS, COULOMB_N = 0.001, 96.0, 31.0, 200.0, 20.0
SCALE_M_S = 0.002
RUBBING = EffectSpec("coulomb_friction", "carriage", {"force": 15.0, "velocity_scale": SCALE_M_S})


def _axis(*rates_hz: float) -> tuple[np.ndarray, ...]:
    """Position, velocity and acceleration of sines, (N, 1) each."""
    times = np.arange(0.0, 20.0, STEP_S)[:, None]
    rate = 2.0 * np.pi * np.array(rates_hz)
    q = 0.12 + 0.02 * np.sin(times * rate).sum(axis=1, keepdims=True)
    qd = 0.02 * (rate * np.cos(times * rate)).sum(axis=1, keepdims=True)
    return q, qd, -0.02 * (rate**2 * np.sin(times * rate)).sum(axis=1, keepdims=True)


def _fitted(robot: Robot, rotor_kg: float) -> InertialFit:
    """The axis fitted to the forces that move its mass, its rotor and its friction."""
    moved = _axis(0.3, 0.7, 1.9)
    _, qd, qdd = moved
    rotor = EffectSpec("rotor_inertia", robot.joints[0].name, {"inertia": rotor_kg})
    effects = ListedEffects.of(replace(robot, effects=(RUBBING, rotor)))
    _, trace = expected_trace(effects, moved, STEP_S)
    rounded = qd / np.hypot(qd, SCALE_M_S)
    force = (MASS_KG + ROTOR_KG) * qdd + VISCOUS * qd + COULOMB_N * rounded
    force += np.random.default_rng(1).normal(size=force.shape)
    model = replace(planned_force_model(effects.robot, effects, []), torque=True)
    found = fit_inertial(model, [replace(trace, joint_torque=force)], FilterSettings())
    assert found is not None
    return found


@pytest.mark.parametrize("listed_kg", [ROTOR_KG, 20.0])
def test_a_rotor_in_line_with_its_load_stays_as_listed(listed_kg: float) -> None:
    """Both move alike: the load has what the listed rotor leaves of the sum."""
    found = _fitted(load_robot("emps"), listed_kg)
    assert found.missing == ()
    names = list(found.model.names)
    rotor = next(i for i, name in enumerate(names) if "rotor_inertia" in name)
    (mass,) = (i for i, name in enumerate(names) if name.endswith(".mass"))
    assert found.fit.theta[rotor] == listed_kg
    assert found.fit.theta[mass] == pytest.approx(MASS_KG + ROTOR_KG - listed_kg, rel=0.01)
    (note,) = part_notes(names, found.held)
    assert note == (
        f"{names[rotor]}: stays as listed, {listed_kg:.4g}: no motion of these recordings tells"
        f" it from {names[mass]}"
    )


def test_what_motion_tells_is_fitted(robot: Robot) -> None:
    """Of joints whose frictions differ none is held: two that are listed are two, not one."""
    dry = replace(robot, cylinders=(), valves=())
    specs = tuple(
        EffectSpec("coulomb_friction", joint.name, {"force": 10.0 + k})
        for k, joint in enumerate(dry.joints)
    )
    effects = ListedEffects.of(replace(dry, effects=specs))
    assert effects.held == ()
    assert effects.force_values == (10.0, 11.0)
