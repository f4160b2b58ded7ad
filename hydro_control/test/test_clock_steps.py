"""What steps of the ROS clock do to a motion: nothing begins late, sooner or again by itself."""

from __future__ import annotations

import numpy as np
import pytest

from hydro_control.answer import Answer
from hydro_control.core import ControllerCore, Sample
from hydro_control.errors import ControlError
from hydro_control.gains import Gains
from hydro_control.reference_run import MOST_AHEAD_S
from hydro_control.trajectory import Waypoint
from hydro_hw_bridge.sample_clock import SampleClock
from hydro_model.kinematics import tip_position
from hydro_model.paths import JointPath
from hydro_model.robot import FloatArray
from hydro_model.robot_files import load_robot

ROBOT = load_robot("xs031")
POSE = np.array([0.6, -1.5])
PERIOD_NS = 2_000_000
SECOND_NS = 1_000_000_000
HOUR_NS = 3600 * SECOND_NS
NOW_NS = 1_700_000_000 * SECOND_NS
EMPTY = np.array([])
THERE = [Waypoint(2.0, np.array([0.8]), EMPTY, EMPTY)]


class Loop:
    """A controller at a machine that stands still, under the bridge's sample clock."""

    def __init__(self, path: JointPath | None = None, delay_s: float = 0.0) -> None:
        self.core = ControllerCore(ROBOT, Gains(), path, delay_s)
        self.q = POSE
        self.begin(NOW_NS)

    def begin(self, ros_ns: int) -> None:
        """A bridge begins, and maps its counter by the ROS clock."""
        self.clock = SampleClock(PERIOD_NS)
        self.restart_machine(ros_ns)

    def restart_machine(self, ros_ns: int) -> None:
        """The machine begins anew under the same bridge."""
        self.clock.start(0, ros_ns)
        self.counter = 0

    @property
    def stamp_ns(self) -> int:
        """Of the next sample."""
        assert self.clock.zero_stamp_ns is not None
        return self.clock.zero_stamp_ns + self.counter * PERIOD_NS

    def run(self, cycles: int = 1) -> Answer | None:
        """Samples on; the last answer."""
        answer = None
        for _ in range(cycles):
            half = np.full(2, 8e6)
            stamp = self.clock.stamp_ns(self.clock.extend(self.counter))
            answer = self.core.answer(Sample(stamp, self.q, half, half, None, None))
            self.counter += 1
        return answer

    def reference(self, cycles: int = 1) -> tuple[FloatArray, FloatArray]:
        """Position and velocity of the last answer's reference."""
        answer = self.run(cycles)
        assert answer is not None
        return answer.reference.position, answer.reference.velocity

    def stands(self, q: FloatArray, cycles: int) -> bool:
        """Every reference from now on is at rest there."""
        for _ in range(cycles):
            position, velocity = self.reference()
            if not np.array_equal(position, q) or np.any(velocity):
                return False
        return True


@pytest.mark.parametrize("space", ["joint", "tip"])
def test_a_start_too_far_ahead_is_refused(space: str) -> None:
    loop = Loop()
    newest_ns = loop.stamp_ns
    loop.run()
    names, points = ["lift"], THERE
    if space == "tip":
        there = np.asarray(tip_position(ROBOT, POSE + 0.02))
        names, points = [ROBOT.tip_link], [Waypoint(2.0, there, EMPTY, EMPTY)]
    most_ns = int(MOST_AHEAD_S * SECOND_NS)
    for ahead_ns in (HOUR_NS, most_ns + PERIOD_NS):
        expected = f"within 10 s of the newest sample, found {ahead_ns / SECOND_NS:.3f} s ahead"
        with pytest.raises(ControlError, match=f"trajectory refused: .*{expected}"):
            loop.core.request_trajectory(space, names, points, newest_ns + ahead_ns)  # type: ignore[arg-type]
        assert expected in loop.core.message
    assert loop.core.counts.refused == 2
    assert loop.stands(POSE, 100)
    loop.core.request_trajectory(space, names, points, newest_ns + most_ns)  # type: ignore[arg-type]
    loop.run()
    assert loop.core.moving
