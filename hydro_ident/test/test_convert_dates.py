"""Dates with a zone and clocks of twelve hours."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml

from hydro_ident.bag.reader import read_bag
from hydro_ident.commands.convert import run
from hydro_ident.logs.file import Log, read_log


def dated(folder: Path, *moments: str) -> Log:
    file = folder / "log.csv"
    rows = [f"{moment};{0.5 + 0.001 * k}" for k, moment in enumerate(moments)]
    file.write_text("\n".join(["Time;q_rad", *rows]) + "\n", encoding="utf-8")
    return read_log(file)


def first_stamp(log: Log, folder: Path) -> int:
    """Of the bag that a suggested mapping makes."""
    mapping = folder / "map.yaml"
    assert run([str(log.path), "--suggest", str(mapping)]) == 0
    assert yaml.safe_load(mapping.read_text(encoding="utf-8"))["start"] == log.start
    assert run([str(log.path), "--map", str(mapping), "--out", str(folder / "bag")]) == 0
    return int(read_bag(folder / "bag").series["/joint_states"].stamp_ns[0])


@pytest.mark.parametrize("zone", ["+02:00", "+0200", "+02", " +02:00"])
def test_a_zone_of_numbers_is_read_and_kept(zone: str, tmp_path: Path) -> None:
    log = dated(tmp_path, *(f"2026-03-12T09:30:0{k}.000000{zone}" for k in range(5)))
    np.testing.assert_array_equal(log.columns["Time"], np.arange(5.0))
    assert log.start == "2026-03-12T09:30:00.000+02:00"
    expected = np.datetime64("2026-03-12T07:30:00", "ns").astype(int)
    assert first_stamp(log, tmp_path) == expected


@pytest.mark.parametrize(
    ("zone", "start"), [("Z", "09:30:00.000Z"), ("-03:30", "09:30:00.000-03:30")]
)
def test_zones_behind_utc_and_utc_itself_are_kept(zone: str, start: str, tmp_path: Path) -> None:
    log = dated(tmp_path, f"2026-03-12 09:30:00{zone}", f"2026-03-12 09:30:01{zone}")
    assert log.start == f"2026-03-12T{start}"


def test_a_clock_that_is_put_back_goes_on_in_a_log_with_zones(tmp_path: Path) -> None:
    log = dated(tmp_path, "2026-10-25T02:59:59+02:00", "2026-10-25T02:00:00+01:00")
    np.testing.assert_array_equal(log.columns["Time"], [0.0, 1.0])


def test_columns_of_two_zones_keep_how_much_later_each_begins(tmp_path: Path) -> None:
    file = tmp_path / "log.csv"
    rows = [f"2026-03-12T09:30:0{k}+02:00;2026-03-12T07:30:0{k}.8Z;{k}" for k in range(5)]
    file.write_text("\n".join(["t1;t2;q", *rows]), encoding="utf-8")
    np.testing.assert_allclose(read_log(file).columns["t2"], np.arange(5) + 0.8)


@pytest.mark.parametrize("words", [("AM", "PM"), ("am", "pm"), ("a.m.", "p.m.")])
def test_clocks_of_twelve_hours_are_read(words: tuple[str, str], tmp_path: Path) -> None:
    am, pm = words
    moments = [f"11:59:59 {am}", f"12:00:00.5 {pm}", f"01:00:00 {pm}", f"11:59:59 {pm}"]
    expected = [43199.0, 43200.5, 46800.0, 86399.0]
    log = dated(tmp_path, *moments)
    np.testing.assert_array_equal(log.columns["Time"], np.array(expected) - expected[0])
    log = dated(tmp_path, *(f"03/13/2026 {moment}" for moment in moments))
    assert log.start == "2026-03-13T11:59:59.000"
    np.testing.assert_array_equal(log.columns["Time"], np.array(expected) - expected[0])


def test_midnight_is_twelve_of_the_first_half_of_a_day(tmp_path: Path) -> None:
    log = dated(tmp_path, "13.03.2026 11:59:59 PM", "14.03.2026 12:00:00 AM")
    np.testing.assert_array_equal(log.columns["Time"], [0.0, 1.0])
    assert first_stamp(log, tmp_path) == np.datetime64("2026-03-13T23:59:59", "ns").astype(int)


@pytest.mark.parametrize("clock", ["13:00:00 PM", "00:30:00 AM"])
def test_hours_that_no_half_day_has_are_refused_with_what_to_try(
    clock: str, tmp_path: Path
) -> None:
    log = dated(tmp_path, *(f"13.03.2026 {clock}" for _ in range(3)))
    assert "looks like a date that is not known here: write them as" in log.why_unread("Time")
