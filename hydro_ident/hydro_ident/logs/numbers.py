"""Texts as numbers: decimal points or commas, thousands, what stands for a missing one."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from hydro_ident.errors import BagError
from hydro_ident.logs.file import SHOWN, Exact
from hydro_model.arrays import FloatArray

#: What stands for a missing number: words, spreadsheets' errors, and of an older C library.
_MISSING = frozenset({"", "nan", "na", "n/a", "null", "none", "-", "--", "---"}) | frozenset(
    {"#n/a", "#nv", "#value!", "#wert!", "#div/0!", "#num!", "#zahl!", "n. def.", "n.def."}
)
_NO_NUMBER = re.compile(r"[+-]?1[.,]#(?:qnan|snan|ind|inf)\d*")
_COMMA_NUMBER = re.compile(r"\s*[+-]?\d*,\d+(?:[eE][+-]?\d+)?\s*")
#: A number with a decimal point or comma, or one with thousands.
_POINTS = re.compile(r"\s*[+-]?[1-9]\d{0,2}(?:\.\d{3})+\s*")
_COMMAS = re.compile(r"\s*[+-]?[1-9]\d{0,2}(?:,\d{3})+\s*")
#: What a line that was cut leaves of a number with thousands.
_CUT = re.compile(r"\s*[+-]?[1-9]\d{0,2}(?:\.\d{3})*\.\d{0,2}\s*")
#: Of a number of 64 bits.
_MOST_DIGITS = 18
#: By decimal sign: numbers whose thousands are parted by the other sign, beyond doubt.
_GROUPED = {
    ".": re.compile(r"\s*[+-]?\d{1,3}(?:,\d{3})+\.\d*\s*"),
    ",": re.compile(r"\s*[+-]?\d{1,3}(?:\.\d{3})+,\d*\s*"),
}


def is_missing(text: str) -> bool:
    """Whether a cell stands for a missing number.

    Parameters
    ----------
    text : str
    """
    bare = text.strip().lower()
    return bare in _MISSING or ("#" in bare and _NO_NUMBER.fullmatch(bare) is not None)


def is_number(text: str, decimal: str) -> bool:
    """Whether a cell is a number.

    Parameters
    ----------
    text, decimal : str
    """
    if decimal == "," and "." in text and not _GROUPED[","].fullmatch(text):
        return False
    try:
        float(_plain(text, decimal))
    except ValueError:
        return False
    return "_" not in text


def _plain(text: str, decimal: str) -> str:
    """A cell as Python writes numbers."""
    other = "," if decimal == "." else "."
    if other in text and _GROUPED[decimal].fullmatch(text):
        text = text.replace(other, "")
    return text.replace(",", ".", 1) if decimal == "," else text


def numbers(cells: Sequence[str], lines: Sequence[int], where: str, decimal: str) -> FloatArray:
    """A column of texts as numbers.

    Parameters
    ----------
    cells : sequence of str
    lines : sequence of int
        Line number of each, for messages.
    where : str
        For messages.
    decimal : str

    Returns
    -------
    (N,) array
        NaN where a cell is empty or stands for a missing number, and everywhere where no cell is
        a number.

    Raises
    ------
    BagError
        Some cells are numbers and one is something else.
    """
    given = [cell.replace(",", ".", 1) for cell in cells] if decimal == "," else cells
    if decimal != "," or not _may_be_thousands(cells):
        try:
            return np.array(given, dtype=np.float64)
        except ValueError:
            pass
    result = np.full(len(cells), np.nan)
    if not any(is_number(cell, decimal) for cell in cells):
        return result  # A column of remarks: only an error if the mapping asks for it.
    for k, cell in enumerate(cells):
        if is_missing(cell):
            continue
        if not is_number(cell, decimal):
            raise BagError(
                f"{where}, line {lines[k]}: expected a number,"
                f" found '{cell.strip()[:SHOWN]}'{_hint(cell, last=k == len(cells) - 1)}"
            )
        result[k] = float(_plain(cell, decimal))
    return result


def exact_of(cells: Sequence[str], decimal: str) -> Exact | None:
    """Texts of plain numbers as what they say, beyond what a double holds.

    Parameters
    ----------
    cells : sequence of str
    decimal : str

    Returns
    -------
    Exact or None
        None where a cell is written in another way, or has more digits than 64 bits hold.
    """
    texts = ["0" if is_missing(cell) else _plain(cell.strip(), decimal) for cell in cells]
    pairs = [text.partition(".") for text in texts]
    digits = max(len(behind) for _, _, behind in pairs)
    if digits > _MOST_DIGITS:
        return None
    try:
        whole = [int(f"{before}{behind:0<{digits}}") for before, _, behind in pairs]
        return Exact(np.array(whole, dtype=np.int64), digits)
    except (ValueError, OverflowError):
        return None


def commas_are_decimal(cells: Sequence[str]) -> bool:
    """Whether some commas are decimal signs beyond doubt and no point is one.

    Parameters
    ----------
    cells : sequence of str
        Of a table that no commas part.
    """
    pointed = [cell for cell in cells if "." in cell and is_number(cell, ".")]
    return all(_POINTS.fullmatch(cell) for cell in pointed) and any(
        _COMMA_NUMBER.fullmatch(cell) and not _COMMAS.fullmatch(cell) for cell in cells
    )


def _may_be_thousands(cells: Sequence[str]) -> bool:
    """Whether the points of a column in a log of decimal commas may part thousands."""
    if not any("." in cell for cell in cells):
        return False
    if any("," in cell for cell in cells):
        return True  # No column has two decimal signs.
    sure = [k for k, cell in enumerate(cells) if "." in cell and not _POINTS.fullmatch(cell)]
    return not sure or (sure == [len(cells) - 1] and bool(_CUT.fullmatch(cells[-1])))


def why_no_numbers(column: FloatArray, cells: Sequence[str], decimal: str) -> str:
    """Why a column that begins with what may be thousands is not read, where it is not.

    Parameters
    ----------
    column : (N,) array
        As it was read.
    cells : sequence of str
    decimal : str

    Returns
    -------
    str
        Empty where it is read, or begins with something else.
    """
    if not np.isnan(column).all():
        return ""
    first = next((cell.strip() for cell in cells if not is_missing(cell)), "")
    if not (_COMMAS if decimal == "." else _POINTS).fullmatch(first):
        return ""
    return f"expected numbers, found '{first[:SHOWN]}'{_hint(first, last=False)}"


def _hint(cell: str, *, last: bool) -> str:
    """What may be behind a cell that is no number."""
    if _COMMA_NUMBER.fullmatch(cell):
        return "; is the decimal sign a comma, or does it part thousands? then write it without"
    if _POINTS.fullmatch(cell) or ("." in cell and is_number(cell, ".")):
        return "; does the point part thousands, or is it the decimal sign? then write it without"
    if last:
        return "; the last line: leave it out of a copy of the file if it was cut"
    return (
        "; a missing number is an empty cell, NaN or #N/A: write it so in a copy of the file, or"
        " leave the line out"
    )
