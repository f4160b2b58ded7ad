"""Logs of other tools become bags sample by sample, and a wrong log or mapping is one line."""

from __future__ import annotations

import gzip
import sys
from datetime import datetime, timezone
from pathlib import Path

import numpy as np
import pytest
import yaml
from scipy.io import savemat

from hydro_ident.bag.reader import read_bag
from hydro_ident.bag.recording import read_recording
from hydro_ident.commands.convert import main, run, summary_text
from hydro_ident.errors import BagError
from hydro_ident.logs.convert import Conversion
from hydro_ident.logs.file import read_log
from hydro_ident.logs.map import read_map
from hydro_model.robot import Robot

COUNT = 400
CRANE_MAP = {
    "schema": "hydro_ident/log_map/1",
    "robot": "xs031",
    "time": {"signal": "t", "unit": "ms"},
    "start": "2026-03-01T09:30:00.250000+00:00",
    "joints": {
        "lift": {"signal": "q1", "unit": "deg"},
        "tilt": {"signal": "q2", "unit": "deg", "sign": -1, "offset": 0.1},
    },
    "pressures": {
        "lift_cylinder/a": {"signal": "p1", "unit": "bar", "reference": "gauge"},
        "lift_cylinder/b": {"signal": "p2", "unit": "bar", "reference": "absolute"},
        "supply": {"signal": "ps", "unit": "MPa", "reference": "gauge"},
    },
    "valves": {"lift_valve": {"signal": "u1"}},
    "valve_commands": {"lift_valve": {"signal": "u1", "scale": 1.0}},
    "oil_temperature": {"signal": "T"},
}


def crane_log() -> dict[str, np.ndarray]:
    t = np.arange(COUNT) * 1.0
    return {
        "t": t,
        "q1": 40.0 + 5.0 * np.sin(0.01 * t),
        "q2": 60.0 + 5.0 * np.cos(0.01 * t),
        "p1": 50.0 + t * 0.01,
        "p2": 20.0 + t * 0.01,
        "ps": np.full(COUNT, 19.0),
        "u1": np.sin(0.02 * t),
        "T": np.full(COUNT, 41.5),
        "spare": t,
    }


def write_map(folder: Path, content: dict) -> Path:
    file = folder / "map.yaml"
    file.write_text(yaml.safe_dump(content))
    return file


def write_csv(file: Path, columns: dict[str, np.ndarray], delimiter: str = ",") -> Path:
    rows = [delimiter.join(columns)]
    table = np.column_stack(list(columns.values()))
    rows += [delimiter.join(repr(float(v)) for v in row) for row in table]
    file.write_text("\n".join(rows) + "\n")
    return file


def write_mat(file: Path, columns: dict[str, np.ndarray]) -> Path:
    savemat(file, {name: values[:, None] for name, values in columns.items()})
    return file


def write_parquet(file: Path, columns: dict[str, np.ndarray]) -> Path:
    pyarrow = pytest.importorskip("pyarrow", reason="pyarrow is optional and not installed")
    from pyarrow import parquet

    parquet.write_table(pyarrow.table(columns), file)
    return file


@pytest.mark.parametrize(
    ("name", "writer"),
    [
        ("log.csv", write_csv),
        ("log.tsv", lambda f, c: write_csv(f, c, "\t")),
        ("log.mat", write_mat),
        ("log.parquet", write_parquet),
    ],
)
def test_every_kind_of_log_gives_the_same_recording(
    name, writer, tmp_path: Path, robot: Robot, capsys
) -> None:
    log = crane_log()
    file = writer(tmp_path / name, log)
    out = tmp_path / "bag"
    assert run([str(file), "--map", str(write_map(tmp_path, CRANE_MAP)), "--out", str(out)]) == 0
    text = capsys.readouterr().out
    assert f"{COUNT} cycles at 1000 Hz" in text
    assert "not in the mapping: spare" in text
    r = read_recording(out, robot)
    assert len(r) == COUNT
    assert r.period_s == pytest.approx(1e-3, rel=1e-9)
    assert r.stamp_ns[0] == 1_772_357_400_250_000_000
    np.testing.assert_array_equal(np.diff(r.stamp_ns), 1_000_000)
    np.testing.assert_allclose(r.q[:, 0], np.radians(log["q1"]), rtol=1e-14)
    np.testing.assert_allclose(r.q[:, 1], 0.1 - np.radians(log["q2"]), rtol=1e-13)
    assert r.p_a is not None
    assert r.p_b is not None
    np.testing.assert_allclose(r.p_a[:, 0], log["p1"] * 1e5, rtol=1e-12)
    np.testing.assert_allclose(r.p_b[:, 0], log["p2"] * 1e5 - 101325.0, rtol=1e-12)
    np.testing.assert_allclose(r.supply, 19e6, rtol=1e-12)
    assert r.valve_v is not None
    np.testing.assert_allclose(r.valve_v[:, 0], log["u1"], rtol=1e-14)
    np.testing.assert_allclose(r.temperature_c, 41.5)
    lost = {loss.channel for loss in r.losses}
    assert lost == {"tilt/force", "tilt/flow_a", "tilt/flow_b", "tank"}
    assert r.metadata["robot"] == "xs031"
    assert r.metadata["log"] == name
    assert "lift_cylinder/a" in r.metadata["mapping"]


def test_empty_cells_stay_empty_and_a_gap_stays_a_gap(tmp_path: Path, robot: Robot) -> None:
    rows = ["t;lift;tilt;u", "0.000;0.5;-1;1", "0.002;;-1;", "0.004;0.5;-1;1", "0.010;0.5;-1;1"]
    log = tmp_path / "log.csv"
    log.write_text("\n".join(rows))
    mapping = {
        "time": {"signal": "t"},
        "joints": {"lift": {"signal": "lift"}, "tilt": {"signal": "tilt"}},
        "valves": {"lift_valve": {"signal": "u"}},
    }
    out = tmp_path / "bag"
    assert run([str(log), "--map", str(write_map(tmp_path, mapping)), "--out", str(out)]) == 0
    r = read_recording(out, robot)
    assert np.isnan(r.q[1, 0])
    assert r.q[1, 1] == -1.0
    assert [gap.missing for gap in r.gaps] == [2]
    assert read_bag(out).topics["/valve_state"].count == 3


def test_a_rate_stands_in_for_the_time(tmp_path: Path) -> None:
    log = write_csv(tmp_path / "log.csv", {"q": np.linspace(0.0, 1.0, 11)})
    mapping = {"time": {"rate_hz": 250}, "joints": {"slide": {"signal": "q", "unit": "mm"}}}
    out = tmp_path / "bag"
    assert run([str(log), "--map", str(write_map(tmp_path, mapping)), "--out", str(out)]) == 0
    series = read_bag(out, ["/joint_states"]).series["/joint_states"]
    np.testing.assert_array_equal(np.diff(series.stamp_ns), 4_000_000)
    assert series.fields["position"][-1, 0] == pytest.approx(1e-3)


def test_matrices_and_structs_of_mat_files_have_names(tmp_path: Path) -> None:
    file = tmp_path / "log.mat"
    data = {"q": np.arange(12.0).reshape(6, 2), "rec": {"p": np.ones(6)}, "remark": "words"}
    savemat(file, data)
    log = read_log(file)
    assert set(log.columns) == {"q[1]", "q[2]", "rec.p"}
    np.testing.assert_array_equal(log.columns["q[2]"], np.arange(1.0, 12.0, 2.0))


def changed(**changes: object) -> dict:
    return {k: v for k, v in {**CRANE_MAP, **changes}.items() if v is not None}


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (changed(time={"signal": "clock"}), "no signal 'clock' in"),
        (
            changed(joints={"boom": {"signal": "q1"}}),
            "robot xs031 has no 'boom' (known: lift, tilt)",
        ),
        (changed(joints={"lift": {"signal": "q1", "unit": "turns"}}), "one of rad, deg"),
        (changed(joints={"lift": {"signal": "q1", "sign": 2}}), "'sign' should be 1 or -1"),
        (changed(joints={"lift": {"signal": "q1", "scale": 0}}), "'scale' should not be 0"),
        (
            changed(valves={"lift_valve": {"signal": "u1", "raw": [0, 1], "span": [5, 5]}}),
            "'span' should be two different numbers",
        ),
        (
            changed(pressures={"supply": {"signal": "ps"}}),
            "key 'reference' is missing, expected gauge or absolute",
        ),
        (changed(pressures={"supply": {"signal": "ps", "reference": "abs"}}), "gauge or absolute"),
        (
            changed(pressures={"tank": {"constant": 0, "unit": "bar"}}),
            "key 'reference' is missing, expected gauge or absolute, as the number is meant:"
            " {constant: , unit: , reference: gauge}",
        ),
        (
            changed(joints={"lift": {"constant": 0, "reference": "gauge"}}),
            "unknown key 'reference' (known: constant, unit)",
        ),
        (
            changed(robot=None, strokes={"lift": {"signal": "spare"}}),
            "expected other names under strokes, those of cylinders, than under joints, found"
            " 'lift' under both",
        ),
        (
            changed(
                robot=None,
                joints=None,
                efforts={"c": {"signal": "q1"}},
                strokes={"c": {"signal": "spare"}},
            ),
            "than under efforts, found 'c' under both",
        ),
        (changed(joins={}), "unknown key 'joins'"),
        (changed(start="yesterday"), "'start' should be like"),
        (changed(start=datetime(2024, 5, 1, 10, tzinfo=timezone.utc)), 'write "2024-05-01 10:00'),
        (changed(robot="no_such"), "no robot file 'no_such'"),
        (changed(joints=None), "expected a position under joints or strokes"),
        (changed(schema="other/1"), "expected schema hydro_ident/log_map/1"),
    ],
)
def test_a_wrong_mapping_is_one_line_and_writes_nothing(
    content: dict, message: str, tmp_path: Path, monkeypatch, capsys
) -> None:
    log = write_csv(tmp_path / "log.csv", crane_log())
    check_refused(log, write_map(tmp_path, content), message, tmp_path, monkeypatch, capsys)


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("log.csv", "t,q1\n0,1\n1,2,3\n", "line 3: expected 2 columns, found 3"),
        ("log.csv", "t,q1\n0,1\n1,two\n", "column 'q1', line 3: expected a number, found 'two'"),
        ("log.csv", "0,1\n1,2\n", "found numbers: write one above them in a copy"),
        ("log.csv", "t,t\n0,1\n", "more than once: give each a name of its own in"),
        ("log.csv", "t,q1\n0,1\n0,2\n", "expected a time that increases"),
        ("log.csv", "t,q1\n0,1\n,2\n", "sample 2 has no time"),
        ("log.csv", "t,q1\n0,1\n", "expected at least 2 samples"),
        ("log.csv", "", "expected a line of names"),
        ("log.mat", "no MATLAB", "not a readable MAT file"),
        ("log.xlsx", "x", "expected .csv"),
    ],
)
def test_a_wrong_log_is_one_line_and_writes_nothing(
    name: str, content: str, message: str, tmp_path: Path, monkeypatch, capsys
) -> None:
    log = tmp_path / name
    log.write_text(content)
    mapping = {"time": {"signal": "t"}, "joints": {"lift": {"signal": "q1"}}}
    check_refused(log, write_map(tmp_path, mapping), message, tmp_path, monkeypatch, capsys)


def test_a_robots_name_where_its_file_lies_beside_the_mapping_is_told(tmp_path: Path) -> None:
    (tmp_path / "crane_7.hydraulics.yaml").write_text("robot: crane_7", encoding="utf-8")
    mapping = write_map(tmp_path, changed(robot="crane_7"))
    with pytest.raises(BagError, match=r"did you mean 'crane_7\.hydraulics\.yaml', which lies"):
        read_map(mapping)


def check_refused(log, mapping, message, folder, monkeypatch, capsys) -> None:
    out = folder / "bag"
    arguments = ["convert", str(log), "--map", str(mapping), "--out", str(out)]
    monkeypatch.setattr("sys.argv", arguments)
    assert main() == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1
    assert not out.exists()


def test_a_bag_is_never_overwritten(tmp_path: Path) -> None:
    log = write_csv(tmp_path / "log.csv", crane_log())
    arguments = [str(log), "--map", str(write_map(tmp_path, CRANE_MAP))]
    assert run([*arguments, "--out", str(tmp_path / "bag")]) == 0
    before = sorted(p.stat().st_mtime_ns for p in (tmp_path / "bag").iterdir())
    with pytest.raises(BagError, match="exists already"):
        run([*arguments, "--out", str(tmp_path / "bag")])
    assert sorted(p.stat().st_mtime_ns for p in (tmp_path / "bag").iterdir()) == before


def test_parquet_without_its_package_says_what_to_install(tmp_path: Path, monkeypatch) -> None:
    (tmp_path / "log.parquet").write_bytes(b"PAR1")
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(BagError, match="optional package pyarrow"):
        read_log(tmp_path / "log.parquet")


def test_a_mat_file_of_hdf5_without_its_package_says_both_ways_on(
    tmp_path: Path, monkeypatch
) -> None:
    log = tmp_path / "log.mat"
    log.write_bytes(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM")
    monkeypatch.setitem(sys.modules, "h5py", None)
    with pytest.raises(BagError, match=r"optional package h5py: python -m pip.* with '-v7' in"):
        read_log(log)


def test_a_difference_of_two_signals_and_a_constant_are_positions(tmp_path: Path) -> None:
    """Inclinometers give angles against the horizon; a joint that was locked is not recorded."""
    log = {
        "t": np.arange(50.0),
        "z1": np.linspace(10.0, 20.0, 50),
        "z2": np.linspace(-30, -10, 50),
    }
    content = {
        "robot": "xs031",
        "time": {"signal": "t", "unit": "ms"},
        "joints": {
            "lift": {"constant": 30.0, "unit": "deg"},
            "tilt": {"signal": "z2", "minus": "z1", "unit": "deg"},
        },
    }
    arguments = [str(write_csv(tmp_path / "log.csv", log)), "--map"]
    arguments += [str(write_map(tmp_path, content)), "--out", str(tmp_path / "bag")]
    assert run(arguments) == 0
    bag = read_bag(tmp_path / "bag").series["/joint_states"]
    at = {name: bag.fields["position"][:, i] for i, name in enumerate(bag.names)}
    np.testing.assert_allclose(at["lift"], np.deg2rad(30.0))
    np.testing.assert_allclose(at["tilt"], np.deg2rad(log["z2"] - log["z1"]), atol=1e-12)


def test_a_constant_rail_is_what_the_mapping_calls_it(
    tmp_path: Path, robot: Robot, capsys
) -> None:
    rails = {
        "tank": {"constant": 0, "unit": "bar", "reference": "gauge"},
        "supply": {"constant": 190, "unit": "bar", "reference": "absolute"},
    }
    content = changed(
        pressures={"lift_cylinder/a": CRANE_MAP["pressures"]["lift_cylinder/a"], **rails}
    )
    out = tmp_path / "bag"
    log = write_csv(tmp_path / "log.csv", crane_log())
    assert run([str(log), "--map", str(write_map(tmp_path, content)), "--out", str(out)]) == 0
    read = read_recording(out, robot)
    np.testing.assert_allclose(read.tank, 0.0, atol=1e-6)
    np.testing.assert_allclose(read.supply, 190e5 - 101325.0, rtol=1e-12)
    said = capsys.readouterr().out
    assert "pressures, tank: one number throughout counts as a reading" in said
    assert "the robot file (supply: tank_pressure_pa, gauge)" in said


def test_a_gzipped_csv_reads_as_the_csv(tmp_path: Path) -> None:
    plain = write_csv(tmp_path / "log.csv", crane_log())
    packed = tmp_path / "log.csv.gz"
    packed.write_bytes(gzip.compress(plain.read_bytes()))
    for name, column in read_log(plain).columns.items():
        np.testing.assert_array_equal(read_log(packed).columns[name], column)
    packed.write_bytes(packed.read_bytes()[:100])
    with pytest.raises(BagError, match="cannot be read as text"):
        read_log(packed)


def test_signals_by_the_hundred_hide_nothing_that_is_to_be_read(tmp_path: Path) -> None:
    """What was done to times stands first, and of the rest a few are named, with their number."""
    rest, remark = tuple(f"spare_{k}" for k in range(300)), "2 lines of the same time: the first"
    done = Conversion(tmp_path, 100, 50.0, 0.02, 0.02, {"/joint_states": 100}, rest, (remark,))
    lines = summary_text(done).splitlines()
    assert lines[1].strip() == remark
    assert lines[-1].startswith("  not in the mapping: spare_0, spare_1, ")
    assert lines[-1].endswith(" and 288 more (all with --json)")
    assert len(done.as_dict()["not_in_the_mapping"]) == 300  # type: ignore[arg-type]
