"""The free run of a robot whose sensors are wrong."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from hydro_ident.estimate.scoring.scores import HoldOut
from hydro_ident.estimate.signals.traces import Trace, traces_of
from hydro_ident.rollouts.free_run import free_run
from hydro_model.effects import Readings, read_with
from hydro_model.robot import EffectSpec, Robot

WHOLE = HoldOut(every=0)


@pytest.fixture(scope="module")
def exact(make_run: tuple[Any, Any]) -> tuple[Robot, Trace]:
    """A crane and what it did, without a sensor's noise."""
    true_crane, simulated_run = make_run
    run = simulated_run(true_crane(), 9.0, noisy=False)
    [trace] = traces_of([run.recording()])
    return run.robot, trace


def _shown(robot: Robot, trace: Trace) -> Trace:
    """The trace as sensors show it that err as the robot's effects say."""
    rails = (trace.supply, trace.tank)
    signals = (trace.q, trace.p_a, trace.p_b, *rails, trace.valve_signal, trace.joint_torque)
    r = read_with(robot, Readings(trace.step_s, *signals))
    return replace(trace, q=r.q, p_a=r.p_a, p_b=r.p_b, supply=r.supply, tank=r.tank)


@pytest.mark.parametrize(
    "spec",
    [
        EffectSpec("encoder_offset", "lift", {"offset": 0.0175}),
        EffectSpec("pressure_sensor_bias", "lift_cylinder/a", {"bias": 5e5}),
        EffectSpec("pressure_sensor_gain", "supply", {"error": 0.05}),
    ],
    ids=lambda spec: spec.name,
)
def test_a_robot_that_knows_its_sensors_follows_what_they_show(
    exact: tuple[Robot, Trace], spec: EffectSpec
) -> None:
    """Rolled out from where it really was, under what the pressure really was."""
    robot, trace = exact
    knowing = replace(robot, effects=(spec,))
    result = free_run(robot, knowing, [_shown(knowing, trace)], WHOLE)
    lift = result.joints[0]
    assert lift.rmse_after is not None
    assert lift.rmse_before is not None
    assert lift.rmse_after < 1e-5 < 1e-4 < lift.rmse_before
    # What was measured stays what the encoders showed: both robots are held against the same.
    at = np.searchsorted(trace.time_s, lift.time_s)
    assert lift.measured == pytest.approx(_shown(knowing, trace).q[at, 0])
    assert lift.after == pytest.approx(lift.measured, abs=1e-4)
