"""Times of logs: further ones, stamps since 1970, dates, lines that do not increase."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml
from scipy.io import savemat

from hydro_ident.bag.reader import read_bag
from hydro_ident.commands.convert import main
from hydro_ident.logs.file import read_log
from hydro_ident.logs.suggest import suggest

FAST = 0.002 * np.arange(2000)
SLOW = 0.8003 + 0.01 * np.arange(200)
LATE_S = 1_772_356_200


def angle(t: np.ndarray) -> np.ndarray:
    return np.asarray(40.0 + 5.0 * np.sin(t))


def pressure(t: np.ndarray) -> np.ndarray:
    return np.asarray(100.0 + 20.0 * np.sin(t))


def table(folder: Path, **columns: np.ndarray) -> Path:
    """A CSV whose shorter columns end with empty cells."""
    count = max(map(len, columns.values()))
    rows = [",".join(columns)]
    for k in range(count):
        cells = [f"{float(c[k]):.17g}" if k < len(c) else "" for c in columns.values()]
        rows.append(",".join("" if cell == "nan" else cell for cell in cells))
    file = folder / "log.csv"
    file.write_text("\n".join(rows) + "\n", encoding="utf-8")
    return file


def suggested(log: Path, folder: Path) -> tuple[Path, dict]:
    file = folder / "map.yaml"
    assert command(log, "--suggest", str(file)) == 0
    text = file.read_text(encoding="utf-8").replace("reference: FILL_IN", "reference: gauge")
    file.write_text(text, encoding="utf-8")
    return file, yaml.safe_load(text)


def command(log: Path, *more: str) -> int:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("sys.argv", ["convert", str(log), *more])
        return main()


def converted(log: Path, mapping: Path | dict, folder: Path) -> int:
    if isinstance(mapping, dict):
        file = folder / "own.yaml"
        file.write_text(yaml.safe_dump(mapping), encoding="utf-8")
        mapping = file
    return command(log, "--map", str(mapping), "--out", str(folder / "bag"))


def mat(folder: Path, **columns: np.ndarray) -> Path:
    savemat(folder / "log.mat", columns)
    return folder / "log.mat"


@pytest.mark.parametrize(("writer", "ending"), [(table, "_bar"), (mat, "")])
def test_signals_in_the_lines_of_another_time_go_by_it(writer, ending, tmp_path, capsys) -> None:
    p, q = f"p1a{ending}", "q1_deg"
    columns = {"t1": FAST, q: angle(FAST), "t2": SLOW, p: pressure(SLOW)}
    _, content = suggested(writer(tmp_path, **columns), tmp_path)
    [entry] = content["pressures"].values()
    assert entry["time"] == "t2"
    assert content["time"]["signal"] == "t1"
    assert "time" not in next(iter(content["joints"].values()))
    entry["unit"] = "bar"  # a MAT file without robot says none
    assert converted(tmp_path / f"log{'.csv' if ending else '.mat'}", content, tmp_path) == 0
    assert "outside from_s" not in capsys.readouterr().out
    series = read_bag(tmp_path / "bag").series
    at = (series["/chamber_pressures"].stamp_ns - series["/joint_states"].stamp_ns[0]) * 1e-9
    positions = series["/joint_states"]
    assert len(at) == len(SLOW)
    # The log's instants are the joints'; the pressures are within half a fast period of theirs.
    taken = (positions.stamp_ns - 946_684_800 * 10**9) * 1e-9
    np.testing.assert_allclose(np.degrees(positions.fields["position"][:, 0]), angle(taken))
    np.testing.assert_allclose(taken, SLOW, atol=1.001e-3)
    values = series["/chamber_pressures"].fields["effort"][:, 0]
    np.testing.assert_allclose((values - 101325.0) * 1e-5, pressure(SLOW))


JOINTS = {"lift": {"signal": "q"}}


def pressures(**more: object) -> dict:
    return {"lift/a": {"signal": "p", "unit": "bar", "reference": "gauge", **more}}


def test_signals_in_the_lines_of_a_time_left_out_are_refused(tmp_path: Path, capsys) -> None:
    log = table(tmp_path, t1=FAST, q=angle(FAST), t2=SLOW, p=pressure(SLOW))
    mapping = {"time": {"signal": "t1"}, "joints": JOINTS, "pressures": pressures()}
    assert converted(log, mapping, tmp_path) == 2
    said = capsys.readouterr().err
    assert "the values of 'p' stand in just the 200 lines of 't2'" in said
    assert "give them 'time: t2'" in said
    assert not (tmp_path / "bag").exists()
    # Whoever names the clock and does not use it has looked; it is still said.
    assert converted(log, {**mapping, "clocks": {"t2": {"unit": "s"}}}, tmp_path) == 0
    assert "'t2' looks like a time and nothing goes by it" in capsys.readouterr().out


def test_a_second_time_of_the_same_instants_is_left_out(tmp_path: Path, capsys) -> None:
    log = table(tmp_path, t=FAST, t_cpu=FAST + 1e-4, q_rad=angle(FAST))
    mapping, content = suggested(log, tmp_path)
    assert "clocks" not in content
    assert content["time"] == {"signal": "t", "unit": "s"}
    assert converted(log, mapping, tmp_path) == 0
    assert "looks like a time" not in capsys.readouterr().out


@pytest.mark.parametrize("every", [1, 5])
def test_a_second_time_in_lines_of_the_first_is_left_open(every: int, tmp_path: Path) -> None:
    """Its signals may go by either: by the line, or by the time that is written beside them."""
    own = np.full(len(FAST), np.nan)
    own[::every] = FAST[::every] + 0.8003
    p = np.where(np.isfinite(own), pressure(FAST), np.nan)
    log = table(tmp_path, t1=FAST, q_rad=angle(FAST), t2=own, p_bar=p)
    mapping, content = suggested(log, tmp_path)
    assert next(iter(content["pressures"].values()))["time"] == "FILL_IN"
    assert converted(log, mapping, tmp_path) == 2


def test_samples_of_no_times_length_are_left_open(tmp_path: Path) -> None:
    file = tmp_path / "log.mat"
    savemat(file, {"t": FAST, "q": angle(FAST), "p_bar": pressure(SLOW)})
    entries = {g.column: g.entry for g in suggest(read_log(file)).guesses}
    assert entries["p_bar"]["time"] == "FILL_IN"
    assert "time" not in entries["q"]


def test_another_length_names_the_time_that_has_it(tmp_path: Path, capsys) -> None:
    file = tmp_path / "log.mat"
    savemat(file, {"t": FAST, "q": angle(FAST), "t_slow": SLOW, "p": pressure(SLOW)})
    mapping = {"time": {"signal": "t"}, "joints": JOINTS, "pressures": pressures()}
    assert converted(file, mapping, tmp_path) == 2
    assert "('t_slow' has as many)" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("name", "text", "unit"),
    [
        ("timestamp", "{s}.{ms:03d}", "s"),
        ("timestamp", "{s}{ms:03d}", "ms"),
        ("timestamp", "{s}{ms:03d}000000", "ns"),
        ("timestamp [ns]", "{s}{ms:03d}000000", "ns"),
    ],
)
def test_stamps_since_1970_convert_as_suggested(name, text, unit, tmp_path: Path) -> None:
    rows = [f"{text.format(s=LATE_S, ms=2 * k)},{0.5 + 0.001 * k}" for k in range(400)]
    log = tmp_path / "log.csv"
    log.write_text("\n".join([f"{name},q_rad", *rows]), encoding="utf-8")
    mapping, content = suggested(log, tmp_path)
    assert content["time"]["unit"] == unit
    assert converted(log, mapping, tmp_path) == 0
    stamps = read_bag(tmp_path / "bag").series["/joint_states"].stamp_ns
    expected = LATE_S * 10**9 + 2_000_000 * np.arange(400)
    np.testing.assert_array_equal(stamps, expected)


@pytest.mark.parametrize(
    ("year", "late", "factor", "unit"),
    [(1970, 0, 1, "s"), (1970, 0, 10**9, "ns"), (1904, 2_082_844_800, 1, "s")],
)
def test_stamps_since_a_year_without_start_say_what_to_try(
    year, late, factor, unit, tmp_path, capsys
) -> None:
    log = table(tmp_path, t=(LATE_S + late + FAST) * factor, q=angle(FAST))
    mapping = {"time": {"signal": "t", "unit": "s"}, "joints": JOINTS}
    assert converted(log, mapping, tmp_path) == 2
    said = capsys.readouterr().err
    assert f'counts {unit} from {year}: give it unit: {unit}, and start: "{year}-01-01T00' in said


def dates(pattern: str, tmp_path: Path) -> Path:
    rows = [pattern.format(f"{k:02d}") + f";{k}" for k in range(20)]
    log = tmp_path / "log.csv"
    log.write_text("\n".join(["Zeit;q_rad", *rows]), encoding="utf-8")
    return log


@pytest.mark.parametrize(
    ("pattern", "start"),
    [
        ("12.03.2026 09:30:{},500", "2026-03-12T09:30:00.500"),
        ("12.03.26 9:30:{},500", "2026-03-12T09:30:00.500"),
        ("2026/03/12 09:30:{}.5", "2026-03-12T09:30:00.500"),
        ("13/03/2026 09:30:{}.5", "2026-03-13T09:30:00.500"),
        ("03/13/2026 09:30:{}.5", "2026-03-13T09:30:00.500"),
    ],
)
def test_dates_are_read_where_their_order_is_told(pattern, start, tmp_path: Path) -> None:
    log = read_log(dates(pattern, tmp_path))
    assert log.start == start
    np.testing.assert_array_equal(log.columns["Zeit"], np.arange(20.0))
    assumed = [note for note in log.notes if "read as" in note]
    assert len(assumed) == (not pattern.startswith("2026"))
    assert all(start[:10] in note for note in assumed)


def test_days_of_dates_follow_each_other(tmp_path: Path) -> None:
    log = tmp_path / "log.csv"
    log.write_text("t;q\n31.01.2026 23:59:59,5;1\n01.02.2026 00:00:00,5;2\n", encoding="utf-8")
    np.testing.assert_allclose(read_log(log).columns["t"], [0.0, 1.0])


@pytest.mark.parametrize(
    ("pattern", "start"),
    [("09:30:{}", ""), ("2026-03-12 09:30:{}", "2026-03-12T09:30:00.000")],
)
def test_columns_of_dates_keep_how_much_later_each_begins(pattern, start, tmp_path: Path) -> None:
    def at(seconds: float) -> str:
        return pattern.format(f"{seconds:06.3f}")

    rows = [f"{at(0.01 * k)};{k};{at(0.8 + 0.01 * k)};{k}" for k in range(100)]
    file = tmp_path / "log.csv"
    file.write_text("\n".join(["t1;q_deg;t2;p_bar", *rows]) + "\n", encoding="utf-8")
    log = read_log(file)
    assert log.start == start
    np.testing.assert_allclose(log.columns["t1"], 0.01 * np.arange(100), atol=1e-9)
    np.testing.assert_allclose(log.columns["t2"], 0.8 + 0.01 * np.arange(100), atol=1e-9)
    mapping = {
        "time": {"signal": "t1"},
        "joints": {"lift": {"signal": "q_deg", "unit": "deg"}},
        "pressures": {
            "lift/a": {"signal": "p_bar", "unit": "bar", "reference": "gauge", "time": "t2"}
        },
    }
    assert converted(file, mapping, tmp_path) == 0
    series = read_bag(tmp_path / "bag").series
    first = {name: one.stamp_ns[0] for name, one in series.items()}
    assert first["/chamber_pressures"] - first["/joint_states"] == 800_000_000


def test_times_of_day_go_by_the_nearest_day_of_dates(tmp_path: Path) -> None:
    file = tmp_path / "log.csv"
    text = "t;t2;q\n2026-03-12 23:59:59.5;00:00:00.0;1\n2026-03-13 00:00:00.5;00:00:01.0;2\n"
    file.write_text(text, encoding="utf-8")
    log = read_log(file)
    np.testing.assert_allclose(log.columns["t2"], [0.5, 1.5])


def test_dates_are_seconds_whatever_unit_a_mapping_gives_them(tmp_path: Path, capsys) -> None:
    mapping = {"time": {"signal": "Zeit", "unit": "ms"}, "joints": JOINTS}
    log = tmp_path / "log.csv"
    log.write_text("Zeit;q\n09:30:00.0;1\n09:30:00.5;2\n", encoding="utf-8")
    assert converted(log, mapping, tmp_path) == 2
    assert "expected unit s for 'Zeit', whose dates are read as seconds" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("pattern", "said"),
    [
        ("03/04/2026 09:30:{}", "may be day/month or month/day"),
        ("12.03.2026 15:30:{} PM", "looks like a date that is not known here"),
    ],
)
def test_dates_that_may_be_two_are_not_guessed(pattern, said, tmp_path: Path, capsys) -> None:
    log = dates(pattern, tmp_path)
    mapping = {"time": {"signal": "Zeit"}, "joints": {"lift": {"signal": "q_rad"}}}
    assert converted(log, mapping, tmp_path) == 2
    assert said in capsys.readouterr().err
    suggested(log, tmp_path)
    assert said in capsys.readouterr().out


def apart(folder: Path, head: str, *lines: str) -> Path:
    """A log whose dates stand in a column of their own."""
    file = folder / "log.csv"
    file.write_text("\n".join([head, *lines]) + "\n", encoding="utf-8")
    return file


@pytest.mark.parametrize(
    ("head", "date"),
    [
        ("Date;Time;q_rad", "2026-03-12"),
        ("Datum;Uhrzeit;q_rad", "12.03.2026"),
        ("Datum;Uhrzeit;q_rad", "12.3.26"),
        ("Tag;Zeit;q_rad", "12.03.2026"),
        ("date;time;q_rad", "03/13/2026"),
    ],
)
def test_dates_in_a_column_of_their_own_belong_to_the_times(head, date, tmp_path: Path) -> None:
    rows = [f"{date};09:30:{k:02d}.5;{k / 9}" for k in range(20)]
    log = read_log(apart(tmp_path, head, *rows))
    day = "13" if "/13/" in date else "12"
    assert log.start == f"2026-03-{day}T09:30:00.500"
    names = head.split(";")
    np.testing.assert_array_equal(log.columns[names[1]], np.arange(20.0))
    assert any(f"dates of '{names[0]}'" in note for note in log.notes)
    file, mapping = suggested(log.path, tmp_path)
    assert mapping["time"] == {"signal": names[1], "unit": "s"}
    assert mapping["start"] == log.start
    assert converted(log.path, file, tmp_path) == 0
    joints = read_bag(tmp_path / "bag", ["/joint_states"]).series["/joint_states"]
    assert joints.stamp_ns[0] == np.datetime64(log.start, "ns").astype(int)


def test_dates_of_their_own_tell_days_that_times_of_day_do_not(tmp_path: Path) -> None:
    """A logger that waited over a whole day: times of day alone would make it a second."""
    lines = ["31.01.2026;23:59:59,5;1", "01.02.2026;00:00:00,5;2", "02.02.2026;00:00:01,5;3"]
    log = read_log(apart(tmp_path, "Datum;Zeit;q", *lines))
    np.testing.assert_allclose(log.columns["Zeit"], [0.0, 1.0, 86402.0])


@pytest.mark.parametrize(
    ("rows", "said"),
    [
        (["03/04/2026;09:30:00;1", "03/04/2026;09:30:01;2"], "may be day/month or month/day"),
        (["30.02.2026;09:30:00;1", "30.02.2026;09:30:01;2"], "day is out of range for month"),
        (["12.03.2026;09:30:00;1", ";09:30:01;2"], "a time without a date in line 3"),
    ],
)
def test_dates_of_their_own_that_do_not_tell_are_left_out_and_said(
    rows, said, tmp_path: Path, capsys
) -> None:
    log = read_log(apart(tmp_path, "Date;Time;q_rad", *rows))
    assert log.start == ""
    np.testing.assert_array_equal(log.columns["Time"], [0.0, 1.0])
    assert any("column 'Date' left out" in note and said in note for note in log.notes)
    suggested(log.path, tmp_path)
    assert said in capsys.readouterr().out


@pytest.mark.parametrize(
    ("head", "row"),
    [
        ("Firmware;Time;q_rad", "1.12.20;09:30:{0:02d};{0}"),
        ("Date;Time;Time 2;q_rad", "2026-03-12;09:30:{0:02d};09:31:{0:02d};{0}"),
        ("Date;Until;Time;q_rad;p_bar", "2026-03-12;2026-03-13;09:30:{0:02d};{0};{0}"),
    ],
)
def test_what_may_be_no_date_of_the_times_gives_none(head, row, tmp_path: Path) -> None:
    log = read_log(apart(tmp_path, head, *(row.format(k) for k in range(20))))
    assert log.start == ""
    np.testing.assert_array_equal(log.columns["Time"], np.arange(20.0))
    assert any("left out" in note for note in log.notes) == ("Firmware" not in head)


def test_a_date_above_the_names_is_no_line_of_numbers(tmp_path: Path) -> None:
    log = tmp_path / "log.csv"
    log.write_text("12.03.2026 09:30:00\nt;q\n0,5;1,5\n0,6;1,6\n", encoding="utf-8")
    assert set(read_log(log).columns) == {"t", "q"}


@pytest.mark.parametrize(
    ("spoilt", "said"),
    [
        ({300: 299 * 0.002}, "0.598 and then 0.598 at line 302; a line that was written twice"),
        ({300: 0.498}, "0.598 and then 0.498 at line 302; a clock that was set"),
    ],
)
def test_a_line_that_does_not_increase_is_named(spoilt, said, tmp_path: Path, capsys) -> None:
    t = FAST.copy()
    for k, value in spoilt.items():
        t[k] = value
    log = table(tmp_path, t=t, q=angle(FAST))
    mapping, _ = suggested(log, tmp_path)
    assert said in capsys.readouterr().out
    assert converted(log, mapping, tmp_path) == 2
    assert said in capsys.readouterr().err


def test_rounded_times_ask_for_a_rate_and_name_it(tmp_path: Path, capsys) -> None:
    log = table(tmp_path, t=np.round(FAST, 2), q_rad=angle(FAST))
    mapping, content = suggested(log, tmp_path)
    assert content["time"] == {"rate_hz": "FILL_IN"}
    said = capsys.readouterr().out
    assert "rounded too coarsely: give time: {rate_hz: ...} (its mean is 499.75 Hz)" in said
    assert converted(log, mapping, tmp_path) == 2
    assert "'rate_hz' is still to be filled in: samples per second" in capsys.readouterr().err
