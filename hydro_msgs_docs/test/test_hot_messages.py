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

from hydro_msgs_docs.cdr import JOINT_STATE, POINT_STAMPED, CdrError, layout_of
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
    with pytest.raises(RuntimeError):
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
