"""CDR encoding and decoding against rosbags and against the installed ROS."""

from __future__ import annotations

from contextlib import suppress

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rosbags.typesys import Stores, get_typestore

from hydro_msgs_docs.cdr import (
    FIELDS,
    FLUID_PRESSURE,
    JOINT_STATE,
    POINT_STAMPED,
    TEMPERATURE,
    CdrError,
    encode,
    layout_of,
)

STORE = get_typestore(Stores.ROS2_JAZZY)
NAMES = st.lists(st.text("abcä_/", max_size=9), max_size=7, unique=True).map(tuple)
STAMPS = st.integers(-(2**31) * 10**9, 2**31 * 10**9 - 1)


def _matrix(data: bytes, size: int) -> np.ndarray:
    return np.frombuffer(data[:size], dtype=np.uint8)[None, :]


def _oracle(names: tuple[str, ...], stamp: int, fields: dict[str, np.ndarray], frame: str):
    types = STORE.types
    header = types["std_msgs/msg/Header"](
        types["builtin_interfaces/msg/Time"](*divmod(stamp, 10**9)), frame
    )
    empty = np.zeros(0)
    return types[JOINT_STATE](
        header, list(names), *(fields.get(f, empty) for f in ("position", "velocity", "effort"))
    )


@settings(max_examples=150, deadline=None)
@given(
    names=NAMES,
    stamp=STAMPS,
    frame=st.text("base_", max_size=5),
    filled=st.sets(st.sampled_from(("position", "velocity", "effort"))),
    big=st.booleans(),
    padding=st.binary(max_size=5),
    data=st.data(),
)
def test_joint_state_round_trip_agrees_with_rosbags(
    names, stamp, frame, filled, big, padding, data
) -> None:
    numbers = st.floats(allow_nan=False, width=64)
    fields = {
        f: np.array(data.draw(st.lists(numbers, min_size=len(names), max_size=len(names))), float)
        for f in filled
    }
    ours = encode(JOINT_STATE, stamp, fields, names=names, frame_id=frame)
    oracle = _oracle(names, stamp, fields, frame)
    little = bytes(STORE.serialize_cdr(oracle, JOINT_STATE, little_endian=True))
    assert little[: len(ours)] == ours
    message = bytes(STORE.serialize_cdr(oracle, JOINT_STATE, little_endian=not big)) + padding
    layout = layout_of(message, JOINT_STATE)
    rows = _matrix(message, layout.size)
    assert layout.names == names
    assert layout.frame_id == frame
    assert layout.order == (">" if big else "<")
    assert layout.stamp_ns(rows)[0] == stamp
    assert layout.matches(rows).all()
    for field, values in fields.items():
        np.testing.assert_array_equal(layout.field(rows, field)[0], values)


@pytest.mark.parametrize(
    ("kind", "values"),
    [
        (POINT_STAMPED, {"point": [1.0, -2.0, 3.5]}),
        (FLUID_PRESSURE, {"fluid_pressure": 1e7, "variance": 2.0}),
        (TEMPERATURE, {"temperature": 41.5}),
    ],
)
def test_small_types_agree_with_rosbags(kind: str, values: dict) -> None:
    data = encode(kind, 12_000_000_034, values, frame_id="base_link")
    message = STORE.deserialize_cdr(data, kind)
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (12, 34)
    assert message.header.frame_id == "base_link"
    if kind == POINT_STAMPED:
        assert [message.point.x, message.point.y, message.point.z] == values["point"]
    else:
        for name, value in values.items():
            assert getattr(message, name) == value
    assert bytes(STORE.serialize_cdr(message, kind)) == data
    layout = layout_of(data, kind)
    for name, value in values.items():
        np.testing.assert_array_equal(
            layout.field(_matrix(data, layout.size), name)[0], np.atleast_1d(value)
        )


def test_encoding_agrees_with_the_installed_ros() -> None:
    serialization = pytest.importorskip("rclpy.serialization")
    from hydro_msgs_docs.messages import joint_state

    message = joint_state(5_000_000_007, ["lift", "tilt"], position=[1.0, 2.0], effort=[3.0, 4.0])
    ours = encode(
        JOINT_STATE,
        5_000_000_007,
        {"position": [1.0, 2.0], "effort": [3.0, 4.0]},
        names=("lift", "tilt"),
    )
    theirs = bytes(serialization.serialize_message(message))
    # The middleware leaves whatever it finds in the padding: only the rest is compared.
    layout = layout_of(theirs, JOINT_STATE)
    rows = np.vstack([_matrix(data, layout.size) for data in (ours, theirs)])
    assert layout.matches(rows).all()
    np.testing.assert_array_equal(layout.stamp_ns(rows), [5_000_000_007] * 2)
    np.testing.assert_array_equal(layout.field(rows, "position"), [[1.0, 2.0]] * 2)
    np.testing.assert_array_equal(layout.field(rows, "effort"), [[3.0, 4.0]] * 2)


def test_a_layout_refuses_messages_of_another_one() -> None:
    first = encode(JOINT_STATE, 1, {"position": [1.0, 2.0]}, names=("ab", "cd"))
    same = encode(JOINT_STATE, 99, {"position": [5.0, 6.0]}, names=("ab", "cd"))
    renamed = encode(JOINT_STATE, 1, {"position": [1.0, 2.0]}, names=("ab", "ce"))
    moved = encode(JOINT_STATE, 1, {"velocity": [1.0, 2.0]}, names=("ab", "cd"))
    layout = layout_of(first, JOINT_STATE)
    rows = np.vstack([_matrix(m, layout.size) for m in (first, same, renamed, moved)])
    assert layout.matches(rows).tolist() == [True, True, False, False]


@settings(max_examples=200, deadline=None)
@given(st.binary(max_size=120), st.sampled_from(sorted(FIELDS)))
def test_any_bytes_are_a_message_or_an_error(data: bytes, kind: str) -> None:
    with suppress(CdrError):
        assert layout_of(b"\0\1\0\0" + data, kind).size <= len(data) + 4


@pytest.mark.parametrize("cut", range(0, 96, 5))
def test_a_message_cut_off_is_an_error(cut: int) -> None:
    data = encode(JOINT_STATE, 1, {"position": [1.0, 2.0]}, names=("lift", "tilt"))
    with pytest.raises(CdrError, match="expected"):
        layout_of(data[: min(cut, len(data) - 1)], JOINT_STATE)


def test_wrong_fields_are_refused() -> None:
    with pytest.raises(CdrError, match="has no field 'torque'"):
        encode(JOINT_STATE, 1, {"torque": [1.0]}, names=("lift",))
    with pytest.raises(CdrError, match="takes 3 values, found 2"):
        encode(POINT_STAMPED, 1, {"point": [1.0, 2.0]})
    uneven = encode(JOINT_STATE, 1, {"position": [1.0]}, names=("lift", "tilt"))
    with pytest.raises(CdrError, match="no or 2 values of position, found 1"):
        layout_of(uneven, JOINT_STATE)
