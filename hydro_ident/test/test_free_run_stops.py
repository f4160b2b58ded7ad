"""The free run where pistons are at their stops, or models where they cannot be rolled out."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from hydro_ident.estimate.scoring.scores import HoldOut
from hydro_ident.estimate.signals.derivatives import FilterSettings
from hydro_ident.estimate.signals.traces import Trace, traces_of
from hydro_ident.rollouts.free_run import free_run
from hydro_ident.rollouts.rollout_windows import at_stops, usable_pieces
from hydro_model.hydraulics.cylinder import stroke
from hydro_model.robot import EffectSpec, Robot

WHOLE = HoldOut(every=0)
#: Begin and end of what is made a rest at the stop, in s.
FROM_S, TO_S = 3.1, 3.3


@pytest.fixture(scope="module")
def exact(make_run: tuple[Any, Any]) -> tuple[Robot, Trace]:
    """A crane and what it did, without a sensor's noise."""
    true_crane, simulated_run = make_run
    run = simulated_run(true_crane(), 12.0, noisy=False)
    [trace] = traces_of([run.recording()])
    return run.robot, trace


def _at_stop(robot: Robot, trace: Trace, beyond_m: float) -> Trace:
    """The trace with the lift piston at its retracted stop, or beyond it, for a while."""
    cylinder = robot.cylinders[0]
    angles = np.linspace(robot.joints[0].lower - 0.2, robot.joints[0].upper, 20001)
    at = float(np.interp(-beyond_m, stroke(cylinder, angles), angles))
    q = trace.q.copy()
    q[(trace.time_s >= FROM_S) & (trace.time_s < TO_S), 0] = at
    return replace(trace, q=q)


@pytest.mark.parametrize("beyond_m", [2e-4, 0.0, -2e-4])
def test_a_rest_at_a_stop_is_left_out_and_told(
    exact: tuple[Robot, Trace], beyond_m: float
) -> None:
    robot, trace = exact
    touching = _at_stop(robot, trace, beyond_m)
    result = free_run(robot, robot, [touching], WHOLE)
    assert result.failed == ""
    [note] = result.rejected
    # With a tenth of a second on either side, in which no filter knows the velocity.
    assert note == "free run: 0.4 s about stops of a piston left out: no model has stops"
    for joint in result.joints:
        assert joint.rmse_after is not None
        # The jump to the stop and back is far quicker than a piston: the filter rings longer.
        assert joint.rmse_after < 1e-3
        assert not ((joint.time_s > FROM_S - 0.09) & (joint.time_s < TO_S + 0.09)).any()
        # Nothing else is lost.
        assert joint.time_s.size * trace.step_s == pytest.approx(12.0 - 0.2 - 0.4, abs=0.02)
    assert not at_stops(robot, trace).any()


def test_nothing_before_a_stop_leads_a_window_in(exact: tuple[Robot, Trace]) -> None:
    robot, trace = exact
    before, after = usable_pieces(robot, _at_stop(robot, trace, 2e-4), FilterSettings())
    assert before.since == 0
    assert after.since == after.begin
    assert trace.time_s[after.begin] == pytest.approx(TO_S + 0.1, abs=0.01)


def test_one_window_in_many_that_cannot_be_rolled_out_is_left_out_for_both(
    exact: tuple[Robot, Trace],
) -> None:
    """A load that is taken up late in the day pulls a piston out of its stroke only then."""
    robot, trace = exact
    day = [replace(trace, time_s=trace.time_s + 12.0 * k, label=f"run#{k}") for k in range(6)]
    load = {"mass": 4e4, "start_s": 70.0}
    overloaded = replace(robot, effects=(EffectSpec("payload_change", robot.name, load),))
    result = free_run(robot, overloaded, day, WHOLE)
    assert result.failed == ""
    assert result.windows == 23
    left_out, whole = result.rejected
    assert left_out.startswith(
        "free run: 1 of 24 windows left out, over which the identified robot cannot be rolled out;"
        " run from 68.95 s on"
    )
    lift = result.joints[0]
    assert lift.time_s.max() < 70.0
    assert lift.rmse_before is not None
    assert lift.rmse_after == pytest.approx(lift.rmse_before)
    # One of six whole runs is no exception.
    assert whole.startswith("whole free run of the identified robot rejected: run from 60.10 s on")
    assert (lift.whole_before is None, lift.whole_after is None) == (False, True)
