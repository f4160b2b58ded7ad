"""Tracking figures against closed forms, from encoders and from the rig's side file."""

from __future__ import annotations

import io
import json
import sys
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore

from hydro_hw_bridge.rig.truth_log import SCHEMA
from hydro_ident.bag.diagnostics import DIAGNOSTIC_ARRAY
from hydro_ident.bag.reader import read_bag
from hydro_ident.bag.writer import BagWriter
from hydro_ident.commands.compare_tracking import run as compare
from hydro_ident.commands.tracking import main, other_machine
from hydro_ident.errors import NotEnoughDataError
from hydro_ident.recordings.metrics import moving_span, speed_m_s, tracking
from hydro_model.command_line import terminal
from hydro_model.multibody.kinematics import tip_position
from hydro_model.robot_files import load_robot
from hydro_msgs_docs.cdr import JOINT_STATE, POINT_STAMPED

PERIOD_NS = 2_000_000
START_NS = 1_700_000_000_000_000_000
STORE = get_typestore(Stores.ROS2_JAZZY)


def _quintic(count: int) -> np.ndarray:
    """1 m along x in `count` cycles after 100 at rest, then 100 more at rest; y and z follow."""
    s = np.linspace(0.0, 1.0, count)
    x = 10 * s**3 - 15 * s**4 + 6 * s**5
    x = np.concatenate([np.zeros(100), x, np.ones(100)])
    return np.column_stack([x, 0.0 * x, 0.0 * x])


def test_figures_of_a_constant_offset() -> None:
    reference = _quintic(1001)
    stamps = START_NS + PERIOD_NS * np.arange(len(reference))
    tip = reference + np.array([0.0, 0.003, 0.004])
    result = tracking(stamps, tip, reference, half_width=1)
    assert result.rmse_mm == pytest.approx(5.0)
    assert result.max_error_mm == pytest.approx(5.0)
    # A quintic over T peaks at 15/8 of its mean speed.
    assert result.max_speed_m_s == pytest.approx(1.875 / 2.0, rel=1e-5)
    assert result.reference_speed_m_s == pytest.approx(1.875 / 2.0, rel=1e-5)
    assert result.rho_s == pytest.approx(5e-3 / (1.875 / 2.0), rel=1e-5)
    assert result.duration_s == pytest.approx(2.0, abs=0.02)
    wide = tracking(stamps, tip, reference, half_width=5)
    assert wide.max_speed_m_s == pytest.approx(1.875 / 2.0, rel=1e-3)


def test_a_pure_delay_is_rho() -> None:
    """Following d seconds late costs an error of d times the speed: rho is about d."""
    reference = _quintic(2001)
    stamps = PERIOD_NS * np.arange(len(reference))
    late = np.vstack([np.repeat(reference[:1], 5, axis=0), reference[:-5]])
    assert tracking(stamps, late, reference, half_width=1).rho_s == pytest.approx(0.01, rel=1e-3)


def test_errors_outside_the_moving_span_do_not_count() -> None:
    reference = _quintic(501)
    tip = reference.copy()
    tip[:90] += 1.0
    tip[-90:] -= 1.0
    stamps = PERIOD_NS * np.arange(len(reference))
    assert tracking(stamps, tip, reference, half_width=1).max_error_mm == 0.0
    span = moving_span(reference)
    assert 100 <= span.start < 105
    assert 596 < span.stop <= 602


def test_a_hold_inside_the_motion_counts_and_gaps_keep_speeds_right() -> None:
    reference = np.vstack([_quintic(501), _quintic(501)[::-1]])
    tip = reference.copy()
    tip[700] += [0.0, 0.0, 0.02]
    stamps = PERIOD_NS * np.arange(len(reference))
    keep = np.r_[0:300, 320 : len(reference)]
    full = tracking(stamps, tip, reference, half_width=5)
    gappy = tracking(stamps[keep], tip[keep], reference[keep], half_width=5)
    assert full.max_error_mm == gappy.max_error_mm == pytest.approx(20.0)
    assert gappy.max_speed_m_s <= full.max_speed_m_s * 1.001


def test_nothing_to_compare_is_said() -> None:
    still = np.ones((50, 3))
    stamps = PERIOD_NS * np.arange(50)
    with pytest.raises(NotEnoughDataError, match="reference never moves"):
        tracking(stamps, still, still, half_width=1)
    with pytest.raises(NotEnoughDataError, match="tip does not move"):
        tracking(stamps, still, _quintic(101)[100:150], half_width=1)
    assert len(speed_m_s(stamps[:2], still[:2], 1)) == 0


@pytest.fixture
def bag(tmp_path):
    """The tip 2 mm beside its reference, encoders 1 mrad off at the second joint."""
    return _tip_bag(tmp_path, "bag")


def _tip_bag(tmp_path, name: str, cycles: int = 1000, metadata=None):
    """Of a motion of 1000 cycles, the first ones; with the truth beside it."""
    robot = load_robot("xs031")
    s = np.linspace(0.0, 1.0, 1000)
    ramp = 10 * s**3 - 15 * s**4 + 6 * s**5
    q = np.column_stack([0.6 + 0.4 * ramp, -1.2 + 0.2 * ramp])
    tip = tip_position(robot, q)
    path = tmp_path / name
    with BagWriter(path, {"robot": "xs031"} if metadata is None else metadata) as writer:
        writer.add_topic("/joint_states", JOINT_STATE)
        writer.add_topic("/tip_reference", POINT_STAMPED)
        writer.add_topic("/diagnostics", DIAGNOSTIC_ARRAY)
        for k in range(cycles):
            stamp = START_NS + 500_000_000 + PERIOD_NS * k
            writer.write_stamped(
                "/joint_states", stamp, {"position": q[k] + [0.0, 1e-3]}, names=("lift", "tilt")
            )
            writer.write_stamped("/tip_reference", stamp, {"point": tip[k] + [0.0, 0.002, 0.0]})
        writer.write("/diagnostics", _diagnostics(), START_NS + 600_000_000)
    counters = np.arange(100, 1400)
    true = np.full((1300, 3), 9.0)
    true[150:1150] = tip
    _save_truth(tmp_path / "truth.npz", counters, true)
    return path


def _save_truth(path, counters: np.ndarray, tip: np.ndarray) -> None:
    """As the rig's side file: named columns, more of them than are needed."""
    rows = np.column_stack([0.0 * counters, counters, tip])
    names = ["time_s", "counter", "tip/x", "tip/y", "tip/z"]
    np.savez_compressed(path, schema=SCHEMA, names=names, rows=rows)


def _diagnostics() -> bytes:
    types = STORE.types
    time = types["builtin_interfaces/msg/Time"](1_700_000_000, 0)
    pair = types["diagnostic_msgs/msg/KeyValue"]
    pairs = [pair("cycles", "12"), pair("sample_zero_stamp_ns", str(START_NS))]
    status = types["diagnostic_msgs/msg/DiagnosticStatus"](0, "can_bridge", "ok", "hw", pairs)
    header = types["std_msgs/msg/Header"](time, "")
    message = types[DIAGNOSTIC_ARRAY](header, [status])
    return bytes(STORE.serialize_cdr(message, DIAGNOSTIC_ARRAY))


def test_the_command_from_encoders_and_truth(tmp_path, bag, capsys) -> None:
    out = tmp_path / "t.json"
    assert main([str(bag), "--truth", str(tmp_path / "truth.npz"), "--json", str(out)]) == 0
    data = json.loads(out.read_text())
    assert data["source"] == "truth"
    assert data["damage"] == []
    assert data["rmse_mm"] == data["truth"]["rmse_mm"] == pytest.approx(2.0, rel=1e-9)
    # 1 mrad at an arm of about 2 m, at right angles to the 2 mm.
    robot = load_robot("xs031")
    arm = np.linalg.norm(robot.tip_offset_m)
    expected = np.hypot(2.0, arm) if arm else data["encoders"]["rmse_mm"]
    assert data["encoders"]["rmse_mm"] == pytest.approx(expected, rel=2e-2)
    assert data["encoders"]["max_speed_m_s"] == pytest.approx(data["max_speed_m_s"], rel=1e-3)
    assert set(data["truth"]) >= {"rmse_mm", "max_error_mm", "max_speed_m_s", "rho_s"}
    assert "rho s" in capsys.readouterr().out
    assert main([str(bag), "--json", str(out)]) == 0
    data = json.loads(out.read_text())
    assert data["source"] == "encoders"
    assert "truth" not in data


@pytest.mark.parametrize("named", ["mycrane", ""])
def test_no_tip_is_computed_by_links_that_nobody_named(tmp_path, capsys, named: str) -> None:
    bag = tmp_path / "other"
    with BagWriter(bag, {"robot": named} if named else {}) as writer:
        writer.add_topic("/joint_states", JOINT_STATE)
        names = ("lift", "tilt") if named else ("boom", "arm")
        writer.write_stamped("/joint_states", START_NS, {"position": np.zeros(2)}, names=names)
    assert main([str(bag)]) == 2
    assert f"found '{named}': give the --robot that the tip is of" in capsys.readouterr().err


def test_a_bag_that_names_no_robot_is_of_the_one_with_its_joints(tmp_path, bag, capsys) -> None:
    """As of `ros2 bag record`."""
    named, bare = tmp_path / "named.json", tmp_path / "bare.json"
    assert main([str(bag), "--json", str(named)]) == 0
    assert "names no robot" not in capsys.readouterr().err
    unnamed = _tip_bag(tmp_path, "unnamed", metadata={})
    assert main([str(unnamed), "--json", str(bare)]) == 0
    assert "the bag names no robot: read as xs031, whose joints" in capsys.readouterr().err
    figures = [json.loads(file.read_text())["encoders"] for file in (named, bare)]
    assert figures[0] == figures[1]


def test_links_of_another_robot_than_the_bags_are_said(tmp_path, bag, capsys) -> None:
    assert other_machine(read_bag(bag), load_robot("xs031")) == []
    other = replace(load_robot("xs031"), name="mycrane")
    assert other_machine(read_bag(bag), other) == [
        "recorded as 'xs031', not mycrane: the tip is that of another machine's links"
    ]


def test_what_could_not_be_read_or_checked_is_said(
    tmp_path, bag, capsys, without_checksums
) -> None:
    """By both commands, beside the figures of what is left, and in the JSON of one bag."""
    (file,) = without_checksums(bag).glob("*.mcap")
    file.write_bytes(file.read_bytes()[:-2000])
    read = read_bag(bag)
    damage, warnings = list(read.losses), [*read.losses, *read.unchecked]
    assert any("cut off" in loss for loss in damage)
    assert warnings[-1].startswith("not checksummed")
    out = tmp_path / "t.json"
    truth = tmp_path / "truth.npz"
    assert main([str(bag), "--truth", str(truth), "--json", str(out)]) == 0
    data = json.loads(out.read_text())
    assert (data["damage"], data["checksummed"]) == (damage, False)
    said = capsys.readouterr().err.splitlines()
    assert said == [f"tracking: warning: {warning}" for warning in warnings]
    assert compare([f"run={bag},{truth}", "--robot", "xs031"]) == 0
    said = capsys.readouterr().err.splitlines()
    assert said == [f"compare_tracking: warning: run: {warning}" for warning in warnings]


def test_the_truth_of_another_run_is_refused(tmp_path, bag, capsys) -> None:
    """All runs count their samples from 0: any side file has a row for each cycle."""
    with np.load(tmp_path / "truth.npz") as data:
        rows = data["rows"]
    for name, shift, code in (("near", 0.4, 0), ("other", 0.6, 2)):
        path = tmp_path / f"{name}.npz"
        _save_truth(path, rows[:, 1], rows[:, 2:] + [0.0, shift, 0.0])
        assert main([str(bag), "--truth", str(path)]) == code
        assert ("is this file of another run" in capsys.readouterr().err) == (code == 2)


def test_a_run_that_was_cut_short_is_void(tmp_path, bag, capsys) -> None:
    """It has less error than one that went all the way, and is no better for that."""
    short, truth = _tip_bag(tmp_path, "short", 600), tmp_path / "truth.npz"
    runs = [f"short={short},{truth}", f"whole={bag},{truth}"]
    assert compare([*runs, "--robot", "xs031"]) == 1
    printed, said = capsys.readouterr()
    assert [line.split()[0] for line in printed.splitlines() if "VOID" in line] == ["short"] * 2
    void, why = said.splitlines()
    assert void == "compare_tracking: void: short"
    assert "short followed another path than whole, or was cut short" in why
    twice = [f"{name}={bag},{truth}" for name in ("one", "two")]
    assert compare([*twice, "--robot", "xs031"]) == 0


@pytest.mark.parametrize(
    ("late_ns", "kept"), [(1_000_000, slice(None)), (0, slice(300)), (0, slice(700, None))]
)
def test_pressures_have_no_part_in_the_figures(
    tmp_path, bag, capsys, late_ns: int, kept: slice
) -> None:
    """On stamps of their own, ended early or begun late."""
    joints = read_bag(bag).series["/joint_states"]
    reference = read_bag(bag).series["/tip_reference"]
    other = tmp_path / "with_pressures"
    with BagWriter(other, {"robot": "xs031"}) as writer:
        for topic, kind in (
            ("/joint_states", JOINT_STATE),
            ("/chamber_pressures", JOINT_STATE),
            ("/tip_reference", POINT_STAMPED),
        ):
            writer.add_topic(topic, kind)
        for k, stamp in enumerate(joints.stamp_ns.tolist()):
            position = {"position": joints.fields["position"][k]}
            writer.write_stamped("/joint_states", stamp, position, names=joints.names)
            writer.write_stamped("/tip_reference", stamp, {"point": reference.fields["point"][k]})
        for stamp in joints.stamp_ns[kept].tolist():
            at = stamp + late_ns
            writer.write_stamped("/chamber_pressures", at, {"effort": [1e5]}, names=["tank"])
    figures = []
    for k, path in enumerate((bag, other)):
        out = tmp_path / f"{k}.json"
        assert main([str(path), "--json", str(out)]) == 0
        figures.append(json.loads(out.read_text())["encoders"])
    assert figures[0] == figures[1]
    assert figures[0]["gaps"] == figures[0]["missing"] == figures[0]["without"] == 0
    assert capsys.readouterr().err == ""


def test_what_is_not_compared_is_said(tmp_path, write_bag, run_columns, capsys) -> None:
    """Cycles that are missing, and cycles without a reference."""
    columns = run_columns(1000)
    columns["/tip_reference"][1]["point"][300:340] = np.nan
    stamps = START_NS + PERIOD_NS * np.arange(1000)
    stamps[600:] += 70 * PERIOD_NS
    out = tmp_path / "t.json"
    path = write_bag(columns, stamps=stamps)
    assert main([str(path), "--robot", "xs031", "--json", str(out)]) == 0
    data = json.loads(out.read_text())
    assert (data["gaps"], data["missing"]) == (1, 70)
    assert data["without"] == 1000 - data["cycles"] == 40
    gap, without = capsys.readouterr().err.splitlines()
    assert "warning: 1 gap while the reference moves, 70 cycles missing" in gap
    assert "warning: 40 of 1000 cycles while the reference moves have no tip" in without


class _Screen(io.StringIO):
    def isatty(self) -> bool:
        return True


@pytest.mark.parametrize("screen", [_Screen(), io.StringIO()], ids=["terminal", "file"])
@pytest.mark.parametrize("several", [False, True], ids=["tracking", "compare_tracking"])
def test_reading_shows_on_a_terminal_alone(
    tmp_path, bag, monkeypatch, capsys, screen, several
) -> None:
    screen.truncate(0)
    monkeypatch.setattr(terminal, "sys", SimpleNamespace(stderr=screen, stdout=sys.stdout))
    monkeypatch.setenv("TERM", "xterm")
    truth = tmp_path / "truth.npz"
    if several:
        runs = [f"{name}={bag},{truth}" for name in ("old", "new")]
        assert compare([*runs, "--robot", "xs031", "--json", "-"]) == 0
        wanted = ("reading file 1 of 1", "run 1 of 2: old", "run 2 of 2: new")
    else:
        assert main([str(bag), "--truth", str(truth), "--json", "-"]) == 0
        wanted = ("reading file 1 of 1", "following the tip")
    json.loads(capsys.readouterr().out)
    if screen.isatty():
        assert all(said in screen.getvalue() for said in wanted)
        assert screen.getvalue().endswith("\r\x1b[2K")
    else:
        assert screen.getvalue() == ""


def test_bad_input_is_one_line(tmp_path, bag, write_bag, run_columns, capsys) -> None:
    columns = run_columns(20)
    del columns["/tip_reference"]
    headless = str(write_bag(columns, name="headless"))
    frozen = run_columns(20)
    frozen["/tip_reference"] = ((), {"point": np.ones((20, 3))})
    one_joint = run_columns(20)
    one_joint["/joint_states"] = (("lift", "x"), one_joint["/joint_states"][1])
    (tmp_path / "no.npz").write_bytes(b"nothing")
    np.savez(tmp_path / "other.npz", x=np.zeros(3))
    _save_truth(tmp_path / "late.npz", np.arange(10) + 10**6, np.zeros((10, 3)))
    four, rows = ["counter", "tip/x", "tip/y", "tip/z"], np.zeros((9, 3))
    np.savez(tmp_path / "column.npz", schema=SCHEMA, names=["counter"], rows=rows[:, :1])
    np.savez(tmp_path / "shape.npz", schema=SCHEMA, names=four, rows=rows)
    np.savez(tmp_path / "schema.npz", schema="truth_log/2", names=four, rows=np.zeros((9, 4)))
    truth = [str(bag), "--truth"]
    no_zero = [str(write_bag(run_columns(20), name="nozero")), "--truth"]
    for arguments, text, code in (
        ([headless], "found none: record a run in which the controller moves the tip", 1),
        ([str(write_bag(frozen, name="frozen"))], "reference never moves", 1),
        ([str(write_bag(one_joint, name="one"))], "expected positions of tilt", 1),
        ([*truth, str(tmp_path / "nowhere.npz")], "No such file", 2),
        ([*truth, str(tmp_path / "no.npz")], "expected the rig's .npz side file", 2),
        ([*truth, str(tmp_path / "other.npz")], "expected arrays schema, names and rows", 2),
        ([*truth, str(tmp_path / "schema.npz")], f"expected schema {SCHEMA}, found 'truth", 2),
        ([*truth, str(tmp_path / "shape.npz")], "expected rows of 4 columns", 2),
        ([*truth, str(tmp_path / "column.npz")], "expected a column tip/x, found counter", 2),
        ([*truth, str(tmp_path / "late.npz")], "no sample of this file", 2),
        ([*no_zero, str(tmp_path / "truth.npz")], "sample_zero_stamp_ns", 2),
    ):
        assert main([*arguments, "--robot", "xs031"]) == code, text
        error = capsys.readouterr().err
        assert error.count("\n") == 1, error
        assert text in error
