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
    LONGEST_OPENING,
    MESSAGE,
    SCHEMA,
    RecordWalk,
    Round,
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
    return walked_all([data], block)[0]


def walked_all(buffers: list[bytes], block: int) -> list[tuple[list[list[int]], Noted, bool]]:
    """The same of buffers that are walked one after the other."""
    noted: Noted = []
    walk = RecordWalk(lambda opcode, body: noted.append((opcode, body)))
    found = []
    for data in buffers:
        pieces = [piece.tolist() for piece in walk.bodies(data, block)]
        found.append((pieces, noted.copy(), walk.whole))
        noted.clear()
    return found


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


_OPENING = b"".join(record(CHANNEL, 300) + record(MESSAGE, size) for size in [40, 22, 70, 22])
_ROUND = b"".join(record(MESSAGE, size) for size in [40, 22, 70, 22])


@pytest.mark.parametrize(
    "then",
    [
        _OPENING + _ROUND * 5,
        _OPENING + _ROUND * 2,
        _OPENING + _ROUND * 5 + _OPENING,
        (_OPENING + _ROUND * 2)[:-1],
        _OPENING[:-1],
        b"",
        _OPENING.replace(record(CHANNEL, 300), record(SCHEMA, 300), 1) + _ROUND * 2,
        _OPENING + record(MESSAGE, 39) + _ROUND * 2,
        _ROUND * 9,
    ],
)
def test_a_buffer_may_begin_as_the_one_before_did_or_not(then: bytes) -> None:
    first = _OPENING + _ROUND * 50
    buffers = [first, then, then, first]
    found = walked_all(buffers, 1000)
    assert [(joined(pieces), *rest) for pieces, *rest in found] == [
        one_by_one(data) for data in buffers
    ]


def test_a_beginning_is_remembered() -> None:
    data = _OPENING + _ROUND * 50
    (_, _, _), (_, second, _), (_, third, _) = walked_all([data, data, data], 1000)
    assert len(second) == 4
    assert all(one is other for (_, one), (_, other) in zip(second, third, strict=True))


def test_a_long_beginning_is_not_remembered() -> None:
    data = record(CHANNEL, LONGEST_OPENING) + _OPENING + _ROUND * 50
    (_, first, _), (_, second, _), (_, third, _) = walked_all([data, data, data], 1000)
    assert first == second == third
    assert not any(one is other for (_, one), (_, other) in zip(second, third, strict=True))


def test_an_opening_is_not_passed_over_a_block() -> None:
    data = _OPENING + _ROUND * 50
    found = walked_all([data, data], 12)
    assert all(len(piece) <= 12 for pieces, _, _ in found for piece in pieces)
    walk = RecordWalk(lambda _opcode, _body: None)
    assert [len(piece) for piece in walk.bodies(data, 1000)] == [12, 192]
    assert [len(piece) for piece in walk.bodies(data, 10)][:2] == [10, 10]


@given(
    kinds=st.lists(_PARTS, min_size=1, max_size=3),
    order=st.lists(st.tuples(st.integers(0, 2), st.integers(0, 2)), min_size=2, max_size=6),
    block=st.integers(1, 50),
)
@settings(max_examples=200, deadline=None)
def test_any_buffers_are_walked_one_after_the_other(
    kinds: list[list[tuple[list[tuple[int, int]], int, bytes]]],
    order: list[tuple[int, int]],
    block: int,
) -> None:
    several = [
        b"".join(
            b"".join(record(*one) for one in round_) * times + odd for round_, times, odd in parts
        )
        for parts in kinds
    ]
    buffers = [several[a % len(several)] + several[b % len(several)] for a, b in order]
    found = walked_all(buffers, block)
    assert [(joined(pieces), *rest) for pieces, *rest in found] == [
        one_by_one(data) for data in buffers
    ]
    assert all(len(piece) <= block for pieces, _, _ in found for piece in pieces)


def test_a_round_is_the_shortest_that_came_twice() -> None:
    assert round_of(np.cumsum([0, 5, 7, 5, 7]).tolist()) == [5, 7]
    assert round_of(np.cumsum([0, 7, 5, 7, 5, 7]).tolist()) == [5, 7]
    assert round_of(np.cumsum([0, 5, 5, 5, 5]).tolist()) == [5]
    assert round_of(np.cumsum([0, 5, 7, 5]).tolist()) == []
    assert round_of([9]) == []


def test_of_a_round_that_is_not_whole_there_is_nothing() -> None:
    data = record(MESSAGE, 22) + record(MESSAGE, 30)
    assert Round([31, 39]).bodies(data, 0, 2).tolist() == [9, 40]
    assert Round([31, 39]).bodies(data, 0, 1).tolist() == []
    assert Round([31, 39]).bodies(data[:-1], 0, 2).tolist() == []
    assert Round([31, 39]).bodies(data, len(data), 2).tolist() == []
    assert Round([]).bodies(data, 0, 2).tolist() == []
