"""A bag that lacks something is used as far as it goes, and every channel lost is listed."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
import yaml

from hydro_ident.commands.identify import run
from hydro_ident.estimate.signals.traces import traces_of
from hydro_ident.identify.identification import identify
from hydro_model.hydraulics.cylinder import lever, piston_force, stroke
from hydro_model.robot import Robot

pytestmark = pytest.mark.needs("clarabel", "plotly")

HYDRAULIC = ("bulk_modulus", "c_pa", "c_at", "c_pb", "c_bt")
Outcome = tuple[int, dict]


@pytest.fixture(scope="module")
def short_run(make_run: tuple) -> Any:
    """12 s of the machine of `crane_run`."""
    return make_run[1](make_run[0](), 12.0)


@pytest.fixture
def identify_bag(write_bag: Callable[..., Path], tmp_path: Path) -> Callable[..., Outcome]:
    """Writes a bag, runs the command, returns its exit code and result."""

    def run_it(
        columns: dict,
        robot: str = "xs031",
        estimator: str = "auto",
        also: Sequence[Path] = (),
        **options: object,
    ) -> Outcome:
        paths, out = [write_bag(columns, **options), *also], tmp_path / "out"
        given = ["--robot", robot, "--estimator", estimator, "--out", str(out)]
        code = run([*map(str, paths), *given])
        result = json.loads((out / "result.json").read_text())
        assert (out / "model.yaml").exists() == (code == 0)
        report = (out / "report.html").read_text()
        for loss in result["losses"]:
            assert f">{loss['channel']}</td>" in report
        return code, result

    return run_it


def without(columns: dict, topic: str, *entries: str) -> dict:
    """The columns less some entries of a topic, or less the topic."""
    names, fields = columns[topic]
    kept = [i for i, name in enumerate(names) if name not in entries]
    rest = {k: v for k, v in columns.items() if k != topic}
    if not entries or not kept:
        return rest
    return rest | {
        topic: (tuple(names[i] for i in kept), {f: v[:, kept] for f, v in fields.items()})
    }


def lost(result: dict) -> dict[str, str]:
    return {loss["channel"]: loss["reason"] for loss in result["losses"]}


def values(result: dict) -> dict[str, float]:
    return {p["name"]: p["value"] for p in result["parameters"] if p["identifiable"]}


def test_everything_there_nothing_lost(short_run, identify_bag) -> None:
    code, result = identify_bag(short_run.columns())
    assert (code, result["verdict"], result["losses"]) == (0, "identified", [])
    assert values(result)["lift_cylinder.bulk_modulus"] == pytest.approx(8.2e8, rel=0.02)


def test_no_valve_topic_loses_the_flows_alone(short_run, identify_bag) -> None:
    code, result = identify_bag(without(short_run.columns(), "/valve_state"))
    assert (code, result["verdict"]) == (0, "partly_identified")
    assert set(result["channels"]) == {"lift/force", "tilt/force"}
    reasons = lost(result)
    assert set(reasons) == {f"{j}/flow_{s}" for j in ("lift", "tilt") for s in "ab"}
    assert set(reasons.values()) == {"no /valve_command or /valve_state"}
    assert "lift_cylinder.bulk_modulus and the edges of lift_valve" in result["problems"][0]
    assert any("free run" in note for note in result["notes"])


def test_the_command_stands_in_for_the_valve_state(short_run, identify_bag) -> None:
    columns = short_run.columns()
    columns["/valve_command"] = columns.pop("/valve_state")
    code, result = identify_bag(columns)
    assert (code, result["verdict"], result["losses"]) == (0, "identified", [])


def test_one_chamber_missing_loses_that_force_and_that_flow(short_run, identify_bag) -> None:
    columns = without(short_run.columns(), "/chamber_pressures", "lift_cylinder/b")
    code, result = identify_bag(columns)
    assert set(lost(result)) == {"lift/force", "lift/flow_b"}
    assert set(result["channels"]) == {"tilt/force", "lift/flow_a", "tilt/flow_a", "tilt/flow_b"}
    assert (code, result["verdict"]) == (0, "partly_identified")
    known = values(result)
    assert known["tilt_cylinder.viscous_friction"] == pytest.approx(4.1e4, rel=0.05)
    assert known["tilt_cylinder.bulk_modulus"] == pytest.approx(7.4e8, rel=0.02)
    assert "lift_link.iyy" not in known
    assert "lift_cylinder.viscous_friction" not in known
    stds = {p["name"]: p["std"] for p in result["parameters"] if p["ci95"] is None}
    # Columns of the tilt's force alone that are zero, or are not told apart.
    assert stds.keys() >= {"lift_link.mcx", "lift_link.iyy", "lift_cylinder.viscous_friction"}
    assert set(stds.values()) == {None}
    text = " ".join(result["problems"])
    assert "lift/force was not measured" in text
    assert "lift_link.iyy" in text
    # The other chamber's edges and its oil are its own.
    assert known["lift_cylinder.bulk_modulus"] == pytest.approx(8.2e8, rel=0.02)
    assert {"lift_valve.c_pa", "lift_valve.c_at"} <= known.keys()
    assert "lift_valve.c_bt" not in known
    assert (
        "lift/flow_b gave no or too few windows: lift_valve.c_bt and lift_valve.c_pb stay the"
        " robot file's; lift_cylinder.bulk_modulus and the other edges are of one chamber alone"
        in text
    )


def test_a_sensor_that_fails_half_way_keeps_its_channels_until_then(crane_run, robot) -> None:
    whole = crane_run.recording()
    p_a = whole.p_a.copy()
    p_a[5000:, 1] = np.nan
    found = identify(robot, [replace(whole, p_a=p_a)])
    assert found.verdict == "identified", found.problems
    values = {p.name: p.value for p in found.parameters if p.identifiable}
    assert values["tilt_cylinder.viscous_friction"] == pytest.approx(4.1e4, rel=0.1)
    assert any("tilt_cylinder/a in 44% of the cycles without a" in n for n in found.notes)


def test_a_recording_is_cut_where_a_sensor_fails_for_long_alone(crane_run) -> None:
    whole = crane_run.recording()

    def traces(*holes: slice) -> list[tuple[int, bool]]:
        p_a = whole.p_a.copy()
        for hole in holes:
            p_a[hole, 1] = np.nan
        parts = traces_of([replace(whole, p_a=p_a)])
        assert all(np.isfinite(t.p_a[:, 0]).all() for t in parts)
        return [(t.samples, bool(np.isfinite(t.p_a[:, 1]).all())) for t in parts]

    count = len(whole)
    assert traces() == [(count, True)]
    assert traces(slice(5000, None)) == [(5000, True), (count - 5000, False)]
    assert traces(slice(2000, 7000)) == [(2000, True), (5000, False), (count - 7000, True)]
    # Too short a time to be worth two ends of the filters.
    assert traces(slice(0, 6000), slice(7000, None)) == [(count, False)]
    assert traces(*(slice(k, k + 300) for k in range(0, count, 1000))) == [(count, False)]


@pytest.mark.thorough
@pytest.mark.parametrize("wrong", [np.inf, -np.inf])
def test_a_voltage_that_is_no_number_is_as_good_as_missing(crane_run, wrong) -> None:
    """An amplifier that says infinity is not known to be fully open."""
    recording, seen = crane_run.recording(), []
    for value in (wrong, np.nan):
        volts = recording.valve_v.copy()
        volts[1000, 0] = value
        [trace] = traces_of([replace(recording, valve_v=volts)])
        assert np.isfinite(trace.valve_signal[999:1002]).all(axis=1).tolist() == [1, 0, 1]
        seen.append(trace.valve_signal)
    np.testing.assert_array_equal(*seen)


@pytest.mark.thorough
def test_robust_weights_do_without_lost_pressures(short_run, identify_bag) -> None:
    """A channel without a row has no residuals to be weighted by; the others are as good."""
    gone = ("tilt_cylinder/a", "tilt_cylinder/b")
    columns = without(short_run.columns(), "/chamber_pressures", *gone)
    code, result = identify_bag(columns, estimator="robust")
    assert set(lost(result)) == {"tilt/force", "tilt/flow_a", "tilt/flow_b"}
    assert (code, result["verdict"]) == (0, "partly_identified")
    assert result["estimator"]["name"] == "robust"
    assert values(result)["lift_cylinder.bulk_modulus"] == pytest.approx(8.2e8, rel=0.02)
    assert "tilt_cylinder.viscous_friction" not in values(result)


def test_robust_weights_do_without_a_joint_torque(short_run, identify_bag) -> None:
    """Torques of the first joint alone; the weights are chosen because its samples stand out."""
    cylinder = short_run.robot.cylinders[0]
    columns = without(short_run.columns(), "/chamber_pressures")
    force = piston_force(cylinder, short_run.p_a[:, 0], short_run.p_b[:, 0])
    torque = np.full_like(short_run.q, np.nan)
    torque[:, 0] = lever(cylinder, short_run.q[:, 0]) * force
    torque[::40, 0] *= 3.0
    columns["/joint_states"][1]["effort"] = torque
    code, result = identify_bag(columns)
    assert (code, result["verdict"]) == (0, "partly_identified")
    assert result["estimator"]["name"] == "robust"
    assert set(result["channels"]) == {"lift/torque"}


@pytest.mark.thorough
def test_robust_weights_do_with_a_channel_of_one_bag_alone(
    short_run, identify_bag, write_bag
) -> None:
    whole = write_bag(short_run.columns(), name="whole")
    columns = without(short_run.columns(), "/chamber_pressures", "tilt_cylinder/b")
    code, result = identify_bag(columns, estimator="robust", also=[whole])
    assert (code, result["estimator"]["name"]) == (0, "robust")
    assert "tilt/force" in result["channels"]
    known = values(result)
    assert known["tilt_cylinder.viscous_friction"] == pytest.approx(4.1e4, rel=0.05)


def test_no_supply_and_no_tank_use_the_robot_files(short_run, identify_bag) -> None:
    columns = without(short_run.columns(), "/chamber_pressures", "supply", "tank")
    code, result = identify_bag(columns)
    assert (code, result["verdict"]) == (0, "identified")
    assert lost(result) == {
        "supply": "not in /chamber_pressures: the robot file's 190 bar used",
        "tank": "not in /chamber_pressures: the robot file's 10 bar used",
    }
    assert values(result)["lift_valve.c_pa"] == pytest.approx(8.91e-7, rel=0.02)


def test_a_missing_distal_angle_loses_every_force(short_run, identify_bag) -> None:
    code, result = identify_bag(without(short_run.columns(), "/joint_states", "tilt"))
    reasons = lost(result)
    assert set(reasons) == {"lift/force", "tilt/force", "tilt/flow_a", "tilt/flow_b"}
    assert reasons["lift/force"] == "no position of tilt in /joint_states"
    assert set(result["channels"]) == {"lift/flow_a", "lift/flow_b"}
    assert (code, result["verdict"]) == (0, "partly_identified")
    assert "no force channel" in result["problems"][0]
    known = values(result)
    assert known["lift_cylinder.bulk_modulus"] == pytest.approx(8.2e8, rel=0.02)
    assert not any(name.startswith("tilt") for name in known)


def test_effort_without_pressures_gives_joint_torques(short_run, identify_bag) -> None:
    robot = short_run.robot
    columns = without(short_run.columns(), "/chamber_pressures")
    torque = np.column_stack(
        [
            lever(c, short_run.q[:, i]) * piston_force(c, short_run.p_a[:, i], short_run.p_b[:, i])
            for i, c in enumerate(robot.cylinders)
        ]
    )
    columns["/joint_states"][1]["effort"] = torque
    code, result = identify_bag(columns)
    assert (code, result["verdict"]) == (0, "partly_identified")
    assert set(result["channels"]) == {"lift/torque", "tilt/torque"}
    assert set(lost(result)) == {
        f"{j}/{k}" for j in ("lift", "tilt") for k in ("force", "flow_a", "flow_b")
    }
    assert set(lost(result).values()) == {"no /chamber_pressures"}
    assert values(result)["tilt_cylinder.viscous_friction"] == pytest.approx(4.1e4, rel=0.05)
    assert not any(name.endswith(HYDRAULIC) for name in values(result))


def test_an_effort_of_zero_is_worth_as_much_as_none(short_run, identify_bag) -> None:
    cylinder = short_run.robot.cylinders[0]
    torque = np.full_like(short_run.q, np.nan)
    force = piston_force(cylinder, short_run.p_a[:, 0], short_run.p_b[:, 0])
    torque[:, 0] = lever(cylinder, short_run.q[:, 0]) * force
    found = []
    for name, filled in (("none", np.nan), ("zero", 0.0)):
        columns = without(short_run.columns(), "/chamber_pressures")
        torque[:, 1] = filled
        columns["/joint_states"][1]["effort"] = torque.copy()
        found.append(identify_bag(columns, name=name)[1])
    none, zero = found
    assert lost(none)["tilt/torque"] == "no effort of tilt in /joint_states"
    assert lost(zero)["tilt/torque"] == "effort of tilt reads 0 throughout while the robot moves"
    assert set(lost(zero)) == set(lost(none))
    assert (zero["channels"], values(zero)) == (none["channels"], values(none))


def test_a_stroke_sensor_stands_in_for_the_joint_angle(short_run, identify_bag) -> None:
    robot = short_run.robot
    columns = short_run.columns()
    length = stroke(robot.cylinders[1], short_run.q[:, 1])
    position = np.column_stack([short_run.q[:, 0], length])
    columns["/joint_states"] = (("lift", "tilt_cylinder"), {"position": position})
    code, result = identify_bag(columns)
    assert (code, result["verdict"], result["losses"]) == (0, "identified", [])
    assert "bag: position of tilt from the stroke of tilt_cylinder" in result["notes"]
    assert values(result)["tilt_cylinder.viscous_friction"] == pytest.approx(4.1e4, rel=0.05)
    both = np.column_stack(
        [stroke(c, q) for c, q in zip(robot.cylinders, short_run.q.T, strict=True)]
    )
    columns["/joint_states"] = (tuple(c.name for c in robot.cylinders), {"position": both})
    code, again = identify_bag(columns, name="strokes")
    assert (code, again["verdict"], again["losses"]) == (0, "identified", [])
    for name, value in values(result).items():
        slack = 1.0 if name.startswith(("lift_link", "tilt_link")) else 0.0
        assert values(again)[name] == pytest.approx(value, rel=1e-3, abs=slack), name


def test_a_stuck_joint_names_what_it_costs_and_the_run(short_run, identify_bag) -> None:
    columns = short_run.columns()
    still = short_run.q.copy()
    still[:, 1] = still[0, 1]
    columns["/joint_states"] = (columns["/joint_states"][0], {"position": still})
    code, result = identify_bag(columns)
    assert (code, result["verdict"]) == (1, "not_enough_data")
    assert "tilt_cylinder.viscous_friction" in result["problems"][0]
    assert "tilt did not move" in result["problems"][0]
    assert "excite --robot xs031" in result["problems"][0]


@pytest.mark.parametrize(
    ("cycles", "share", "said", "lost"),
    [
        (1200, 1.0, "2.4 s are too short", "lift_link.iyy"),
        (6000, 0.02, "too little motion", "lift_link.mcx"),
    ],
)
def test_too_little_motion_names_what_it_costs_and_the_run(
    short_run, identify_bag, cycles: int, share: float, said: str, lost: str
) -> None:
    columns = {
        topic: (names, {f: v[:cycles] for f, v in fields.items()})
        for topic, (names, fields) in short_run.columns().items()
    }
    middle = short_run.q[0]
    moved = middle + share * (short_run.q[:cycles] - middle)
    columns["/joint_states"] = (short_run.robot.joint_names, {"position": moved})
    code, result = identify_bag(columns)
    assert (code, result["verdict"]) == (1, "not_enough_data")
    assert said in result["problems"][0]
    assert lost in result["problems"][0]
    assert "excite --robot xs031" in result["problems"][0]


def test_saturated_valves_name_what_they_cost_and_the_run(short_run, identify_bag) -> None:
    columns = short_run.columns()
    full = 10.0 * np.sign(columns["/valve_state"][1]["effort"])
    columns["/valve_state"] = (columns["/valve_state"][0], {"effort": full})
    code, result = identify_bag(columns)
    assert (code, result["verdict"]) == (0, "partly_identified")
    [text] = [p for p in result["problems"] if p.startswith("lift_valve stood at its 10 V limit")]
    assert "100% of the cycles" in text
    assert "the opening curve of lift_valve" in text
    assert "excite --robot xs031" in text


def test_a_wrong_robot_is_said_with_the_parameters_it_costs(
    short_run, identify_bag, tmp_path: Path, robot: Robot
) -> None:
    """A smaller crane with the same joint names: its lift turns half as far."""
    other = tmp_path / "other"
    other.mkdir()
    assert robot.source is not None
    assert robot.urdf is not None
    lift, cylinder = robot.joints[0], robot.cylinders[0]
    low, high = float(short_run.q[:, 0].min()), float(np.median(short_run.q[:, 0]))
    tree = ElementTree.parse(robot.urdf)
    for joint in tree.getroot().iter("joint"):
        if joint.get("name") == lift.name:
            joint.find("limit").attrib |= {"lower": str(low), "upper": str(high)}
    tree.write(other / "small.urdf")
    data = yaml.safe_load(robot.source.read_text()) | {"robot": "small", "urdf": "small.urdf"}
    ends = np.sort(stroke(cylinder, np.array([low, high])))
    data["cylinders"][0] |= {
        "stroke_m": float(ends[1] - ends[0]) + 0.002,
        "x0_m": cylinder.x0_m + float(ends[0]) - 0.001,
    }
    (other / "small.hydraulics.yaml").write_text(yaml.safe_dump(data))
    code, result = identify_bag(short_run.columns(), str(other / "small.hydraulics.yaml"))
    assert (code, result["verdict"]) == (1, "not_enough_data")
    [text] = result["problems"]
    assert "bag does not fit robot small" in text
    assert "would put lift_cylinder at" in text
    assert "none of its parameters can be identified" in text
    assert "robot file of this machine" in text


def test_a_model_that_explains_nothing_is_said(short_run, identify_bag) -> None:
    columns = short_run.columns()
    names, fields = columns["/chamber_pressures"]
    order = [
        names.index(n.replace("lift", "@").replace("tilt", "lift").replace("@", "tilt"))
        for n in names
    ]
    columns["/chamber_pressures"] = (names, {"effort": fields["effort"][:, order]})
    _, result = identify_bag(columns)
    assert result["verdict"] != "identified"
    assert result["problems"]


def test_a_bag_of_another_robot_by_name_is_said(short_run, identify_bag) -> None:
    code, result = identify_bag(short_run.columns(), metadata={"robot": "mh26"})
    assert (code, result["verdict"]) == (0, "partly_identified")
    assert "bag was recorded as robot 'mh26', not xs031" in result["problems"][0]
