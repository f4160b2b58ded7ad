"""Edits that turn a good file into one that nobody wrote."""

from __future__ import annotations

import re
import struct
from collections.abc import Callable, Sequence

#: An edit: its kind, a place and a value; any integers will do.
Edit = tuple[int, int, int]

#: What stands in texts where nobody expects it.
TOKENS = tuple(
    text.encode("utf-8")
    for text in (
        *("0", "-1", "1e400", "-1e-400", "nan", ".inf", "1e308", "9" * 30, "9" * 500, "1:59:59"),
        *("", " ", "\t", "\n", "\r", "\0", "\x1b[2J", "\ufeff", "ÿ", "'", '"', ",", ";", "#", "|"),
        *(
            ":",
            "- ",
            "[",
            "]",
            "{",
            "}",
            "<",
            ">",
            "&a ",
            "*a",
            "<<: *a",
            "!!int ''",
            "!!set ",
            "~",
        ),
        *("null", "true", "[]", "{}", "../../x", "/dev/zero", "2024-13-45", "!!python/name:os.x"),
        *("<!DOCTYPE a [<!ENTITY b 'c'>]>", "SG_ ", "BO_ ", "0|64@1+", "lift", "tilt"),
    )
)
_NUMBERS = (0, 1, 0x7F, 0xFF, 0xFFFF, (1 << 31) - 1, (1 << 32) - 1, 1 << 40, (1 << 63) - 1)


_WORD = re.compile(rb"[^\s,:;\[\]{}|\"'<>=]+")
_LINE = re.compile(rb"[^\n]*\n")


def edited(data: bytes, edits: Sequence[Edit], other: bytes = b"") -> bytes:
    """A file with edits made to it.

    Parameters
    ----------
    data : bytes
    edits : sequence of Edit
        Every one is possible everywhere.
    other : bytes
        Another file, of which pieces may be put in.

    Returns
    -------
    bytes
        At most twice as long as both files and 64 kB together.

    Examples
    --------
    >>> edited(b"a: 5", [(7, 2, 0)])
    b'a: 0'
    """
    whole = bytearray(data)
    for kind, place, value in edits:
        at = place % (len(whole) + 1)
        _EDITS[kind % len(_EDITS)](whole, at, value, other or data)
    return bytes(whole[: 2 * (len(data) + len(other)) + 65536])


def _flip(whole: bytearray, at: int, value: int, _: bytes) -> None:
    if at < len(whole):
        whole[at] ^= 1 << value % 8


def _set(whole: bytearray, at: int, value: int, _: bytes) -> None:
    if at < len(whole):
        whole[at] = value % 256


def _delete(whole: bytearray, at: int, value: int, _: bytes) -> None:
    del whole[at : at + 1 + value % 64]


def _repeat(whole: bytearray, at: int, value: int, _: bytes) -> None:
    whole[at:at] = whole[at : at + 1 + value % 64] * (1 + value // 64 % 8)


def _insert(whole: bytearray, at: int, value: int, _: bytes) -> None:
    whole[at:at] = TOKENS[value % len(TOKENS)]


def _number(whole: bytearray, at: int, value: int, _: bytes) -> None:
    packed = struct.pack("<Q", _NUMBERS[value % len(_NUMBERS)])
    width = (1, 2, 4, 8)[value // 16 % 4]
    whole[at : at + width] = packed[:width]


def _splice(whole: bytearray, at: int, value: int, other: bytes) -> None:
    begin = value % (len(other) + 1)
    whole[at:at] = other[begin : begin + 1 + value % 64]


def _word(whole: bytearray, at: int, value: int, _: bytes) -> None:
    """Another word in the place of the next one."""
    if found := _WORD.search(whole, at):
        whole[found.start() : found.end()] = TOKENS[value % len(TOKENS)]


def _other_word(whole: bytearray, at: int, value: int, other: bytes) -> None:
    """A word of the other file in the place of the next one."""
    found, there = _WORD.search(whole, at), _WORD.search(other, value % (len(other) + 1))
    if found and there:
        whole[found.start() : found.end()] = there.group()


def _line(whole: bytearray, at: int, value: int, _: bytes) -> None:
    """The next line away, or to another place too."""
    if found := _LINE.search(whole, at):
        line = found.group()
        if value % 2:
            del whole[found.start() : found.end()]
        other = _LINE.search(whole, value % (len(whole) + 1))
        if other and value % 3:
            whole[other.start() : other.start()] = line


_EDITS: tuple[Callable[[bytearray, int, int, bytes], None], ...] = (
    *(_flip, _set, _delete, _repeat, _insert, _number, _splice),
    *(_word, _other_word, _word, _other_word, _line),
)
