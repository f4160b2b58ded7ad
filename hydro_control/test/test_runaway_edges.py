"""Where exactly the watch of measured motion begins to object, sample by sample."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from hydro_control.monitoring.runaway import RunawayLimits, RunawayWatch
from hydro_control.motion.motion_limits import limits_of
from hydro_model.hydraulics.cylinder import lever
from hydro_model.robot import FloatArray, Robot
from hydro_model.robot_files import load_robot

ROBOT = load_robot("xs031")
LIMITS = limits_of(ROBOT, 20.0)  # of the tip's speed nothing here
RANGE = LIMITS.upper - LIMITS.lower
MIDDLE, LIFT = np.array([0.5, -1.25]), np.array([1.0, 0.0])
#: A power of two, so that times and speeds are exact.
DT = 1.0 / 512.0
#: So that only positions count.
ANY_SPEED = RunawayLimits(speed_factor=1e6)
#: The lift's limit is 1 rad/s, and 1.5 times that a fault.
TOO_FAST = 1.5
#: The lower and the upper end of the lift.
ENDS = pytest.mark.parametrize("sign", [-1.0, 1.0])


def watch(runaway: RunawayLimits = ANY_SPEED, robot: Robot = ROBOT) -> RunawayWatch:
    return RunawayWatch(robot, LIMITS, runaway, DT)


def beyond(sign: float, by: float) -> FloatArray:
    """The lift beyond an end by a share of its range."""
    end = LIMITS.upper if sign > 0.0 else LIMITS.lower
    q = MIDDLE.copy()
    q[0] = (end + sign * (by * RANGE))[0]
    return q


def judged(
    one: RunawayWatch, rows: list[FloatArray], *, first: int = 0, driven: bool = True
) -> list[str]:
    """What is said of samples that follow each other."""
    return [one.judge((first + k) * DT, q, driven=driven) for k, q in enumerate(rows)]


def lifted(angles: list[float]) -> list[FloatArray]:
    """Positions with the lift at these angles from the middle."""
    return [MIDDLE + angle * LIFT for angle in angles]


def test_before_the_first_sample_joints_may_be_within_their_ends() -> None:
    one = watch()
    assert not one.opened
    assert np.array_equal((one.lower, one.upper), (LIMITS.lower, LIMITS.upper))


@pytest.mark.parametrize("field", ["end_share", "speed_factor"])
def test_its_limits_cannot_be_changed(field: str) -> None:
    limits = RunawayLimits()
    with pytest.raises(AttributeError):
        setattr(limits, field, 99.0)
    assert not hasattr(limits, "__dict__")


@ENDS
@pytest.mark.parametrize(("share", "faulty"), [(0.02, False), (0.0201, True)])
def test_at_the_margin_is_not_beyond_it(sign: float, share: float, faulty: bool) -> None:
    said = judged(watch(), [MIDDLE, *[beyond(sign, share)] * 4])
    assert [bool(text) for text in said] == [False, False, False, faulty, faulty]
    assert not faulty or said[-1].endswith(
        f"expected {LIMITS.lower[0] - 0.035:.4f} to {LIMITS.upper[0] + 0.035:.4f}:"
        " latched until the controller is activated anew"
    )


@ENDS
def test_two_wrong_readings_are_none_and_three_are_a_fault(sign: float) -> None:
    out = beyond(sign, 0.05)
    assert not any(judged(watch(), [MIDDLE, out, out, MIDDLE, out, out, MIDDLE]))
    one = watch()
    assert judged(one, [MIDDLE, out, out, out])[-1]
    # Latched, until it begins anew: by then it may stand there.
    assert judged(one, [MIDDLE] * 9, first=4)[-1] == one.fault != ""
    one.forget()
    assert not any(judged(one, [out] * 9, first=13))


@ENDS
def test_what_stands_beyond_an_end_may_stay_be_driven_back_and_not_return(sign: float) -> None:
    one = watch()
    assert not any(judged(one, [beyond(sign, 0.08)] * 5))
    assert one.opened
    assert not any(judged(one, [beyond(sign, 0.05)] * 5, first=5))
    assert (one.upper if sign > 0.0 else one.lower)[0] == beyond(sign, 0.05)[0]
    assert not any(judged(one, [beyond(sign, 0.069)] * 5, first=10))
    assert judged(one, [beyond(sign, 0.071)] * 3, first=15)[-1]


@ENDS
def test_one_wrong_reading_does_not_close_the_way_where_it_stands(sign: float) -> None:
    one = watch(RunawayLimits())
    out = [beyond(sign, 0.08)]
    assert not any(judged(one, [*out * 20, MIDDLE, *out * 30]))
    assert one.opened


@ENDS
def test_a_tenth_of_the_range_beyond_is_the_farthest_that_is_driven_back(sign: float) -> None:
    assert not any(judged(watch(), [beyond(sign, 0.1)] * 5))
    said = judged(watch(), [beyond(sign, 0.1001)] * 5)
    assert [bool(text) for text in said] == [False, False, True, True, True]
    assert "expected -0.2250 to 1.8750 to be driven back from" in said[-1]


@ENDS
def test_where_it_would_be_driven_back_from_the_margin_is_what_was_expected(sign: float) -> None:
    said = judged(watch(), [MIDDLE, *[beyond(sign, 0.1)] * 3])
    expected = f"expected {LIMITS.lower[0] - 0.035:.4f} to {LIMITS.upper[0] + 0.035:.4f}: latched"
    assert expected in said[-1]


@ENDS
def test_a_machine_that_is_not_driven_may_stand_anywhere(sign: float) -> None:
    """Of three samples in a row that are believed the last of these is one."""
    one = watch()
    assert not any(judged(one, [beyond(sign, 0.2)] * 9, driven=False))
    said = judged(one, [beyond(sign, 0.2)] * 3, first=9)
    assert [bool(text) for text in said] == [False, True, True]


def test_how_fast_it_was_before_it_was_driven_does_not_count() -> None:
    one = watch(RunawayLimits())
    swung = lifted([0.02 * k for k in range(20)])
    assert not any(judged(one, swung, driven=False))
    assert not any(judged(one, [swung[-1]] * 30, first=20))


@pytest.mark.parametrize(("faster", "found"), [(2.0, 8), (10.0 / 3.0, 5), (1.02, 10)])
def test_a_speed_is_that_of_the_last_ten_sample_times(faster: float, found: int) -> None:
    """From standing still: after `found` samples their mean is above 1.5 times the limit."""
    speed = TOO_FAST * faster if faster < 1.1 else faster
    moving = [speed * DT * k for k in range(1, 15)]
    said = judged(watch(RunawayLimits()), lifted([0.0] * 20 + moving))
    assert [bool(text) for text in said[20:]] == [k >= found + 2 for k in range(1, 15)]


def test_at_the_speed_itself_is_not_above_it() -> None:
    moving = lifted([TOO_FAST * DT * k for k in range(40)])
    assert not any(judged(watch(RunawayLimits()), moving))


@pytest.mark.parametrize(("steps", "faulty"), [(9, True), (10, True), (11, False), (12, False)])
def test_over_a_gap_of_more_than_ten_sample_times_there_is_no_speed(
    steps: int, faulty: bool
) -> None:
    """Samples were lost, and where they begin again the lift stands elsewhere."""
    one = watch(RunawayLimits())
    assert not any(judged(one, lifted([0.0] * 20)))
    leap = 1.1 * TOO_FAST * 21 * DT  # too fast in whatever span the gap is
    said = judged(one, lifted([leap] * 30), first=19 + steps)
    assert bool(said[-1]) == faulty


def turning_at(sign: float, by: float, *, pulls: bool) -> tuple[Robot, float]:
    """A robot whose lift has no lever so far beyond an end; how far beyond it is 5 mm still."""
    zero = beyond(sign, 0.0)[0] + sign * by
    lift = next(c for c in ROBOT.cylinders if c.joint == "lift")
    # Its lever is 0 where its pins and the joint are in a line: beside or across each other.
    lift = replace(lift, q0_rad=-zero if pulls else np.pi - zero)
    robot = replace(
        ROBOT, cylinders=tuple(lift if c.joint == "lift" else c for c in ROBOT.cylinders)
    )
    near, far = 0.0, by
    for _ in range(60):
        middle = 0.5 * (near + far)
        long = abs(float(lever(lift, zero + sign * (middle - by)))) >= 0.005
        near, far = (middle, far) if long else (near, middle)
    return robot, near


def driven_from(robot: Robot, sign: float, by: float) -> bool:
    """Whether the lift is driven from so far beyond an end."""
    q = beyond(sign, 0.0)
    q[0] += sign * by
    return not any(judged(watch(robot=robot), [q] * 3))


@ENDS
@pytest.mark.parametrize("pulls", [False, True])
@pytest.mark.parametrize("by", [0.05, 0.1, 0.15])
def test_it_is_driven_back_from_where_its_cylinder_has_a_lever(
    sign: float, pulls: bool, by: float
) -> None:
    robot, reach = turning_at(sign, by, pulls=pulls)
    step = 0.1 * RANGE[0] / 99.0  # as finely as it is looked at
    assert 3.0 * step < reach < by
    assert driven_from(robot, sign, reach - step)
    assert not driven_from(robot, sign, reach + 1e-6)


@ENDS
def test_without_a_lever_at_its_end_it_is_driven_from_nowhere_beyond(sign: float) -> None:
    robot, _ = turning_at(sign, 0.001, pulls=True)
    assert driven_from(robot, sign, 0.0)
    assert not driven_from(robot, sign, 1e-6)
