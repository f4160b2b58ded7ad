"""A stop ends what was asked for before it: whatever the valves get, and however samples come."""

from __future__ import annotations

import numpy as np
import pytest

from hydro_control.core.core import ControllerCore, Sample
from hydro_control.gains import Gains
from hydro_control.monitoring.applied import MOST_WITHHELD
from hydro_control.motion.reference import STOP_S
from hydro_control.motion.reference_run import ReferenceRun
from hydro_model.motion.paths import JointPath
from hydro_model.motion.paths_segments import Quintic
from hydro_model.robot import FloatArray
from hydro_model.robot_files import load_robot

ROBOT = load_robot("xs031")
POSE = np.array([0.6, -1.5])
STEP_NS, DT = 2_000_000, 0.002
PATH = JointPath((Quintic.at_rest([0.6], [0.8], 2.0),), joints=("lift",))


class Bench:
    """A controller, and valves that get a share of its commands; the robot stands."""

    def __init__(self, path: JointPath = PATH, **options: object) -> None:
        self.core = ControllerCore(ROBOT, Gains(), path, **options)  # type: ignore[arg-type]
        self.cycle = -1

    def run(self, cycles: int = 1, *, share: float = 1.0, lost: int = 0) -> FloatArray:
        """The desired positions of so many samples, (cycles, n)."""
        half, rows = np.full(2, 8e6), []
        self.cycle += lost
        for _ in range(cycles):
            self.cycle += 1
            stamp_ns = 10**18 + self.cycle * STEP_NS
            answer = self.core.answer(Sample(stamp_ns, POSE, half, half, None, None))
            assert answer is not None
            self.core.applied(stamp_ns, share * answer.output.voltage_v)
            rows.append(answer.reference.position)
        return np.array(rows)


def withheld() -> Bench:
    """The bridge drives nothing, and the path that has begun waits for it."""
    bench = Bench()
    bench.run(MOST_WITHHELD + 100, share=0.0)
    assert "the valves do not get the commands" in bench.core.message
    return bench


@pytest.mark.parametrize("stopped", [False, True])
def test_a_path_that_waits_for_the_valves_does_not_set_out_once_it_is_stopped(
    stopped: bool,
) -> None:
    """Nobody expects the arm to move by itself when the bridge is activated, minutes later."""
    bench = withheld()
    if stopped:
        bench.core.requests.stop()
    bench.run(100, share=0.0)
    went = np.ptp(bench.run(200), axis=0)
    assert bench.core.moving != stopped
    assert (went[0] == 0.0) == stopped


def test_nor_where_it_was_stopped_just_before_the_valves_got_nothing() -> None:
    """It comes to rest when that is noticed: what is slowed down is no path that waits."""
    bench = Bench()
    bench.run(MOST_WITHHELD // 2, share=0.0)
    bench.core.requests.stop()
    bench.run(round(0.5 * STOP_S / DT), share=0.0)
    assert "the valves do not get the commands" in bench.core.message
    bench.run(1)
    np.testing.assert_array_equal(bench.run(200), np.tile(POSE, (200, 1)))
    assert not bench.core.moving


def test_nor_where_the_next_sample_comes_after_a_gap() -> None:
    """Held for its check, it outlives a gap: not one that a stop came before."""
    some = JointPath((Quintic.at_rest([-2.2], [-2.4], 4.0),), joints=("tilt",))
    bench = Bench(some, checks_beside=True)
    bench.run()
    assert bench.core.path_waits
    bench.run(lost=1000)
    assert bench.core.path_waits
    bench.core.requests.stop()
    bench.run(lost=1000)
    assert not bench.core.path_waits


@pytest.mark.parametrize("ask", ["stop", "trajectory without points"])
def test_nor_where_it_was_stopped_before_the_first_sample(ask: str) -> None:
    """Such as while the controller waits for the bridge. Begun anew it plays it."""
    bench = Bench()
    if ask == "stop":
        bench.core.requests.stop()
    else:
        bench.core.requests.trajectory("tip", [], [])
    assert (bench.core.counts.refused, bench.core.message) == (0, "")
    np.testing.assert_array_equal(bench.run(300), np.tile(POSE, (300, 1)))
    assert not bench.core.moving
    bench.core.restart()
    bench.run()
    assert bench.core.moving


@pytest.mark.parametrize("before", ["it is known", "it is asked"])
def test_a_stop_is_heard_in_the_middle_of_the_first_sample(
    before: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    bench, play = Bench(), ReferenceRun.play_path

    def played(run: ReferenceRun, *arguments: object, **options: object) -> None:
        if before == "it is asked":
            bench.core.requests.stop()
        play(run, *arguments, **options)  # type: ignore[arg-type]
        if before == "it is known":
            bench.core.requests.stop()

    monkeypatch.setattr(ReferenceRun, "play_path", played)
    bench.run()
    assert not bench.core.moving
