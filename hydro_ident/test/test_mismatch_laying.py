"""Rows are laid out where their samples are, whatever their stamps do."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from hydro_ident.estimate.chambers import WindowSettings
from hydro_ident.estimate.derivatives import FilterSettings
from hydro_ident.estimate.traces import traces_of
from hydro_ident.mismatch.laying import material_of
from hydro_ident.mismatch.residuals import own_forces
from hydro_model.robot import Robot


def test_balances_start_at_the_same_samples_when_stamps_jitter(crane_run, robot: Robot) -> None:
    [trace] = traces_of([crane_run.recording()])
    late = 0.3 * trace.step_s * np.random.default_rng(1).normal(size=trace.samples)
    starts = []
    for time_s in (trace.time_s, np.sort(trace.time_s + late)):
        forces = own_forces(robot, torque=False)
        stamped = [replace(trace, time_s=time_s)]
        laid = material_of(robot, forces, stamped, FilterSettings(), WindowSettings(), {})
        starts.append(laid.stretches[0].starts)
    assert all(some.size for some in starts[0])
    for regular, jittered in zip(*starts, strict=True):
        np.testing.assert_array_equal(jittered, regular)
