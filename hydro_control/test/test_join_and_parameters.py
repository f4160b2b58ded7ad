"""Joining sensor topics by stamp, and the parameters' single declaration."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import fields
from importlib import resources
from pathlib import Path

import numpy as np
import pytest
import yaml

from hydro_control.core.sample_join import SampleJoin
from hydro_control.gains import Gains
from hydro_control.node import parameters
from hydro_model.robot_files import load_robot
from hydro_msgs_docs.messages import StampedVector

ROBOT = load_robot("xs031")


def vector(stamp: int, name: Sequence[str], values: Sequence[float]) -> StampedVector:
    """Of both topics: positions and efforts alike."""
    return StampedVector(stamp, tuple(name), position=tuple(values), effort=tuple(values))


def joints(stamp: int, values: tuple[float, float] = (0.6, -1.5)) -> StampedVector:
    return vector(stamp, ROBOT.joint_names, values)


def pressures(stamp: int, names: tuple[str, ...] = ROBOT.pressure_names) -> StampedVector:
    return vector(stamp, names, [1e6 + i for i in range(len(names))])


def test_the_newest_common_stamp_whatever_the_order() -> None:
    join = SampleJoin(ROBOT)
    assert join.newest() is None
    join.add_pressures(pressures(10))
    before = join.waiting
    join.add_joints(joints(10))
    assert (before, join.waiting) == (True, False)
    sample = join.newest()
    assert sample is not None
    assert sample.stamp_ns == 10
    join.add_joints(joints(20))
    join.add_joints(joints(30))
    join.add_pressures(pressures(20))
    sample = join.newest()
    assert sample is not None
    assert sample.stamp_ns == 20


def test_values_are_taken_by_name() -> None:
    join = SampleJoin(ROBOT)
    join.add_joints(vector(1, ["tilt", "other", "lift"], [-1.5, 9.0, 0.6]))
    names = ROBOT.pressure_names[::-1]
    join.add_pressures(pressures(1, names))
    sample = join.newest()
    assert sample is not None
    np.testing.assert_array_equal(sample.q, [0.6, -1.5])
    at = {name: 1e6 + i for i, name in enumerate(names)}
    np.testing.assert_array_equal(sample.p_a, [at["lift_cylinder/a"], at["tilt_cylinder/a"]])
    np.testing.assert_array_equal(sample.p_b, [at["lift_cylinder/b"], at["tilt_cylinder/b"]])
    assert (sample.p_s, sample.p_t) == (at["supply"], at["tank"])


def test_supply_and_tank_may_be_absent_but_no_chamber() -> None:
    join = SampleJoin(ROBOT)
    join.add_joints(joints(1))
    join.add_pressures(pressures(1, ROBOT.pressure_names[:4]))
    sample = join.newest()
    assert sample is not None
    assert sample.p_s is None
    join.add_pressures(pressures(2, ROBOT.pressure_names[1:]))
    join.add_joints(vector(2, ["lift"], [0.1]))
    assert join.malformed == 2
    assert join.message == "/joint_states should carry lift, tilt, found lift"
    again = join.newest()
    assert again is not None
    assert again.stamp_ns == 1
    # What was wrong is said for as long as it is.
    join.add_joints(joints(3))
    assert (join.malformed, join.message) == (2, "")
    join.clear()
    assert join.malformed == 0


def test_each_rail_counts_by_itself() -> None:
    """A machine with a transducer at the pump and none at the tank."""
    join = SampleJoin(ROBOT)
    join.add_joints(joints(1))
    join.add_pressures(pressures(1, ROBOT.pressure_names[:5]))
    sample = join.newest()
    assert sample is not None
    assert (sample.p_s, sample.p_t) == (1e6 + 4, None)
    assert len(sample.p_a) == len(sample.p_b) == 2


def test_messages_of_other_machines_are_none_of_this_one() -> None:
    join = SampleJoin(ROBOT)
    join.add_joints(vector(1, ["gripper"], [0.1]))
    join.add_pressures(vector(1, ["grapple/a"], [1e6]))
    assert (join.malformed, join.message) == (0, "")


def test_what_is_said_of_foreign_names_is_a_short_line() -> None:
    join = SampleJoin(ROBOT)
    join.add_joints(vector(1, ["lift", *(f"{k}{'x' * 100}\n" for k in range(1000))], [0.1]))
    assert join.malformed == 1
    assert join.message.isprintable()
    assert len(join.message) < 1000


def test_cleared_and_bounded() -> None:
    join = SampleJoin(ROBOT)
    for stamp in range(1000):
        join.add_joints(joints(stamp))
    join.add_pressures(pressures(5))
    assert join.newest() is None
    join.add_pressures(pressures(999))
    assert join.newest() is not None
    join.clear()
    assert join.newest() is None


@pytest.mark.parametrize("first", ["joints", "pressures"])
def test_eight_messages_wait_for_their_partners(first: str) -> None:
    """What came on one topic, for as long as the other may lag behind it."""
    kinds = {"joints": joints, "pressures": pressures}
    (other,) = set(kinds) - {first}
    join = SampleJoin(ROBOT)
    for stamp in range(9):
        getattr(join, f"add_{first}")(kinds[first](stamp))
    getattr(join, f"add_{other}")(kinds[other](0))
    assert join.newest() is None
    getattr(join, f"add_{other}")(kinds[other](1))
    sample = join.newest()
    assert sample is not None
    assert sample.stamp_ns == 1


@pytest.mark.parametrize("kept", [joints, pressures])
def test_cleared_it_joins_nothing_of_before(kept: Callable[[int], StampedVector]) -> None:
    """A sample half of which is from before a pause would be a state that never was."""
    join = SampleJoin(ROBOT)
    adds = {joints: join.add_joints, pressures: join.add_pressures}
    adds.pop(kept)(kept(1))
    join.clear()
    ((make, add),) = adds.items()
    add(make(1))
    assert join.newest() is None


def test_it_waits_for_the_joints_of_the_newest_pressures_alone() -> None:
    join = SampleJoin(ROBOT)
    assert join.waiting is False
    for stamp in (10, 20):
        join.add_joints(joints(stamp))
        assert join.waiting is False
        join.add_pressures(pressures(stamp))
        assert join.waiting is False
    join.add_pressures(pressures(30))
    assert join.waiting is True
    join.add_joints(joints(30))
    assert join.waiting is False


def test_pressures_that_are_right_again_are_not_complained_of() -> None:
    join = SampleJoin(ROBOT)
    join.add_pressures(pressures(1, ROBOT.pressure_names[1:]))
    lacking = ", ".join(ROBOT.pressure_names[1:])
    chambers = ", ".join(ROBOT.pressure_names[:4])
    assert join.message == f"/chamber_pressures should carry {chambers}, found {lacking}"
    join.add_pressures(pressures(2))
    assert (join.malformed, join.message) == (1, "")


def test_every_gain_is_a_parameter_with_its_default_inside_its_range() -> None:
    declared = {p.name: p for p in parameters.PARAMETERS}
    for field in fields(Gains):
        p = declared[field.name]
        assert p.default == getattr(Gains(), field.name)
        assert p.lower <= float(p.default) <= p.upper
        assert p.text


def test_the_table_lists_every_parameter() -> None:
    table = parameters.markdown_table()
    lines = table.splitlines()
    assert len(lines) == len(parameters.PARAMETERS) + 2
    assert all(line.count("|") == lines[0].count("|") for line in lines)
    assert "| `k_x_m` | double | `0.0` | 0 to 1 | m |" in table


@pytest.mark.parametrize("name", ["gains.yaml", "paper_table3.yaml"])
def test_shipped_gain_files_name_known_parameters_within_range(name: str) -> None:
    file = Path(str(resources.files("hydro_control"))) / "config" / name
    values: dict[str, float] = yaml.safe_load(file.read_text())["controller"]["ros__parameters"]
    declared = {p.name: p for p in parameters.PARAMETERS}
    for key, value in values.items():
        assert type(value) is type(declared[key].default), key
        assert declared[key].lower <= float(value) <= declared[key].upper
    assert set(values) == {f.name for f in fields(Gains)}
    gains = Gains(**values)
    if name == "gains.yaml":
        assert gains == Gains()
    else:
        assert (gains.k_p_1_s, gains.k_v, gains.k_x_m) == (10.0, 3e4, 0.04)
        assert gains.alpha_qd == gains.alpha_p == 0.04
