"""What drivers get wrong in `/joint_states` is said, and no rate is made up."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hydro_ident.bag.reader import read_bag
from hydro_ident.bag.recording import read_recording
from hydro_ident.bag.writer import BagWriter
from hydro_ident.commands.inspect import main
from hydro_ident.errors import BagError
from hydro_ident.identify.survey import survey_source
from hydro_ident.inspecting.inspection_reading import inspect_bag
from hydro_ident.recordings.sources import bag_source
from hydro_msgs_docs.cdr import JOINT_STATE, encode

JOINTS = "/joint_states"
START_NS, PERIOD_NS = 1_700_000_000_000_000_000, 2_000_000


def test_positions_that_do_not_go_with_the_names_are_told_as_such(
    tmp_path: Path, robot: Any, capsys: Any
) -> None:
    """It had been said that `/joint_states` was expected, and found."""
    with BagWriter(tmp_path / "bag", metadata={"robot": "xs031"}) as writer:
        writer.add_topic(JOINTS, JOINT_STATE)
        for k in range(20):
            stamp = START_NS + k * PERIOD_NS
            data = encode(JOINT_STATE, stamp, {"position": [0.5, -1.5]}, names=("lift", "tilt"))
            begin = data.index(struct.pack("<Id", 2, 0.5)[:4], data.index(b"tilt"))
            short = data[:begin] + struct.pack("<I", 1) + data[begin + 4 :]
            writer.write(JOINTS, short, stamp)
    said = (
        f"{JOINTS}: expected messages that can be decoded, found none; the first: expected no or 2"
        " values of position, found 1"
    )
    with pytest.raises(BagError, match=said):
        read_recording(tmp_path / "bag", robot)
    with pytest.raises(BagError, match=said):
        survey_source(bag_source(str(tmp_path / "bag"), robot), robot)
    assert main([str(tmp_path / "bag"), "--robot", "xs031"]) == 2
    assert said in capsys.readouterr().err


def test_a_joint_that_is_named_twice_is_not_taken_and_told(
    write_bag: Any, run_columns: Any, robot: Any
) -> None:
    """Its last value had been, in silence: of two encoders under one name that of the other."""
    columns = run_columns(400)
    names, fields = columns[JOINTS]
    both = np.hstack([fields["position"], fields["position"][:, 1:]])
    columns[JOINTS] = (*names, "lift"), {"position": both}
    bag = write_bag(columns)
    read, said = read_recording(bag, robot), inspect_bag(bag, robot)
    told = (
        f"{JOINTS}: expected each name once in a message, found lift several times: none of its"
        " values there is taken"
    )
    assert read.notes == (told,)
    assert said.damage == [told]
    assert np.isnan(read.q[:, 0]).all()
    np.testing.assert_array_equal(read.q[:, 1], fields["position"][:, 1])
    assert {loss.channel for loss in read.losses} >= {"lift/force"}


@pytest.mark.parametrize("twice", [False, True])
def test_a_topic_of_any_number_of_layouts_is_read_whole(tmp_path: Path, twice: bool) -> None:
    """A number in `frame_id`, names in any order: after 4096 of them messages were left out."""
    rng, count = np.random.default_rng(5), 5000
    values = rng.normal(size=(count, 3))
    names = ("a", "b", "a" if twice else "c")
    with BagWriter(tmp_path / "bag", metadata={}) as writer:
        writer.add_topic(JOINTS, JOINT_STATE)
        for k in range(count):
            order = rng.permutation(3)
            fields = {"position": values[k, order], "effort": -values[k, order]}
            stamp, named = START_NS + k * PERIOD_NS, tuple(names[i] for i in order)
            data = encode(JOINT_STATE, stamp, fields, names=named, frame_id=f"frame {k}")
            writer.write(JOINTS, data, stamp)
    bag = read_bag(tmp_path / "bag")
    read = bag.series[JOINTS]
    assert read.malformed == 0
    np.testing.assert_array_equal(read.stamp_ns, START_NS + PERIOD_NS * np.arange(count))
    for name, column in zip(names, values.T, strict=True):
        if twice and name == "a":
            assert read.column(name, "position") is None
        else:
            np.testing.assert_array_equal(read.column(name, "position"), column)
            np.testing.assert_array_equal(read.column(name, "effort"), -column)
    assert bool(bag.losses) is twice


@pytest.mark.parametrize("count", [1, 50])
def test_a_lone_cycle_has_no_rate(
    count: int, write_bag: Any, run_columns: Any, robot: Any, capsys: Any
) -> None:
    columns = run_columns(count)
    stamps = np.zeros(count, dtype=np.int64)  # a driver that never stamps
    bag = write_bag(columns, stamps=stamps, metadata={"robot": "xs031"})
    found = inspect_bag(bag, robot)
    assert (found.cycles, found.rate_hz) == (1, None)
    assert main([str(bag)]) == 0
    assert "  robot xs031: 1 cycle, of no rate\n" in capsys.readouterr().out
