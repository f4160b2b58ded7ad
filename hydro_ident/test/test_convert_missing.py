"""What stands for a missing number in a text log, and a minus that is no hyphen."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from hydro_ident.errors import BagError
from hydro_ident.logs.file import Log, read_log
from hydro_ident.logs.numbers import exact_of

SPELLINGS = [
    *("#N/A", "#NV", "#DIV/0!", "#WERT!", "n. def.", "--", "---", "NaN", "n/a"),
    *("1.#QNAN", "-1.#IND", "-1.#IND00", "1.#INF", "1,#QNAN"),
]


def table(folder: Path, *rows: str) -> Log:
    (folder / "log.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
    return read_log(folder / "log.csv")


@pytest.mark.parametrize("spelling", SPELLINGS)
@pytest.mark.parametrize(("decimal", "first"), [(".", False), (",", True)])
def test_a_missing_number_does_not_refuse_the_log(
    decimal: str, first: bool, spelling: str, tmp_path: Path
) -> None:
    at = 0 if first else 2
    cells = [[f"0{decimal}{k}", f"1{decimal}5", f"2{decimal}5", f"-{k}"] for k in range(5)]
    cells[at][1] = cells[at][2] = cells[at][3] = spelling
    log = table(tmp_path, "t;q;p;u", *map(";".join, cells))
    expected = np.full(5, 1.5)
    expected[at] = np.nan
    np.testing.assert_array_equal(log.columns["q"], expected)
    np.testing.assert_allclose(log.columns["t"], 0.1 * np.arange(5))


@pytest.mark.parametrize("units", ["1;-;-;-", "1;1;deg;-", "-;-;1;1", "s;-;-;-"])
def test_a_line_of_units_that_has_few_is_no_line_of_numbers(units: str, tmp_path: Path) -> None:
    log = table(tmp_path, "n;q;p;u", units, *(f"{k};{k}.5;2;3" for k in range(5)))
    np.testing.assert_array_equal(log.columns["n"], np.arange(5.0))
    assert list(log.units.values()) == units.split(";")


def test_a_first_line_of_missing_numbers_is_one_where_dashes_stand_for_them(
    tmp_path: Path,
) -> None:
    log = table(tmp_path, "t;q;p;u", "1;-;-;-", "2;5;-;-", "3;5;6;7", "4;5;6;7")
    np.testing.assert_array_equal(log.columns["t"], np.arange(1.0, 5.0))
    np.testing.assert_array_equal(log.columns["q"], [np.nan, 5.0, 5.0, 5.0])
    log = table(tmp_path, "t;q;p;u", "1;#N/A;#N/A;#N/A", "2;5;6;7", "3;5;6;7")
    np.testing.assert_array_equal(log.columns["t"], [1.0, 2.0, 3.0])


def test_another_text_says_what_can_be_tried(tmp_path: Path) -> None:
    said = "line 3: expected a number, found 'off'; a missing number is an empty cell, NaN or #N/A"
    with pytest.raises(BagError, match=said):
        table(tmp_path, "t,q", "0,1", "1,off", "2,3")


def test_a_minus_that_is_no_hyphen_is_a_sign(tmp_path: Path) -> None:
    minus = "\u2212"
    rows = [f'{minus}{k}.5,"{minus}.25",{minus}1' for k in range(5, 0, -1)]
    log = table(tmp_path, f"t,q {minus} r,p", *rows)
    np.testing.assert_array_equal(log.columns["t"], [-5.5, -4.5, -3.5, -2.5, -1.5])
    np.testing.assert_array_equal(log.columns[f"q {minus} r"], np.full(5, -0.25))
    log = table(tmp_path, "t;q", f"0,5;{minus}1,5", f"0,6;{minus}2,5")
    np.testing.assert_array_equal(log.columns["q"], [-1.5, -2.5])


@pytest.mark.parametrize(
    ("cells", "decimal", "expected"),
    [
        (["1773307800.002", "1773307800,5"], ".", None),
        (["1773307800.002", "1773307801"], ".", ([1773307800002, 1773307801000], 3)),
        (["1.773.307.800,25", "", "n. def."], ",", ([177330780025, 0, 0], 2)),
        (["1773307800000000001"], ".", ([1773307800000000001], 0)),
        (["1.7733078e9"], ".", None),
        (["1773307800." + "0" * 18 + "1"], ".", None),
        (["99999999999.999999999"], ".", None),
    ],
    ids=["two signs", "points", "commas", "whole", "powers of ten", "digits", "64 bits"],
)
def test_what_a_double_rounds_is_kept_where_the_text_says_it(
    cells: list[str], decimal: str, expected: tuple[list[int], int] | None
) -> None:
    found = exact_of(cells, decimal)
    assert (None if found is None else (found.whole.tolist(), found.digits)) == expected
