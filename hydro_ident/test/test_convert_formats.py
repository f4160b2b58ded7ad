"""Logs as other tools write them: rates, clocks, commas, wrapped angles, raw transducers."""

from __future__ import annotations

import re
import resource
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from scipy.io import savemat

from hydro_ident.bag.reader import read_bag
from hydro_ident.bag.recording import read_recording
from hydro_ident.errors import BagError
from hydro_ident.logs.convert import Conversion, convert
from hydro_ident.logs.file import read_log
from hydro_ident.logs.map import read_map
from hydro_model.robot_files import load_robot

EXAMPLES = Path(__file__).resolve().parents[2] / "hydro_msgs_docs" / "log_examples"


def converted(log: Path, mapping: dict, folder: Path) -> Conversion:
    file = folder / "map.yaml"
    file.write_text(yaml.safe_dump(mapping), encoding="utf-8")
    read = read_map(file)
    return convert(read_log(log, read.layout), read, folder / "bag", {})


def positions(folder: Path) -> dict[str, np.ndarray]:
    series = read_bag(folder / "bag").series["/joint_states"]
    return {n: series.fields["position"][:, i] for i, n in enumerate(series.names)}


def write(folder: Path, text: str, name: str = "log.csv") -> Path:
    file = folder / name
    file.write_text(text, encoding="utf-8")
    return file


#: Header of a LabVIEW file whose channels have X columns of their own.
MULTI = (
    "LabVIEW Measurement\t\nSeparator\tTab\nDecimal_Separator\t.\nMulti_Headings\tYes\n"
    "X_Columns\tMulti\n***End_of_Header***\t\n\t\nChannels\t2\t\n***End_of_Header***\t\n"
)
JOINT = {"slide": {"signal": "q", "unit": "mm"}}


def lines(time: np.ndarray, *columns: np.ndarray, decimal: str = ".", delimiter: str = ",") -> str:
    rows = np.column_stack([time, *columns])
    return "\n".join(delimiter.join(f"{v:.6f}".replace(".", decimal) for v in row) for row in rows)


@pytest.mark.parametrize("delimiter", [";", "\t"])
def test_decimal_commas_units_and_lines_above_are_read(delimiter: str, tmp_path: Path) -> None:
    t = np.arange(40) * 0.01
    head = f"Messung 7\nBediener: M. Muster, Halle 3\nt{delimiter}q\ns{delimiter}mm\n"
    file = write(tmp_path, head + lines(t, 1.5 + t, decimal=",", delimiter=delimiter))
    log = read_log(file)
    assert log.units == {"t": "s", "q": "mm"}
    assert "2 lines above the names left out" in log.notes
    done = converted(file, {"time": {"signal": "t"}, "joints": JOINT}, tmp_path)
    assert done.rate_hz == pytest.approx(100.0)
    np.testing.assert_allclose(positions(tmp_path)["slide"], (1.5 + t) * 1e-3, atol=1e-9)


def test_a_comma_in_a_number_of_points_says_what_it_may_be(tmp_path: Path) -> None:
    file = write(tmp_path, "t;q\n0.0;1.0\n0.1;1.1\n0.2;1,2\n0.3;1.3\n0.4;1.4\n")
    with pytest.raises(BagError, match=r"line 4: expected a number, found '1,2'; is the decimal"):
        read_log(file)


def test_dates_and_times_of_day_are_time(tmp_path: Path) -> None:
    rows = [f"2026-03-01 23:59:59.{k}00,{k}" for k in range(10)]
    rows += [f"2026-03-02 00:00:00.{k}00,{k}" for k in range(10)]
    log = read_log(write(tmp_path, "\n".join(["stamp,q", *rows])))
    np.testing.assert_allclose(np.diff(log.columns["stamp"]), 0.1, atol=1e-6)
    assert log.start == "2026-03-01T23:59:59.000"


def test_windows_and_utf16_texts_are_read(tmp_path: Path) -> None:
    text = "t (s)\tWinkel (°)\n0\t1\n1\t2\n"
    for encoding in ("cp1252", "utf-16", "utf-8-sig", "utf-16-le", "utf-16-be"):
        (tmp_path / "log.txt").write_bytes(text.encode(encoding))
        assert read_log(tmp_path / "log.txt").units == {"t (s)": "s", "Winkel (°)": "°"}


def test_several_rates_keep_their_own_instants_or_those_they_share(tmp_path: Path) -> None:
    fast, slow = np.arange(100) * 0.002, 0.02 + np.arange(16) * 0.01
    file = tmp_path / "log.mat"
    savemat(file, {"t": fast, "q": fast * 10.0, "t2": slow, "p": 1e6 + slow})
    mapping = {
        "time": {"signal": "t"},
        "joints": {"lift": {"signal": "q"}},
        "pressures": {
            "lift_cylinder/a": {"signal": "p", "unit": "Pa", "reference": "absolute", "time": "t2"}
        },
    }
    every = converted(file, mapping, tmp_path)
    assert every.counts == {"/joint_states": 100, "/chamber_pressures": 16}
    assert "clock 't2' begins 0.02 s after the first" in every.remarks
    assert any("time: {keep: common} leaves them out" in text for text in every.remarks)
    (tmp_path / "bag").rename(tmp_path / "all")
    mapping["time"]["keep"] = "common"
    done = converted(file, mapping, tmp_path)
    assert done.counts == {"/joint_states": 16, "/chamber_pressures": 16}
    np.testing.assert_allclose(positions(tmp_path)["lift"], slow * 10.0, atol=1e-12)
    recording = read_recording(tmp_path / "bag", load_robot("xs031"))
    assert (recording.period_s, len(recording.gaps)) == (pytest.approx(0.01), 0)


def test_a_late_trigger_is_shifted_and_clocks_that_never_meet_are_said(tmp_path: Path) -> None:
    t = np.arange(50) * 0.01
    file = tmp_path / "log.mat"
    savemat(file, {"t": t, "q": t, "t2": t[:40], "s": t[:40] + 0.1})
    mapping = {
        "time": {"signal": "t"},
        "clocks": {"t2": {"late_s": 0.1}},
        "joints": {"a": {"signal": "q"}, "b": {"signal": "s", "time": "t2"}},
    }
    done = converted(file, mapping, tmp_path)
    assert done.cycles == 50
    both = positions(tmp_path)
    late = np.isfinite(both["b"])
    assert np.count_nonzero(late) == 40
    np.testing.assert_allclose(both["b"][late], both["a"][late], atol=1e-12)
    (tmp_path / "bag").rename(tmp_path / "first")
    mapping["clocks"]["t2"]["late_s"] = 0.1033
    apart = converted(file, mapping, tmp_path)
    assert apart.cycles == 90
    assert any("would move each to the nearest" in text for text in apart.remarks)
    (tmp_path / "bag").rename(tmp_path / "second")
    mapping["time"]["within_s"] = 0.005
    near = converted(file, mapping, tmp_path)
    assert near.cycles == 50
    assert any("moved by up to 3.3e+03 us" in text for text in near.remarks)


def test_a_channel_that_begins_late_and_a_cut_are_said(tmp_path: Path) -> None:
    rows = [f"{k / 100:.2f},{k},{'' if k < 30 else k}" for k in range(-10, 90)]
    file = write(tmp_path, "\n".join(["t,q,p", *rows]))
    mapping = {
        "time": {"signal": "t", "from_s": 0.0},
        "joints": JOINT,
        "valves": {"v": {"signal": "p"}},
    }
    done = converted(file, mapping, tmp_path)
    assert done.cycles == 90
    assert done.counts["/valve_state"] == 60
    assert "time begins at -0.1 s" in done.remarks
    assert "10 samples outside from_s to to_s left out" in done.remarks
    assert "valves, v: first value 0.3 s after the beginning" in done.remarks


def test_wrapped_angles_are_said_and_unwrapped_where_asked(tmp_path: Path) -> None:
    t = np.arange(400) * 0.01
    true = -70.0 + 12.0 * np.sin(3.0 * t)
    wrapped = (true - 110.0 + 180.0) % 360.0 - 180.0
    jumps = int(np.count_nonzero(np.abs(np.diff(wrapped)) > 180.0))
    assert jumps > 2
    wrapped[7] = np.nan
    file = tmp_path / "log.mat"
    savemat(file, {"t": t, "q": np.full(400, 30.0), "z": wrapped})
    mapping = {
        "robot": "xs031",
        "time": {"signal": "t"},
        "joints": {
            "lift": {"signal": "q", "unit": "deg"},
            "tilt": {"signal": "z", "unit": "deg", "offset": float(np.radians(110.0 - 720.0))},
        },
    }
    said = converted(file, mapping, tmp_path).remarks
    assert any(
        f"joints, tilt: {jumps} jumps by about 360; if the angle is wrapped" in r for r in said
    )
    (tmp_path / "bag").rename(tmp_path / "wrapped")
    mapping["joints"]["tilt"]["wrap"] = 360
    remarks = converted(file, mapping, tmp_path).remarks
    assert f"joints, tilt: {jumps} jumps by 360 taken out" in remarks
    got = positions(tmp_path)["tilt"]
    known = np.isfinite(got)
    np.testing.assert_allclose(got[known], np.radians(true)[known], atol=1e-9)


WRAPPED = {"unit": "deg", "wrap": 360}


@pytest.mark.parametrize(
    ("span", "joint"),
    [
        (2.0 * np.pi, {"signal": "q", **WRAPPED}),
        (np.inf, {"signal": "q", **WRAPPED}),
        (np.inf, {"constant": 179, "unit": "deg"}),
    ],
    ids=["wide", "endless", "locked"],
)
def test_a_wrapped_reference_is_of_the_turn_of_its_joint(
    span: float, joint: dict, tmp_path: Path
) -> None:
    """A slew beyond half a turn: its reference is ahead by the jump of a wrapped angle."""
    t = np.arange(400) * 0.01
    angle = 179.0 + 0.8 * np.sin(3.0 * t)
    asked = angle + 2.0
    savemat(tmp_path / "log.mat", {"t": t, "q": angle, "r": (asked + 180.0) % 360.0 - 180.0})
    mapping = {
        "robot": "xs031",
        "time": {"signal": "t"},
        "joints": {"lift": joint, "tilt": {"constant": -30, "unit": "deg"}},
        "references": {
            "lift": {"signal": "r", **WRAPPED},
            "tilt": {"constant": -40, "unit": "deg"},
        },
    }
    (tmp_path / "map.yaml").write_text(yaml.safe_dump(mapping), encoding="utf-8")
    robot = load_robot("xs031")
    slew = replace(robot.joints[0], lower=-span, upper=span)
    read = replace(
        read_map(tmp_path / "map.yaml"),
        robot=replace(robot, joints=(slew, *robot.joints[1:])),
    )
    done = convert(read_log(tmp_path / "log.mat"), read, tmp_path / "bag", {})
    assert "references, lift: +1 turns, nearest to the joint's angle" in done.remarks
    got = read_bag(tmp_path / "bag").series["/joint_reference"].fields["position"]
    np.testing.assert_allclose(got[:, 0], np.radians(asked), atol=1e-9)
    np.testing.assert_allclose(got[:, 1], np.radians(-40.0), atol=1e-9)


def test_loop_currents_become_the_transducers_range(tmp_path: Path) -> None:
    file = write(tmp_path, "t,q,i\n0,1,4\n1,2,12\n2,3,20\n")
    pressure = {"signal": "i", "raw": [4, 20], "span": [0, 250], "unit": "bar"}
    mapping = {
        "time": {"signal": "t"},
        "joints": JOINT,
        "pressures": {"supply": {**pressure, "reference": "absolute"}},
    }
    converted(file, mapping, tmp_path)
    series = read_bag(tmp_path / "bag").series["/chamber_pressures"]
    np.testing.assert_allclose(series.fields["effort"][:, 0], [0.0, 1.25e7, 2.5e7])


def test_control_desk_example_is_what_it_was_made_of(tmp_path: Path) -> None:
    mapping = read_map(EXAMPLES / "control_desk.map.yaml")
    done = convert(read_log(EXAMPLES / "control_desk.csv"), mapping, tmp_path / "bag", {})
    assert done.rate_hz == pytest.approx(100.0)
    assert "clock 'time[2]' begins 0.04 s after the first" in done.remarks
    t = 0.04 + 0.01 * np.arange(done.cycles)
    got = positions(tmp_path)
    lift = 40.0 + 6.0 * np.sin(1.6 * np.pi * t)
    tilt = -70.0 + 8.0 * np.sin(1.2 * np.pi * t + 0.4)
    np.testing.assert_allclose(np.degrees(got["lift"]), lift, atol=1e-5)
    np.testing.assert_allclose(np.degrees(got["tilt"]), tilt, atol=1e-3)


def test_labview_example_is_what_it_was_made_of(tmp_path: Path) -> None:
    mapping = read_map(EXAMPLES / "labview.map.yaml")
    log = read_log(EXAMPLES / "labview.lvm")
    assert log.start == "2026-03-01T09:30:00.250000"
    done = convert(log, mapping, tmp_path / "bag", {})
    assert "25 samples outside from_s to to_s left out" in done.remarks
    t = 0.002 * np.arange(done.cycles)
    lift = 40.0 + 6.0 * np.sin(1.6 * np.pi * t)
    np.testing.assert_allclose(np.degrees(positions(tmp_path)["lift"]), lift, atol=1e-5)


@pytest.mark.parametrize("named", [{}, {"time": "X_Value[2]"}], ids=["by the file", "named"])
def test_only_what_is_of_one_instant_is_subtracted(named: dict, tmp_path: Path) -> None:
    table = "X_Value\tz1\tX_Value\tz2\n0\t1\t0.004\t2\n0.01\t3\t0.014\t4\n"
    file = write(tmp_path, MULTI + table, "a.lvm")
    mapping = {
        "time": {"signal": "X_Value[1]"},
        "joints": {"a": {"signal": "z2", "minus": "z1", "unit": "deg", **named}},
    }
    said = "expected 'z2' and 'z1' of the same instants, found one by 'X_Value"
    with pytest.raises(BagError, match=re.escape(said)):
        converted(file, mapping, tmp_path)


def test_a_time_that_is_no_clock_of_the_file_is_for_both_of_a_difference(tmp_path: Path) -> None:
    head = "X_Value\tz1\tX_Value\tz2\tX_Value\tt\n"
    table = head + "0\t1\t0.004\t2\t0\t7\n0.01\t3\t0.014\t4\t0.01\t7.01\n"
    file = write(tmp_path, MULTI + table, "a.lvm")
    mapping = {
        "time": {"signal": "X_Value[1]"},
        "joints": {"a": {"signal": "z2", "minus": "z1", "unit": "deg", "time": "t"}},
    }
    converted(file, mapping, tmp_path)
    np.testing.assert_allclose(np.degrees(positions(tmp_path)["a"]), [1.0, 1.0])


def test_a_disk_that_is_full_is_one_line_and_leaves_nothing(tmp_path: Path) -> None:
    file = write(tmp_path, "\n".join(["t,q", *(f"{k / 100:.2f},{k % 7}" for k in range(4000))]))
    mapping = {"time": {"signal": "t"}, "joints": JOINT}
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (2000, hard))
    try:
        with pytest.raises(BagError, match="bag: cannot be written: File too large"):
            converted(file, mapping, tmp_path)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert not (tmp_path / "bag").exists()


def test_a_last_line_that_was_cut_is_left_out_and_said(tmp_path: Path) -> None:
    log = tmp_path / "log.csv"
    log.write_text("t,q,p\n0,1,2\n1,2,3\n2,3", encoding="utf-8")
    read = read_log(log)
    assert len(read.columns["t"]) == 2
    assert "line 4, the last one, is cut and left out" in " ".join(read.notes)
    log.write_text("t,q,p\n0,1,2\n1,2\n2,3,4\n", encoding="utf-8")
    with pytest.raises(BagError, match="line 3: expected 3 columns, found 2; leave a line"):
        read_log(log)
    log.write_text("t,q,p\n0,1,2\n1,2,3\n2,3,1.5e", encoding="utf-8")
    with pytest.raises(BagError, match=r"found '1\.5e'; the last line: leave it out"):
        read_log(log)
