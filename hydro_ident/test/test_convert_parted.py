"""What parts the columns of a text log: blanks that align them, bars, and lines of remarks."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

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


def test_bars_part_columns(tmp_path: Path) -> None:
    log = table(tmp_path, "t|lift angle", *(f"0,{k}|1,5" for k in range(5)))
    assert "delimiter '|', decimal ','" in log.notes
    np.testing.assert_array_equal(log.columns["lift angle"], np.full(5, 1.5))
