"""What `network.md` says of SROS 2 with the installed middleware."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
DOMAIN = 10 + (os.getpid() + 57) % 90
#: What an enclave holds. A middleware without security asks only whether they are there; one
#: with it finds them broken.
FILES = (
    *("identity_ca.cert.pem", "cert.pem", "key.pem"),
    *("permissions_ca.cert.pem", "governance.p7s", "permissions.p7s"),
)
NODE = """
import rclpy, sys
rclpy.init(args=["x", "--ros-args", "--enclave", "/hydro/x"])
rclpy.create_node("x")
print("came up")
"""


def _started(keys: Path, strategy: str, *command: str) -> subprocess.CompletedProcess[str]:
    asked = {
        "ROS_SECURITY_ENABLE": "true",
        "ROS_SECURITY_STRATEGY": strategy,
        "ROS_SECURITY_KEYSTORE": str(keys),
        "ROS_DOMAIN_ID": str(DOMAIN),
    }
    return subprocess.run(
        list(command),
        env={**os.environ, **asked},
        capture_output=True,
        text=True,
        check=False,
        timeout=240,
    )


@pytest.fixture
def keys(tmp_path: Path) -> Path:
    """A keystore with one enclave, `/hydro/x`."""
    enclave = tmp_path / "enclaves" / "hydro" / "x"
    enclave.mkdir(parents=True)
    for name in FILES:
        (enclave / name).write_text("no key\n", encoding="utf-8")
    return tmp_path


@pytest.mark.ros
def test_where_security_is_enforced_and_not_there_no_node_comes_up(keys: Path) -> None:
    done = _started(keys, "Enforce", sys.executable, "-c", NODE)
    assert done.returncode != 0
    assert "came up" not in done.stdout
    assert "security" in done.stderr.lower()


@pytest.mark.ros
def test_the_bridge_does_not_drive_without_its_keys(keys: Path) -> None:
    bridge = ROOT / "ros2_ws/install/hydro_hw_bridge/lib/hydro_hw_bridge/can_bridge"
    for enclave in ("/hydro/x", "/hydro/absent"):
        arguments = [
            "--ros-args",
            "--enclave",
            enclave,
            "-p",
            "can:=udp_multicast:239.74.163.9:43199",
        ]
        done = _started(keys, "Enforce", str(bridge), *arguments)
        assert done.returncode != 0
        assert "security" in done.stderr.lower()


@pytest.mark.ros
def test_where_it_is_only_permitted_a_node_without_keys_comes_up_unprotected(keys: Path) -> None:
    """Why the page says never to use it."""
    node = NODE.replace("/hydro/x", "/hydro/absent")
    done = _started(keys, "Permissive", sys.executable, "-c", node)
    assert done.returncode == 0, done.stderr
    assert "came up" in done.stdout
