"""Valve messages that were lost: what they touch is left out, and nothing else changes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from hydro_ident.estimate.chambers import WindowSettings
from hydro_ident.estimate.derivatives import FilterSettings
from hydro_ident.estimate.force_rows import force_model
from hydro_ident.estimate.signal_survey import SignalSurvey
from hydro_ident.estimate.traces import Trace, traces_of
from hydro_ident.mismatch.laying import material_of
from hydro_ident.mismatch.material import Material
from hydro_ident.mismatch.telling import telling
from hydro_model.robot import Robot

Make = tuple[Callable[..., Robot], Callable[..., Any]]
WINDOWS = WindowSettings(max_delay_cycles=6.0)


def _material(robot: Robot, trace: Trace) -> Material:
    return material_of(robot, force_model(robot), [trace], FilterSettings(), WINDOWS, {})


def _with_holes(trace: Trace, holes: list[slice]) -> Trace:
    """The trace without the lift valve's signal in some samples."""
    signal = trace.valve_signal.copy()
    for hole in holes:
        signal[hole, 0] = np.nan
    return replace(trace, valve_signal=signal)


def _kept_times(material: Material, signals: SignalSurvey, channel: int) -> np.ndarray:
    rows = telling(material, signals) & (material.channel == channel)
    return np.asarray(material.time_s[rows])


def test_a_lost_message_costs_the_windows_that_touch_it(crane_run: Any) -> None:
    """Also where it is the sample that a window ends at, and where some are lost in a row."""
    robot = crane_run.robot
    (trace,) = traces_of([crane_run.recording()])
    signals, whole = SignalSurvey.of(robot, [trace]), _material(robot, trace)
    reach_s = WINDOWS.length_s + WINDOWS.max_delay_cycles * trace.step_s
    for hole in (slice(4000, 4001), slice(4000, 4012)):
        holed = _material(robot, _with_holes(trace, [hole]))
        begin_s, end_s = hole.start * trace.step_s, (hole.stop - 1) * trace.step_s
        for k, name in enumerate(whole.channels):
            if not whole.is_flow(k) or not name.startswith("lift"):
                continue
            before, after = (_kept_times(m, signals, k) for m in (whole, holed))
            lost = np.setdiff1d(before.round(6), after.round(6))
            assert before.size > 100
            assert not np.setdiff1d(after.round(6), before.round(6)).size
            assert (lost > begin_s - reach_s).all(), name
            assert (lost < end_s + reach_s).all(), name
