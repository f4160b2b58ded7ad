"""Commands that the valves do not get: noticed, followed, and never caught up with at once."""

from __future__ import annotations

import numpy as np
import pytest

from hydro_control.adaptation.adaptation_settings import AdaptationSettings
from hydro_control.core.core import Answer, ControllerCore, Sample
from hydro_control.errors import ControlError
from hydro_control.gains import Gains
from hydro_control.monitoring.applied import IDLE, MOST_WITHHELD, AppliedWatch
from hydro_control.motion.trajectory import Waypoint
from hydro_model.hydraulics.cylinder import lever
from hydro_model.motion.paths import JointPath
from hydro_model.motion.paths_segments import Quintic
from hydro_model.multibody.rigid_body import inverse_dynamics
from hydro_model.robot import FloatArray
from hydro_model.robot_files import load_robot

ROBOT = load_robot("xs031")
POSE = np.array([0.6, -1.5])
STEP_NS = 2_000_000
ZERO = np.zeros(2)
RATED_V = np.full(2, 10.0)
SOME = np.array([1.0, -0.5])
PATH = JointPath((Quintic.at_rest([0.6], [0.8], 2.0),), joints=("lift",))


def watch_of(
    pairs: list[tuple[FloatArray, FloatArray]], *, moving: bool = False, first: str = "commanded"
) -> AppliedWatch:
    watch = AppliedWatch(RATED_V)
    for stamp, (commanded, applied) in enumerate(pairs):
        if first == "commanded":
            watch.commanded(stamp, commanded, moving=moving)
        watch.applied(stamp, applied)
        if first != "commanded":
            watch.commanded(stamp, commanded, moving=moving)
    return watch


@pytest.mark.parametrize("first", ["commanded", "applied"])
def test_more_than_ten_stamps_in_a_row_are_withheld(first: str) -> None:
    none = (SOME, ZERO)
    assert not watch_of([none] * MOST_WITHHELD, first=first).withheld
    watch = watch_of([none] * (MOST_WITHHELD + 1), first=first)
    assert (watch.withheld, watch.settled, watch.count) == (True, False, MOST_WITHHELD + 1)
    assert not watch_of([*[none] * 10, (SOME, SOME), *[none] * 10], first=first).withheld
    watch = watch_of([*[none] * 11, (SOME, SOME / 9.0)], first=first)
    assert (watch.withheld, watch.settled) == (False, False)
    assert watch_of([*[none] * 11, (SOME, SOME / 9.0), (SOME, SOME)], first=first).settled


def test_order_and_delay_of_what_was_applied_do_not_matter() -> None:
    watch = AppliedWatch(RATED_V)
    for stamp in range(150):
        watch.commanded(stamp, SOME, moving=True)
    for stamp in reversed(range(150)):
        watch.applied(stamp, SOME)
    assert (watch.withheld, watch.count, watch.moved) == (False, 0, True)


def test_what_is_no_evidence_is_not_counted() -> None:
    # 0 V commanded, within the step of a wire of 8 bits: neither way. Another voltage than
    # commanded: a ramp.
    assert not watch_of([(np.full(2, 0.04), ZERO)] * 50).withheld
    assert watch_of([(np.array([0.0, 0.06]), ZERO)] * 50).withheld
    assert not watch_of([(SOME, SOME / 100.0)] * 50).withheld
    mixed = [(SOME, ZERO), (ZERO, ZERO)] * (MOST_WITHHELD + 1)
    assert watch_of(mixed).withheld
    watch = AppliedWatch(RATED_V)
    for stamp in range(1000):  # stamps that were never answered
        watch.applied(stamp, ZERO)
    assert watch.count == 0


def test_nothing_is_withheld_before_anything_was_commanded() -> None:
    watch = AppliedWatch(RATED_V)
    assert (watch.withheld, watch.settled, watch.moved, watch.count) == (False, True, False, 0)


@pytest.mark.parametrize("order", ["aca", "cac"])
def test_two_halves_make_a_stamp_and_a_third_waits(order: str) -> None:
    watch = AppliedWatch(RATED_V)
    for half in order:
        if half == "a":
            watch.applied(1, ZERO)
        else:
            watch.commanded(1, SOME, moving=False)
    assert watch.count == 1


def test_an_applied_command_ends_the_row() -> None:
    none = (SOME, ZERO)
    watch = watch_of([none, (SOME, SOME), *[none] * 10])
    assert not watch.withheld
    assert watch_of([none, (SOME, SOME), *[none] * 11]).withheld


@pytest.mark.parametrize("asked_v", [0.0, 0.039, -0.05])
def test_0_v_that_is_right_for_a_second_is_not_withheld(asked_v: float) -> None:
    """A wire of 8 bits has no voltage below 39 mV: nothing else would ever tell."""
    withheld = [(SOME, ZERO)] * (MOST_WITHHELD + 1)
    right = (np.array([0.0, asked_v]), ZERO)
    assert IDLE / 500.0 == 1.0  # stamps of the contract's rate
    assert watch_of([*withheld, *[right] * (IDLE - 1)]).withheld
    watch = watch_of([*withheld, *[right] * IDLE])
    assert (watch.withheld, watch.settled, watch.count) == (False, False, MOST_WITHHELD + 1)
    # In a row: what is withheld once more begins the second anew.
    between = [*withheld, *[right] * (IDLE - 1), (SOME, ZERO), *[right] * (IDLE - 1)]
    assert watch_of(between).withheld
    assert not watch_of([*between, right]).withheld
    # And as many stamps as at the beginning are needed to see it again.
    once = [*withheld, *[right] * IDLE]
    assert not watch_of([*once, *withheld[1:]]).withheld
    again = [*once, *withheld]
    assert watch_of([*again, *[right] * (IDLE - 1)]).withheld
    assert not watch_of([*again, *[right] * IDLE]).withheld
    # Nor do stamps count that were right before, or before it was applied and withheld again.
    assert watch_of([*[right] * IDLE, *withheld, *[right] * (IDLE - 1)]).withheld
    broken = [*withheld, *[right] * (IDLE - 1), (SOME, SOME), *withheld, *[right] * (IDLE - 1)]
    assert watch_of(broken).withheld


def test_what_counts_as_0_v_as_told_and_as_settled() -> None:
    milli = np.array([1e-3, 0.0])
    assert watch_of([(SOME, milli)]).count == 1
    assert watch_of([(SOME, 1.001 * milli)]).count == 0
    assert watch_of([(np.array([0.05, 0.0]), ZERO)]).count == 0
    assert watch_of([(np.array([0.0501, 0.0]), ZERO)]).count == 1
    none = [(SOME, ZERO)] * 11
    step = np.array([0.05, 0.0])
    assert watch_of([*none, (ZERO, step)]).settled
    assert not watch_of([*none, (ZERO, 1.002 * step)]).settled
    assert not watch_of([*none, (np.array([0.0, -0.01]), step[::-1])]).settled


def test_commands_are_applied_as_they_are_by_a_wire_of_coarse_steps() -> None:
    """Eight bits for 10 V either way: rounded by up to 39 mV, told as what is on the wire."""
    step_v = 10.0 / 127.0
    for commanded in np.random.default_rng(1).uniform(-9.0, 9.0, (200, 2)):
        on_wire = step_v * np.round(commanded / step_v)
        assert watch_of([*[(SOME, ZERO)] * 11, (commanded, on_wire)]).settled


def test_what_a_coarse_wire_applies_is_learnt_from_again() -> None:
    loop = Loop(adaptation=AdaptationSettings(kinds=("payload", "friction", "null_bias")))
    loop.run(30, share=0.0)
    adaptation = loop.core.law.adaptation
    assert adaptation is not None
    for k in range(400):
        answer = loop.run(1, POSE + 0.05 * np.sin(0.02 * k), share=None)
        loop.core.applied(answer.stamp_ns, on_coarse_wire(answer))
    assert adaptation.report()["adaptation_updates"]


@pytest.mark.parametrize("later", [0, 1])
@pytest.mark.parametrize("first", ["commanded", "applied"])
def test_the_newest_200_halves_are_kept(first: str, later: int) -> None:
    watch = AppliedWatch(RATED_V)
    for stamp in range(200 + later):
        if first == "commanded":
            watch.commanded(stamp, SOME, moving=False)
        else:
            watch.applied(stamp, ZERO)
    if first == "commanded":
        watch.applied(0, ZERO)
    else:
        watch.commanded(0, SOME, moving=False)
    assert watch.count == 1 - later


def test_half_a_story_is_forgotten_after_a_while() -> None:
    watch = AppliedWatch(RATED_V)
    for stamp in range(1000):
        watch.commanded(stamp, SOME, moving=False)
    watch.applied(0, ZERO)
    assert watch.count == 0
    watch.applied(999, ZERO)
    assert watch.count == 1


def sample(cycle: int, q: FloatArray) -> Sample:
    half = np.full(2, 8e6)
    return Sample(10**18 + cycle * STEP_NS, q, half, half, None, None)


def balanced(cycle: int, q: FloatArray) -> Sample:
    """The same with chambers that hold the arm there."""
    torque, p_b = inverse_dynamics(ROBOT, q, ZERO, ZERO), np.full(2, 8e6)
    arms = [float(lever(c, x)) for c, x in zip(ROBOT.cylinders, q, strict=True)]
    area_a, area_b = np.array([(c.area_a_m2, c.area_b_m2) for c in ROBOT.cylinders]).T
    air = ROBOT.atmospheric_pressure_pa
    p_a = (torque / arms + p_b * area_b) / area_a
    return Sample(10**18 + cycle * STEP_NS, q, p_a + air, p_b + air, None, None)


def on_coarse_wire(answer: Answer) -> FloatArray:
    """What 8 bits for 10 V either way make of a command."""
    step_v = 10.0 / 127.0
    return np.asarray(step_v * np.round(answer.output.voltage_v / step_v))


class Loop:
    """A controller and the valves' side of it; the robot stands where it is told."""

    def __init__(self, path: JointPath | None = None, **options: object) -> None:
        self.core = ControllerCore(ROBOT, Gains(), path, **options)  # type: ignore[arg-type]
        self.cycle = 0

    def run(self, cycles: int, q: FloatArray = POSE, *, share: float | None = 1.0) -> Answer:
        answer = None
        for _ in range(cycles):
            answer = self.core.answer(sample(self.cycle, q))
            assert answer is not None
            if share is not None:
                self.core.applied(answer.stamp_ns, share * answer.output.voltage_v)
            self.cycle += 1
        assert answer is not None
        return answer


def test_applied_commands_change_no_bit_whenever_they_are_told() -> None:
    def voltages(late: int | None) -> bytes:
        core, told, out = ControllerCore(ROBOT, Gains(), PATH, 0.1), [], []
        for k in range(300):
            answer = core.answer(sample(k, POSE))
            assert answer is not None
            out.append(answer.output.voltage_v)
            told.append(answer)
            if late is not None and k >= late:
                past = told[k - late]
                core.applied(past.stamp_ns, past.output.voltage_v)
        return np.array(out).tobytes()

    assert voltages(None) == voltages(0) == voltages(1) == voltages(40)


def test_a_motion_that_is_withheld_is_dropped_and_held_where_the_robot_is() -> None:
    loop = Loop(PATH, start_delay_s=0.1)
    moving = loop.run(500).reference
    assert moving.velocity[0] > 0.0
    loop.run(MOST_WITHHELD + 1, share=0.0)
    sunk = POSE - 0.05
    reference = loop.run(100, sunk, share=0.0).reference
    np.testing.assert_array_equal(reference.position, sunk)
    assert "do not get the commands" in loop.core.message
    assert not loop.core.moving
    assert loop.core.counts.withheld > 100
    with pytest.raises(ControlError, match="do not get the commands"):
        loop.core.requests.trajectory("joint", ["lift"], [Waypoint(1.0, POSE[:1], ZERO, ZERO)])
    # Applied again, slowly: held where it was then, with no error to catch up with.
    loop.run(1, sunk, share=0.01)
    reference = loop.run(200, sunk - 0.01, share=0.01).reference
    np.testing.assert_array_equal(reference.position, sunk)
    np.testing.assert_array_equal(reference.velocity, ZERO)
    assert loop.core.message.startswith("holding: the motion was dropped")
    there = [Waypoint(1.0, np.array([0.6]), np.array([]), np.array([]))]
    loop.core.requests.trajectory("joint", ["lift"], there)
    loop.run(1, sunk)
    assert loop.core.moving
    assert loop.core.message == ""


def test_a_path_of_which_nothing_was_driven_starts_anew() -> None:
    loop = Loop(PATH, start_delay_s=0.1)
    loop.run(700, share=0.0)  # with the valves off it would be well under way
    np.testing.assert_array_equal(loop.run(1, share=0.0).reference.position, POSE)
    loop.run(1)
    begin = loop.cycle
    for k in range(300):
        expected = PATH.sample(k * 0.002 - 0.1)[0][0]
        np.testing.assert_allclose(
            loop.run(1).reference.position, [expected, -1.5], atol=1e-12, err_msg=str(begin + k)
        )
    assert loop.core.message == ""


def test_a_path_under_way_does_not_start_anew() -> None:
    loop = Loop(PATH)
    loop.run(20)
    loop.run(50, share=0.0)
    assert not np.any(loop.run(300).reference.velocity)


def test_withheld_is_said_where_it_is_noticed_while_the_valves_are_shut() -> None:
    """Told late, behind a sample that could not be answered: the pose was followed unsaid."""
    loop = Loop(PATH)
    loop.run(100)
    late = [loop.run(1, share=None) for _ in range(MOST_WITHHELD + 1)]
    loop.run(1, np.full(2, np.nan), share=None)
    loop.run(1, share=None)
    for answer in late:
        loop.core.applied(answer.stamp_ns, ZERO)
    loop.run(100, share=None)
    assert loop.core.message == "the valves do not get the commands: staying with the robot's pose"
    with pytest.raises(ControlError, match="do not get the commands"):
        loop.core.requests.trajectory("joint", ["lift"], [Waypoint(1.0, POSE[:1], ZERO, ZERO)])
    loop.run(2)
    assert loop.core.message.startswith("holding: the motion was dropped")


def test_a_hold_stays_a_hold() -> None:
    loop = Loop()
    loop.run(20)
    loop.run(50, share=0.0)
    loop.run(3)
    assert loop.core.message == ""
    loop.core.restart()
    assert not loop.core.moving


def test_an_arm_at_rest_on_a_coarse_wire_is_held_again() -> None:
    """Its weight is carried, so the wire has no step for what is asked for: 0 V is applied.

    It crept away unheld, no limit of its motion was looked at, and no trajectory was taken.
    """
    loop, q = Loop(), POSE
    loop.run(30, share=0.0)
    assert loop.core.message.startswith("the valves do not get the commands")
    for k in range(2000):
        q = POSE - 1e-7 * k  # it creeps
        answer = loop.core.answer(balanced(loop.cycle + k, q))
        assert answer is not None
        # What was asked for before it was balanced has faded when the bridge drives again.
        loop.core.applied(answer.stamp_ns, on_coarse_wire(answer) if k >= 200 else ZERO)
    assert loop.core.message == ""
    assert np.all(answer.reference.position - q > 1e-4)
    there = [Waypoint(1.0, np.array([0.6]), np.array([]), np.array([]))]
    loop.core.requests.trajectory("joint", ["lift"], there)


def test_nothing_is_learnt_while_commands_have_no_effect() -> None:
    settings = AdaptationSettings(kinds=("payload", "friction", "null_bias"))
    loop = Loop(adaptation=settings)
    loop.run(30, share=0.0)
    adaptation = loop.core.law.adaptation
    assert adaptation is not None
    before = adaptation.estimates
    for k in range(400):  # pushed by something else
        loop.run(1, POSE + 0.05 * np.sin(0.02 * k), share=0.0)
    np.testing.assert_array_equal(adaptation.estimates, before)
    assert adaptation.frozen
