"""Messages of one topic put into a table, in whichever order layouts and names come."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from hydro_ident.bag.mcap_types import Channel, MessageBlock
from hydro_ident.bag.series import SeriesBuilder
from hydro_msgs_docs.cdr import JOINT_STATE, encode

_CHANNEL = Channel("/joints", JOINT_STATE, "cdr", "ros2msg", "", {})


def block_of(messages: list[bytes]) -> MessageBlock:
    """Messages side by side, one nanosecond after the other."""
    lengths = np.array([len(message) for message in messages])
    ends = np.cumsum(lengths)
    times = np.arange(len(messages))
    return MessageBlock(_CHANNEL, b"".join(messages), ends - lengths, lengths, times, times)


@pytest.mark.parametrize(
    "order",
    ["aaaa", "abab", "aabb", "bbaa", "abba", "cacb", "accb", "abcabc", "cc", "a?ab", "?b"],
)
@pytest.mark.parametrize("blocks", [1, 2])
def test_every_value_stands_in_its_row_and_column(order: str, blocks: int) -> None:
    kinds = {"a": ("boom", "arm"), "b": ("arm", "boom", "tip"), "c": ("tip", "arm")}
    builder = SeriesBuilder("/joints", JOINT_STATE)
    counter = itertools.count(1.0)
    expected: list[tuple[int, dict[str, float]]] = []
    for _ in range(blocks):
        messages = []
        for kind in order:
            if kind == "?":
                messages.append(b"\0\1\0\0 no message")
                continue
            values = {name: next(counter) for name in kinds[kind]}
            stamp_ns = 10 * len(expected)
            expected.append((stamp_ns, values))
            position = {"position": list(values.values())}
            messages.append(encode(JOINT_STATE, stamp_ns, position, names=kinds[kind]))
        builder.add(block_of(messages))
    series = builder.finish()
    assert series.stamp_ns.tolist() == [stamp_ns for stamp_ns, _ in expected]
    assert series.malformed == blocks * order.count("?")
    assert set(series.names) == {name for _, values in expected for name in values}
    table = np.array([[values.get(n, np.nan) for n in series.names] for _, values in expected])
    np.testing.assert_array_equal(series.fields["position"], table)
