"""Signals to the processes of a running machine, and what stands at the rig's valves then.

The bridge is killed in `test_bridge_cut_off.py`, `calibrate` in `test_calibrate_cut_off.py`, the
recorder in `test_recorder_faults.py`, all of them in real time by `scripts/faults.sh`.
"""

from __future__ import annotations

import signal
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hydro_hw_bridge.faults.injection import AGE, WATCHDOG
from hydro_hw_bridge.rig.truth_log import read_truth_log
from hydro_ident.bag.writer import BagWriter
from hydro_model.robot_files import load_robot
from hydro_msgs_docs import topics

pytestmark = pytest.mark.ros
ROBOT = load_robot("xs031")
STOPPED = (False, (0.0, 0.0))
PERIOD_NS = 2_000_000
LISTENING = ("visual_joints", "identification_node")
RESTARTED = "the device restarted: its sample counter went back"
NO_DEVICE = "waiting for the device"
#: The second after a trip was cleared.
SLOW_CYCLES = 500
#: More than a rig keeps before it writes them down.
RIG_CYCLES = 300


@pytest.mark.thorough
def test_a_path_that_was_not_sent_yet_is_never_played(chain: Any) -> None:
    """`send_path` waits for a controller; one dies and one stands still before there is one."""
    ros = chain.ros
    ros.until(lambda: ros.node.count_publishers(topics.JOINT_TRAJECTORY) == 3)
    assert chain.signal("send_path", signal.SIGKILL) == -signal.SIGKILL
    chain.signal("send_path_2", signal.SIGSTOP)
    assert chain.controller() == "controller"
    chain.answered(20)
    stood = chain.device.core.plant.q.copy()
    chain.answered(100)
    # Told to end while it stands still, it sends nothing as it goes on.
    assert chain.ended_while_it_stands("send_path_2") == -signal.SIGTERM
    chain.answered(100)
    assert ros.bridge()["gate"] == "driving"
    assert ros.asked == []
    ros.until(lambda: ros.said["controller"]["message"] == "holding")
    assert np.abs(chain.device.core.plant.q - stood).max() < 2e-3


def test_a_controller_that_is_killed_is_answered_by_the_gate_until_that_is_cleared(
    chain: Any,
) -> None:
    chain.drive()
    assert chain.signal(chain.active, signal.SIGKILL) == -signal.SIGKILL
    chain.stopped_by_the_gate()
    # The next one commands, and drives nothing.
    chain.controller()
    chain.commanded_and_stopped()
    chain.clear_and_drive()


@pytest.mark.thorough
def test_processes_beside_the_valves_way_are_killed_or_stopped_and_it_is_driven_on(
    chain: Any,
) -> None:
    ros = chain.ros
    nodes = {f"{name}{k}" for name in LISTENING for k in ("", "_2")}
    ros.until(lambda: nodes <= set(ros.node.get_node_names()))
    chain.drive()
    before, begin = ros.bridge()["trips"], len(chain.rows)
    for name in LISTENING:
        for number in (signal.SIGSTOP, signal.SIGCONT, signal.SIGTERM):
            ended = chain.signal(name, number)
            chain.answered(2 * WATCHDOG)
        assert ended == 0
        assert chain.signal(f"{name}_2", signal.SIGKILL) == -signal.SIGKILL
        chain.answered(2 * WATCHDOG)
        assert chain.driven()
    assert all(on for on, _ in chain.rows[begin:])
    now = ros.bridge()
    assert (now["gate"], now["trips"]) == ("driving", before)


def test_a_controller_that_is_stopped_does_not_drive_as_it_goes_on(chain: Any) -> None:
    chain.drive()
    chain.signal(chain.active, signal.SIGSTOP)
    chain.stopped_by_the_gate()
    chain.signal(chain.active, signal.SIGCONT)
    chain.commanded_and_stopped()
    chain.clear_and_drive()


@pytest.mark.thorough
def test_a_rig_that_is_gone_is_told_and_a_new_one_is_not_driven_unasked(chain: Any) -> None:
    """In lockstep the machine's time stands still with it: nothing is driven on meanwhile."""
    ros = chain.ros
    chain.drive()
    records = []
    for name, number in (("sim_rig", signal.SIGTERM), ("sim_rig_2", signal.SIGKILL)):
        file = chain.start_rig(name)
        assert ros.until_tripped() == RESTARTED
        at_ns = ros.until_commanded(ros.zero_ns, 2 * AGE)
        # The gate is cleared while it stands: otherwise it runs ahead of the commands.
        chain.signal(name, signal.SIGSTOP)
        ros.until_caught_up(int(ros.bridge()["sample_counter"]))
        ros.clear()
        chain.signal(name, signal.SIGCONT)
        at_ns = ros.until_commanded(at_ns, RIG_CYCLES)
        if number is signal.SIGTERM:
            chain.signal(name, signal.SIGSTOP)
            ros.until_caught_up(int(ros.bridge()["sample_counter"]))
            at_ns = ros.commands[-1]
            assert ros.said["can_bridge"]["gate"] == "driving"
            chain.signal(name, signal.SIGCONT)
            ros.until_commanded(at_ns, RIG_CYCLES)
        assert chain.signal(name, number) == (0 if number is signal.SIGTERM else -number)
        records.append(read_truth_log(file))
    ros.until(lambda: ros.said["can_bridge"]["message"] == NO_DEVICE)
    for record in records:
        on, volts = record.column("enabled"), record.columns("voltage")
        assert np.all(np.diff(record.column("counter")) == 1)
        first = int(np.argmax(on))
        assert first >= AGE  # not before it was cleared
        assert np.all(on[first:])
        assert np.abs(np.diff(volts[: first + SLOW_CYCLES], axis=0)).max() < 0.021  # 10 V/s
    chain.new_machine()
    chain.stays_stopped()
    assert ros.until_tripped() == RESTARTED
    chain.clear_and_drive()


def test_a_controller_that_is_told_to_end_stops_by_itself(chain: Any) -> None:
    chain.drive()
    trips = chain.ros.bridge()["trips"]
    chain.told_to_end()
    now = chain.ros.bridge()
    assert (now["gate"], now["trips"]) == ("waiting", trips)


def recorded_commands(path: Path) -> Path:
    """A second of 1 V on every valve, some years ago."""
    with BagWriter(path) as writer:
        writer.add_topic(topics.VALVE_COMMAND, "sensor_msgs/msg/JointState")
        for k in range(500):
            stamp = 1_700_000_000_000_000_000 + k * PERIOD_NS
            volts = {"effort": np.ones(len(ROBOT.valves))}
            writer.write_stamped(topics.VALVE_COMMAND, stamp, volts, names=ROBOT.valve_names)
    return path


@pytest.mark.thorough
def test_a_recording_that_is_played_into_a_waiting_gate_drives_nothing(chain: Any) -> None:
    """Whatever becomes of `player` meanwhile."""
    if chain.active:
        chain.drive()
        chain.told_to_end()
    before, begin = chain.ros.bridge(), len(chain.rows)
    words = (str(recorded_commands(chain.folder / "recorded")), "--loop", "--delay", "0")
    for k in ("", "_2"):
        chain.start(f"player{k}", "hydro_ident", "player", *words)
    chain.played()
    for number in (signal.SIGSTOP, signal.SIGCONT, signal.SIGTERM):
        assert chain.signal("player", number) in (None, 0)
        chain.played()
    assert chain.signal("player_2", signal.SIGKILL) == -signal.SIGKILL
    for _ in range(AGE):
        chain.answered_or_not(advance=True)
    assert set(chain.rows[begin:]) == {STOPPED}
    now = chain.ros.bridge()
    assert (now["gate"], now["trips"]) == ("waiting", before["trips"])
    assert now["commands_accepted"] == before["commands_accepted"]
    assert int(now["commands_outdated"]) > int(before["commands_outdated"]) + 3 * WATCHDOG
