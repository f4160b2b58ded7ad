"""`inspect` and the health of signals: each irregularity is found, a healthy run has none."""

from __future__ import annotations

import io
import json
import re
import sys
from collections.abc import Mapping
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from hydro_ident.bag import stretches
from hydro_ident.bag.diagnostics import Status
from hydro_ident.bag.reader import read_bag
from hydro_ident.bag.recording import recording_of
from hydro_ident.bag.writer import BagWriter
from hydro_ident.commands.inspect import main, text_of
from hydro_ident.inspecting.complaints import Complaints
from hydro_ident.inspecting.health import find_irregularities
from hydro_ident.inspecting.inspection_reading import inspect_bag
from hydro_ident.inspecting.named_robot import named_robot
from hydro_model.command_line import terminal
from hydro_msgs_docs.cdr import JOINT_STATE

N = 1500


@pytest.fixture
def kinds_of(write_bag, robot):
    """(signal, kind) of what is found in a run."""

    def found(columns, **options) -> set[tuple[str, str]]:
        recording = recording_of(read_bag(write_bag(columns, **options)), robot)
        return {(f.signal, f.kind) for f in find_irregularities(recording)}

    return found


def test_a_healthy_run_has_no_findings(kinds_of, run_columns) -> None:
    assert kinds_of(run_columns(N)) == set()


@pytest.mark.parametrize(
    ("topic", "field", "column", "change", "expected"),
    [
        ("/chamber_pressures", "effort", 0, lambda v: v[0], ("lift_cylinder/a", "stuck")),
        ("/joint_states", "position", 1, lambda v: v[0], ("tilt", "stuck")),
        ("/chamber_pressures", "effort", 3, lambda v: v * 0 + 2.6e7, ("tilt_cylinder/b", "sat")),
        ("/chamber_pressures", "effort", 4, lambda v: v - 6e6, ("supply", "range")),
        ("/joint_states", "position", 0, lambda v: v + 4.0, ("lift", "limit")),
        (
            "/joint_states",
            "position",
            0,
            lambda v: np.where(v == v[9], np.inf, v),
            ("lift", "not"),
        ),
        ("/valve_state", "effort", 1, lambda v: v * 0 + 10.0, ("tilt_valve", "saturated")),
    ],
)
def test_each_irregularity_is_found(
    kinds_of, run_columns, topic, field, column, change, expected
) -> None:
    columns = run_columns(N)
    values = columns[topic][1][field]
    values[:, column] = change(values[:, column].copy())
    found = kinds_of(columns)
    assert any(s == expected[0] and k.startswith(expected[1]) for s, k in found), found


def test_an_encoder_at_rest_with_its_valve_closed_is_not_stuck(kinds_of, run_columns) -> None:
    columns = run_columns(N)
    columns["/joint_states"][1]["position"][:, 0] = 0.8
    for topic in ("/valve_state", "/valve_command"):
        columns[topic][1]["effort"][:, 0] = 0.01
    assert kinds_of(columns) == set()


def test_gaps_and_latches_are_found(kinds_of, run_columns) -> None:
    columns = run_columns(N)
    columns["/joint_states"][1]["position"][300:310] = np.nan
    columns["/valve_state"] = (
        columns["/valve_state"][0],
        {"effort": columns["/valve_command"][1]["effort"].copy()},
    )
    columns["/valve_state"][1]["effort"][700:900] = 0.0
    assert kinds_of(columns) == {("cycles", "gap"), ("valves", "latched")}


def test_the_longest_gap_is_told_with_its_time(write_bag, run_columns, robot, capsys) -> None:
    columns = run_columns(N)
    for first, last in ((100, 102), (300, 310)):
        columns["/joint_states"][1]["position"][first:last] = np.nan
    path = write_bag(columns, metadata={"robot": "xs031"})
    # 2 ms each: from cycle 299 to cycle 310, beside 2 cycles from cycle 99 on.
    topics = {t.topic: t for t in inspect_bag(path, robot).topics}
    gap = topics["/joint_states"].longest_gap
    assert gap is not None
    assert (gap.after_s, gap.length_s, gap.missing) == pytest.approx((0.598, 0.022, 10))
    assert topics["/valve_state"].longest_gap is None
    assert main([str(path)]) == 0
    out = capsys.readouterr().out
    assert "2 gaps, 12 cycles missing; the longest, 0.022 s (10 cycles), after 0.598 s" in out
    assert "\n  missing: by the topic's own rate; what cycles lack stands under health" in out
    assert "\n  twice: " not in out
    assert [line for line in out.splitlines() if "0.022 s at 0.598 s" in line] == [
        line for line in out.splitlines() if line.startswith("/joint_states")
    ]


def test_the_record_of_a_bag(write_bag, run_columns, robot) -> None:
    columns = run_columns(N)
    del columns["/valve_state"]
    path = write_bag(
        columns, metadata={"robot": "xs031", "note": "cold oil", "mapping": "x" * 999}
    )
    inspection = inspect_bag(path, robot)
    assert inspection.cycles == N
    assert inspection.rate_hz == pytest.approx(500.0)
    assert inspection.duration_s == pytest.approx(2.998)
    assert inspection.messages == 5 * N
    assert inspection.checksummed
    assert inspection.compression == ["zstd"]
    assert inspection.metadata == {"robot": "xs031", "note": "cold oil", "mapping": "999 bytes"}
    assert inspection.channels == [
        f"{joint}/{kind}" for joint in ("lift", "tilt") for kind in ("force", "flow_a", "flow_b")
    ]
    topics = {topic.topic: topic for topic in inspection.topics}
    assert topics["/joint_states"].rate_hz == pytest.approx(500.0)
    assert topics["/joint_states"].missing == 0
    ranges = {r.signal: r for r in inspection.ranges}
    q = columns["/joint_states"][1]["position"][:, 0]
    assert (ranges["lift position"].low, ranges["lift position"].high) == (q.min(), q.max())
    assert ranges["supply"].unit == "Pa gauge"
    assert ranges["supply"].mean == pytest.approx(5e6 - 101325.0, rel=1e-3)


def test_the_command_prints_and_writes_json(tmp_path, write_bag, run_columns, capsys) -> None:
    path = write_bag(run_columns(N), metadata={"robot": "xs031"}, repeat={"/joint_states": 2})
    assert main([str(path), "--json", str(tmp_path / "i.json")]) == 0
    out = capsys.readouterr().out
    assert "1500 cycles at 500.00 Hz" in out
    assert "checksums hold" in out
    assert "health\n  nothing irregular\n  channels: lift/force, " in out
    assert "DAMAGE" not in out
    # Beside "nothing irregular" a column of numbers says what it is.
    assert "\n  twice: a stamp that came again, " in out
    assert "\n  missing: " not in out
    data = json.loads((tmp_path / "i.json").read_text())
    assert data["schema"] == "hydro_ident/inspection/1"
    topics = {topic["topic"]: topic for topic in data["topics"]}
    assert topics["/joint_states"]["duplicates"] == 2
    assert data["damage"] == []


def test_pressures_and_angles_are_told_as_people_tell_them(
    tmp_path, write_bag, run_columns, capsys
) -> None:
    path = write_bag(run_columns(N), metadata={"robot": "xs031"})
    assert main([str(path), "--json", str(tmp_path / "i.json")]) == 0
    lines = capsys.readouterr().out.splitlines()
    data = {r["signal"]: r for r in json.loads((tmp_path / "i.json").read_text())["ranges"]}
    for signal, unit, told, size in (
        ("supply", "Pa gauge", "bar gauge", 1e-5),
        ("lift position", "rad", "deg", 180.0 / np.pi),
    ):
        at = next(k for k, line in enumerate(lines) if line.startswith(f"{signal}  "))
        assert lines[at].endswith(f"  {unit}")
        low, high, mean, *words = lines[at + 1].split()
        assert " ".join(words) == told
        for value, key in ((low, "low"), (high, "high"), (mean, "mean")):
            assert float(value) == pytest.approx(size * data[signal][key], rel=1e-2)
        assert data[signal]["unit"] == unit


BEGIN = ("inactive: reading", "waiting for the next sample", "waiting for a first command")
END = ("waiting for a first command", "inactive: reading")


@pytest.mark.parametrize(
    ("messages", "expected"),
    [
        ((*BEGIN, "driving", "driving"), []),
        ((*BEGIN, "driving", *END), []),
        ((*BEGIN, "driving", *END, *BEGIN, "driving"), []),  # activated twice
        ((*BEGIN[1:], "driving"), []),  # recorded from after the activation on
        (("inactive: no device", *BEGIN, "driving", "waiting for the device"), []),  # lockstep
        ((*BEGIN, "driving", BEGIN[2], "driving"), [BEGIN[2]]),
        (BEGIN, list(BEGIN[1:])),  # it never came to work
        ((*BEGIN, "driving", *END, *BEGIN), list(BEGIN[1:])),  # nor the second time
        ((*BEGIN, "tripped: too old", BEGIN[2], "driving"), ["tripped: too old", BEGIN[2]]),
        (
            (BEGIN[2], "driving", "nothing from the device"),
            ["nothing from the device"],
        ),
    ],
)
def test_waiting_is_irregular_in_the_middle_of_a_run_only(messages, expected) -> None:
    levels = {"driving": "ok", "inactive: reading": "ok"}
    statuses = [
        status
        for k, message in enumerate(messages)
        for status in (
            Status(k, levels.get(message, "warn"), "can_bridge", message, {}),
            Status(k, "ok", "controller", "following", {}),  # another node's work is not its own
        )
    ]
    complaints = Complaints()
    complaints.add(statuses)
    assert complaints.told() == [f"can_bridge: {text} (warn)" for text in expected]


def test_a_bag_cut_off_is_said(write_bag, run_columns, capsys) -> None:
    path = write_bag(run_columns(N), metadata={"robot": "xs031"})
    (file,) = path.glob("*.mcap")
    data = file.read_bytes()
    file.write_bytes(data[: len(data) * 2 // 3])
    assert main([str(path)]) == 0
    out = capsys.readouterr().out
    assert "DAMAGE" in out
    assert "cut off" in out


def test_a_missing_bag_names_those_beside_it(tmp_path, write_bag, run_columns, capsys) -> None:
    there = write_bag(run_columns(20))
    assert main([str(there.parent / "nope")]) == 2
    assert f"bags in '{there.parent}': {there.name}" in capsys.readouterr().err
    assert main([str(tmp_path / "no" / "nope")]) == 2
    assert f"there is no folder '{tmp_path / 'no'}'" in capsys.readouterr().err


def test_bad_input_is_one_line_and_exit_2(tmp_path, write_bag, run_columns, capsys) -> None:
    columns = run_columns(20)
    columns["/joint_states"] = (("boom", "arm"), columns["/joint_states"][1])
    other = str(write_bag(columns))
    (tmp_path / "folder").mkdir()
    for arguments, text in (
        ([str(tmp_path / "nowhere")], "no bag"),
        ([str(tmp_path / "folder")], "expected a rosbag2 directory"),
        ([other, "--robot", "nothing"], "no robot file"),
        ([other, "--robot", "xs031"], "found boom, arm"),
        ([other, "--json", str(tmp_path / "no" / "x.json")], "cannot be written"),
    ):
        assert main(arguments) == 2
        error = capsys.readouterr().err
        assert error.count("\n") == 1
        assert text in error
    with pytest.raises(SystemExit) as usage:
        main([])
    assert usage.value.code == 2


def test_an_unknown_robot_is_said_before_the_bag_is_read(
    write_bag, run_columns, capsys, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write_bag(run_columns(20))
    monkeypatch.setattr(stretches.Passage, "stretches", lambda _: pytest.fail("it was read"))
    assert main([str(path), "--robot", "nothing"]) == 2
    assert "no robot file" in capsys.readouterr().err


class _Screen(io.StringIO):
    def isatty(self) -> bool:
        return True


@pytest.mark.parametrize("to", ["result.json", "-", None])
def test_reading_shows_on_a_terminal_wherever_the_result_goes(
    write_bag, run_columns, tmp_path, monkeypatch, capsys, to
) -> None:
    screen = _Screen()
    monkeypatch.setattr(terminal, "sys", SimpleNamespace(stderr=screen, stdout=sys.stdout))
    monkeypatch.setenv("TERM", "xterm")
    file = to and (to if to == "-" else str(tmp_path / to))
    options = [] if file is None else ["--json", file]
    assert main([str(write_bag(run_columns(N))), "--robot", "xs031", *options]) == 0
    drawn = screen.getvalue()
    assert "reading 1 of 2: file 1 of 1" in drawn
    assert "reading 2 of 2: file 1 of 1" in drawn
    # It goes on from the first reading to the second one, to its end.
    shares = [int(share) for share in re.findall(r" (\d+)%", drawn)]
    assert shares == sorted(shares)
    assert shares[-1] == 100
    assert screen.getvalue().endswith("\r\x1b[2K")
    said = capsys.readouterr().out
    if to == "-":
        assert json.loads(said)["cycles"] == N
    else:
        assert f"{N} cycles" in said
        assert to is None or json.loads((tmp_path / to).read_text())["cycles"] == N


def _small_bag(folder: Path, metadata: Mapping[str, str]) -> Path:
    """A bag of one message."""
    with BagWriter(folder, metadata) as writer:
        writer.add_topic("/joint_states", JOINT_STATE)
        values = {"position": [0.25, 0.0]}
        writer.write_stamped("/joint_states", 10**18, values, names=("lift", "tilt"))
    return folder


def test_a_failed_checksum_is_in_the_inspection(tmp_path: Path, robot) -> None:
    path = _small_bag(tmp_path / "bag", {"note": "small"})
    assert "checksums hold" in text_of(inspect_bag(path, robot))
    file = path / "bag_0.mcap"
    data = bytearray(file.read_bytes())
    data[data.index(b"small")] ^= 1
    file.write_bytes(data)
    told = text_of(inspect_bag(path, robot))
    assert "a checksum FAILS" in told
    assert "bytes changed" in told


def test_what_a_bag_says_commands_no_terminal_and_opens_no_file(tmp_path: Path, robot) -> None:
    metadata = {"robot": "/etc/hostname", "note": "\x1b[2Jgone\nnext"}
    path = _small_bag(tmp_path / "bag", metadata)
    assert named_robot(metadata) is None
    assert inspect_bag(path).robot is None
    text = text_of(inspect_bag(path, robot))
    assert "\x1b" not in text
    assert "\\x1b[2Jgone\\nnext" in text
