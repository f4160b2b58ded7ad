"""Points and commas that may part thousands or be decimal signs."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from hydro_ident.errors import BagError
from hydro_ident.logs.file import CsvLayout, read_log


def test_thousands_are_read_beyond_doubt_only(tmp_path: Path) -> None:
    log = tmp_path / "log.csv"
    log.write_text('t,p\n0.5,999.5\n0.6,"1,000.5"\n0.7,"1,234,000.25"\n', encoding="utf-8")
    np.testing.assert_array_equal(read_log(log).columns["p"], [999.5, 1000.5, 1234000.25])
    log.write_text("t;p\n0,5;999,5\n0,6;1.000,5\n", encoding="utf-8")
    np.testing.assert_array_equal(read_log(log).columns["p"], [999.5, 1000.5])
    log.write_text('t,p\n0.5,999.5\n0.6,"1,000"\n0.7,998.5\n', encoding="utf-8")
    with pytest.raises(BagError, match="or does it part thousands"):
        read_log(log)


def test_points_in_a_log_of_commas_are_decimal_signs_beyond_doubt_only(tmp_path: Path) -> None:
    """Whole numbers of a mixed size would become a thousandth, each by itself."""
    log = tmp_path / "log.csv"
    log.write_text("t;u;q\n0,5;987;0,1\n0,6;1.000;0,2\n0,7;12.345;0,3\n", encoding="utf-8")
    said = r"line 3: expected a number, found '1\.000'; does the point part thousands"
    with pytest.raises(BagError, match=said):
        read_log(log)
    log.write_text("t;u;q\n0,5;0.987;0,1\n0,6;1.000;0,2\n0,7;12.345;0,3\n", encoding="utf-8")
    np.testing.assert_array_equal(read_log(log).columns["u"], [0.987, 1.0, 12.345])


@pytest.mark.parametrize(
    ("rows", "found"),
    [
        (["0,5;0,1;987", "0,6;0,1;9.876", "0,7;0,1;12.3"], "line 3: .* '9.876'; does"),
        (["0,5;0,5;0,1", "0,6;1.000;0,1", "0,7;0.5;0,1"], "line 3: .* '1.000'; does"),
        (["1;987;0,5", "2;1.000;0,5", "3;12.345;1,25"], "line 3: .* '1.000'; does"),
        (["1;987;7;0,5", "2;1.000;7.000;0,5", "3;2.000;8.000;0,5"], "line 3: .* '1.000'; does"),
    ],
    ids=["the last line is cut", "both signs", "whole times", "fewer commas than points"],
)
def test_no_point_that_may_part_thousands_is_taken_for_a_decimal_one(
    rows: list[str], found: str, tmp_path: Path
) -> None:
    log = tmp_path / "log.csv"
    names = ";".join("tuqp"[: rows[0].count(";") + 1])
    log.write_text("\n".join([names, *rows]), encoding="utf-8")
    with pytest.raises(BagError, match=found):
        read_log(log)


def test_a_column_of_nothing_but_thousands_says_so(tmp_path: Path) -> None:
    log = tmp_path / "log.csv"
    log.write_text("t;u;q\n0,5;1.000;0,1\n0,6;2.000;0,2\n0,7;2.000;\n", encoding="utf-8")
    assert read_log(log).why_unread("u").startswith(": expected numbers, found '1.000'; does the")


def test_commas_that_may_part_thousands_leave_points_the_decimal_sign(tmp_path: Path) -> None:
    log = tmp_path / "log.csv"
    log.write_text("t;u;q\n1;1.250;1,000\n2;1.125;2,000\n3;2.375;3,000\n", encoding="utf-8")
    np.testing.assert_array_equal(read_log(log).columns["u"], [1.25, 1.125, 2.375])


@pytest.mark.parametrize(
    "layout",
    [{}, {"delimiter": ","}, {"decimal": ","}, {"delimiter": ",", "decimal": ","}],
    ids=["by itself", "delimiter", "decimal", "both"],
)
def test_decimal_commas_in_quotes_are_read_between_commas(layout: dict, tmp_path: Path) -> None:
    """Both given, the advice had been 'max() arg is an empty sequence'."""
    log = tmp_path / "log.csv"
    log.write_text('t,q,n\n"0,5","-12,5",1\n"0,6","3,4",2\n"0,7","1.234,5",3\n', encoding="utf-8")
    read = read_log(log, CsvLayout(**layout))
    assert "delimiter ',', decimal ','" in read.notes
    np.testing.assert_array_equal(read.columns["t"], [0.5, 0.6, 0.7])
    np.testing.assert_array_equal(read.columns["q"], [-12.5, 3.4, 1234.5])
    np.testing.assert_array_equal(read.columns["n"], [1.0, 2.0, 3.0])


def test_quoted_commas_that_may_part_thousands_are_no_decimal_signs(tmp_path: Path) -> None:
    log = tmp_path / "log.csv"
    log.write_text('t,p\n1,999\n2,"1,000"\n3,"12,345"\n', encoding="utf-8")
    with pytest.raises(BagError, match=r"line 3: .* or does it part thousands"):
        read_log(log)


def test_one_column_of_decimal_commas_is_no_table_of_two(tmp_path: Path) -> None:
    log = tmp_path / "log.csv"
    log.write_text("q\n0,5\n0,6\n", encoding="utf-8")
    np.testing.assert_array_equal(read_log(log, CsvLayout(decimal=",")).columns["q"], [0.5, 0.6])
