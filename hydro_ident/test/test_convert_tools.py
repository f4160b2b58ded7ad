"""Logs as dSPACE, LabVIEW and Simulink write them."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

from hydro_ident.errors import BagError
from hydro_ident.logs.file import read_log


def write(folder: Path, text: str, name: str = "log.csv") -> Path:
    file = folder / name
    file.write_text(text, encoding="utf-8")
    return file


def test_structs_of_axes_and_signals_are_read_by_name(tmp_path: Path) -> None:
    def signal(name: str, data: np.ndarray, index: int) -> dict:
        return {"Name": name, "Data": data, "Unit": "deg", "XIndex": index, "Path": "Model"}

    axes = [{"Name": "fast", "Data": np.arange(6.0)}, {"Name": "slow", "Data": np.arange(3.0)}]
    signals = [signal("q", np.ones(6), 1), signal("p", np.zeros(3), 2)]
    dtype = [(k, object) for k in axes[0]]
    x = np.array([tuple(a.values()) for a in axes], dtype=dtype)
    y = np.array([tuple(s.values()) for s in signals], dtype=[(k, object) for k in signals[0]])
    savemat(tmp_path / "rec.mat", {"rec1": {"X": x, "Y": y}})
    log = read_log(tmp_path / "rec.mat")
    assert dict(log.clocks) == {"q": "time[1]", "p": "time[2]"}
    assert {n: len(v) for n, v in log.columns.items()} == {
        "time[1]": 6, "time[2]": 3, "q": 6, "p": 3,
    }  # fmt: skip
    assert log.units["q"] == "deg"


def lvm(x_columns: str, top: str, table: str) -> str:
    return (
        f"LabVIEW Measurement\t\nSeparator\tTab\nDecimal_Separator\t.\nMulti_Headings\tYes\n"
        f"X_Columns\t{x_columns}\n***End_of_Header***\t\n\t\n{top}***End_of_Header***\t\n{table}"
    )


def test_labview_without_an_x_column_and_with_one_each(tmp_path: Path) -> None:
    top = "Channels\t2\t\nX0\t0.5\t0.5\t\nDelta_X\t1.0E-2\t1.0E-2\t\n"
    none = lvm("No", top, "X_Value\tq\tp\tComment\n\t1\t2\n\t3\t4\n")
    log = read_log(write(tmp_path, none, "a.lvm"))
    np.testing.assert_allclose(log.columns["X_Value"], [0.5, 0.51])
    multi = lvm("Multi", "Channels\t2\t\n", "X_Value\tq\tX_Value\tp\n0\t1\t0\t2\n1\t3\t\t\n")
    log = read_log(write(tmp_path, multi, "b.lvm"))
    assert dict(log.clocks) == {"q": "X_Value[1]", "p": "X_Value[2]"}
    np.testing.assert_array_equal(log.columns["X_Value[2]"], [0.0, np.nan])


def test_no_labview_channel_is_lost_to_another_of_its_name(tmp_path: Path) -> None:
    twice = lvm("One", "Channels\t2\t\n", "X_Value\tq\tq\tComment\n0\t1\t2\n1\t3\t4\n")
    with pytest.raises(BagError, match="column 'q' appears more than once"):
        read_log(write(tmp_path, twice, "a.lvm"))


@pytest.mark.parametrize("labels", ["\t\t\tbar\t", "\t\tbar\t"], ids=["columns", "channels"])
def test_labview_units_stay_with_their_channels(tmp_path: Path, labels: str) -> None:
    """Of two channels with X columns of their own the first has no unit."""
    top = f"Channels\t2\t\nY_Unit_Label{labels}\n"
    table = "X_Value\tq\tX_Value\tp\n0\t1\t0\t2\n1\t3\t1\t4\n"
    units = read_log(write(tmp_path, lvm("Multi", top, table), "a.lvm")).units
    assert units["p"] == "bar"
    assert "q" not in units


def test_no_control_desk_signal_is_lost_to_another_of_its_name(tmp_path: Path) -> None:
    text = "trace_names,time,q,q\ntrace_values,0.0,1,2\n,0.1,3,4\n"
    with pytest.raises(BagError, match="column 'q' appears more than once"):
        read_log(write(tmp_path, text))


def test_a_control_desk_signal_named_as_a_clock_takes_its_place_from_none(tmp_path: Path) -> None:
    text = "trace_names,x,time,q\ntrace_values,0.0,5,2\n,0.1,6,4\n"
    log = read_log(write(tmp_path, text))
    assert {n: v.tolist() for n, v in log.columns.items()} == {
        "time": [0.0, 0.1], "time[2]": [5.0, 6.0], "q": [2.0, 4.0],
    }  # fmt: skip
    assert dict(log.clocks) == {"time[2]": "time", "q": "time"}
    first = "trace_names,x,time[2],q\ntrace_values,0.0,5,2\n,0.1,6,4\n\n"
    with pytest.raises(BagError, match=r"column 'time\[2\]' appears more than once"):
        read_log(write(tmp_path, first + text))


def test_simulinks_structure_with_time_is_read_by_its_labels(tmp_path: Path) -> None:
    kind = [("values", object), ("dimensions", object), ("label", object)]
    signals = np.array([(np.ones(5), 1, "q"), (np.zeros((5, 1)), 1, "p")], dtype=kind)
    savemat(tmp_path / "rec.mat", {"rec": {"time": np.arange(5.0), "signals": signals}})
    columns = read_log(tmp_path / "rec.mat").columns
    assert {n: len(v) for n, v in columns.items()} == {
        "rec.time": 5, "rec.signals.q": 5, "rec.signals.p": 5,
    }  # fmt: skip
    signals["label"] = ""
    savemat(tmp_path / "rec.mat", {"rec": {"time": np.arange(5.0), "signals": signals}})
    columns = read_log(tmp_path / "rec.mat").columns
    assert {"rec.signals[1]", "rec.signals[2]"} <= set(columns)
    others = np.array([(1.0, 2.0), (3.0, 4.0)], dtype=[("a", float), ("b", float)])
    savemat(tmp_path / "rec.mat", {"rec": others})
    columns = read_log(tmp_path / "rec.mat").columns
    assert {n: v.tolist() for n, v in columns.items()} == {
        "rec[1].a": [1.0], "rec[1].b": [2.0], "rec[2].a": [3.0], "rec[2].b": [4.0],
    }  # fmt: skip


def test_numbers_of_more_than_two_dimensions_are_left_out_and_named(tmp_path: Path) -> None:
    kind = [("values", object), ("dimensions", object), ("label", object)]
    signals = np.array([(np.ones(5), 1, "q"), (np.zeros((2, 2, 5)), 4, "inertia")], dtype=kind)
    rec = {"time": np.arange(5.0), "signals": signals, "grid": np.stack([signals, signals])}
    savemat(tmp_path / "rec.mat", {"rec": rec})
    log = read_log(tmp_path / "rec.mat")
    assert set(log.columns) == {"rec.time", "rec.signals.q"}
    assert log.notes == ("left out: rec.signals.inertia, rec.grid: of more than two dimensions",)


def test_labview_segments_follow_each_other_by_their_own_times(tmp_path: Path) -> None:
    def segment(second: int) -> str:
        return (
            f"Channels\t1\t\nDate\t2026/03/01\t\nTime\t10:00:0{second}.000000\t\n"
            "***End_of_Header***\t\nX_Value\tq\tComment\n0.0\t1\n0.1\t2\n\n"
        )

    head = "LabVIEW Measurement\t\nSeparator\tTab\nMulti_Headings\tYes\n***End_of_Header***\t\n\n"
    log = read_log(write(tmp_path, head + segment(0) + segment(3), "log.lvm"))
    np.testing.assert_allclose(log.columns["X_Value"], [0.0, 0.1, 3.0, 3.1])
    assert log.notes == ("LabVIEW measurement file, 2 segments",)


def waveforms(t0: str = "12.03.2026 09:30:00,000", time: str = "time\tY[0]\tY[1]") -> str:
    head = f"waveform\tlift angle [deg]\tp lift A\nt0\t12.03.2026 09:30:00,000\t{t0}\n"
    rows = [f"12.03.2026 09:30:00,{2 * k:03d}\t{k},5\t-{k},25" for k in range(20)]
    return "\n".join([f"{head}delta t\t0,002\t0,002\n\n{time}", *rows]) + "\n"


def test_labviews_export_of_waveforms_is_a_table(tmp_path: Path) -> None:
    log = read_log(write(tmp_path, waveforms(), "a.txt"))
    assert list(log.columns) == ["time", "lift angle [deg]", "p lift A"]
    np.testing.assert_allclose(log.columns["time"], 0.002 * np.arange(20), atol=1e-12)
    np.testing.assert_array_equal(log.columns["lift angle [deg]"], 0.5 + np.arange(20))
    assert log.start == "2026-03-12T09:30:00.000"
    assert log.notes[0] == "LabVIEW export of waveforms"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (waveforms(t0="12.03.2026 09:30:01,000"), "expected the same 't0' of all, found 12.03"),
        (waveforms(time="time[0]\tY[0]\ttime[1]"), "export it with a single time column, or as"),
        (waveforms(time="Y[0]\tY[1]"), "a LabVIEW export of waveforms, expected one row 'time'"),
    ],
)
def test_waveforms_of_several_times_are_refused_with_what_to_export(
    text: str, said: str, tmp_path: Path
) -> None:
    with pytest.raises(BagError, match=re.escape(said)):
        read_log(write(tmp_path, text, "a.txt"))
