"""At 0 V: valves with a null bias let the load creep, and a parked machine stands."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from hydro_hw_bridge.rig.core import RigCore
from hydro_hw_bridge.rig.truth_files import load_truth
from hydro_model.robot import FloatArray, Robot

ZERO = (0.0, 0.0)
SECONDS, WINDOW_S = 4.0, 0.5
#: The page: millimetres a second at worst. Above the encoders' noise there is something to bound.
WORST_M_S, SEEN_M_S = 3e-3, 5e-5
POSES = [(0.2, -0.5), (0.7, -1.2), (1.0, -2.2)]


def rig_with(robot: Robot, bias: float, pose: tuple[float, float]) -> RigCore:
    truth = load_truth("realistic", robot)
    valves = tuple(replace(valve, null_bias=bias) for valve in truth.valves)
    return RigCore(robot, replace(truth, valves=valves), seed=1, q=pose)


def speeds(core: RigCore, *, enable: bool) -> FloatArray:
    """Mean speeds of the pistons over windows at 0 V, the first one left out, m/s."""
    window = round(WINDOW_S / core.cycle_s)
    strokes = [core.plant.strokes()]
    for cycle in range(round(SECONDS / core.cycle_s)):
        core.actuate(ZERO, enable)
        if (cycle + 1) % window == 0:
            strokes.append(core.plant.strokes())
    found: FloatArray = np.diff(strokes, axis=0)[1:] / WINDOW_S
    return found


@pytest.mark.parametrize("pose", POSES)
@pytest.mark.parametrize("enable", [True, False], ids=["enabled", "switched_off"])
def test_at_0_v_a_load_creeps_by_millimetres_a_second_at_worst(
    robot: Robot, pose: tuple[float, float], enable: bool
) -> None:
    ends = []
    for bias in (-0.005, 0.005):  # that of the shipped machine, either way
        core = rig_with(robot, bias, pose)
        core.actuate(ZERO, enable=True)  # no longer held by its locks
        found = speeds(core, enable=enable)
        assert np.abs(found).max() < WORST_M_S
        # It does creep, and does not come to rest: nothing but hydraulics holds it.
        assert np.abs(found[-1]).max() > SEEN_M_S
        ends.append(found[-1])
    # The more the spool is open towards the bore side, the less it sinks.
    assert (ends[1] > ends[0]).all()


@pytest.mark.parametrize("pose", POSES)
def test_a_parked_machine_does_not_creep(robot: Robot, pose: tuple[float, float]) -> None:
    core = rig_with(robot, 0.005, pose)
    start = core.plant.state.copy()
    assert not speeds(core, enable=False).any()
    assert core.parked
    np.testing.assert_array_equal(core.plant.state, start)
