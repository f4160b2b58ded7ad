"""How old a valve command the simulated amplifiers take."""

from __future__ import annotations

from dataclasses import replace

import pytest

from hydro_hw_bridge.bus.bus import Bus
from hydro_hw_bridge.bus.bus_name import BusName
from hydro_hw_bridge.protocol.codec import Codec
from hydro_hw_bridge.protocol.frames import CommandFrame
from hydro_hw_bridge.rig.core import RigCore
from hydro_hw_bridge.rig.device import Counters, Device
from hydro_hw_bridge.rig.truth_files import load_truth
from hydro_model.robot import Robot

#: 10 ms that drive, 50 ms of 0 V and enable off.
DRIVES, STOPS = 5, 25
COMMAND = CommandFrame(0, 16, (1.0, 0.0), True)


@pytest.fixture(scope="module")
def device(robot: Robot, codec: Codec) -> Device:
    core = RigCore(robot, load_truth("realistic", robot))
    return Device(core, codec, Bus(BusName("no", "bus"), object()), lockstep=False)


@pytest.fixture
def in_lockstep(robot: Robot, codec: Codec) -> Device:
    core = RigCore(robot, load_truth("realistic", robot))
    return Device(core, codec, Bus(BusName("no", "bus"), object()), lockstep=True)


@pytest.mark.parametrize("counter", [1000, 2, (1 << 16) + 3, (1 << 32) - 1])
@pytest.mark.parametrize(("enable", "oldest"), [(True, DRIVES), (False, STOPS)])
def test_a_command_is_taken_up_to_its_age_and_then_counted(
    device: Device, counter: int, enable: bool, oldest: int
) -> None:
    device.core.counter = counter
    before = replace(device.counters)
    for age in range(oldest + 1):
        command = replace(COMMAND, answered=(counter - age) % (1 << 16), enable=enable)
        assert device.takes(command)
    assert device.counters == replace(before, taken=before.taken + oldest + 1)
    for age in (oldest + 1, oldest + 2, 300, -1):  # the last is of a cycle that has not been
        command = replace(COMMAND, answered=(counter - age) % (1 << 16), enable=enable)
        assert not device.takes(command)
    assert device.counters.taken == before.taken + oldest + 1
    assert device.counters.stale == before.stale + 4


def test_of_a_counter_of_four_bits_no_more_than_it_can_tell(device: Device) -> None:
    device.core.counter = 1000
    for age in range(16):
        command = replace(COMMAND, answered=(1000 - age) % 16, answered_bits=4, enable=False)
        assert device.takes(command)
        assert device.takes(replace(command, enable=True)) is (age <= DRIVES)


@pytest.mark.parametrize("counter", [1000, (1 << 16) + 3])
@pytest.mark.parametrize("enable", [True, False])
def test_in_lockstep_the_answer_to_the_cycle_at_hand_alone_is_taken(
    in_lockstep: Device, counter: int, enable: bool
) -> None:
    """However quick the computer is, what drives is the answer to what was measured last."""
    in_lockstep.core.counter = counter
    for age in (1, DRIVES, -1, 300):
        command = replace(COMMAND, answered=(counter - age) % (1 << 16), enable=enable)
        assert not in_lockstep.takes(command)
    assert in_lockstep.takes(replace(COMMAND, answered=counter % (1 << 16), enable=enable))
    assert in_lockstep.counters == Counters(taken=1, stale=4)
