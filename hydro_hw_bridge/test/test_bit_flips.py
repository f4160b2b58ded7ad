"""Every bit of every frame flipped on its way, one at a time, machine and bridge core to core."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import pytest

from hydro_hw_bridge.faults.bench import Bench, WatchedCodec
from hydro_hw_bridge.faults.bus_faults import BRIDGE, DEVICE, BusFault
from hydro_hw_bridge.faults.naming import Diagnosis
from hydro_hw_bridge.faults.wave import Wave
from hydro_hw_bridge.gate.gate import GateState
from hydro_hw_bridge.gate.gate_limits import GateLimits
from hydro_hw_bridge.rig.core import RigCore
from hydro_hw_bridge.rig.truth_files import load_truth
from hydro_model.robot import Robot

AT, EVERY, BITS = 20, 3, 64
FLIPPED = [AT + EVERY * bit for bit in range(BITS)]


def driven(robot: Robot, direction: str, frame: int, cycles: Sequence[int]) -> Bench:
    """A machine that is driven while one bit after the other of a frame is flipped."""
    rated = tuple(valve.rated_voltage_v for valve in robot.valves)
    limits = GateLimits(robot.valve_names, rated, 0.002, 1000.0, 5, 2.0e6)
    wave = Wave(robot.valve_names, rated, 2.0, frequency_hz=3.0, period_s=limits.period_s)
    faults = [
        BusFault("bit_flip", cycle, 1, direction, (frame,), amount=bit)
        for bit, cycle in enumerate(cycles)
    ]
    rig = RigCore(robot, load_truth("realistic", robot), seed=1)
    bench = Bench(rig, WatchedCodec.load(None, None, robot), limits, wave, bus=faults)
    bench.run(AT + EVERY * BITS + 2)
    assert bench.core.gate.state is GateState.DRIVING, bench.core.gate.reason
    assert bench.line.injected == len(cycles)
    return bench


@pytest.fixture(scope="module")
def device_ids(robot: Robot) -> tuple[int, ...]:
    return WatchedCodec.load(None, None, robot).device_ids


def test_without_flips_every_cycle_is_a_sample_and_changes_the_valves(
    robot: Robot, device_ids: tuple[int, ...]
) -> None:
    bench = driven(robot, DEVICE, device_ids[0], ())
    assert [s.counter for s in bench.samples] == list(range(AT + EVERY * BITS + 2))
    assert bench.core.assembler.counters.corrupt == bench.device.counters.corrupt == 0
    rows = bench.rows[AT:]
    assert all(a.voltages != b.voltages for a, b in pairwise(rows))


def test_a_flipped_bit_of_any_frame_of_the_machine_makes_no_sample(
    robot: Robot, device_ids: tuple[int, ...]
) -> None:
    assert len(device_ids) > 4
    for frame in device_ids:
        bench = driven(robot, DEVICE, frame, FLIPPED)
        whole = set(range(AT + EVERY * BITS + 2)) - set(FLIPPED)
        assert {s.counter for s in bench.samples} == whole, hex(frame)
        assert bench.partial_samples() == []
        counters = Diagnosis.of(bench.core, bench.end).counters
        assert counters["cycles_corrupt"] == BITS, hex(frame)


def test_a_flipped_bit_of_a_valve_frame_drives_nothing_and_is_counted(robot: Robot) -> None:
    valve_frame = WatchedCodec.load(None, None, robot).bridge_ids[0]
    bench = driven(robot, BRIDGE, valve_frame, FLIPPED)
    delay = bench.rig.truth.command_delay_cycles
    for cycle in range(AT, AT + EVERY * BITS):
        before, row = (bench.rows[cycle + delay - k].voltages for k in (1, 0))
        assert (row == before) is (cycle in FLIPPED), cycle
    assert bench.device.counters.corrupt == BITS
    counters = Diagnosis.of(bench.core, bench.end).counters
    assert counters["valve_frames_refused"] == BITS
    assert counters["trips"] == 0
