"""What parts the columns of a text log: blanks that align them, bars, and lines of remarks."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from hydro_ident.errors import BagError
from hydro_ident.logs.file import CsvLayout, Log, read_log

BY_HAND = CsvLayout(delimiter=" ")


def table(folder: Path, *rows: str, layout: CsvLayout | None = None) -> Log:
    (folder / "log.txt").write_text("\n".join(rows) + "\n", encoding="utf-8")
    return read_log(folder / "log.txt", layout)


@pytest.mark.parametrize("layout", [None, BY_HAND], ids=["by itself", "said"])
@pytest.mark.parametrize(
    ("head", "units", "row"),
    [
        ("t   lift angle   p", "s   deg   barg", "{t:.1f}   {q:.2f}   -3"),
        ("  t   lift angle   p", "  s   deg   barg", "{t:5.1f} {q:8.2f} -3"),
        ('t "lift angle" p', "s deg barg", "{t:.1f} {q:.2f} -3"),
    ],
    ids=["wide gaps", "aligned right", "quoted"],
)
def test_columns_that_blanks_align_are_read(
    head: str, units: str, row: str, layout: CsvLayout | None, tmp_path: Path
) -> None:
    rows = [row.format(t=0.1 * k, q=-99.5 + 20.0 * k) for k in range(20)]
    log = table(tmp_path, "Run 7, crane 3", head, units, *rows, layout=layout)
    assert list(log.columns) == ["t", "lift angle", "p"]
    assert log.units == {"t": "s", "lift angle": "deg", "p": "barg"}
    np.testing.assert_allclose(log.columns["lift angle"], -99.5 + 20.0 * np.arange(20))
    assert "delimiter 'blanks', decimal '.'" in log.notes


def test_decimal_commas_and_dates_stand_between_blanks(tmp_path: Path) -> None:
    rows = [f"2026-03-12 09:30:0{k},5   1,{k}   NaN" for k in range(5)]
    log = table(tmp_path, "Zeit   q   p", *rows)
    np.testing.assert_array_equal(log.columns["Zeit"], np.arange(5.0))
    np.testing.assert_allclose(log.columns["q"], 1.0 + 0.1 * np.arange(5))
    assert log.start == "2026-03-12T09:30:00.500"


@pytest.mark.parametrize(
    ("rows", "names"),
    [
        (["t, q", "0, 1", "1, 2"], ["t", "q"]),
        (["t;q;said", "0.5;1;on 2 3 4 5", "1.5;2;on 2 3 4 5"], ["t", "q", "said"]),
        (["q", "0.5 ", "1.5 "], ["q"]),
    ],
    ids=["blanks behind commas", "words", "one column"],
)
def test_blanks_part_nothing_where_another_sign_does(
    rows: list[str], names: list[str], tmp_path: Path
) -> None:
    assert list(table(tmp_path, *rows).columns) == names


@pytest.mark.parametrize(
    ("head", "row", "columns"),
    [
        ("time, q1, q2", "2026-03-12T09:30:0{0}.002, {0}, 2", ["time", "q1", "q2"]),
        ("q1, q2, time", "{0}.000, 1.500, 09:30:0{0}.002", ["q1", "q2", "time"]),
        ("q1,   q2,   time", "{0}.000,   1.500,   09:30:0{0}.002", ["q1", "q2", "time"]),
        ("time, q1, said", "2026-03-12 09:30:0{0}, {0}, on 2 3 4", ["time", "q1", "said"]),
        ("time;q1;said", "2026-03-12 09:30:0{0};{0};on, 2", ["time", "q1", "said"]),
        ("time,q1", "2026-03-12T09:30:0{0},{0}", ["time", "q1"]),
        ("q1, q2, gear, " + ", ".join("abcdefgh"), "{0}, 2, gear 1" + ", 3" * 8, None),
    ],
    ids=["date", "clock", "wide gaps", "words", "semicolons", "one value", "more numbers"],
)
def test_commas_in_front_of_blanks_part_columns(
    head: str, row: str, columns: list[str] | None, tmp_path: Path
) -> None:
    """Names had kept their commas, which were taken for decimal ones: 1.000 was read as 1000."""
    log = table(tmp_path, head, *(row.format(k) for k in range(8)))
    names = {name.strip(): values for name, values in log.columns.items()}
    assert list(names) == (columns or [name.strip() for name in head.split(",")])
    np.testing.assert_array_equal(names["q1"], np.arange(8.0))
    if "time" in names:
        np.testing.assert_array_equal(names["time"], np.arange(8.0))


def test_bars_part_columns(tmp_path: Path) -> None:
    log = table(tmp_path, "t|lift angle", *(f"0,{k}|1,5" for k in range(5)))
    assert "delimiter '|', decimal ','" in log.notes
    np.testing.assert_array_equal(log.columns["lift angle"], np.full(5, 1.5))


@pytest.mark.parametrize("sign", ["#", "%", "# ", "%% "])
def test_remarks_among_numbers_are_left_out(sign: str, tmp_path: Path) -> None:
    rows = [f"{k},{k + 0.5}" for k in range(6)]
    remark = f"{sign}the operator pressed pause"
    log = table(tmp_path, remark, "t,q", "s,deg", *rows[:3], remark, *rows[3:], remark)
    np.testing.assert_array_equal(log.columns["q"], 0.5 + np.arange(6))
    assert log.units == {"t": "s", "q": "deg"}


def test_names_behind_a_percent_sign_are_kept(tmp_path: Path) -> None:
    assert list(table(tmp_path, "%t,q", "0,1", "1,2").columns) == ["%t", "q"]


@pytest.mark.parametrize(
    ("names", "row"), [("# t,q,p", "{0},1.5,2.5"), ("# t q p", "{0} 1.5 2.5")]
)
def test_names_in_a_comment_right_above_the_numbers_are_read(
    names: str, row: str, tmp_path: Path
) -> None:
    """As NumPy's savetxt writes them."""
    log = table(tmp_path, "# Run 7", names, *(row.format(k) for k in range(5)))
    assert list(log.columns) == ["t", "q", "p"]
    assert "names from line 2, a comment" in log.notes


@pytest.mark.parametrize("sign", [",", ";", "\t", " | "])
@pytest.mark.parametrize("units", [[], ["-{0}s{0}deg"]], ids=["names", "units"])
def test_a_column_may_be_named_by_a_hash_alone(
    sign: str, units: list[str], tmp_path: Path
) -> None:
    """Its name had been empty."""
    rows = [sign.join(f"{k} {k + 0.5} 2".split()) for k in range(5)]
    head = [line.format(sign) for line in ["#{0}t{0}q", *units]]
    log = table(tmp_path, "# Run 7", *head, *rows)
    assert list(log.columns) == ["#", "t", "q"]
    assert log.units.get("q", "") == ("deg" if units else "")


def test_a_comment_that_lacks_a_name_is_no_line_of_names(tmp_path: Path) -> None:
    rows = [f"{k},{k + 0.5},2" for k in range(5)]
    for names in ("#,,q", "# t,,q"):
        with pytest.raises(BagError, match="expected a first line of names, found numbers"):
            table(tmp_path, names, *rows)
    assert list(table(tmp_path, "t,q,p", "#,,", *rows, "#, pause,").columns) == ["t", "q", "p"]


def test_a_missing_number_that_begins_a_line_is_no_remark(tmp_path: Path) -> None:
    log = table(tmp_path, "t;q", "0;1", "#N/A;2", "#NV;3", "3;4")
    np.testing.assert_array_equal(log.columns["t"], [0.0, np.nan, np.nan, 3.0])


def test_what_remarks_begin_with_can_be_said(tmp_path: Path) -> None:
    rows = ["t,q", "0,1", "// pause", "1,2", "2,3", "3,4"]
    said = r"line 3: expected 2 columns, found 1; leave a remark .* or say .* csv: \{comment: \}"
    with pytest.raises(BagError, match=said):
        table(tmp_path, *rows)
    assert len(table(tmp_path, *rows, layout=CsvLayout(comment="//")).columns["t"]) == 4
