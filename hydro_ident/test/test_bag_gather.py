"""Messages gathered over several buffers."""

from __future__ import annotations

import struct

import numpy as np
from numpy.typing import NDArray

from hydro_ident.bag.mcap_gather import BLOCK_BYTES, Gatherer

_RECORDS = ((7, 10, b"abc"), (2, 11, b""), (7, 12, b"defgh"))


def _buffer(
    lead: bytes, records: tuple[tuple[int, int, bytes], ...]
) -> tuple[bytes, NDArray[np.int64]]:
    data, bodies = bytearray(lead), []
    for channel, log_ns, payload in records:
        data += struct.pack("<BQ", 5, 22 + len(payload))
        bodies.append(len(data))
        data += struct.pack("<HIQQ", channel, 0, log_ns, log_ns - 1) + payload
    return bytes(data), np.array(bodies, dtype=np.int64)


def test_messages_of_two_buffers_come_by_channel_in_order() -> None:
    gatherer = Gatherer()
    gatherer.add(*_buffer(b"xy", _RECORDS))
    gatherer.add(b"nothing in here", np.zeros(0, dtype=np.int64))
    gatherer.add(*_buffer(b"", ((2, 13, b"ij"),)))
    seven, two = gatherer.take()
    for found, channel, times, payloads in (
        (seven, 7, [10, 12], [b"abc", b"defgh"]),
        (two, 2, [11, 13], [b"", b"ij"]),
    ):
        assert found.channel == channel
        assert found.log_ns.tolist() == times
        assert found.publish_ns.tolist() == [t - 1 for t in times]
        ends = zip(found.offset, found.length, strict=True)
        assert [found.data[a : a + n] for a, n in ends] == payloads
    assert list(gatherer.take()) == []


def test_a_buffer_may_be_taken_in_by_pieces() -> None:
    gatherer, (data, bodies) = Gatherer(), _buffer(b"xy", _RECORDS)
    for piece in (bodies[:2], bodies[2:]):
        gatherer.add(data, piece)
    gatherer.add(*_buffer(b"", _RECORDS[:1]))
    seven, _ = gatherer.take()
    ends = zip(seven.offset, seven.length, strict=True)
    assert [seven.data[a : a + n] for a, n in ends] == [b"abc", b"defgh", b"abc"]
    assert len(seven.data) == len(data) + 9 + 22 + 3


def test_a_large_buffer_is_enough_on_its_own() -> None:
    gatherer = Gatherer()
    gatherer.add(*_buffer(b"", _RECORDS))
    assert not gatherer.full
    gatherer.add(*_buffer(bytes(BLOCK_BYTES), _RECORDS))
    assert gatherer.full


def test_a_time_beyond_the_signed_is_seen_as_negative() -> None:
    gatherer = Gatherer()
    gatherer.add(*_buffer(b"", ((1, (1 << 64) - 2, b""),)))
    (found,) = gatherer.take()
    assert found.log_ns.tolist() == [-2]
