"""Joints and pressures that begin or end apart: said once, in the same words, by every reader."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from hydro_ident.bag.digest import Digest
from hydro_ident.bag.recording import read_recording
from hydro_ident.bag.streaming import stream_recordings
from hydro_ident.bag.writer import BagWriter
from hydro_ident.commands.inspect import text_of
from hydro_ident.identify.survey import recorded_notes, survey_source
from hydro_ident.inspecting.inspection_reading import inspect_bag
from hydro_ident.recordings.sources import BagSource
from hydro_msgs_docs.cdr import JOINT_STATE
from hydro_msgs_docs.topics import CHAMBER_PRESSURES, JOINT_STATES

N, PERIOD_NS, START_NS = 2000, 2_000_000, 1_700_000_000_000_000_000
STAMPS = START_NS + PERIOD_NS * np.arange(N)


def _bag(folder: Path, columns: dict, stamps: dict[str, np.ndarray]) -> Path:
    """Joints and pressures at stamps of their own, in the order of these."""
    path = folder / "bag"
    order = sorted(
        (int(stamp), topic, k) for topic, own in stamps.items() for k, stamp in enumerate(own)
    )
    with BagWriter(path, {"robot": "xs031"}, split_ns=200_000_000) as writer:
        for topic in stamps:
            writer.add_topic(topic, JOINT_STATE)
        for stamp, topic, k in order:
            names, fields = columns[topic]
            values = {name: v[k] for name, v in fields.items()}
            # A stamp that leaped was received like any other.
            came = min(stamp, int(STAMPS[-1]) + PERIOD_NS)
            writer.write_stamped(topic, stamp, values, names=names, log_ns=came)
    return path


def _said(path: Path, robot) -> tuple[list[str], list[str], list[str]]:
    """Notes read whole and in pieces, and findings of an inspection by stretches, of the ends."""

    def chosen(told) -> list[str]:
        return [t for t in told if "make no cycle" in t]

    digest = Digest()
    for piece in stream_recordings(path, robot, piece_s=0.5, overlap_s=0.2):
        digest.add(piece)
    found = inspect_bag(path, rows=200, late_s=0.02).findings
    said = [f"{f.signal}: {f.text}" for f in found if f.kind == "apart" and not f.harmless]
    return chosen(read_recording(path, robot).notes), chosen(digest.recording().notes), said


@pytest.mark.parametrize(
    ("topic", "kept", "text"),
    [
        (CHAMBER_PRESSURES, slice(500), "ends 3.0 s before /joint_states: 1500"),
        (CHAMBER_PRESSURES, slice(500, None), "begins 1.0 s after /joint_states: 500"),
        (JOINT_STATES, slice(500), "ends 3.0 s before /chamber_pressures: 1500"),
        (JOINT_STATES, slice(500, None), "begins 1.0 s after /chamber_pressures: 500"),
    ],
)
def test_a_topic_that_ends_early_or_begins_late_is_said_once(
    tmp_path: Path, run_columns, robot, small_blocks, topic: str, kept: slice, text: str
) -> None:
    columns = run_columns(N)
    names, fields = columns[topic]
    columns[topic] = names, {name: values[kept] for name, values in fields.items()}
    stamps = {JOINT_STATES: STAMPS, CHAMBER_PRESSURES: STAMPS}
    path = _bag(tmp_path, columns, {**stamps, topic: STAMPS[kept]})
    small_blocks(60)
    wanted = [f"{topic}: {text} messages of that make no cycle"]
    assert _said(path, robot) == (wanted, wanted, wanted)
    shown = text_of(inspect_bag(path))
    assert "nothing irregular" not in shown
    assert shown.count(wanted[0]) == 1
    # This is what identify and diagnose take their notes from.
    notes = recorded_notes([survey_source(BagSource(path, robot), robot)])
    assert f"bag: {wanted[0]}" in notes


def test_stamps_that_cease_to_be_the_others_are_said_of_both(
    tmp_path: Path, run_columns, robot, small_blocks
) -> None:
    shifted = STAMPS.copy()
    shifted[800:] += PERIOD_NS // 2
    path = _bag(tmp_path, run_columns(N), {JOINT_STATES: STAMPS, CHAMBER_PRESSURES: shifted})
    small_blocks(60)
    wanted = [
        f"{one}: its last 2.4 s share no stamp with {other}: 1200 messages make no cycle"
        for one, other in (
            (JOINT_STATES, CHAMBER_PRESSURES),
            (CHAMBER_PRESSURES, JOINT_STATES),
        )
    ]
    assert _said(path, robot) == (wanted, wanted, wanted)


def test_what_a_recorder_loses_at_start_and_stop_is_not_said(
    tmp_path: Path, run_columns, robot, small_blocks
) -> None:
    """Up to 0.1 s, or a lone stamp that leaped years ahead."""
    columns, kept = run_columns(N), slice(45, N - 45)
    names, fields = columns[CHAMBER_PRESSURES]
    columns[CHAMBER_PRESSURES] = names, {name: values[kept] for name, values in fields.items()}
    stamps = {JOINT_STATES: STAMPS, CHAMBER_PRESSURES: STAMPS[kept]}
    path = _bag(tmp_path, columns, stamps)
    small_blocks(60)
    assert _said(path, robot) == ([], [], [])
    far = STAMPS.copy()
    far[700] += 10**17
    (tmp_path / "far").mkdir()
    leaped = _bag(tmp_path / "far", columns, {**stamps, JOINT_STATES: far})
    recording = read_recording(leaped, robot)
    assert not [note for note in recording.notes if "make no cycle" in note]
    assert recording.ends.tails[JOINT_STATES].count == 46
