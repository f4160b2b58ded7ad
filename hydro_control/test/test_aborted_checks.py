"""A check that nobody waits for any more ends, and what is asked for next does not wait for it."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from hydro_control.core.core import ControllerCore, Sample
from hydro_control.errors import ControlError
from hydro_control.gains import Gains
from hydro_control.motion import motion_limits
from hydro_control.motion.trajectory import Waypoint
from hydro_control.node.trajectory_intake import TrajectoryIntake
from hydro_model.motion import paths_check, paths_joints
from hydro_model.motion.paths import JointPath
from hydro_model.motion.paths_segments import Quintic
from hydro_model.motion.row_pieces import ROWS
from hydro_model.multibody.kinematics import tip_position
from hydro_model.robot_files import load_robot

ROBOT = load_robot("xs031")
POSE = np.array([0.6, -1.5])
TIP = np.asarray(tip_position(ROBOT, POSE))
EMPTY = np.array([])
#: Places of the tip that a check of 20 s looks at: every 0.02 s.
PLACES = 1000
PATIENCE_S = 60.0


def answered(core: ControllerCore, cycle: int) -> Any:
    air = ROBOT.atmospheric_pressure_pa
    rails = ROBOT.supply_pressure_pa + air, ROBOT.tank_pressure_pa + air
    chambers = np.full(2, 8e6 + air)
    answer = core.answer(Sample(10**18 + cycle * 2_000_000, POSE, chambers, chambers, *rails))
    assert answer is not None
    return answer


class Places:
    """Counts the places of the tip that are looked at; at the 50th something happens."""

    def __init__(self, happens: Callable[[], object]) -> None:
        self.count, self._happens, self._look = 0, happens, paths_joints.joints_at_tip

    def __call__(self, *arguments: Any) -> Any:
        self.count += 1
        if self.count == 50:
            self._happens()
        return self._look(*arguments)


ABOVE = TIP + np.array([0.0, 0.0, 0.05])
LONG = [Waypoint(20.0, ABOVE, EMPTY, EMPTY)]


@pytest.mark.parametrize(
    ("happens", "why"),
    [
        (lambda core: core.requests.trajectory("tip", [], []), "a stop was asked for"),
        (lambda core: answered(core, 1000), "the reference was set anew"),  # behind a gap
        (lambda core: core.restart(), "the controller began anew"),
    ],
    ids=["stop", "gap", "restart"],
)
def test_a_check_ends_with_what_makes_it_idle(
    happens: Callable[[ControllerCore], object], why: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    core = ControllerCore(ROBOT, Gains())
    answered(core, 0)
    places = Places(lambda: happens(core))
    monkeypatch.setattr(paths_joints, "joints_at_tip", places)
    with pytest.raises(ControlError, match=f"trajectory refused: {why} while it was checked"):
        core.requests.trajectory("tip", [ROBOT.tip_link], LONG)
    assert places.count == 50


def test_nothing_else_ends_it(monkeypatch: pytest.MonkeyPatch) -> None:
    core = ControllerCore(ROBOT, Gains())
    answered(core, 0)
    places = Places(lambda: answered(core, 1))
    monkeypatch.setattr(paths_joints, "joints_at_tip", places)
    core.requests.trajectory("tip", [ROBOT.tip_link], LONG)
    assert places.count > PLACES
    answered(core, 2)
    assert core.moving


def test_what_is_asked_for_after_a_stop_is_played() -> None:
    core = ControllerCore(ROBOT, Gains())
    answered(core, 0)
    core.requests.stop()
    core.requests.trajectory("joint", ["lift"], [Waypoint(1.0, np.array([0.7]), EMPTY, EMPTY)])
    answered(core, 1)
    assert core.moving


def test_the_controllers_own_path_is_not_checked_on_once_it_is_stopped(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """What a stop ended is not refused, either: nobody asks for it any more."""
    path = JointPath((Quintic.at_rest([-1.5], [-1.4], 4.0),), joints=("tilt",))
    core = ControllerCore(ROBOT, Gains(), path, checks_beside=True)
    answered(core, 0)
    assert core.path_waits
    move = paths_check.joint_motion

    def moved(*arguments: Any) -> Any:
        core.requests.trajectory("joint", [], [])
        return move(*arguments)

    looked_on: list[object] = []
    monkeypatch.setattr(paths_check, "joint_motion", moved)
    monkeypatch.setattr(paths_check, "_pistons", lambda *given: looked_on.append(given))
    core.requests.check_waiting_path()
    assert not looked_on
    assert core.message == ""
    assert core.counts.refused == 0
    answered(core, 1)
    assert not core.path_waits
    assert not core.moving


def _time(seconds: float) -> SimpleNamespace:
    return SimpleNamespace(sec=int(seconds), nanosec=0)


def _message(names: list[str], points: list[SimpleNamespace]) -> SimpleNamespace:
    header = SimpleNamespace(stamp=_time(0), frame_id="")
    return SimpleNamespace(header=header, joint_names=names, points=points)


def _tip(seconds: float) -> SimpleNamespace:
    x, y, z = ABOVE.tolist()
    at = SimpleNamespace(translation=SimpleNamespace(x=x, y=y, z=z))
    point = SimpleNamespace(
        transforms=[at], velocities=[], accelerations=[], time_from_start=_time(seconds)
    )
    return _message([ROBOT.tip_link], [point])


class Intake:
    """The way of messages to a core, and what is said of them."""

    def __init__(self) -> None:
        self.core, self.said = ControllerCore(ROBOT, Gains()), list[str]()
        log = SimpleNamespace(error=self.said.append, info=self.said.append)
        self.takes = TrajectoryIntake(self.core, lambda: True, log)
        answered(self.core, 0)

    def stop(self) -> None:
        self.takes.take("tip", _message([], []))

    def wait(self) -> None:
        end = time.monotonic() + PATIENCE_S
        while self.takes.busy and time.monotonic() < end:
            time.sleep(1e-3)
        assert not self.takes.busy


@pytest.fixture
def held(monkeypatch: pytest.MonkeyPatch) -> tuple[Intake, threading.Event]:
    """A trajectory whose check stands at its 50th place until it is let go."""
    intake, there, go = Intake(), threading.Event(), threading.Event()

    def stand() -> None:
        there.set()
        assert go.wait(PATIENCE_S)

    monkeypatch.setattr(paths_joints, "joints_at_tip", Places(stand))
    intake.takes.take("tip", _tip(20))
    assert there.wait(PATIENCE_S)
    return intake, go


def test_after_a_stop_the_next_one_is_taken_at_once_and_checked_after_the_other_has_ended(
    held: tuple[Intake, threading.Event],
) -> None:
    intake, go = held
    intake.stop()
    intake.takes.take("tip", _tip(4))
    assert intake.said == ["tip trajectory to stop accepted"]
    go.set()
    intake.wait()
    assert intake.said[1:] == [
        "trajectory refused: a stop was asked for while it was checked",
        "tip trajectory with 1 points accepted",
    ]
    assert intake.core.message == ""
    answered(intake.core, 1)
    assert intake.core.moving


def test_without_a_stop_it_is_refused_and_the_first_one_played(
    held: tuple[Intake, threading.Event],
) -> None:
    intake, go = held
    intake.takes.take("tip", _tip(4))
    assert intake.said == [
        "trajectory refused: another trajectory is being checked: wait, or stop it with an empty"
        " trajectory (send_path --stop)"
    ]
    go.set()
    intake.wait()
    assert intake.said[1:] == ["tip trajectory with 1 points accepted"]


def test_of_two_behind_a_stop_the_second_waits_for_no_check_that_was_ended(
    held: tuple[Intake, threading.Event],
) -> None:
    """Ended is the first alone: the second is being checked, and the third refused for it."""
    intake, go = held
    intake.stop()
    intake.takes.take("tip", _tip(4))
    intake.takes.take("tip", _tip(5))
    assert "another trajectory is being checked" in intake.said[-1]
    go.set()
    intake.wait()
    assert intake.said[-1] == "tip trajectory with 1 points accepted"


def test_what_is_asked_for_before_the_first_sample_does_not_wait_for_it(
    held: tuple[Intake, threading.Event],
) -> None:
    """It would begin by itself, whatever was stopped or ended before that sample."""
    intake, go = held
    intake.core.restart()
    intake.takes.take("tip", _tip(4))
    intake.stop()
    answered(intake.core, 0)
    go.set()
    intake.wait()
    answered(intake.core, 1)
    assert not intake.core.moving
    assert intake.said[:2] == [
        "trajectory refused: no sample has come yet",
        "tip trajectory to stop accepted",
    ]


def test_no_compiled_function_keeps_the_samples_waiting_for_long(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Of ten minutes, each would take more than the 10 ms that a command is good for."""
    core, rows = ControllerCore(ROBOT, Gains()), list[int]()
    answered(core, 0)

    def counted(of_rows: Callable[..., Any]) -> Callable[..., Any]:
        def count(robot: Any, q: Any, *others: Any) -> Any:
            rows.append(len(q))
            return of_rows(robot, q, *others)

        return count

    for module, name in (
        (paths_check, "inverse_dynamics"),
        (motion_limits, "tip_jacobian"),
    ):
        monkeypatch.setattr(module, name, counted(getattr(module, name)))
    point = Waypoint(600.0, POSE + 0.1, EMPTY, EMPTY)
    core.requests.trajectory("joint", ROBOT.joint_names, [point])
    assert max(rows) <= ROWS
    assert sum(rows) > 2 * 30_000 + 60_000


def test_who_is_told_of_a_refusal_may_ask_again_at_once() -> None:
    """Not only when the line about it is written, which takes milliseconds on a busy computer."""
    intake = Intake()

    def told(text: str) -> None:
        intake.said.append(text)
        if len(intake.said) == 1:
            intake.takes.take("tip", _tip(4))

    log = SimpleNamespace(error=told, info=told)
    intake.takes = TrajectoryIntake(intake.core, lambda: True, log)
    unknown = _tip(4)
    unknown.joint_names = ["hook"]
    intake.takes.take("tip", unknown)
    end = time.monotonic() + PATIENCE_S
    while len(intake.said) < 2 and time.monotonic() < end:
        time.sleep(1e-3)
    assert "found hook" in intake.said[0]
    assert intake.said[1:] == ["tip trajectory with 1 points accepted"]
