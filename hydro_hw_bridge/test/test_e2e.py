"""Profile 2 protection against cantools computed apart, and what it must reject."""

from __future__ import annotations

import can
import cantools
import pytest
from cantools.autosar.end_to_end import compute_profile2_crc
from hypothesis import given
from hypothesis import strategies as st

from hydro_hw_bridge.protocol.codec import Codec
from hydro_hw_bridge.protocol.e2e import PROTECTED_BITS, alive_counter, is_intact, protect


def crc8_2f(data: bytes) -> int:
    """CRC-8 of AUTOSAR (polynomial 0x2F, start and final xor 0xFF), bit by bit."""
    crc = 0xFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = (crc << 1 ^ 0x2F if crc & 0x80 else crc << 1) & 0xFF
    return crc ^ 0xFF


@given(st.binary(min_size=2, max_size=8), st.integers(0, 1 << 33))
def test_protect_is_cantools_and_the_polynomial(payload: bytes, alive: int) -> None:
    identifiers = tuple(range(100, 116))
    data = bytearray(payload)
    protect(data, alive, identifiers)
    assert alive_counter(data) == alive % 16
    assert data[1] >> 4 == payload[1] >> 4
    assert data[2:] == payload[2:]
    identifier = identifiers[alive % 16]
    assert data[0] == compute_profile2_crc(bytes(data), identifier)
    assert data[0] == crc8_2f(bytes(data[1:]) + bytes([identifier]))
    assert is_intact(data, identifiers)


@pytest.mark.parametrize("payload", [bytes(8), b"\xff" * 8])
def test_no_other_bits_than_the_protected_are_written_and_each_of_them(payload: bytes) -> None:
    """A mapping may put its signals into all others, and is refused in one of these."""
    written = 0
    for alive in range(16):
        data = bytearray(payload)
        protect(data, alive, tuple(range(16)))
        written |= int.from_bytes(data, "little") ^ int.from_bytes(payload, "little")
    assert written == PROTECTED_BITS


def test_too_short_is_not_intact() -> None:
    assert not is_intact(b"", tuple(range(16)))
    assert not is_intact(b"\x00", tuple(range(16)))


def every_frame(codec: Codec, readings: object, counter: int) -> list[can.Message]:
    assert callable(readings)
    return [
        *codec.encode_cycle(readings(counter)),
        codec.encode_command(counter, (1.5, -2.5), True),
        codec.encode_claim(0xDEADBEEF, counter),
    ]


@pytest.mark.parametrize("counter", range(16))
def test_every_single_bit_flip_of_every_frame_is_rejected(
    codec: Codec, readings: object, counter: int
) -> None:
    for message in every_frame(codec, readings, counter):
        frame = codec.receive(message)
        assert frame is not None
        assert frame.intact
        for bit in range(64):
            flipped = bytearray(message.data)
            flipped[bit // 8] ^= 1 << bit % 8
            broken = can.Message(
                arbitration_id=message.arbitration_id, is_extended_id=False, data=flipped
            )
            received = codec.receive(broken)
            assert received is not None
            assert not received.intact, f"{frame.name} bit {bit}"


def test_identifiers_differ_between_frames_so_that_none_passes_as_another(codec: Codec) -> None:
    used = [i for f in codec.layout.frames for i in f.identifiers or ()]
    assert len(used) == len(set(used)) == 16 * len(codec.layout.frames)


def test_a_frame_under_another_identifier_is_rejected(codec: Codec, readings: object) -> None:
    messages = every_frame(codec, readings, 5)
    for message in messages:
        for other in messages:
            if other.arbitration_id != message.arbitration_id:
                masked = can.Message(
                    arbitration_id=other.arbitration_id, is_extended_id=False, data=message.data
                )
                received = codec.receive(masked)
                assert received is not None
                assert not received.intact


@pytest.mark.parametrize("size", range(8))
def test_wrong_length_is_not_intact(codec: Codec, readings: object, size: int) -> None:
    for message in every_frame(codec, readings, 3):
        short = can.Message(
            arbitration_id=message.arbitration_id, is_extended_id=False, data=message.data[:size]
        )
        received = codec.receive(short)
        assert received is not None
        assert not received.intact


def test_the_dbc_describes_what_is_sent(codec: Codec, readings: object) -> None:
    database = cantools.database.load_file(codec.mapping.dbc)
    decoded = {}
    for message in every_frame(codec, readings, 0x12345678):
        decoded.update(database.decode_message(message.arbitration_id, bytes(message.data)))
    assert decoded["SampleCounter"] == 0x12345678
    assert decoded["SyncAlive"] == decoded["Pressures2Alive"] == decoded["CommandAlive"] == 8
    assert decoded["LiftPressureA"] == 5.0e6
    assert decoded["TankPressure"] == 1.0e6
    assert decoded["LiftVoltage"] == pytest.approx(1.5)
    assert decoded["TiltVoltage"] == pytest.approx(-2.5)
    assert decoded["AnsweredCounter"] == 0x5678
    assert decoded["Instance"] == 0xDEADBEEF
    assert decoded["OilTemperature"] == 40.0
    assert decoded["EmergencyStopOk"] == decoded["Enable"] == 1
    assert decoded["Parked"] == 0
