"""Types of a Parquet file's columns: times of every kind, decimals, and what is left out."""

from __future__ import annotations

import re
from decimal import Decimal
from pathlib import Path

import numpy as np
import pytest
import yaml

from hydro_ident.bag.reader import read_bag
from hydro_ident.commands.convert import main, run
from hydro_ident.errors import BagError
from hydro_ident.logs.file import Log, read_log

pa = pytest.importorskip("pyarrow", reason="pyarrow is optional and not installed")
COUNT = 50
STEPS = 2_000_000 * np.arange(COUNT)


def written(folder: Path, **columns: object) -> Path:
    from pyarrow import parquet

    parquet.write_table(pa.table(columns), folder / "log.parquet")
    return folder / "log.parquet"


def read(folder: Path, **columns: object) -> Log:
    return read_log(written(folder, **columns))


def test_durations_are_seconds(tmp_path: Path) -> None:
    log = read(tmp_path, elapsed=pa.array([*STEPS.tolist(), None], pa.duration("ns")))
    np.testing.assert_allclose(log.columns["elapsed"], [*(0.002 * np.arange(COUNT)), np.nan])
    assert (log.units["elapsed"], log.dated, log.unread) == ("s", frozenset(), {})


def test_decimals_are_numbers(tmp_path: Path) -> None:
    values = pa.array([Decimal("12.50"), None, Decimal("-3.25")], pa.decimal128(10, 2))
    np.testing.assert_array_equal(read(tmp_path, q=values).columns["q"], [12.5, np.nan, -3.25])


@pytest.mark.parametrize("kind", ["time32[s]", "time32[ms]", "time64[us]", "time64[ns]"])
def test_times_of_day_go_on_over_midnight(kind: str, tmp_path: Path) -> None:
    unit = kind[7:-1]
    each = {"s": 1, "ms": 10**3, "us": 10**6, "ns": 10**9}[unit]
    of_day = [each * second for second in (86398, 86399, 0, 1)]
    of_type = pa.time32(unit) if kind.startswith("time32") else pa.time64(unit)
    log = read(tmp_path, at=pa.array([None, *of_day], of_type))
    np.testing.assert_array_equal(log.columns["at"], [np.nan, 0.0, 1.0, 2.0, 3.0])
    assert log.dated == {"at"}
    assert log.units["at"] == "s"


def test_times_of_day_go_by_the_nearest_day_of_stamps(tmp_path: Path) -> None:
    stamps = np.datetime64("2026-03-12T23:59:59.5", "ns") + np.arange(2) * np.timedelta64(1, "s")
    log = read(tmp_path, at=pa.array([0, 1], pa.time32("s")), stamp=stamps)
    np.testing.assert_allclose(log.columns["at"], [0.5, 1.5])
    assert log.start == "2026-03-12T23:59:59.500000"
    assert list(log.columns) == ["at", "stamp"]


def test_a_first_stamp_that_is_missing_takes_no_other_with_it(tmp_path: Path) -> None:
    first = np.datetime64("2026-03-12T09:30:00", "ns")
    stamps = np.array([np.datetime64("NaT", "ns"), first, first + np.timedelta64(2, "ms")])
    log = read(tmp_path, stamp=stamps)
    np.testing.assert_allclose(log.columns["stamp"], [np.nan, 0.0, 0.002])
    assert log.start == "2026-03-12T09:30:00.000000"


def test_what_is_left_out_is_named(tmp_path: Path, capsys, monkeypatch) -> None:
    """It had been dropped, and a mapping that named it was told that there is no such signal."""
    pairs = pa.array([[0.0, 1.0]] * COUNT)
    words = pa.array(["x"] * COUNT)
    file = written(
        tmp_path, t=STEPS * 1e-9, q_rad=np.linspace(0, 1, COUNT), both=pairs, said=words
    )
    assert run([str(file), "--suggest", str(tmp_path / "new.yaml")]) == 0
    shown = capsys.readouterr().out
    assert re.search("^both +- +of type list<", shown, re.M)
    assert re.search("^said +- +of type string, ", shown, re.M)
    assert "# Left out:\n#   both: of type list" in (tmp_path / "new.yaml").read_text()
    mapping = {"time": {"signal": "t"}, "joints": {"lift": {"signal": "both"}}}
    (tmp_path / "map.yaml").write_text(yaml.safe_dump(mapping))
    asked = ["--map", str(tmp_path / "map.yaml"), "--out", str(tmp_path / "bag")]
    monkeypatch.setattr("sys.argv", ["convert", str(file), *asked])
    assert main() == 2
    assert "'both' in" in (said := capsys.readouterr().err)
    assert "log.parquet is left out: of type list" in said
    assert "no signal" not in said


@pytest.mark.parametrize("first", ["axis", "axis.q"])
def test_a_struct_beside_a_column_of_its_dotted_name_is_left_out(
    first: str, tmp_path: Path
) -> None:
    """It had ended in a bare TypeError: asked for the column, Arrow reads the struct, too."""
    both = {
        "axis": pa.array([{"q": 7.0, "said": "x"}] * COUNT),
        "axis.q": np.arange(float(COUNT)),
    }
    log = read(tmp_path, **{first: both.pop(first)}, **both)
    assert list(log.columns) == ["axis.q"]
    np.testing.assert_array_equal(log.columns["axis.q"], np.arange(float(COUNT)))
    assert list(log.unread) == ["axis"]


def test_names_of_several_lines_stay_in_theirs(tmp_path: Path, capsys) -> None:
    """The second line of one had stood outside the comment, as a line of the mapping."""
    odd = {
        "said\nschema: 7": pa.array(["x"] * COUNT),
        "q_rad\nlift \u00b0\U0001f600": STEPS * 1e-9,
    }
    file = written(tmp_path, t=STEPS * 1e-9, **odd)
    assert run([str(file), "--suggest", str(tmp_path / "new.yaml")]) == 0
    text = (tmp_path / "new.yaml").read_text(encoding="utf-8")
    assert "#   said\\nschema: 7: of type string" in text
    shown = capsys.readouterr().out.splitlines()
    assert any(line.startswith("said\\nschema: 7 ") for line in shown)
    assert any(line.startswith("q_rad\\nlift ") for line in shown)
    mapping = yaml.safe_load(text)
    assert [entry["signal"] for entry in mapping["joints"].values()] == [list(odd)[1]]


def test_two_columns_of_one_name_are_refused(tmp_path: Path) -> None:
    from pyarrow import parquet

    twice = pa.Table.from_arrays([pa.array([0.0, 1.0])] * 2, names=["q", "q"])
    parquet.write_table(twice, tmp_path / "log.parquet")
    with pytest.raises(BagError, match="column 'q' appears more than once"):
        read_log(tmp_path / "log.parquet")


def test_a_file_of_nothing_that_is_read_names_what_it_has(tmp_path: Path) -> None:
    with pytest.raises(BagError, match="found no column of numbers; 'said' is of type string"):
        read(tmp_path, said=pa.array(["x"] * COUNT))


@pytest.mark.parametrize("unit", ["us", "ns"])
@pytest.mark.parametrize("kind", [np.int64, np.uint64])
def test_whole_stamps_since_1970_keep_every_nanosecond(
    unit: str, kind: type, tmp_path: Path, capsys
) -> None:
    """Of exactly 500 Hz "500.032 Hz (intervals 1.99962 to 2.00038 ms)" had been reported."""
    first = 1_773_307_800_000_000_000
    stamps = (first + STEPS) // (1000 if unit == "us" else 1)
    file = written(tmp_path, timestamp=stamps.astype(kind), q_rad=np.linspace(0.4, 0.6, COUNT))
    mapping = tmp_path / "map.yaml"
    assert run([str(file), "--suggest", str(mapping)]) == 0
    assert run([str(file), "--map", str(mapping), "--out", str(tmp_path / "bag")]) == 0
    assert "50 cycles at 500 Hz (intervals 2 to 2 ms)" in capsys.readouterr().out
    found = read_bag(tmp_path / "bag").series["/joint_states"].stamp_ns
    np.testing.assert_array_equal(found, first + STEPS)


def test_exact_stamps_of_two_clocks_and_cuts_are_on_one_line(tmp_path: Path) -> None:
    """The second clock is in us, ends before the table, and begins 1 ms late."""
    first = 1_773_307_800_000_000_123
    slow = (first + 1_000_000 + STEPS[1::2]) // 1000
    none = [None] * (COUNT - len(slow))
    file = written(
        tmp_path,
        t=first + STEPS,
        q=np.arange(float(COUNT)),
        t2=pa.array([*slow.tolist(), *none], pa.int64()),
        p=pa.array([*range(len(slow)), *none], pa.float64()),
    )
    mapping = {
        "time": {"signal": "t", "unit": "ns", "to_s": 1_773_307_800.05},
        "start": "1970-01-01T00:00:00Z",
        "clocks": {"t2": {"unit": "us"}},
        "joints": {"lift": {"signal": "q"}, "tilt": {"signal": "p", "time": "t2"}},
    }
    (tmp_path / "map.yaml").write_text(yaml.safe_dump(mapping))
    asked = ["--map", str(tmp_path / "map.yaml"), "--out", str(tmp_path / "bag")]
    assert run([str(file), *asked]) == 0
    stamps = read_bag(tmp_path / "bag").series["/joint_states"].stamp_ns
    fast, late = first + STEPS, 1000 * slow
    kept = [part[part <= 1_773_307_800_050_000_000] for part in (fast, late)]
    np.testing.assert_array_equal(stamps, np.sort(np.concatenate(kept)))


def test_stamps_of_parquet_keep_how_much_later_each_begins(tmp_path: Path) -> None:
    first = np.datetime64("2026-03-12T09:30:00", "ns") + np.arange(5) * np.timedelta64(10, "ms")
    later = first + np.timedelta64(800, "ms")
    log = read(tmp_path, t1=first, t2=later)
    assert log.start == "2026-03-12T09:30:00.000000"
    np.testing.assert_allclose(log.columns["t2"], 0.8 + 0.01 * np.arange(5))
