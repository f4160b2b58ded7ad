"""Samples that no voltage follows from: valves are shut for a while, and in the end for good."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hydro_control.core.answer import Answer
from hydro_control.core.core import ControllerCore, Sample
from hydro_control.errors import ControlError
from hydro_control.gains import Gains
from hydro_control.monitoring.bad_samples import RECURS, RECURS_NS, SETTLED
from hydro_control.motion.trajectory import Waypoint
from hydro_model.hydraulics.cylinder import lever
from hydro_model.motion.paths import JointPath
from hydro_model.motion.paths_segments import Quintic
from hydro_model.robot import FloatArray
from hydro_model.robot_files import load_robot

ROBOT = load_robot("xs031")
POSE = np.array([0.6, -1.5])
STEP_NS = 2_000_000
PAGE = Path(__file__).parents[2] / "hydro_msgs_docs/safety_case.md"
PATH = JointPath((Quintic.at_rest([0.6], [0.8], 2.0),), joints=("lift",))
THERE = [Waypoint(2.0, np.array([0.8]), np.array([]), np.array([]))]


class Loop:
    """A controller, and samples of a machine that goes where it is told to be."""

    def __init__(self, path: JointPath | None = None, delay_s: float = 0.0) -> None:
        self.core = ControllerCore(ROBOT, Gains(), path, delay_s)
        self.q, self.cycle = POSE, 0

    def run(self, cycles: int = 1, **bad: FloatArray | float) -> Answer:
        """Samples on, with readings that are `bad`; the last answer."""
        for _ in range(cycles):
            chambers = np.full(2, 8e6)
            sample = Sample(10**18 + self.cycle * STEP_NS, self.q, chambers, chambers, 19e6, 2e5)
            answer = self.core.answer(replace(sample, **bad))  # type: ignore[arg-type]
            self.cycle += 1
        assert answer is not None
        return answer

    def ask(self) -> None:
        """For a motion."""
        self.core.requests.trajectory("joint", ["lift"], THERE)


BAD = {
    "a joint": {"q": np.array([np.nan, -1.5])},
    "a chamber": {"p_a": np.array([8e6, np.inf])},
    "the supply": {"p_s": np.nan},
}


@pytest.mark.parametrize("bad", BAD.values(), ids=BAD)
@pytest.mark.parametrize("lasts", [1, 2, 200])
def test_behind_bad_samples_the_valves_are_shut_until_the_filters_know_the_velocity(
    bad: dict[str, FloatArray], lasts: int
) -> None:
    """They said 0 for the first good one, which was answered with all that damps left out."""
    loop, turns = Loop(), np.array([0.05, -0.04])
    for moving in (False, True):
        # Held, so that its velocity alone is at fault: it is carried by something else.
        for _ in range(30 if moving else 1):
            loop.q = loop.q + turns * 0.002 * moving
            driven = loop.run()
    assert np.any(driven.output.voltage_v)
    said = {loop.run(**bad).output.fault for _ in range(lasts)}
    assert all("expected finite numbers, found" in one for one in said)
    for k in range(SETTLED):
        loop.q = loop.q + turns * 0.002
        shut = loop.run().output
        assert not np.any(shut.voltage_v)
        assert f"0 V until {SETTLED} samples in a row are good" in shut.fault
        assert loop.core.counts.faults == lasts + k + 1
    loop.q = loop.q + turns * 0.002
    output = loop.run().output
    assert not output.fault
    arms = [float(lever(c, x)) for c, x in zip(ROBOT.cylinders, loop.q, strict=True)]
    np.testing.assert_allclose(output.piston_velocity_m_s, arms * turns, rtol=1e-3)
    assert 0.0 < np.abs(output.voltage_v).max() <= 2.0  # from 0 V by the slew limit
    assert f"stay at 0 V until {SETTLED} good ones in a row came" in PAGE.read_text("utf-8")


@pytest.mark.parametrize("apart", [11, 31])
def test_good_ones_before_a_gap_do_not_open_them(apart: int) -> None:
    """The filters start anew there: it was driven by velocities of two samples."""
    loop, turns = Loop(), np.array([0.05, -0.04])
    loop.run(30)
    loop.run(1, **BAD["a joint"])  # type: ignore[arg-type]
    loop.run(SETTLED - 2)
    loop.cycle += apart - 1
    for _ in range(SETTLED):
        loop.q = loop.q + turns * 0.002
        assert not np.any(loop.run().output.voltage_v)
    loop.q = loop.q + turns * 0.002
    output = loop.run().output
    arms = [float(lever(c, x)) for c, x in zip(ROBOT.cylinders, loop.q, strict=True)]
    np.testing.assert_allclose(output.piston_velocity_m_s, arms * turns, rtol=1e-3)
    assert np.any(output.voltage_v)


def drops_of(loop: Loop, every: int, cycles: int) -> int:
    """How often driven valves went to 0 V, a chamber's reading bad every so many samples."""
    volts = [np.any(loop.run().output.voltage_v)]
    for k in range(1, cycles):
        bad = {} if k % every else BAD["a chamber"]
        volts.append(np.any(loop.run(**bad).output.voltage_v))  # type: ignore[arg-type]
    return int(np.sum(np.diff(np.array(volts, dtype=int)) < 0))


@pytest.mark.parametrize("every", [2, 3, 6, 10, SETTLED + 5, 100, 250])
def test_a_reading_that_comes_and_goes_chops_no_valve_and_is_latched(every: int) -> None:
    loop = Loop()
    loop.run()
    loop.q = POSE + 0.02  # away from where it is held: something is commanded
    most = 1 if every <= SETTLED else RECURS
    assert drops_of(loop, every, RECURS * every + 60) <= most
    stopped = loop.run(100)
    assert not np.any(stopped.output.voltage_v)
    latched = stopped.output.fault
    assert latched.startswith("expected finite numbers, found pressure of chamber A [")
    assert f"it came and went {RECURS} times in {2e-3 * 2 * every:.3f} s: latched" in latched
    assert f"for the {RECURS}rd time within a second" in PAGE.read_text("utf-8")
    with pytest.raises(ControlError, match="the controller stopped: expected finite numbers"):
        loop.ask()
    loop.core.restart()
    assert not loop.run().output.fault


def test_one_bad_sample_now_and_then_is_not_latched() -> None:
    loop = Loop()
    loop.run()
    every = RECURS_NS // STEP_NS // (RECURS - 1) + 1
    drops_of(loop, every, 6 * every)
    assert not loop.run(SETTLED + 1).output.fault


@pytest.mark.parametrize("lasts", [1, 100])
def test_a_motion_is_dropped_and_the_arm_held_where_it_came_to_rest(lasts: int) -> None:
    loop = Loop(PATH)
    loop.run(300)
    assert loop.core.moving
    loop.run(lasts, **BAD["a joint"])  # type: ignore[arg-type]
    loop.q = POSE + 0.005
    loop.run()
    with pytest.raises(ControlError, match="refused: a sample could not be answered: expected"):
        loop.ask()
    loop.q = rests = POSE + 0.01
    loop.run(SETTLED - 1)
    assert not loop.core.moving
    held = loop.run(500)
    np.testing.assert_array_equal(held.reference.position, rests)
    assert not np.any(held.reference.velocity)
    assert not held.output.fault
    said = "holding: the motion was dropped, as a sample could not be answered: expected finite"
    assert loop.core.message.startswith(said)
    loop.ask()
    loop.run()
    assert loop.core.moving
    assert loop.core.message == ""


def test_a_hold_stays_one_and_what_was_refused_is_said_on() -> None:
    loop = Loop()
    loop.run(10)
    with pytest.raises(ControlError, match="trajectory refused"):
        loop.core.requests.trajectory("joint", ["boom"], THERE)
    said = loop.core.message
    loop.run(1, **BAD["a joint"])  # type: ignore[arg-type]
    loop.run(SETTLED + 1)
    assert loop.core.message == said


def test_a_path_that_has_not_moved_yet_waits_anew_and_in_full() -> None:
    loop = Loop(PATH, 0.5)
    loop.run(100)
    loop.run(1, **BAD["a joint"])  # type: ignore[arg-type]
    loop.run(SETTLED)
    for k in range(300):
        expected = PATH.sample(k * 0.002 - 0.5)[0][0]
        at = loop.run().reference.position
        np.testing.assert_allclose(at, [expected, -1.5], atol=1e-12)
