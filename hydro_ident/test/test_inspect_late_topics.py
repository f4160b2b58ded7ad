"""Inspections of bags in which topics, names, stamps or messages come when they should not."""

from __future__ import annotations

import tracemalloc
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hydro_ident.bag import memory, stretches
from hydro_ident.bag.reader import read_bag
from hydro_ident.bag.recording import read_recording
from hydro_ident.bag.writer import BagWriter
from hydro_ident.errors import BagError
from hydro_ident.inspecting.inspection_reading import inspect_bag
from hydro_msgs_docs.cdr import JOINT_STATE
from hydro_msgs_docs.topics import CHAMBER_PRESSURES, JOINT_STATES, VALVE_COMMAND, VALVE_STATE

N = 600
START_NS, PERIOD_NS = 1_700_000_000_000_000_000, 2_000_000


def _behind(columns: dict, topic: str) -> tuple[dict, np.ndarray]:
    """All of a topic after everything else, with the stamps of the others."""
    moved = {}
    for name, (names, fields) in columns.items():
        nothing = {n: np.full_like(v, np.nan) for n, v in fields.items()}
        order = (nothing, fields) if name == topic else (fields, nothing)
        moved[name] = names, {n: np.concatenate([o[n] for o in order]) for n in fields}
    stamps = START_NS + PERIOD_NS * np.arange(N)
    return moved, np.concatenate([stamps, stamps])


@pytest.mark.parametrize("topic", [CHAMBER_PRESSURES, VALVE_STATE, VALVE_COMMAND])
def test_a_topic_that_comes_behind_all_others_within_one_stretch(
    write_bag, run_columns, robot, small_blocks, known, topic: str
) -> None:
    """Its first messages are the ones that are older than what was given away."""
    small_blocks(60)
    moved, stamps = _behind(run_columns(N), topic)
    path = write_bag(moved, stamps=stamps, metadata={"robot": "xs031"})
    whole = inspect_bag(path, rows=1 << 40)
    known.clear()
    cut = inspect_bag(path, rows=N + 200, late_s=0.02)
    assert known[-1].whole
    assert repr(cut.as_dict()) == repr(whole.as_dict())
    assert cut.cycles == len(read_recording(path, robot)) == N


def _many_names_late(path: Path, count: int) -> Path:
    """So many messages of one name, then 60 of a thousand."""
    with BagWriter(path) as writer:
        writer.add_topic("/x", JOINT_STATE)
        for k in range(count + 60):
            names = ("a",) if k < count else tuple(f"n{i}" for i in range(1000))
            fields = {name: np.zeros(len(names)) for name in ("position", "velocity", "effort")}
            # All within what may be late, in a chunk for every hundred.
            at, came = START_NS + 2000 * k, START_NS + PERIOD_NS * k
            writer.write_stamped("/x", at, fields, names=names, log_ns=came)
    return path


def test_many_names_that_come_late_are_refused_before_they_are_joined(
    tmp_path: Path, small_blocks
) -> None:
    path = _many_names_late(tmp_path / "bag", 3000)
    small_blocks(500)
    with pytest.raises(BagError) as whole:
        read_bag(path)
    tracemalloc.start()
    with pytest.raises(BagError) as cut:
        inspect_bag(path, rows=1000)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert str(cut.value) == str(whole.value)
    assert peak < 20e6  # the table would take 73 MB


def test_memory_for_names_that_come_late_is_asked_for(
    tmp_path: Path, small_blocks, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = _many_names_late(tmp_path / "bag", 1200)
    small_blocks(400)
    assert inspect_bag(path, rows=500).messages == 1260
    monkeypatch.setattr(memory, "available_bytes", lambda: 40_000_000)
    with pytest.raises(BagError, match=r"fits into memory \(0.04 GB are free\)"):
        inspect_bag(path, rows=500)


def _valves_ahead(columns: dict, path: Path, ahead_s: float) -> Path:
    """Joints, and valves whose stamps are of another clock."""
    with BagWriter(path, metadata={"robot": "xs031"}) as writer:
        for topic in (JOINT_STATES, VALVE_COMMAND):
            writer.add_topic(topic, JOINT_STATE)
        for k in range(N):
            for topic, ahead_ns in ((JOINT_STATES, 0), (VALVE_COMMAND, round(ahead_s * 1e9))):
                names, fields = columns[topic]
                values, came = {n: v[k] for n, v in fields.items()}, START_NS + PERIOD_NS * k
                writer.write_stamped(topic, came + ahead_ns, values, names=names, log_ns=came)
    return path


@pytest.mark.parametrize(("ahead_s", "whole"), [(1.0, False), (3600.0, True)])
def test_valves_that_are_far_ahead_of_the_joints_have_the_bag_read_as_one(
    tmp_path: Path, run_columns, small_blocks, known, ahead_s: float, *, whole: bool
) -> None:
    path = _valves_ahead(run_columns(N), tmp_path / "bag", ahead_s)
    as_one = inspect_bag(path, rows=1 << 40)
    small_blocks(60)
    known.clear()
    cut = inspect_bag(path, rows=100, late_s=0.02)
    assert known[-1].whole == whole
    assert repr(cut.as_dict()) == repr(as_one.as_dict())


@pytest.mark.parametrize("late", [0, 10**9])
def test_a_bag_that_changes_between_its_readings_is_refused(
    tmp_path: Path,
    write_bag,
    run_columns,
    small_blocks,
    monkeypatch: pytest.MonkeyPatch,
    late: int,
) -> None:
    """By messages more, one of which may be so late that the bag would be read as one."""
    [short] = write_bag(run_columns(300), name="short").glob("*.mcap")
    stamps = START_NS + PERIOD_NS * np.arange(N)
    stamps[-5] -= late
    [grown] = write_bag(run_columns(N), name="grown", stamps=stamps).glob("*.mcap")
    bag = tmp_path / "bag.mcap"
    bag.write_bytes(short.read_bytes())
    passage, known = stretches.Passage, []

    def grows(*arguments: Any) -> stretches.Passage:
        if len(known) == 1:
            bag.write_bytes(grown.read_bytes())
        known.append(arguments)
        return passage(*arguments)

    monkeypatch.setattr(stretches, "Passage", grows)
    small_blocks(60)
    with pytest.raises(BagError, match=r"1800 messages .* found 3600 .* changed while"):
        inspect_bag(bag, rows=200, late_s=0.05)
