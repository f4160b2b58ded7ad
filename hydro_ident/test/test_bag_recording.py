"""From a bag to aligned arrays: joined by stamp, nothing filled in, every loss named."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from hydro_ident.bag.gaps import contiguous, find_gaps
from hydro_ident.bag.grid import runs
from hydro_ident.bag.recording import read_recording
from hydro_ident.bag.writer import BagWriter
from hydro_ident.errors import BagError
from hydro_ident.inspecting.inspection_reading import inspect_bag
from hydro_model.robot_files import load_robot
from hydro_msgs_docs.cdr import JOINT_STATE, TEMPERATURE

START_NS = 1_700_000_000_000_000_000
PERIOD_NS = 2_000_000
N = 300


def _without(names: tuple[str, ...], values: dict, gone: str) -> tuple[tuple[str, ...], dict]:
    keep = [i for i, name in enumerate(names) if name != gone]
    return tuple(names[i] for i in keep), {f: v[:, keep] for f, v in values.items()}


def test_a_whole_run_is_read_bit_by_bit(write_bag, run_columns, robot) -> None:
    columns = run_columns(N)
    r = read_recording(write_bag(columns), robot)
    assert len(r) == N
    assert r.period_s == pytest.approx(0.002, abs=1e-15)
    assert r.duration_s == pytest.approx(0.598)
    np.testing.assert_array_equal(r.stamp_ns, START_NS + PERIOD_NS * np.arange(N))
    np.testing.assert_array_equal(r.q, columns["/joint_states"][1]["position"])
    pressure = columns["/chamber_pressures"][1]["effort"] - robot.atmospheric_pressure_pa
    np.testing.assert_array_equal(r.p_a, pressure[:, [0, 2]])
    np.testing.assert_array_equal(r.p_b, pressure[:, [1, 3]])
    np.testing.assert_array_equal(r.supply, pressure[:, 4])
    np.testing.assert_array_equal(r.tank, pressure[:, 5])
    np.testing.assert_array_equal(r.valve_v, columns["/valve_state"][1]["effort"])
    np.testing.assert_array_equal(r.spool, columns["/valve_state"][1]["position"])
    np.testing.assert_array_equal(r.force_ref, columns["/joint_reference"][1]["effort"])
    np.testing.assert_array_equal(r.tip_ref, columns["/tip_reference"][1]["point"])
    assert r.valve_source == "/valve_state"
    assert r.losses == r.gaps == r.notes == ()
    assert r.duplicates == {}
    assert r.stroke is r.effort is r.temperature_c is None
    assert r.segments == (slice(0, N),)
    assert not r.latched.any()


def test_columns_follow_the_robot_whatever_the_order_in_the_bag(
    write_bag, run_columns, robot
) -> None:
    columns = run_columns(20)
    turned = {
        topic: (names[::-1], {f: v[:, ::-1] for f, v in values.items()})
        if names
        else (names, values)
        for topic, (names, values) in columns.items()
    }
    one = read_recording(write_bag(columns), robot)
    two = read_recording(write_bag(turned, name="turned"), robot)
    for field in ("q", "p_a", "p_b", "supply", "tank", "valve_v", "spool", "q_ref"):
        np.testing.assert_array_equal(getattr(one, field), getattr(two, field))


def test_missing_cycles_are_gaps_and_never_filled(write_bag, run_columns, robot) -> None:
    columns = run_columns(N)
    columns["/joint_states"][1]["position"][100:103] = np.nan
    columns["/chamber_pressures"][1]["effort"][200] = np.nan
    r = read_recording(write_bag(columns), robot)
    kept = np.r_[0:100, 103:200, 201:N]
    np.testing.assert_array_equal(r.stamp_ns, START_NS + PERIOD_NS * kept)
    np.testing.assert_array_equal(r.valve_v, columns["/valve_state"][1]["effort"][kept])
    assert [gap.missing for gap in r.gaps] == [3, 1]
    assert r.gaps[0].after_ns == START_NS + 99 * PERIOD_NS
    assert r.gaps[0].before_ns == START_NS + 103 * PERIOD_NS
    assert r.segments == (slice(0, 100), slice(100, 197), slice(197, 296))


def test_optional_topics_are_nan_where_they_have_no_sample(write_bag, run_columns, robot) -> None:
    columns = run_columns(N)
    columns["/valve_state"][1]["effort"][:50] = np.nan
    columns["/tip_reference"][1]["point"][:70] = np.nan
    r = read_recording(write_bag(columns), robot)
    assert len(r) == N
    assert r.valve_v is not None
    assert r.tip_ref is not None
    assert np.isnan(r.valve_v[:50]).all()
    assert np.isfinite(r.valve_v[50:]).all()
    assert np.isnan(r.tip_ref[:70]).all()
    assert np.isfinite(r.tip_ref[70:]).all()
    assert r.segments == (slice(0, N),)


def test_repeated_stamps_are_dropped_and_counted(write_bag, run_columns, robot) -> None:
    columns = run_columns(N)
    repeat = {"/joint_states": 4, "/chamber_pressures": 4}
    r = read_recording(write_bag(columns, repeat=repeat), robot)
    assert r.duplicates == repeat
    assert len(r) == N
    np.testing.assert_array_equal(r.q, columns["/joint_states"][1]["position"])
    assert r.gaps == ()


@pytest.mark.parametrize("same_stamp", [True, False])
def test_what_others_publish_among_the_joints_makes_no_cycles(robot, tmp_path, same_stamp) -> None:
    """A gripper of its own, or a second broadcaster, on the same topic."""
    q = np.random.default_rng(1).normal(size=(N, 2))
    with BagWriter(tmp_path / "bag") as bag:
        bag.add_topic("/joint_states", JOINT_STATE)
        for k in range(N):
            stamp_ns = START_NS + PERIOD_NS * k
            if k % 10 == 0:
                other_ns = stamp_ns if same_stamp else stamp_ns - PERIOD_NS // 2
                other = {"position": [0.1 * k]}
                bag.write_stamped("/joint_states", other_ns, other, names=["gripper"])
            own = {"position": q[k]}
            bag.write_stamped("/joint_states", stamp_ns, own, names=robot.joint_names)
    r = read_recording(tmp_path / "bag", robot)
    np.testing.assert_array_equal(r.stamp_ns, START_NS + PERIOD_NS * np.arange(N))
    np.testing.assert_array_equal(r.q, q)
    assert r.period_s == pytest.approx(0.002)
    assert r.duplicates == {}
    assert inspect_bag(tmp_path / "bag", robot).cycles == N


def test_messages_out_of_order_are_sorted_and_said(write_bag, run_columns, robot) -> None:
    columns = run_columns(N)
    stamps = START_NS + PERIOD_NS * np.arange(N)
    stamps[[10, 11]] = stamps[[11, 10]]
    r = read_recording(write_bag(columns, stamps=stamps), robot)
    assert (np.diff(r.stamp_ns) == PERIOD_NS).all()
    np.testing.assert_array_equal(r.q[10], columns["/joint_states"][1]["position"][11])
    assert "/joint_states: 1 messages with a stamp older than the one before" in r.notes


def _losses(r) -> dict[str, str]:
    return {loss.channel: loss.reason for loss in r.losses}


def test_no_valve_topic_costs_the_flow_channels(write_bag, run_columns, robot) -> None:
    columns = run_columns(20)
    del columns["/valve_state"]
    r = read_recording(write_bag(columns), robot)
    assert r.losses == ()
    assert r.valve_source == "/valve_command"
    np.testing.assert_array_equal(r.valve_v, columns["/valve_command"][1]["effort"])
    del columns["/valve_command"]
    r = read_recording(write_bag(columns, name="two"), robot)
    assert r.valve_v is None
    reason = "no /valve_command or /valve_state"
    assert _losses(r) == {f"{j}/flow_{s}": reason for j in ("lift", "tilt") for s in "ab"}


def test_a_valve_topic_without_voltages_is_told_of(write_bag, run_columns, robot) -> None:
    """It had been said that there is none, above a table of topics that has it."""
    columns = run_columns(20)
    del columns["/valve_command"]
    stamps, fields = columns["/valve_state"][0], columns["/valve_state"][1]
    columns["/valve_state"] = (
        stamps,
        {"position": fields["effort"]},
        *columns["/valve_state"][2:],
    )
    r = read_recording(write_bag(columns), robot)
    assert (r.valve_v, r.valve_source) == (None, "")
    assert _losses(r) == {
        f"{j}/flow_{s}": f"no voltage (effort) of {j}_valve in /valve_state"
        for j in ("lift", "tilt")
        for s in "ab"
    }


@pytest.mark.parametrize(("every", "how"), [(0, "no"), (20, "hardly a")])
def test_valves_with_stamps_of_their_own_are_told(
    every: int, how: str, tmp_path, run_columns, robot
) -> None:
    columns = run_columns(N)
    with BagWriter(tmp_path / "bag") as writer:
        for topic in ("/joint_states", "/chamber_pressures", "/valve_state"):
            writer.add_topic(topic, JOINT_STATE)
        for k in range(N):
            for topic in ("/joint_states", "/chamber_pressures", "/valve_state"):
                names, fields = columns[topic]
                own = topic == "/valve_state" and not (every and k % every == 0)
                stamp = START_NS + k * PERIOD_NS + (1000 if own else 0)
                writer.write_stamped(
                    topic, stamp, {f: v[k] for f, v in fields.items()}, names=names
                )
    r = read_recording(tmp_path / "bag", robot)
    reason = (
        f"{how} stamp of /valve_state is that of a cycle: record /valve_state with the stamps of"
        " /joint_states"
    )
    assert _losses(r) == {f"{j}/flow_{s}": reason for j in ("lift", "tilt") for s in "ab"}


def test_valves_that_are_slower_or_faster_than_the_cycles_lose_nothing(
    write_bag, run_columns, robot
) -> None:
    columns = run_columns(N)
    del columns["/valve_command"]
    for topic in ("/valve_state", "/chamber_pressures"):
        names, fields = columns[topic]
        thin = {f: np.where(np.arange(N)[:, None] % 5, np.nan, v) for f, v in fields.items()}
        bag = write_bag(columns | {topic: (names, thin)}, name=topic.strip("/"))
        assert read_recording(bag, robot).losses == ()


def test_one_chamber_costs_the_joints_force_and_that_flow(write_bag, run_columns, robot) -> None:
    columns = run_columns(20)
    names, values = columns["/chamber_pressures"]
    columns["/chamber_pressures"] = _without(names, values, "lift_cylinder/b")
    r = read_recording(write_bag(columns), robot)
    reason = "no lift_cylinder/b in /chamber_pressures"
    assert _losses(r) == {"lift/force": reason, "lift/flow_b": reason}
    assert r.p_b is not None
    assert np.isnan(r.p_b[:, 0]).all()
    assert np.isfinite(r.p_b[:, 1]).all()


def test_constants_of_the_robot_file_stand_in(write_bag, run_columns, robot) -> None:
    columns = run_columns(20)
    names, values = columns["/chamber_pressures"]
    names, values = _without(names, values, "supply")
    columns["/chamber_pressures"] = _without(names, values, "tank")
    r = read_recording(write_bag(columns), robot)
    assert r.supply is r.tank is None
    bar = f"{robot.supply_pressure_pa / 1e5:g} bar"
    assert bar in _losses(r)["supply"]
    assert set(_losses(r)) == {"supply", "tank"}


def test_a_missing_angle_costs_every_force_that_needs_it(write_bag, run_columns, robot) -> None:
    columns = run_columns(20)
    columns["/joint_states"] = _without(*columns["/joint_states"], "tilt")
    r = read_recording(write_bag(columns), robot)
    lost = _losses(r)
    assert set(lost) == {"lift/force", "tilt/force", "tilt/flow_a", "tilt/flow_b"}
    assert lost["lift/force"] == "no position of tilt in /joint_states"
    assert np.isnan(r.q[:, 1]).all()


def test_a_stroke_sensor_keeps_the_flows_without_the_angle(write_bag, run_columns, robot) -> None:
    columns = run_columns(20)
    _, values = columns["/joint_states"]
    columns["/joint_states"] = (("lift", "tilt_cylinder"), values)
    r = read_recording(write_bag(columns), robot)
    assert r.stroke is not None
    np.testing.assert_array_equal(r.stroke[:, 1], values["position"][:, 1])
    assert set(_losses(r)) == {"lift/force", "tilt/force"}


def test_no_pressures_but_effort_leaves_the_torques(write_bag, run_columns, robot) -> None:
    columns = run_columns(20)
    del columns["/chamber_pressures"]
    names, values = columns["/joint_states"]
    columns["/joint_states"] = (names, {**values, "effort": 1e3 * values["position"]})
    r = read_recording(write_bag(columns), robot)
    lost = _losses(r)
    assert set(lost) == {
        f"{j}/{k}" for j in ("lift", "tilt") for k in ("force", "flow_a", "flow_b")
    }
    assert set(lost.values()) == {"no /chamber_pressures"}
    np.testing.assert_array_equal(r.effort, 1e3 * values["position"])


def test_oil_temperature_keeps_its_own_stamps(tmp_path, robot) -> None:
    with BagWriter(tmp_path / "bag") as writer:
        writer.add_topic("/joint_states", JOINT_STATE)
        writer.add_topic("/oil_temperature", TEMPERATURE)
        for k in range(100):
            stamp = START_NS + k * PERIOD_NS
            writer.write_stamped(
                "/joint_states", stamp, {"position": [0.1, 0.2]}, names=robot.joint_names
            )
            if k % 25 == 0:
                writer.write_stamped("/oil_temperature", stamp + 7, {"temperature": 40 + k})
    r = read_recording(tmp_path / "bag", robot)
    assert r.temperature_c is not None
    assert r.temperature_stamp_ns is not None
    assert r.temperature_c.tolist() == [40, 65, 90, 115]
    assert (r.temperature_stamp_ns - START_NS).tolist() == [
        7,
        50_000_007,
        100_000_007,
        150_000_007,
    ]


def test_bags_that_do_not_fit_are_errors(write_bag, run_columns, robot) -> None:
    columns = run_columns(20)
    other = {**columns, "/joint_states": (("boom", "arm"), columns["/joint_states"][1])}
    with pytest.raises(BagError, match=r"joints of robot \w+ \(lift, tilt\).*found boom, arm"):
        read_recording(write_bag(other, name="other"), robot)
    headless = {k: v for k, v in columns.items() if k != "/joint_states"}
    with pytest.raises(BagError, match="expected a topic /joint_states, found /chamber_pressures"):
        read_recording(write_bag(headless, name="headless"), robot)
    wrong = {**columns, "/chamber_pressures": columns["/tip_reference"]}
    with pytest.raises(BagError, match="JointState on /chamber_pressures, found geom"):
        read_recording(write_bag(wrong, name="wrong"), robot)


def test_topics_that_share_no_stamp_are_an_error(tmp_path, robot) -> None:
    with BagWriter(tmp_path / "bag") as writer:
        for topic in ("/joint_states", "/chamber_pressures"):
            writer.add_topic(topic, JOINT_STATE)
        for k in range(9):
            writer.write_stamped(
                "/joint_states", 10 * k, {"position": [0.0, 0.0]}, names=robot.joint_names
            )
            writer.write_stamped(
                "/chamber_pressures", 10 * k + 5, {"effort": [1e5]}, names=["supply"]
            )
    with pytest.raises(BagError, match="none in common"):
        read_recording(tmp_path / "bag", robot)


def test_stretches() -> None:
    stamps = np.array([0, 2, 4, 10, 12, 30], dtype=np.int64) * 1_000_000
    assert [g.missing for g in find_gaps(stamps, 0.002)] == [2, 8]
    assert contiguous(stamps, 0.002) == (slice(0, 3), slice(3, 5), slice(5, 6))
    assert runs(np.array([True, True, False, True])) == [(0, 2), (3, 4)]
    assert runs(np.zeros(3, dtype=np.bool_)) == []


def test_a_robot_with_a_model_file_reads_alike(write_bag, run_columns) -> None:
    path = write_bag(run_columns(10))
    robot = load_robot("xs031")
    again = load_robot(robot.source)
    np.testing.assert_array_equal(read_recording(path, robot).q, read_recording(path, again).q)


def test_under_a_name_that_a_joint_has_no_stroke_is_read(write_bag, run_columns, robot) -> None:
    """An angle of 0.6 rad would be one of 0.6 m."""
    lift, tilt = robot.cylinders
    named = replace(robot, cylinders=(replace(lift, name="lift"), tilt))
    valves = (replace(robot.valves[0], cylinder="lift"), robot.valves[1])
    r = read_recording(write_bag(run_columns(20)), replace(named, valves=valves))
    assert r.stroke is None
    assert np.isfinite(r.q).all()
