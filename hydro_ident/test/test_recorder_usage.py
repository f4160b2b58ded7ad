"""What the recorder is asked to do, and what it refuses, before anything is recorded."""

from __future__ import annotations

import pytest

from hydro_ident.bag.provenance import project_metadata
from hydro_ident.bag.recorder import main
from hydro_ident.bag.recorder_topics import wanted_topics
from hydro_ident.errors import BagError
from hydro_model.robot_files import load_robot


def test_bad_usage_is_one_line_and_leaves_nothing(tmp_path, capsys) -> None:
    (tmp_path / "file").touch()
    out = ["--out", str(tmp_path)]
    for arguments, text in (
        ([*out, "--topics", "/tf"], "unknown topic /tf"),
        ([*out, "--topics", "/tf:nothing_msgs/msg/Tf"], "no message type 'nothing_msgs/msg/Tf'"),
        ([*out, "--topics", "/a b:sensor_msgs/msg/JointState"], "is no topic name"),
        ([*out, "--name", "a/b"], "expected a bag name"),
        ([*out, "--robot", "nothing"], "no robot file 'nothing'"),
        ([*out, "--attach", "mapping"], "expected --attach KEY=FILE"),
        ([*out, "--attach", f"m={tmp_path / 'nowhere'}"], "cannot be attached"),
        (["--out", str(tmp_path / "file")], "cannot be written"),
    ):
        assert main(arguments) == 2, text
        error = capsys.readouterr().err
        assert error.count("\n") == 1, error
        assert text in error
    assert [p.name for p in tmp_path.iterdir()] == ["file"]


def test_topics_and_types() -> None:
    robot = load_robot("xs031")
    every = wanted_topics(None, robot)
    assert every["/pressure/tilt_cylinder/b"] == "sensor_msgs/msg/FluidPressure"
    assert every["/tip_reference"] == "geometry_msgs/msg/PointStamped"
    assert wanted_topics(["joint_states", "/log:rcl_interfaces/msg/Log"], robot) == {
        "/joint_states": "sensor_msgs/msg/JointState",
        "/log": "rcl_interfaces/msg/Log",
    }
    with pytest.raises(BagError, match="expected one of"):
        wanted_topics(["/nothing"], robot)


def test_metadata_names_robot_software_and_note() -> None:
    metadata = project_metadata(load_robot("xs031"), "warm", [])
    assert metadata["robot"] == "xs031"
    assert metadata["software"].startswith("hydro_ident ")
    assert metadata["note"] == "warm"
    assert "cylinders:" in metadata["robot_file"]
