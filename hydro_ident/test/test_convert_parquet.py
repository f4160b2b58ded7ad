"""Types of a Parquet file's columns: times of every kind, decimals, and what is left out."""

from __future__ import annotations

from decimal import Decimal
from pathlib import Path

import numpy as np
import pytest
import yaml

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
    assert "left out: of type list<" in shown
    assert "left out: of type string, " in shown
    assert "#   both: left out: of type list" in (tmp_path / "new.yaml").read_text()
    mapping = {"time": {"signal": "t"}, "joints": {"lift": {"signal": "both"}}}
    (tmp_path / "map.yaml").write_text(yaml.safe_dump(mapping))
    asked = ["--map", str(tmp_path / "map.yaml"), "--out", str(tmp_path / "bag")]
    monkeypatch.setattr("sys.argv", ["convert", str(file), *asked])
    assert main() == 2
    assert "'both' in" in (said := capsys.readouterr().err)
    assert "log.parquet is left out: of type list" in said
    assert "no signal" not in said


def test_a_file_of_nothing_that_is_read_names_what_it_has(tmp_path: Path) -> None:
    with pytest.raises(BagError, match="found no column of numbers; 'said' is of type string"):
        read(tmp_path, said=pa.array(["x"] * COUNT))
