"""Requests of one thread while that of the samples is at work, interleaved by hand."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from hydro_control.core.core import Answer, ControllerCore, Sample
from hydro_control.errors import ControlError
from hydro_control.gains import Gains
from hydro_control.monitoring.applied import MOST_WITHHELD
from hydro_control.motion import reference
from hydro_control.motion.reference import Plan, ReferencePlayer
from hydro_control.motion.reference_run import Standing
from hydro_control.motion.trajectory import Waypoint
from hydro_model.motion.paths import JointPath
from hydro_model.motion.paths_segments import Quintic
from hydro_model.robot import FloatArray
from hydro_model.robot_files import load_robot

ROBOT = load_robot("xs031")
POSE = np.array([0.6, -1.5])
EMPTY = np.array([])
THERE = [Waypoint(1.0, np.array([0.7]), EMPTY, EMPTY)]
PATIENCE_S = 60.0


class Bench:
    """A controller whose machine stands where it is put."""

    def __init__(self, path: JointPath | None = None) -> None:
        self.core, self.cycle, self.q = ControllerCore(ROBOT, Gains(), path), -1, POSE
        self.run()

    def run(self, cycles: int = 1, *, lost: int = 0, applied: float = 1.0) -> Answer:
        half = np.full(2, 8e6)
        self.cycle += lost
        for _ in range(cycles):
            self.cycle += 1
            stamp_ns = 10**18 + self.cycle * 2_000_000
            answer = self.core.answer(Sample(stamp_ns, self.q, half, half, None, None))
            assert answer is not None
            self.core.applied(stamp_ns, applied * answer.output.voltage_v)
        return answer

    def ask(self) -> None:
        self.core.requests.trajectory("joint", ["lift"], THERE)


def once_handed_over(
    monkeypatch: pytest.MonkeyPatch, bench: Bench, happens: Callable[[], object]
) -> None:
    """What samples do between the handing over of a motion and the last look at its check."""
    looked, left = Standing.overtaken.fget, [happens]  # type: ignore[attr-defined]

    def look(standing: Standing) -> bool:
        if standing.run.pending is not None and left:
            left.pop()()
        found: bool = looked(standing)
        return found

    monkeypatch.setattr(Standing, "overtaken", property(look))
    bench.ask()
    assert not left


def test_what_is_played_at_once_is_accepted(monkeypatch: pytest.MonkeyPatch) -> None:
    """Refused, its sender takes the arm for one that stands."""
    bench = Bench()
    once_handed_over(monkeypatch, bench, bench.run)
    assert bench.core.moving
    assert (bench.core.counts.refused, bench.core.message) == (0, "")


def test_what_is_stopped_before_it_is_played_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    bench = Bench()

    def stopped() -> None:
        bench.core.requests.stop()
        bench.run()

    with pytest.raises(ControlError, match="a stop was asked for while it was checked"):
        once_handed_over(monkeypatch, bench, stopped)
    assert not bench.core.moving


def test_what_is_dropped_at_once_is_said_to_be(monkeypatch: pytest.MonkeyPatch) -> None:
    bench = Bench()
    once_handed_over(monkeypatch, bench, lambda: bench.run(MOST_WITHHELD + 50, applied=0.0))
    assert not bench.core.moving
    assert "the valves do not get the commands" in bench.core.message


def test_what_is_accepted_as_another_is_taken_up_is_said_to_be_dropped(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Both were planned from the same stand, and accepted; only one of them can be played."""
    bench, play = Bench(), ReferencePlayer.play
    bench.ask()

    def playing(player: ReferencePlayer, plan: Plan, start_s: float) -> None:
        monkeypatch.setattr(ReferencePlayer, "play", play)
        bench.ask()
        play(player, plan, start_s)

    monkeypatch.setattr(ReferencePlayer, "play", playing)
    bench.run()
    assert bench.core.counts.refused == 0
    bench.run()
    assert bench.core.moving
    assert "the trajectory was dropped: the reference was set anew" in bench.core.message


def test_what_is_accepted_as_the_own_path_sets_out_anew_is_said_to_be_dropped(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Its way there is planned in the sample, which takes longer than a short check."""
    path = JointPath((Quintic.at_rest([0.6], [0.5], 2.0),), joints=("lift",))
    bench, plan = Bench(path), ReferencePlayer.plan_path
    bench.run(MOST_WITHHELD + 50, applied=0.0)

    def planning(player: ReferencePlayer, *given: Any, **options: Any) -> Plan:
        bench.ask()
        return plan(player, *given, **options)

    monkeypatch.setattr(ReferencePlayer, "plan_path", planning)
    bench.run(2)
    assert bench.core.counts.refused == 0
    assert "the trajectory was dropped: the reference was set anew" in bench.core.message
    assert bench.run(500).reference.position[0] < POSE[0]  # the path's way, not the other's


def test_what_is_accepted_as_a_gap_is_noticed_is_said_to_be_dropped(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """It was being checked before the gap, and is handed over before the arm is held for it."""
    bench, planned, noticed = Bench(), threading.Event(), threading.Event()
    plan, hold = reference.segments_through, ReferencePlayer.hold

    def planning(at: FloatArray, points: list[Waypoint]) -> object:
        planned.set()
        assert noticed.wait(PATIENCE_S)
        return plan(at, points)

    asking = threading.Thread(target=bench.ask)

    def holding(player: ReferencePlayer, q: FloatArray, stamp_s: float) -> None:
        noticed.set()
        asking.join(PATIENCE_S)
        hold(player, q, stamp_s)

    monkeypatch.setattr(reference, "segments_through", planning)
    asking.start()
    assert planned.wait(PATIENCE_S)
    monkeypatch.setattr(ReferencePlayer, "hold", holding)
    bench.run(lost=1000)
    assert bench.core.counts.refused == 0
    assert not bench.core.moving
    assert "holding: the motion was dropped, as no usable sample came" in bench.core.message


def test_what_is_refused_for_it_is_not_said_to_be_dropped_as_well(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    bench = Bench()
    with pytest.raises(ControlError, match="the reference was set anew while it was checked"):
        once_handed_over(monkeypatch, bench, lambda: bench.core._run.hold())  # type: ignore[union-attr]
    bench.run(2)
    assert bench.core.message.startswith("trajectory refused: the reference was set anew")


def test_nothing_is_planned_from_where_the_reference_stood_until_just_now(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Asked for while an arm that did not come to its place is set to be held where it is."""
    bench, planned, dropped = Bench(), threading.Event(), threading.Event()
    plan, hold = reference.segments_through, ReferencePlayer.hold
    refused: list[str] = []

    def planning(at: FloatArray, points: list[Waypoint]) -> object:
        planned.set()
        assert dropped.wait(PATIENCE_S)
        return plan(at, points)

    def ask() -> None:
        try:
            bench.ask()
        except ControlError as error:
            refused.append(str(error))

    asking = threading.Thread(target=ask)

    def holding(player: ReferencePlayer, q: FloatArray, stamp_s: float) -> None:
        monkeypatch.setattr(reference, "segments_through", planning)
        asking.start()
        assert planned.wait(PATIENCE_S)
        hold(player, q, stamp_s)

    far = Waypoint(1.0, POSE[:1] + 0.1, EMPTY, EMPTY)
    bench.core.requests.trajectory("joint", ["lift"], [far])
    monkeypatch.setattr(ReferencePlayer, "hold", holding)
    while not asking.ident and bench.cycle < 3000:
        bench.run()
    dropped.set()
    asking.join(PATIENCE_S)
    assert bench.core.counts.not_followed == 1
    np.testing.assert_array_equal(bench.run().reference.position, POSE)
    assert len(refused) == 1
    assert "the reference was set anew while it was checked" in refused[0]
