"""Messages of the hot path beside what rclpy makes of the same."""

from __future__ import annotations

import struct

import numpy as np
import pytest
from geometry_msgs.msg import PointStamped
from hypothesis import given, settings
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message
from rosbags.typesys import Stores, get_typestore
from sensor_msgs.msg import JointState

from hydro_msgs_docs import hot_messages
from hydro_msgs_docs.cdr import JOINT_STATE, POINT_STAMPED, CdrError, Layout, layout_of
from hydro_msgs_docs.hot_messages import HotMessage, VectorReader
from hydro_msgs_docs.messages import VECTOR_FIELDS, StampedVector, joint_state, set_stamp

STORE = get_typestore(Stores.ROS2_JAZZY)
STAMPS = st.integers(-(2**31) * 10**9, 2**31 * 10**9 - 1)
NAMES = st.lists(st.text("abcä_/", max_size=9), max_size=5)
NUMBERS = st.floats(allow_nan=False)
LISTS = st.lists(NUMBERS, max_size=6)


@st.composite
def vectors(draw: st.DrawFn) -> StampedVector:
    """Any: lists as long as the names or not, as a faulty sender makes them."""
    lists = [tuple(draw(LISTS)) for _ in VECTOR_FIELDS]
    return StampedVector(draw(STAMPS), tuple(draw(NAMES)), *lists)


def message_of(vector: StampedVector) -> JointState:
    fields = {field: getattr(vector, field) for field in VECTOR_FIELDS}
    return joint_state(vector.stamp_ns, vector.name, **fields)


@settings(max_examples=150, deadline=None)
@given(st.lists(vectors(), min_size=1, max_size=4))
def test_whatever_is_sent_after_whatever_is_read_as_rclpy_reads_it(sent) -> None:
    reader = VectorReader()
    for vector in (*sent, *sent):
        data = serialize_message(message_of(vector))
        assert reader.read(data) == StampedVector.of(deserialize_message(data, JointState))
        assert reader.read(data) == vector


def test_a_message_of_one_name_more_or_fewer_values_is_not_read_as_the_one_before() -> None:
    reader = VectorReader()
    for names, values in (("ab", "12"), ("ac", "12"), ("a", "1"), ("abc", "123"), ("ab", "1")):
        message = joint_state(7, names, effort=[float(v) for v in values])
        vector = reader.read(serialize_message(message))
        assert vector == StampedVector(7, tuple(names), (), (), tuple(map(float, values)))


def _sent(names: str, k: int, little: bool = True) -> bytes:
    """The message of a sender, other numbers each time."""
    values = np.array([k + 0.5, np.nan if k % 3 else -np.inf, -k][: len(names)])
    types = STORE.types
    header = types["std_msgs/msg/Header"](types["builtin_interfaces/msg/Time"](k, 7 * k), "")
    oracle = types[JOINT_STATE](header, list(names), values, np.zeros(0), -values)
    return bytes(STORE.serialize_cdr(oracle, JOINT_STATE, little_endian=little))


def test_two_senders_by_turns_and_another_byte_order_are_looked_at_once_each(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    looked: list[int] = []

    def looking(data: bytes, message_type: str) -> Layout:
        looked.append(len(data))
        return layout_of(data, message_type)

    monkeypatch.setattr(hot_messages, "layout_of", looking)
    reader = VectorReader()
    for k in range(60):
        for data in (_sent("ab", k), _sent("xyz", k)):
            expected = StampedVector.of(deserialize_message(data, JointState))
            assert repr(reader.read(data)) == repr(expected)  # NaN is like no other NaN
    assert len(looked) == 2
    for k in range(60):
        assert reader.read(_sent("ab", k, little=False)).position[0] == k + 0.5
    assert len(looked) == 3
    assert reader.read(_sent("ab", 7)).stamp_ns == 7_000_000_049


def test_a_name_with_a_zero_in_it_is_for_rclpy_to_judge() -> None:
    data = _sent("ab", 1).replace(b"\x02\0\0\0a\0", b"\x02\0\0\0\0a")
    assert data != _sent("ab", 1)
    expected = StampedVector.of(deserialize_message(data, JointState))
    assert repr(VectorReader().read(data)) == repr(expected)


@settings(max_examples=50, deadline=None)
@given(vectors(), st.binary(max_size=5))
def test_big_endian_senders_and_padding_are_read(vector, padding) -> None:
    types = STORE.types
    header = types["std_msgs/msg/Header"](
        types["builtin_interfaces/msg/Time"](*divmod(vector.stamp_ns, 10**9)), "base"
    )
    lists = [np.array(getattr(vector, field), dtype=float) for field in VECTOR_FIELDS]
    oracle = types[JOINT_STATE](header, list(vector.name), *lists)
    data = bytes(STORE.serialize_cdr(oracle, JOINT_STATE, little_endian=False))
    assert VectorReader().read(data + padding) == vector


@pytest.mark.parametrize("kept", [-1, -9, -17, 40, 12, 3, 0])
def test_a_cut_message_is_never_read_as_a_whole_one(kept) -> None:
    reader = VectorReader()
    whole = serialize_message(joint_state(1, ["lift", "tilt"], effort=[1.0, 2.0]))
    assert reader.read(whole).effort == (1.0, 2.0)
    # The serialiser may write padding behind the last value.
    last = layout_of(whole, JOINT_STATE).size
    with pytest.raises(CdrError, match="bytes that are no JointState"):
        reader.read(whole[:last][:kept])
    assert reader.read(whole).effort == (1.0, 2.0)


@settings(max_examples=50, deadline=None)
@given(STAMPS, st.tuples(*[NUMBERS] * 2), st.tuples(*[NUMBERS] * 2))
def test_what_is_filled_is_what_rclpy_writes(stamp, position, effort) -> None:
    message = HotMessage(JOINT_STATE, {"effort": 2, "position": 2}, names=("lift", "tilt"))
    data = message.filled(stamp, effort, position)
    expected = joint_state(stamp, ["lift", "tilt"], position=position, effort=effort)
    assert deserialize_message(data, JointState) == expected
    # Filled again, nothing of the time before is left, and what was given away is as it was.
    again = message.filled(5, (0.0, 0.0), (0.0, 1.0))
    assert deserialize_message(again, JointState) == joint_state(
        5, ["lift", "tilt"], position=[0.0, 1.0], effort=[0.0, 0.0]
    )
    assert deserialize_message(data, JointState) == expected


def test_points_are_filled_in_their_frame() -> None:
    data = HotMessage(POINT_STAMPED, {"point": 3}, frame_id="base_link").filled(
        12_000_000_003, (1.0, -2.0, 0.5)
    )
    expected = PointStamped()
    set_stamp(expected, 12_000_000_003)
    expected.header.frame_id = "base_link"
    expected.point.x, expected.point.y, expected.point.z = 1.0, -2.0, 0.5
    assert deserialize_message(data, PointStamped) == expected


def test_numbers_of_values_are_held_to_what_was_said() -> None:
    message = HotMessage(JOINT_STATE, {"effort": 2}, names=("lift", "tilt"))
    with pytest.raises(struct.error):
        message.filled(1, (1.0,))
    with pytest.raises(ValueError, match="zip"):
        message.filled(1, (1.0, 2.0), (3.0, 4.0))
    with pytest.raises(CdrError, match="no field 'torque'"):
        HotMessage(JOINT_STATE, {"torque": 2}, names=("lift", "tilt"))
    with pytest.raises(CdrError, match="expected no or 2 values of effort, found 3"):
        HotMessage(JOINT_STATE, {"effort": 3}, names=("lift", "tilt"))
