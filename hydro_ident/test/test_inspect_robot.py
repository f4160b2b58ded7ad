"""The robot that a bag is inspected for: named, known by its joints, broken or none."""

from __future__ import annotations

import json
import shutil

import numpy as np
import pytest

from hydro_ident.bag.recording import read_recording
from hydro_ident.bag.writer import BagWriter
from hydro_ident.commands.inspect import main
from hydro_ident.inspecting.inspection_reading import inspect_bag
from hydro_ident.inspecting.named_robot import named_robot, robot_of_joints
from hydro_model.robot_files import shipped_robots
from hydro_msgs_docs.cdr import JOINT_STATE, POINT_STAMPED

N = 1500


@pytest.mark.parametrize("others", [(), ("gripper", "wrist")])
def test_a_bag_that_names_no_robot_is_read_by_its_joints(
    write_bag, run_columns, capsys, tmp_path, others
) -> None:
    """As of `ros2 bag record`; with messages of others first, and with strokes for joints."""
    columns = run_columns(N)
    if others:
        columns["/joint_states"] = (
            ("lift", "tilt_cylinder"),
            {"position": columns["/joint_states"][1]["position"] * [1.0, 0.0] + [0.0, 0.3]},
        )
        bag = tmp_path / "others"
        with BagWriter(bag, {}) as writer:
            for topic, (names, _) in columns.items():
                writer.add_topic(topic, JOINT_STATE if names else POINT_STAMPED)
            stamp = 10**18
            writer.write_stamped("/joint_states", stamp, {"position": [0.0, 1.0]}, names=others)
            for k in range(N):
                for topic, (names, fields) in columns.items():
                    values = {field: v[k] for field, v in fields.items()}
                    writer.write_stamped(topic, stamp + 2_000_000 * k, values, names=names)
    else:
        bag = write_bag(columns)
    assert main([str(bag), "--json", str(tmp_path / "i.json")]) == 0
    out = capsys.readouterr().out
    assert "robot by its joints, as the bag names none (--robot takes another)" in out
    said = json.loads((tmp_path / "i.json").read_text())
    assert (said["robot"], said["robot_by_joints"], said["cycles"]) == ("xs031", True, N)
    assert "tilt/force" in said["channels"]


@pytest.mark.parametrize(
    ("names", "expected"),
    [
        (("tilt", "lift"), "xs031"),
        (("tilt", "x", "lift_cylinder"), "xs031"),
        (("lift",), "xs031"),
        (("carriage",), "emps"),
        (("lift", "boom"), None),
        ((), None),
    ],
)
def test_the_shipped_robot_whose_joints_they_are(names, expected) -> None:
    found = robot_of_joints(names)
    assert (found and found.name) == expected


@pytest.mark.parametrize(
    ("slow", "quick", "times"),
    [
        ("/chamber_pressures", "/joint_states", 2),
        ("/joint_states", "/chamber_pressures", 3),
        ("/valve_state", "", 2),
    ],
)
def test_messages_that_make_no_cycle_are_told(
    write_bag, run_columns, robot, slow, quick, times
) -> None:
    """Of joints at twice the rate of the pressures every other one, which was called healthy."""
    columns = run_columns(N)
    for values in columns[slow][1].values():
        values[np.arange(N) % times > 0] = np.nan
    path = write_bag(columns, metadata={"robot": "xs031"})
    found = [(f.signal, f.text) for f in inspect_bag(path).findings if f.kind == "unused"]
    told = (
        f"only one message in {times} is used: with the others comes no {slow} of the same stamp"
    )
    assert found == ([(quick, told)] if quick else [])
    notes = [note for note in read_recording(path, robot).notes if "is used" in note]
    assert notes == ([f"{quick}: {told}"] if quick else [])


def test_without_a_robot_the_topics_are_still_told(write_bag, run_columns, capsys) -> None:
    columns = run_columns(20)
    columns["/joint_states"] = (("boom", "arm"), columns["/joint_states"][1])
    assert main([str(write_bag(columns))]) == 0
    out = capsys.readouterr().out
    assert "give --robot" in out
    assert "/chamber_pressures" in out
    assert "joints, pressures and valves were not looked at" in out
    assert "nothing irregular" not in out


def test_a_robot_by_the_bags_name_is_looked_for_where_its_user_works(
    tmp_path, write_bag, run_columns, capsys, monkeypatch
) -> None:
    """Of files that whoever asks has there the bag chooses one; a path in it opens none."""
    shipped = shipped_robots()["xs031"]
    text = shipped.read_text().replace("robot: xs031", "robot: loader")
    bag, here = write_bag(run_columns(N), metadata={"robot": "loader"}), tmp_path / "here"
    here.mkdir()
    monkeypatch.chdir(here)
    assert main([str(bag)]) == 0
    out = capsys.readouterr().out
    assert "no robot: the bag names 'loader', of which no one file is here; give --robot" in out
    assert "not looked at" in out.partition("health\n")[2].splitlines()[0]
    shutil.copy(shipped.with_name("xs031.urdf"), here)
    (here / "ours.hydraulics.yaml").write_text(text)
    (here / "other.hydraulics.yaml").write_text(text.replace("loader", "crane"))
    assert main([str(bag)]) == 0
    out = capsys.readouterr().out
    assert f"robot loader: {N} cycles" in out
    assert f"robot by the name in the bag: {here / 'ours.hydraulics.yaml'}" in out
    # Two of that name: the one that is called so.
    (here / "older.hydraulics.yaml").write_text(text)
    found = inspect_bag(bag, folders=[here])
    assert found.robot is None
    assert "expected one file of robot 'loader', found 2: " in found.robot_troubles[0]
    (here / "loader.hydraulics.yaml").write_text(text)
    assert inspect_bag(bag, folders=[here]).robot_file == str(here / "loader.hydraulics.yaml")
    assert named_robot({"robot": str(here / "ours")}, [here]) is None


def test_a_broken_file_of_the_named_robot_is_not_called_absent(
    tmp_path, write_bag, run_columns, capsys, monkeypatch
) -> None:
    """A key that it lacks, and a file of which nobody can tell whose it is: the reason is told."""
    text = shipped_robots()["xs031"].read_text().replace("robot: xs031", "robot: loader")
    bag = write_bag(run_columns(N), metadata={"robot": "loader"})
    monkeypatch.chdir(tmp_path)
    for broken, why in ((text, "xs031.urdf"), ("robot: [loader", "ours.hydraulics.yaml")):
        (tmp_path / "ours.hydraulics.yaml").write_text(broken)
        assert main([str(bag)]) == 0
        out = capsys.readouterr().out
        assert "the bag names 'loader', of which no file here can be used; give --robot" in out
        health = out.partition("health\n")[2].splitlines()
        assert "not looked at" in health[0]
        assert "CHECK" in health[1]
        assert why in health[1]
    # Once the robot is there, a file that may be another one's is nobody's trouble.
    shutil.copy(shipped_robots()["xs031"].with_name("xs031.urdf"), tmp_path)
    (tmp_path / "loader.hydraulics.yaml").write_text(text)
    found = inspect_bag(bag, folders=[tmp_path])
    assert (found.robot, found.robot_troubles) == ("loader", ())
