"""Bags as other writers, and people who rename files, leave them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from mcap.writer import Writer

from hydro_ident.bag.definitions import definition
from hydro_ident.bag.reader import read_bag
from hydro_ident.errors import BagError
from hydro_msgs_docs.cdr import JOINT_STATE, encode

START = 10**18


def _tell(bag: Path, **changed: object) -> None:
    """Change what metadata.yaml says."""
    file = bag / "metadata.yaml"
    data = yaml.safe_load(file.read_text())
    data["rosbag2_bagfile_information"].update(changed)
    file.write_text(yaml.safe_dump(data))


@pytest.mark.parametrize("mode", ["NONE", "none", "None", "", None])
def test_files_that_are_not_compressed_are_read_whatever_that_is_called(
    write_bag: Any, run_columns: Any, mode: str | None
) -> None:
    path = write_bag(run_columns(20))
    _tell(path, compression_mode=mode)
    bag = read_bag(path)
    assert (bag.count, bag.losses) == (120, ())


@pytest.mark.parametrize("mode", ["FILE", "MESSAGE"])
def test_compressed_files_are_refused(write_bag: Any, run_columns: Any, mode: str) -> None:
    path = write_bag(run_columns(20))
    _tell(path, compression_mode=mode, compression_format="zstd")
    with pytest.raises(BagError, match=f"found whole {mode}s compressed by rosbag2"):
        read_bag(path)


def test_a_file_that_was_renamed_is_read_and_said(write_bag: Any, run_columns: Any) -> None:
    path = write_bag(run_columns(20))
    (file,) = path.glob("*.mcap")
    file.rename(path / "mine.mcap")
    bag = read_bag(path)
    assert bag.count == 120
    assert bag.losses == (
        f"{file.name}: named by metadata.yaml, not there",
        "mine.mcap: not named by metadata.yaml, taken, as no file that it names is there",
    )


def test_split_files_that_were_renamed_are_read_in_their_order(
    write_bag: Any, run_columns: Any
) -> None:
    columns = run_columns(600)
    path = write_bag(columns, split_ns=100_000_000)
    files = list(path.glob("*.mcap"))
    assert len(files) == 12
    for file in files:
        file.rename(path / file.name.replace(path.name, "mine"))
    q = columns["/joint_states"][1]["position"]
    np.testing.assert_array_equal(read_bag(path).series["/joint_states"].fields["position"], q)


def _write(path: Path, name: str, encoding: str) -> Path:
    with open(path, "wb") as stream:
        writer = Writer(stream)
        writer.start(profile="ros2", library="test")
        schema = writer.register_schema(name, encoding, definition(JOINT_STATE).encode())
        channel = writer.register_channel("/joint_states", "cdr", schema)
        data = encode(JOINT_STATE, START, {"position": [0.25, -0.5]}, names=("lift", "tilt"))
        writer.add_message(channel, START, data, START)
        writer.finish()
    return path


@pytest.mark.parametrize("encoding", ["ros2msg", "ros2idl"])
@pytest.mark.parametrize("name", ["sensor_msgs/JointState", "sensor_msgs/msg/JointState"])
def test_types_may_be_named_in_two_parts(tmp_path: Path, name: str, encoding: str) -> None:
    """As the example of mcap's own writer for ROS 2 does."""
    bag = read_bag(_write(tmp_path / "a.mcap", name, encoding))
    assert bag.topics["/joint_states"].message_type == JOINT_STATE
    np.testing.assert_array_equal(bag.series["/joint_states"].fields["position"], [[0.25, -0.5]])


@pytest.mark.parametrize(
    ("name", "encoding"),
    [("sensor_msgs/JointState", "ros1msg"), ("JointState", "ros2msg"), ("a/b/C/D", "ros2msg")],
)
def test_other_names_of_types_stay(tmp_path: Path, name: str, encoding: str) -> None:
    bag = read_bag(_write(tmp_path / "a.mcap", name, encoding))
    assert bag.topics["/joint_states"].message_type == name
    assert "/joint_states" not in bag.series
