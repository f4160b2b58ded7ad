"""Messages found in rounds at once: the same as from record to record, whatever comes between."""

from __future__ import annotations

import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hydro_ident.bag.mcap_gather import MESSAGE_HEAD
from hydro_ident.bag.record_walk import (
    CHANNEL,
    MESSAGE,
    SCHEMA,
    RecordWalk,
    bodies_of_rounds,
    round_of,
)

Noted = list[tuple[int, bytes]]


def record(opcode: int, size: int) -> bytes:
    """A record with a body of so many bytes, which look like heads of messages themselves."""
    body = (struct.pack("<BQ", MESSAGE, MESSAGE_HEAD) * (size // 9 + 1))[:size]
    return struct.pack("<BQ", opcode, size) + body


def one_by_one(data: bytes) -> tuple[list[int], Noted, bool]:
    """What the walk has to find: bodies of messages, other records, and whether it ends whole."""
    at, bodies, noted = 0, [], []
    while at + 9 <= len(data):
        opcode, length = struct.unpack_from("<BQ", data, at)
        unknown = opcode not in (SCHEMA, CHANNEL, MESSAGE)
        if unknown or at + 9 + length > len(data) or (opcode == MESSAGE and length < MESSAGE_HEAD):
            break
        if opcode == MESSAGE:
            bodies.append(at + 9)
        else:
            noted.append((opcode, data[at + 9 : at + 9 + length]))
        at += 9 + length
    return bodies, noted, at == len(data)


def walked(data: bytes, block: int) -> tuple[list[list[int]], Noted, bool]:
    """What it finds, piece by piece."""
    noted: Noted = []
    walk = RecordWalk(data, lambda opcode, body: noted.append((opcode, body)))
    pieces = [piece.tolist() for piece in walk.bodies(block)]
    return pieces, noted, walk.whole


def joined(pieces: list[list[int]]) -> list[int]:
    """All that was found."""
    return [body for piece in pieces for body in piece]


def test_rounds_are_found_at_once() -> None:
    sizes = [40, 22, 70, 22]
    data = b"".join(record(MESSAGE, size) for size in sizes * 500)
    pieces, _, whole = walked(data, 10_000)
    assert whole
    assert joined(pieces) == one_by_one(data)[0]
    assert [len(piece) for piece in pieces] == [12, 1988]


def test_rounds_are_found_behind_the_descriptions_of_their_channels() -> None:
    first = b"".join(record(CHANNEL, 300) + record(MESSAGE, size) for size in [40, 22, 70, 22])
    pieces, _, _ = walked(first + b"".join(record(MESSAGE, s) for s in [40, 22, 70, 22] * 99), 400)
    assert [len(piece) for piece in pieces] == [12, 388]


@pytest.mark.parametrize("block", [1, 7, 64, 10_000])
@pytest.mark.parametrize("odd", [record(CHANNEL, 33), record(MESSAGE, 23), record(0x0C, 5), b"\5"])
def test_what_comes_between_is_not_passed_over(odd: bytes, block: int) -> None:
    usual = b"".join(record(MESSAGE, size) for size in [40, 22, 70] * 40)
    for cut in (0, len(record(MESSAGE, 40)), 3):
        data = usual + odd + usual[cut:]
        pieces, noted, whole = walked(data, block)
        assert (joined(pieces), noted, whole) == one_by_one(data)


@pytest.mark.parametrize("left", [1, 8, 9, 10, 48])
def test_a_record_that_is_not_whole_is_told_even_where_its_head_ends_the_buffer(left: int) -> None:
    data = record(MESSAGE, 40) * 30
    assert walked(data, 100)[2]
    pieces, _, whole = walked(data + record(MESSAGE, 40)[:left], 100)
    assert not whole
    assert joined(pieces) == one_by_one(data)[0]


@pytest.mark.parametrize("block", [1, 8, 30, 100])
def test_no_piece_goes_beyond_a_block(block: int) -> None:
    data = b"".join(record(MESSAGE, size) for size in [40, 22, 70] * 100)
    pieces, _, _ = walked(data, block)
    ends = np.cumsum([len(piece) for piece in pieces])
    assert ends[-1] == 300
    assert set(range(block, 301, block)) <= set(ends.tolist())


_RECORDS = st.tuples(
    st.sampled_from([MESSAGE, MESSAGE, MESSAGE, CHANNEL, SCHEMA, 0x0C]),
    st.sampled_from([0, 21, 22, 23, 31, 40]),
)
_PARTS = st.lists(
    st.tuples(st.lists(_RECORDS, max_size=6), st.integers(1, 40), st.binary(max_size=12)),
    max_size=4,
)


@given(parts=_PARTS, block=st.integers(1, 50))
@settings(max_examples=300, deadline=None)
def test_any_buffer_is_walked_as_one_by_one(
    parts: list[tuple[list[tuple[int, int]], int, bytes]], block: int
) -> None:
    data = b"".join(
        b"".join(record(*one) for one in round_) * times + odd for round_, times, odd in parts
    )
    pieces, noted, whole = walked(data, block)
    assert (joined(pieces), noted, whole) == one_by_one(data)


def test_a_round_is_the_shortest_that_came_twice() -> None:
    assert round_of(np.cumsum([0, 5, 7, 5, 7]).tolist()) == [5, 7]
    assert round_of(np.cumsum([0, 7, 5, 7, 5, 7]).tolist()) == [5, 7]
    assert round_of(np.cumsum([0, 5, 5, 5, 5]).tolist()) == [5]
    assert round_of(np.cumsum([0, 5, 7, 5]).tolist()) == []
    assert round_of([9]) == []


def test_of_a_round_that_is_not_whole_there_is_nothing() -> None:
    data = record(MESSAGE, 22) + record(MESSAGE, 30)
    assert bodies_of_rounds(data, 0, [31, 39], 2).tolist() == [9, 40]
    assert bodies_of_rounds(data, 0, [31, 39], 1).tolist() == []
    assert bodies_of_rounds(data[:-1], 0, [31, 39], 2).tolist() == []
    assert bodies_of_rounds(data, len(data), [31, 39], 2).tolist() == []
    assert bodies_of_rounds(data, 0, [], 2).tolist() == []
