"""`can_bridge` where something is wrong: a second bridge, bus-off, a silent device."""

from __future__ import annotations

import re
import subprocess
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from hydro_hw_bridge.bus.claims import GONE_S

pytestmark = pytest.mark.ros

PERIOD_NS = 2_000_000
ACTIVATE = 3
Run = Callable[..., subprocess.CompletedProcess[str]]


def test_a_second_bridge_is_refused_and_the_first_goes_on(
    ros: Any, device: Any, processes: Any, can_name: str, run_bridge: Run
) -> None:
    # In lockstep the device may be silent, so nothing but the other bridge can trip this one.
    ros.bring_up(processes, can_name, "clock:=lockstep", installed=True)
    device.lockstep = True
    second = run_bridge(can_name, "robot:=xs031")
    assert second.returncode == 2
    assert second.stdout == ""
    assert second.stderr.count("\n") == 1
    assert second.stderr.startswith("can_bridge: another bridge (instance ")
    assert processes[0].poll() is None
    # One that appears without asking first trips the bridge that drives.
    stamp = ros.first_sample(device, 0)
    ros.transition(ACTIVATE)
    ros.send_and_hear(device, 1, stamp + PERIOD_NS)
    assert ros.answer_to(device, stamp + PERIOD_NS, 0.5, 0.5).enable
    device.bus.send(device.codec.encode_claim(0x1234, 7))
    answer = device.answer()
    assert (answer.voltages, answer.enable) == ((0.0, 0.0), False)
    ros.until(lambda: "a second bridge is on the bus" in ros.diagnosis()["message"])
    alive, heard_at = 7, time.monotonic()

    def refused() -> bool:
        """It claims again, as one that lives does: a single claim may be old once it is asked."""
        nonlocal alive, heard_at
        alive, heard_at = alive + 1, time.monotonic()
        device.bus.send(device.codec.encode_claim(0x1234, alive))
        return "still there: a second bridge is on the bus" in ros.clear().message

    ros.until(refused)
    # Gone, once it was not heard for long enough.
    ros.until(lambda: ros.clear().success)
    assert time.monotonic() - heard_at > GONE_S


def test_bus_off_trips_and_comes_back_at_zero(
    ros: Any, device: Any, processes: Any, can_name: str, tmp_path: Path
) -> None:
    faults = tmp_path / "faults"
    simulated = f"{can_name.replace('udp_multicast', 'simulated_faults')}:{faults}"
    ros.bring_up(processes, simulated, "clock:=lockstep")
    assert "bus-off and error frames are SIMULATED" in processes.log.read_text(encoding="utf-8")
    device.lockstep = True
    stamp = ros.first_sample(device, 0)
    faults.write_text("error_frames 3")
    ros.until(lambda: ros.diagnosis()["bus_error_frames"] == "3")
    assert ros.diagnosis()["bus_last_error_frame"] == "protocol violation, bus error"
    ros.transition(ACTIVATE)
    assert ros.answer_to(device, stamp, 1.0, 1.0).enable
    faults.write_text("bus_off")
    ros.until(lambda: ros.diagnosis()["message"].startswith("tripped: bus-off"))
    assert ros.diagnosis()["bus_off"] == "yes"
    device.send(1)
    assert device.commands(0.3) == []
    assert ros.clear().message.startswith("still there: bus-off")
    # Back on the bus: 0 V until cleared.
    faults.write_text("ok")
    ros.until(lambda: ros.diagnosis()["bus_off"] == "no")
    assert ros.diagnosis()["bus_last_error_frame"] == "controller restarted"
    for counter in range(1, 8):
        device.send(counter)
        answer = device.answer()
        assert answer.answers(counter)
        assert (answer.voltages, answer.enable) == ((0.0, 0.0), False)
    assert ros.clear().success
    ros.send_and_hear(device, 8, stamp + 8 * PERIOD_NS)
    # After a cleared trip the first second is slow: 10 V/s.
    answer = ros.answer_to(device, stamp + 8 * PERIOD_NS, 1.0, 1.0)
    assert answer.voltages == (0.02, 0.02)
    assert "Traceback" not in processes.log.read_text(encoding="utf-8")


def test_silence_is_counted_from_sync_frames_not_from_any(
    ros: Any, device: Any, processes: Any, can_name: str
) -> None:
    ros.bring_up(processes, can_name)
    stamp = ros.first_sample(device, 0)
    ros.transition(ACTIVATE)
    device.send(1)
    assert not device.answer().enable
    assert ros.answer_to(device, stamp + PERIOD_NS, 1.0, 1.0).enable
    encoders = device.codec.encode_cycle(device.readings(1))[1]
    claim = device.codec.encode_claim(0, 0)
    claim.data[0] ^= 1
    end = time.monotonic() + 0.2
    while time.monotonic() < end:
        for message in (encoders, claim):
            device.bus.send(message)
        time.sleep(0.005)
    # Nothing at all for so long, where this computer is too busy.
    said = re.compile("(nothing|no sync frame) from the device for 10 ms")
    ros.until(lambda: said.search(ros.diagnosis()["message"]))
