"""What nodes ask of the middleware: topics stay on this computer, what was missed comes soon.

Unless the environment says otherwise, in scripts and nodes.
"""

from __future__ import annotations

import os
import re
import socket
import subprocess
import sys
import time
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest

from hydro_ident.bench import processes
from hydro_ident.study.faults import __main__ as faults
from hydro_msgs_docs.middleware import (
    LOCAL,
    PROFILES,
    PROFILES_FILE,
    RANGE,
    prepare_middleware,
    unused_domain,
)

ROOT = Path(__file__).parents[1]
PACKAGES = ("hydro_control", "hydro_hw_bridge", "hydro_ident", "hydro_msgs_docs")
DOMAIN = 10 + (os.getpid() + 40) % 90
PATIENCE_S = 120.0
RECORDER = "import sys; from hydro_ident.bag.recorder import main; sys.exit(main())"


def test_every_node_asks_for_it_before_it_starts() -> None:
    """By `start_ros`, or itself where it starts in a context of its own."""
    starts = 0
    for package in PACKAGES:
        for path in (ROOT / package / package).rglob("*.py"):
            lines = path.read_text(encoding="utf-8").splitlines()
            for k, line in enumerate(lines):
                starts += bool(re.match(r"\s*start_ros\(", line))
                if re.match(r"\s*(rclpy|context)\.init\(", line):
                    starts += 1
                    assert lines[k - 1].strip() == "prepare_middleware()", f"{path}, line {k + 1}"
    assert starts >= 8


@pytest.mark.parametrize(
    ("name", "ours", "asked"),
    [
        (RANGE, LOCAL, "SUBNET"),
        (RANGE, LOCAL, "OFF"),
        (PROFILES, str(PROFILES_FILE), "/somewhere/own.xml"),
    ],
)
def test_what_the_environment_says_is_kept(
    monkeypatch: pytest.MonkeyPatch, name: str, ours: str, asked: str
) -> None:
    monkeypatch.setattr(os, "environ", {})
    prepare_middleware()
    assert os.environ[name] == ours
    os.environ[name] = asked
    prepare_middleware()
    assert os.environ[name] == asked


def test_settings_are_packed_and_change_no_quality_of_service() -> None:
    (profile,) = ET.parse(PROFILES_FILE).getroot()[0]
    assert profile.attrib["is_default_profile"] == "true"
    assert [child.tag.rpartition("}")[2] for child in profile] == ["times"]


@pytest.mark.parametrize("asked", [None, "SUBNET"])
def test_scripts_keep_topics_local(asked: str | None) -> None:
    environment = {name: value for name, value in os.environ.items() if name != RANGE}
    if asked is not None:
        environment[RANGE] = asked
    said = subprocess.run(
        ["bash", "-c", f'source scripts/env.sh && printf "%s" "${RANGE}"'],
        cwd=ROOT,
        env=environment,
        capture_output=True,
        text=True,
        check=True,
    )
    assert said.stdout == (asked or LOCAL)


def _udp_ports(pid: int) -> set[int]:
    """UDP ports that a process listens on."""
    inodes = set()
    for entry in Path(f"/proc/{pid}/fd").iterdir():
        try:
            target = os.readlink(entry)
        except OSError:
            continue  # closed meanwhile
        if target.startswith("socket:["):
            inodes.add(target[8:-1])
    rows = [line.split() for line in Path("/proc/net/udp").read_text().splitlines()[1:]]
    return {int(row[1].rpartition(":")[2], 16) for row in rows if row[9] in inodes}


@pytest.mark.ros
@pytest.mark.parametrize("asked", [None, "SUBNET"], ids=["unasked", "subnet"])
def test_a_node_listens_to_the_subnet_only_when_asked(tmp_path: Path, asked: str | None) -> None:
    """By the port of DDS to which participants of the domain in the subnet announce themselves."""
    environment = {name: value for name, value in os.environ.items() if name != RANGE}
    environment["ROS_DOMAIN_ID"] = str(DOMAIN)
    if asked is not None:
        environment[RANGE] = asked
    announced = 7400 + 250 * DOMAIN
    with open(tmp_path / "said.txt", "w", encoding="utf-8") as said:
        process = subprocess.Popen(
            [sys.executable, "-c", RECORDER, "--out", str(tmp_path), "--name", "local"],
            env=environment,
            stdout=said,
            stderr=said,
        )
    try:
        end = time.monotonic() + PATIENCE_S
        # Its own port, and the bag: the node is there. One look may miss a port, as the system's
        # table is no snapshot while others open theirs: that asked for is waited for.
        ports = set[int]()
        while not (
            any(announced < port < announced + 250 for port in ports)
            and list(tmp_path.glob("*_local"))
            and (asked is None or announced in ports)
        ):
            assert process.poll() is None, (tmp_path / "said.txt").read_text()
            assert time.monotonic() < end, ports
            time.sleep(0.05)
            ports |= _udp_ports(process.pid)
        assert (announced in ports) == (asked == "SUBNET")
    finally:
        process.terminate()
        process.wait(PATIENCE_S)


def test_a_domain_of_a_campaign_is_nobodys() -> None:
    """Of its own whatever the shell says, and none in which somebody takes part."""
    free = unused_domain()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as participant:
        # Where the first participant of a domain is reached (OMG DDSI-RTPS, 9.6.1.1).
        participant.bind(("", 7400 + 250 * free + 10))
        other = unused_domain()
    assert other != free
    assert 10 <= other <= 99


def test_benchmarks_and_campaigns_take_such_a_domain(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The shell's may be a machine's, which they would activate and clear."""
    monkeypatch.setenv("ROS_DOMAIN_ID", "7")
    monkeypatch.setattr(processes, "unused_domain", lambda: 98)
    assert processes.Processes(tmp_path).environment["ROS_DOMAIN_ID"] == "98"

    class StopError(Exception):
        pass

    def stage(*_: object) -> None:
        raise StopError

    monkeypatch.setattr(faults, "unused_domain", lambda: 97)
    monkeypatch.setattr(faults, "on_end", lambda end: None)
    monkeypatch.setattr("hydro_ident.study.faults.stage.Stage", stage)
    with pytest.raises(StopError):
        faults._in_wall_time(1, 0, tmp_path)
    assert os.environ["ROS_DOMAIN_ID"] == "97"
