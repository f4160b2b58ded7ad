"""Readings and commands through frames and back; layouts of other labs' DBCs; bus load."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import can
import cantools
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hydro_hw_bridge.protocol.calibration import Calibration, calibrated_mapping
from hydro_hw_bridge.protocol.codec import Codec
from hydro_hw_bridge.protocol.frames import Echo, Readings, Status
from hydro_hw_bridge.protocol.layout import load_layout
from hydro_hw_bridge.protocol.signals import raw_signal
from hydro_model.robot import Robot

Make = Callable[..., Readings]


def received(codec: Codec, messages: list[can.Message]) -> Readings:
    frames = [codec.receive(message) for message in messages]
    assert all(frame is not None and frame.intact for frame in frames)
    return codec.readings({frame.name: frame.data for frame in frames if frame is not None})


@given(
    st.integers(0, 2**32 - 1),
    st.lists(st.floats(-3.0, 3.0), min_size=2, max_size=2),
    st.lists(st.floats(-0.9e6, 31e6), min_size=6, max_size=6),
    st.lists(st.floats(-1.0, 1.0), min_size=2, max_size=2),
    st.tuples(*[st.booleans()] * 7),
    st.tuples(st.integers(0, 10_000), st.integers(0, 10_000)),
)
def test_readings_round_trip_within_half_a_count(
    codec: Codec,
    counter: int,
    positions: list[float],
    pressures: list[float],
    spools: list[float],
    bits: tuple[bool, ...],
    heard: tuple[int, int],
) -> None:
    values = (tuple(positions), tuple(pressures), tuple(spools), ())
    sent = Readings(counter, Status(*bits), *values, 41.3, Echo(*heard))
    got = received(codec, codec.encode_cycle(sent))
    assert got.counter == counter
    assert got.status == sent.status
    assert codec.echo_spans == (256, 32)
    assert got.echo == Echo(heard[0] % 256, heard[1] % 32)
    count_rad = 2.0 * math.pi / 2**20
    assert got.positions == pytest.approx(positions, abs=0.5001 * count_rad, rel=0)
    assert got.pressures_pa == pytest.approx(pressures, abs=250.001, rel=0)
    assert got.spools == pytest.approx(spools, abs=2.6e-5, rel=0)
    assert got.oil_temperature_c == pytest.approx(41.3, abs=0.04)
    # What was decoded encodes to the same frames: nothing drifts from hop to hop.
    again = codec.encode_cycle(got)
    assert [m.data for m in again] == [m.data for m in codec.encode_cycle(sent)]


def test_sensors_saturate_as_transducers_do(codec: Codec, readings: Make) -> None:
    high = readings(1, pressures_pa=(1e9, -1e9, 0.0, 0.0, 0.0, 0.0), positions=(1e6, -1e6))
    got = received(codec, codec.encode_cycle(high))
    assert got.pressures_pa[:2] == (31_767_500.0, -1_000_000.0)
    assert got.positions[0] > 50.0
    assert got.positions[1] < -50.0


@pytest.mark.parametrize("voltage", [-10.0, -0.0005, 0.0, 0.00025, 3.2101, 10.0])
@pytest.mark.parametrize("counter", [0, 15, 65535, 65536, 2**32 - 1])
def test_commands_round_trip_and_name_their_cycle(
    codec: Codec, voltage: float, counter: int
) -> None:
    frame = codec.receive(codec.encode_command(counter, (voltage, -voltage), True))
    assert frame is not None
    assert frame.alive == counter % 16
    command = codec.decode_command(frame)
    assert command.voltages == codec.quantised((voltage, -voltage))
    assert command.voltages == pytest.approx((voltage, -voltage), abs=0.000251)
    assert command.enable
    assert command.answers(counter)
    assert not command.answers(counter + 1)
    assert not command.answers(counter + 16)


def test_full_and_no_voltage_are_exact(codec: Codec) -> None:
    assert codec.quantised((10.0, -10.0)) == (10.0, -10.0)
    assert codec.quantised((0.0, -0.0)) == (0.0, 0.0)


def test_foreign_frames_are_not_ours(codec: Codec) -> None:
    assert codec.receive(can.Message(arbitration_id=0x555, is_extended_id=False)) is None
    assert codec.receive(can.Message(arbitration_id=0x80, is_extended_id=True)) is None
    remote = can.Message(arbitration_id=0x80, is_extended_id=False, is_remote_frame=True, dlc=8)
    frame = codec.receive(remote)
    assert frame is not None
    assert not frame.intact


def test_calibration_shifts_zeros_and_turns_valves(robot: Robot, codec: Codec) -> None:
    calibration = Calibration(
        name="20260101-120000_xs031",
        robot="xs031",
        mapping="xs031",
        pressure_zero_pa={"supply": 40_000.0},
        position_offset={"tilt": 0.25},
        valve_sign={"tilt_valve": -1},
    )
    mapping = calibrated_mapping(codec.mapping, calibration, robot.name)
    bridge = Codec(robot, mapping, load_layout(mapping.dbc, mapping, robot))
    device = Readings(7, Status(), (0.1, 0.2), (0.0,) * 4 + (19e6, 1e6), (0.5, 0.5), (), 20.0)
    got = received(bridge, codec.encode_cycle(device))
    assert got.positions == pytest.approx((0.1, 0.45), abs=1e-5)
    assert got.pressures_pa[4] == pytest.approx(19e6 - 40e3)
    assert got.pressures_pa[5] == pytest.approx(1e6)
    assert got.spools == pytest.approx((0.5, -0.5))
    frame = codec.receive(bridge.encode_command(7, (2.0, 2.0), True))
    assert frame is not None
    assert codec.decode_command(frame).voltages == pytest.approx((2.0, -2.0))


def test_absolute_transducers_become_gauge_inside(
    robot: Robot, codec: Codec, tmp_path: Path, readings: Make
) -> None:
    text = codec.mapping.source.read_text(encoding="utf-8")
    text = text.replace("SupplyPressure, reference: gauge", "SupplyPressure, reference: absolute")
    (tmp_path / "m.yaml").write_text(text, encoding="utf-8")
    absolute = Codec.load(codec.mapping.dbc, tmp_path / "m.yaml", robot)
    got = received(absolute, codec.encode_cycle(readings(1)))
    assert got.pressures_pa[4] == pytest.approx(19e6 - robot.atmospheric_pressure_pa)
    assert got.pressures_pa[0] == pytest.approx(5e6)


def test_bus_load_counts_worst_case_stuffing(codec: Codec) -> None:
    # Davis et al. 2007: 8 data bytes and a standard identifier take at most 135 bits.
    assert {frame.worst_case_bits for frame in codec.layout.frames} == {135}
    assert codec.layout.bus_load == pytest.approx((6 * 135 * 500 + 135 * 10) / 1e6)
    assert codec.layout.bus_load <= 0.5
    assert "40.6 %" in codec.layout.describe_load()


MOTOROLA = """VERSION ""
BU_: A
BO_ 100 MIXED: 8 A
 SG_ BigSigned : 7|13@0- (0.5,3) [0|0] "" A
 SG_ BigUnsigned : 10|11@0+ (2,0) [0|0] "" A
 SG_ LittleSigned : 32|17@1- (1,-7) [0|0] "" A
 SG_ LittleUnsigned : 49|15@1+ (1,0) [0|0] "" A
"""


@given(st.binary(min_size=8, max_size=8))
def test_raw_signals_are_those_of_cantools_in_either_byte_order(data: bytes) -> None:
    message = cantools.database.load_string(MOTOROLA, "dbc").get_message_by_name("MIXED")
    expected = message.decode(data, decode_choices=False, scaling=False)
    packed = bytearray(8)
    for signal in message.signals:
        raw = raw_signal(message, signal)
        assert raw.unpack(data) == expected[signal.name]
        assert raw.low <= raw.unpack(data) <= raw.high
        raw.pack(raw.unpack(data), packed)
    assert message.decode(bytes(packed), decode_choices=False, scaling=False) == expected


def test_cantools_decodes_to_the_same_values(codec: Codec, readings: Make) -> None:
    database = cantools.database.load_file(codec.mapping.dbc)
    messages = codec.encode_cycle(readings(99))
    got = received(codec, messages)
    by_name: dict[str, float] = {}
    for message in messages:
        by_name.update(database.decode_message(message.arbitration_id, bytes(message.data)))
    for i, channel in enumerate(codec.mapping.pressures.values()):
        assert got.pressures_pa[i] == by_name[channel.signal.split(".")[1]]
    for i, channel in enumerate(codec.mapping.joints.values()):
        assert got.positions[i] == by_name[channel.signal.split(".")[1]] * channel.scale
