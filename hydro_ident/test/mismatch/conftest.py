"""Rows of simulated runs, and a model that knows all of one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from hydro_ident.bag.recording import Recording
from hydro_ident.estimate.flows.chambers import WindowSettings
from hydro_ident.estimate.forces.force_rows import force_model
from hydro_ident.estimate.signals.derivatives import FilterSettings
from hydro_ident.estimate.signals.traces import traces_of
from hydro_ident.mismatch.fitting.training import start_model
from hydro_ident.mismatch.rows.laying import material_of
from hydro_ident.mismatch.rows.prediction import Model, Predictor
from hydro_ident.mismatch.split.residuals import Residuals
from hydro_model.effects.catalogue import resolve
from hydro_model.robot import EffectSpec, Robot

EFFECTS = (
    EffectSpec("coulomb_friction", "lift_cylinder", {"force": 2500.0}),
    EffectSpec("valve_null_bias", "tilt_valve", {"bias": 0.006}),
    EffectSpec("internal_leakage", "lift_cylinder", {"coefficient": 4e-13}),
    EffectSpec("dead_volume", "tilt_cylinder", {"volume_a": 9e-4, "volume_b": 1.1e-3}),
)
#: Dry friction of the machine that rubs, N.
RUBBING_N = 2500.0


@pytest.fixture(scope="session")
def predictor_of() -> Callable[[Robot, Recording], Predictor]:
    """Lays a recording's rows out under a robot, as a diagnosis does."""

    def laid(robot: Robot, given: Recording) -> Predictor:
        windows = WindowSettings(max_delay_cycles=6.0)
        traces = traces_of([given])
        rows = material_of(robot, force_model(robot), traces, FilterSettings(), windows, {})
        return Predictor(rows)

    return laid


@pytest.fixture(scope="session")
def laid_crane(crane_run: object, lay_out: Callable[..., Residuals]) -> Residuals:
    """The run of the true crane, laid out: what a diagnosis knows before it searches."""
    return lay_out(crane_run)


@pytest.fixture(scope="session")
def rubbing(crane_run: Any, lay_out: Callable[..., Residuals]) -> Residuals:
    """The motion of a machine against dry friction of `RUBBING_N` in its lift cylinder."""
    speed = np.gradient(np.convolve(crane_run.q[:, 0], np.ones(25) / 25.0, "same"), 0.002)
    p_a = crane_run.p_a.copy()
    p_a[:, 0] += RUBBING_N * np.tanh(speed / 0.01) / crane_run.robot.cylinders[0].area_a_m2
    return lay_out(replace(crane_run, p_a=p_a))


@pytest.fixture(scope="session")
def true_model(
    make_run: tuple, predictor_of: Callable[[Robot, Recording], Predictor]
) -> tuple[Predictor, Model]:
    """A run of a machine with effects, and the model that knows all of it."""
    true_crane, simulated_run = make_run
    truth = replace(true_crane(), effects=EFFECTS)
    predictor = predictor_of(truth, simulated_run(truth, 12.0).recording())
    start = start_model(truth, predictor, resolve(truth))
    delays = (truth.command_delay_s,) * len(truth.cylinders)
    return predictor, replace(start, delays_s=delays)
