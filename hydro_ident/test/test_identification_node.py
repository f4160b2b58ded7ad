"""`identification_node` as a process: a latched answer from a bag, and one line on an error."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from hydro_ident.identify.identification_node import run
from hydro_model.command_line.command import run_command
from hydro_model.hydraulics.cylinder import lever
from hydro_model.multibody.base_parameters import base_map
from hydro_model.multibody.rigid_body import inverse_dynamics
from hydro_model.robot import Robot

pytestmark = pytest.mark.ros
H = 0.002
COMMAND = [sys.executable, "-m", "hydro_ident.identify.identification_node"]


def _environment() -> dict[str, str]:
    domain = str(10 + (os.getpid() + 20) % 90)
    return {**os.environ, "ROS_DOMAIN_ID": domain, "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}


@pytest.fixture
def bag(robot: Robot, write_bag: Callable[..., Path]) -> Path:
    """Pressures that carry exactly the forces of a motion: no voltages, so no valves."""
    t = np.arange(0.0, 12.0, H)[:, None]
    sizes, rates = np.array([0.3, 0.4]), np.array([1.1, 1.7])
    q = np.array([0.8, -1.2]) + sizes * np.sin(rates * t)
    qd, qdd = sizes * rates * np.cos(rates * t), -sizes * rates**2 * np.sin(rates * t)
    torque = inverse_dynamics(robot, q, qd, qdd)
    pressures = np.full((t.size, 6), 2.0e6)
    for i, cylinder in enumerate(robot.cylinders):
        arm = lever(cylinder, q[:, i])
        force = torque[:, i] / arm + 4.0e4 * arm * qd[:, i]
        pressures[:, 2 * i] = (force + 2.0e6 * cylinder.area_b_m2) / cylinder.area_a_m2
    columns = {
        "/joint_states": (robot.joint_names, {"position": q}),
        "/chamber_pressures": (
            robot.pressure_names,
            {"effort": pressures + robot.atmospheric_pressure_pa},
        ),
    }
    return write_bag(columns, name="exact")


@pytest.fixture
def node(bag: Path) -> Iterator[subprocess.Popen[str]]:
    arguments = ["--ros-args", "-p", f"bags:=['{bag}']", "-p", "robot:=xs031"]
    process = subprocess.Popen([*COMMAND, *arguments], env=_environment(), text=True)
    yield process
    if process.poll() is None:
        process.kill()
    process.wait()


def _receive(seconds: float) -> object:
    """The latched message, by a subscriber in a process of its own: rclpy has one context."""
    code = (
        "import rclpy, json\n"
        "from sensor_msgs.msg import JointState\n"
        "from hydro_msgs_docs.topics import BASE_PARAMETERS, latched\n"
        "rclpy.init()\n"
        "n = rclpy.create_node('listener')\n"
        "got = []\n"
        "n.create_subscription(JointState, BASE_PARAMETERS, got.append, latched())\n"
        "while not got: rclpy.spin_once(n, timeout_sec=0.2)\n"
        "m = got[0]\n"
        "print(json.dumps([list(m.name), list(m.effort), list(m.velocity)]))\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code],
        env=_environment(),
        capture_output=True,
        text=True,
        timeout=seconds,
        check=True,
    )
    import json

    return json.loads(done.stdout)


@pytest.mark.needs("clarabel")
def test_a_late_subscriber_gets_the_identified_parameters(
    node: subprocess.Popen[str], robot: Robot
) -> None:
    names, values, deviations = _receive(300.0)  # type: ignore[misc]
    base = base_map(robot)
    truth = dict(zip(base.names, base.combination @ robot.parameter_vector, strict=True))
    found = dict(zip(names, values, strict=True))
    # What cannot be told (barrels and rods here) is held, and not published.
    links = {name: value for name, value in truth.items() if "_link." in name}
    assert links.keys() <= found.keys()
    for name, value in links.items():
        assert found[name] == pytest.approx(value, rel=1e-3, abs=0.05)
    assert found["tilt_cylinder.viscous_friction"] == pytest.approx(4.0e4, rel=1e-3)
    assert len(deviations) == len(names)
    assert node.poll() is None
    node.send_signal(signal.SIGINT)
    assert node.wait(timeout=60) == 0


@pytest.mark.needs("clarabel")
@pytest.mark.parametrize(
    ("arguments", "code", "message"),
    [
        ([], 2, "parameter 'bags' is missing"),
        (["-p", "bags:=['/no/such/bag']", "-p", "robot:=xs031"], 2, "/no/such/bag"),
        (["-p", "bags:=3", "-p", "robot:=xs031"], 2, "parameter 'bags' should be"),
        (["-p", "bags:=['x']", "-p", "robot:=nobody"], 2, "no robot file 'nobody'"),
    ],
)
def test_bad_parameters_are_one_line(
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
    arguments: list[str],
    code: int,
    message: str,
) -> None:
    """One of them as a process of its own, too."""
    for name, value in _environment().items():
        monkeypatch.setenv(name, value)
    words = ["--ros-args", *arguments]
    with monkeypatch.context() as patch:
        patch.setattr(signal, "signal", lambda number, handler: None)
        ended = [(run_command("identification_node", run, words), capfd.readouterr().err)]
    if not arguments:
        done = subprocess.run(
            [*COMMAND, *words],
            capture_output=True,
            text=True,
            timeout=120,
            check=False,
        )
        ended.append((done.returncode, done.stderr))
    for found, told in ended:
        assert found == code
        assert message in told
        assert "Traceback" not in told
        assert told.count("\n") == 1
