"""A load at the tip of the rig: its inertia and weight, its instant, its argument."""

from __future__ import annotations

import argparse
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from hydro_hw_bridge.errors import BridgeError
from hydro_hw_bridge.rig.core import RigCore
from hydro_hw_bridge.rig.payload import Payload, payload_argument
from hydro_hw_bridge.rig.plant import Plant
from hydro_hw_bridge.rig.pose import tip_frame
from hydro_hw_bridge.rig.truth_files import load_truth
from hydro_hw_bridge.rig.truth_log import read_truth_log
from hydro_model.robot import FloatArray, Robot

BUS = "udp_multicast:239.74.163.2:43961"
POSE = np.array([0.5, -1.5])


def test_load_adds_its_jacobian_square_and_its_weight(robot: Robot) -> None:
    plant = Plant(robot, load_truth("realistic", robot), POSE)
    _, jacobian = tip_frame(robot, POSE)
    empty = plant.equations(POSE, np.zeros(2))
    plant.load_tip(50.0)
    loaded = plant.equations(POSE, np.zeros(2))
    np.testing.assert_allclose(loaded[0] - empty[0], 50.0 * jacobian.T @ jacobian, rtol=1e-9)
    weight = -50.0 * jacobian.T @ robot.gravity_m_s2
    np.testing.assert_allclose(loaded[1] - empty[1], weight, rtol=1e-9)
    # In motion too: power of the bias is the rate of M, so the kinetic energy stays consistent.
    qd, step = np.array([0.3, -0.4]), 1e-6
    ahead, behind = (plant.equations(POSE + s * qd, qd)[0] for s in (step, -step))
    rate = 0.5 * qd @ ((ahead - behind) / (2.0 * step)) @ qd
    bias = plant.equations(POSE, qd)[1] - plant.equations(POSE, np.zeros(2))[1]
    assert qd @ bias == pytest.approx(rate, rel=1e-6)


def test_a_load_replaces_the_one_before_and_none_is_the_truth_again(robot: Robot) -> None:
    plant = Plant(robot, load_truth("realistic", robot), POSE)
    empty = plant.equations(POSE, np.zeros(2))[0]
    plant.load_tip(80.0)
    plant.load_tip(50.0)
    fifty = plant.equations(POSE, np.zeros(2))[0]
    once = Plant(robot, load_truth("realistic", robot), POSE)
    once.load_tip(50.0)
    np.testing.assert_array_equal(fifty, once.equations(POSE, np.zeros(2))[0])
    plant.load_tip(0.0)
    np.testing.assert_array_equal(plant.equations(POSE, np.zeros(2))[0], empty)


def rows(robot: Robot, payloads: tuple[Payload, ...], parked: int = 0) -> FloatArray:
    core = RigCore(robot, load_truth("realistic", robot), q=POSE.tolist(), payloads=payloads)
    for _ in range(parked):
        core.actuate(None)
    out = []
    for _ in range(100):
        core.actuate([1.0, -1.0])
        out.append(core.truth_row()[4:])
    return np.array(out)


def test_it_comes_at_its_instant_since_the_first_drive(robot: Robot) -> None:
    late = (Payload(50.0, 0.1),)
    with_load, without = rows(robot, late), rows(robot, ())
    np.testing.assert_array_equal(with_load[:50], without[:50])
    assert np.any(with_load[50] != without[50])
    np.testing.assert_array_equal(rows(robot, late), with_load)
    # Parked cycles do not count.
    np.testing.assert_array_equal(rows(robot, late, parked=30), with_load)
    # Velocities do not jump with it.
    n = robot.dof
    assert np.abs(np.diff(with_load[45:55, n : 2 * n], axis=0)).max() < 0.02


def test_argument() -> None:
    assert payload_argument("50@6.5") == Payload(50.0, 6.5)
    assert payload_argument("20") == Payload(20.0, 0.0)
    for text in ("-1@2", "x@2", "50@", "5@-1", "nan@1"):
        if text == "50@":
            assert payload_argument(text) == Payload(50.0)
            continue
        with pytest.raises(argparse.ArgumentTypeError, match="KG@S"):
            payload_argument(text)
    with pytest.raises(BridgeError, match="mass in kg of 0 or more"):
        Payload(-1.0)


@pytest.mark.processes
def test_the_side_file_says_what_was_loaded(tmp_path: Path) -> None:
    out = tmp_path / "truth.npz"
    main = "from hydro_hw_bridge.rig.command import main; raise SystemExit(main())"
    arguments = ["--can", BUS, "--real-time", "--cycles", "3", "--truth-out", str(out)]
    done = subprocess.run(
        [sys.executable, "-c", main, *arguments, "--payload", "50@6", "0@12"],
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
    )
    assert done.returncode == 0, done.stderr
    assert read_truth_log(out).facts["payloads"] == [
        {"mass_kg": 50.0, "from_s": 6.0},
        {"mass_kg": 0.0, "from_s": 12.0},
    ]
