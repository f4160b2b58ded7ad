"""`can_bridge` through its life: samples up, commands down, 0 V at every end."""

from __future__ import annotations

import signal
from pathlib import Path
from typing import Any

import pytest

from hydro_hw_bridge.core.supervision import READ_LATE
from hydro_hw_bridge.protocol.calibration import Calibration, calibration_text, channels_hash

pytestmark = pytest.mark.ros

PERIOD_NS = 2_000_000
ACTIVATE, DEACTIVATE = 3, 4


def reads(ros: Any, device: Any) -> bool:
    """Whether an inactive bridge says that it reads, from a device that goes on speaking."""
    device.send(device.counter)
    return bool(ros.diagnosis()["message"] == "inactive: reading")


def test_a_day_in_lockstep(
    ros: Any, device: Any, processes: Any, can_name: str, robot: Any
) -> None:
    required = "/joint_states:1 /chamber_pressures:1 /valve_state:1"
    parameters = ("clock:=lockstep", f"required_subscribers:='{required}'")
    ros.bring_up(processes, can_name, *parameters, installed=True)
    device.lockstep = True
    # Inactive: reads, publishes, says nothing on the bus.
    stamp = ros.first_sample(device, 50)
    state, pressure = ros.heard["/joint_states"][-1], ros.heard["/chamber_pressures"][-1]
    assert ros.stamp_of(pressure) == stamp
    assert list(state.name) == ["lift", "tilt"]
    assert list(state.position) == pytest.approx([0.3, -0.5], abs=3.1e-6)
    assert list(state.velocity) == [0.0, 0.0]
    assert list(pressure.name) == list(robot.pressure_names)
    gauge = [5.0e6, 2.0e6, 3.0e6, 4.0e6, 19.0e6, 1.0e6]
    assert list(pressure.effort) == [p + robot.atmospheric_pressure_pa for p in gauge]
    ros.until(lambda: ros.heard["/pressure/lift_cylinder/a"] and ros.heard["/oil_temperature"])
    reading = ros.heard["/pressure/lift_cylinder/a"][0]
    assert reading.fluid_pressure == 5.0e6 + robot.atmospheric_pressure_pa
    assert ros.stamp_of(reading) == stamp
    assert ros.heard["/oil_temperature"][0].temperature == 40.0
    assert device.commands(0.2) == []
    # Active: the command answers its cycle, at the very same stamps when the cycle is repeated.
    ros.transition(ACTIVATE)
    ros.send_and_hear(device, 50, stamp)
    assert device.commands(0.2) == []
    answer = ros.answer_to(device, stamp, 1.5, -0.5)
    assert answer.answers(50)
    assert answer.enable
    assert answer.voltages == (1.5, -0.5)
    ros.until(lambda: ros.heard["/valve_state"])
    applied = ros.heard["/valve_state"][-1]
    assert ros.stamp_of(applied) == stamp
    assert list(applied.effort) == [1.5, -0.5]
    assert list(applied.position) == pytest.approx([0.1, -0.2])
    assert {ros.stamp_of(m) for m in ros.heard["/joint_states"]} == {stamp}
    device.send(50)
    assert device.answer().voltages == (1.5, -0.5)
    # What it does already it cannot begin: refused, and it goes on.
    assert not ros.tried(ACTIVATE)
    # The next cycle, a period later whatever the wall clock says.
    ros.send_and_hear(device, 51, stamp + PERIOD_NS)
    answer = ros.answer_to(device, stamp + PERIOD_NS, 9.0, -0.5)
    assert answer.answers(51)
    assert not answer.enable
    assert answer.voltages == (0.0, 0.0)
    ros.until(lambda: "step of 7.500 V" in ros.diagnosis()["message"])
    # Tripped: device time goes on, at 0 V, until cleared.
    for counter in range(52, 60):
        device.send(counter)
        answer = device.answer()
        assert answer.answers(counter)
        assert not answer.enable
    assert ros.clear().success
    ros.send_and_hear(device, 60, stamp + 10 * PERIOD_NS)
    assert device.commands(0.2) == []
    assert ros.answer_to(device, stamp + 10 * PERIOD_NS, 1.0, 0.0).enable
    # Deactivation is 0 V at once.
    ros.transition(DEACTIVATE)
    assert not device.answer().enable
    ros.until(lambda: reads(ros, device))
    diagnosis = ros.diagnosis()
    assert diagnosis["sample_zero_stamp_ns"] == str(stamp - 50 * PERIOD_NS)
    assert diagnosis["calibration"] == "none"
    assert diagnosis["mapping"] == "xs031"
    assert diagnosis["commands_accepted"] == "2"
    assert diagnosis["cycles_complete"] == "11"


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP], ids=["term", "hup"])
def test_real_time_stale_commands_end_at_zero_and_signals_too(
    ros: Any, device: Any, processes: Any, can_name: str, number: signal.Signals
) -> None:
    ros.bring_up(processes, can_name)
    stamp = ros.first_sample(device, 0)
    ros.transition(ACTIVATE)
    device.send(1)
    assert not device.answer().enable
    assert ros.answer_to(device, stamp + PERIOD_NS, 1.0, 1.0).enable
    # Five cycles without a command are legal, the sixth is not.
    driven = device.counter
    for counter in range(driven + 1, driven + 6):
        device.send(counter)
    device.send(driven + 6)
    answer = device.answer()
    assert not answer.enable
    assert answer.voltages == (0.0, 0.0)
    # So do the device's own silence and frames read late, where the machine is too busy.
    stops = ("no command for 12 ms", "nothing from the device for 10 ms", READ_LATE)
    ros.until(lambda: ros.diagnosis()["trip_reason"].startswith(stops))
    # The emergency stop keeps it tripped, with the reason said.
    ros.send_and_hear(
        device, driven + 7, stamp + (driven + 7) * PERIOD_NS, emergency_stop_ok=False
    )
    refused = ros.clear()
    assert not refused.success
    assert refused.message == "still there: emergency stop"
    ros.send_and_hear(device, driven + 8, stamp + (driven + 8) * PERIOD_NS)
    assert ros.clear().success
    device.commands(0.1)
    assert ros.answer_to(device, stamp + (driven + 8) * PERIOD_NS, 1.0, 1.0).enable
    processes[0].send_signal(number)
    assert not device.answer().enable
    assert processes.wait(0) == 0
    assert "Traceback" not in processes.log.read_text(encoding="utf-8")


def test_it_waits_for_the_subscribers_it_was_told_of(
    ros: Any, device: Any, processes: Any, can_name: str
) -> None:
    from sensor_msgs.msg import JointState

    from hydro_msgs_docs.topics import reliable

    required = "required_subscribers:='valve_state:2'"
    ros.bring_up(processes, can_name, "clock:=lockstep", required)
    device.lockstep = True
    stamp = ros.first_sample(device, 0)
    ros.transition(ACTIVATE)
    device.send(0)
    ros.ask(stamp, 1.0, 1.0)
    assert device.commands(0.5) == []
    ros.until(lambda: "/valve_state (1 of 2)" in ros.diagnosis()["message"])
    ros.node.create_subscription(JointState, "/valve_state", lambda _: None, reliable())
    ros.until(lambda: ros.node.count_subscribers("/valve_state") == 2)

    def answered() -> bool:
        device.send(0)
        ros.ask(stamp, 1.0, 1.0)
        return any(answer.enable for answer in device.commands(0.1))

    ros.until(answered)


@pytest.mark.parametrize("asleep", [False, True], ids=["usual", "main_thread_waits"])
def test_a_signal_ends_driving_within_the_age_limit_of_device_time(
    ros: Any, device: Any, processes: Any, can_name: str, asleep: bool
) -> None:
    """In lockstep, so that device time stands where the computer has no time for the bridge."""
    ros.bring_up(processes, can_name, "clock:=lockstep", asleep=asleep)
    device.lockstep = True
    stamp = ros.first_sample(device, 0)
    ros.transition(ACTIVATE)

    def followed(counter: int) -> bool:
        """Whether a command for this cycle still drives."""
        device.send(counter)
        wanted = stamp + counter * PERIOD_NS
        for _ in range(10_000):
            ros.executor.spin_once(0.001)
            if ros.stamp_of(ros.heard["/chamber_pressures"][-1]) == wanted:
                ros.ask(wanted, 1.0, 1.0)
            if (answer := device.next_command(0.001)) is not None:
                return bool(answer.enable)
        raise AssertionError(f"no valve frame for cycle {counter}")

    ros.until(lambda: ros.answer_to(device, stamp, 1.0, 1.0).enable)
    assert all(followed(counter) for counter in range(1, 20))
    processes[0].send_signal(signal.SIGTERM)
    driven = 0
    while driven < 100 and followed(20 + driven):
        driven += 1
    assert driven <= 5  # 10 ms
    assert not any(frame.enable for frame in device.commands(0.5))
    assert processes.wait(0) == 0
    assert "Traceback" not in processes.log.read_text(encoding="utf-8")


def test_a_calibration_that_lacks_a_reference_is_read_with_and_not_driven_with(
    ros: Any, device: Any, processes: Any, can_name: str, tmp_path: Path
) -> None:
    """Of the files that `calibrate` writes one after the other only the last one has it all."""
    mapping = device.codec.mapping
    signs = {"lift_valve": 1, "tilt_valve": 1}
    first = Calibration(
        "first", "xs031", "xs031", {}, {"lift": 0.0}, signs, channels_hash(mapping)
    )
    file = tmp_path / "first.calibration.yaml"
    file.write_text(calibration_text(first, {}), encoding="utf-8")
    ros.bring_up(processes, can_name, f"calibration:={file}")
    ros.first_sample(device, 0)
    assert not ros.tried(ACTIVATE)
    log = processes.until_said("activate: calibration first")
    for line in ("activate: calibration first", "not driven with calibration first"):
        assert f"{line}: expected an offset of every joint" in log
    assert "found no position_offset of tilt (--reference tilt=VALUE): measure it" in log
    ros.until(lambda: reads(ros, device))
