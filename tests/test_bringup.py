"""`bringup.sh` around processes that do nothing: whose domain it takes, what it says of them."""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from hydro_model.robot_files import shipped_robots

ROOT = Path(__file__).resolve().parents[1]
PATIENCE_S = 120.0
#: Rig, bridge, controller and lifecycle client in one. Both nodes say what their files say.
STUB = """#!/usr/bin/env bash
case $* in
  "absent "*) [[ $2 != "/$there" ]] || { echo "lifecycle: $2 is there" >&2; exit 1; } ;;
  configure*|activate*) echo "$*" >>"$0.asked" ;;
  *clock:=*) echo "$ROS_DOMAIN_ID" >"$0.domain"; exec tail -n +1 -f "$0.can_bridge" ;;
  *robot:=*) exec tail -n +1 -f "$0.controller" ;;
  *--real-time*) echo "$*" >"$0.rig"; echo ready; exec sleep 240 ;;
  *) exec sleep 240 ;;
esac
"""


class Bringup:
    """The script, what it has said so far, and what its nodes are to say."""

    def __init__(self, folder: Path, arguments: list[str], environment: dict[str, str]) -> None:
        self.folder, self.said = folder, folder / "said.txt"
        with self.said.open("w", encoding="utf-8") as said:
            self.process = subprocess.Popen(
                ["bash", str(folder / "scripts/bringup.sh"), *arguments],
                stdout=said,
                stderr=said,
                cwd=folder,
                env=environment,
            )

    def bridge(self, *words: str) -> None:
        self._say("can_bridge", words)

    def controller(self, *words: str) -> None:
        self._say("controller", words)

    def _say(self, node: str, words: tuple[str, ...]) -> None:
        with (self.folder / f"stub.{node}").open("a", encoding="utf-8") as file:
            file.writelines(f"[INFO] [1.0] [{node}]: {line}\n" for line in words)

    def until(self, text: str, count: int = 1) -> str:
        end = time.monotonic() + PATIENCE_S
        while (said := self.said.read_text(encoding="utf-8")).count(text) < count:
            assert time.monotonic() < end, said
            time.sleep(0.05)
        return said

    def asked(self) -> list[str]:
        """Transitions that were asked for, in their order."""
        file = self.folder / "stub.asked"
        lines = file.read_text(encoding="utf-8").splitlines() if file.exists() else []
        return [" ".join(line.split()[:2]) for line in lines]

    def end(self) -> int:
        self.process.send_signal(signal.SIGTERM)
        return self.process.wait(PATIENCE_S)


@pytest.fixture
def bringup(tmp_path: Path) -> Iterator[Callable[..., Bringup]]:
    shutil.copytree(ROOT / "scripts", tmp_path / "scripts")
    stub = tmp_path / "stub"
    stub.write_text(STUB, encoding="utf-8")
    stub.chmod(0o755)
    for node in ("can_bridge", "controller"):
        (tmp_path / f"stub.{node}").touch()
    exe = "hydro_exe() { printf '%s' \"$stub\"; }\n"
    (tmp_path / "scripts/env.sh").write_text(exe, encoding="utf-8")
    started: list[Bringup] = []

    def start(*arguments: str, domain: str = "", there: str = "") -> Bringup:
        own = {"stub": str(stub), "there": there, "ROS_DOMAIN_ID": domain}
        started.append(Bringup(tmp_path, list(arguments), os.environ | own))
        return started[-1]

    yield start
    for one in started:
        if one.process.poll() is None:
            one.end()


@pytest.mark.parametrize("there", ["can_bridge", "controller"])
def test_where_a_machine_is_up_nothing_is_started(
    bringup: Callable[..., Bringup], there: str
) -> None:
    one = bringup("--can", "can0", domain="5", there=there)
    assert one.process.wait(PATIENCE_S) == 1
    assert one.said.read_text(encoding="utf-8") == f"lifecycle: /{there} is there\n"
    assert not (one.folder / "stub.domain").exists()


@pytest.mark.parametrize(
    ("arguments", "domain", "taken"),
    [
        (("--sim",), "", r"[1-9]\d"),
        (("--sim",), "7", "7"),
        (("--can", "can0"), "", ""),
    ],
)
def test_a_rehearsal_takes_a_domain_that_nobody_uses(
    bringup: Callable[..., Bringup], arguments: tuple[str, ...], domain: str, taken: str
) -> None:
    """Unless somebody said which; a machine's is what the shell says."""
    one = bringup(*arguments, domain=domain)
    said = one.until("reading xs031")
    found = (one.folder / "stub.domain").read_text(encoding="utf-8").strip()
    assert re.fullmatch(taken, found)
    assert (f"export ROS_DOMAIN_ID={found}\n" in said) == (not domain and "--sim" in arguments)
    assert one.asked() == ["configure /can_bridge", "configure /controller"]


@pytest.mark.parametrize("model", ["own.hydraulics.yaml", "model.yaml"])
def test_an_identified_model_drives_the_machine_that_it_was_identified_on(
    bringup: Callable[..., Bringup], tmp_path: Path, model: str
) -> None:
    """Its base parameters are no bodies, its cylinders have an oil each: no rig could be it."""
    shipped = shipped_robots()["xs031"]
    shutil.copy(shipped.with_name("xs031.urdf"), tmp_path)
    text = shipped.read_text(encoding="utf-8")
    file, robot = tmp_path / "own.hydraulics.yaml", tmp_path / model
    for one in (file, robot):
        one.write_text(text.replace("robot: xs031", "robot: own"), encoding="utf-8")
    given = ("--rig", str(file)) if robot != file else ()
    bringup("--sim", "--robot", str(robot), *given).until("reading")
    rig = (tmp_path / "stub.rig").read_text(encoding="utf-8")
    assert rig.startswith(f"--robot {file} --truth ideal --can ")


def test_what_drives_is_said_by_the_bridge_and_a_trip_is_told_at_once(
    bringup: Callable[..., Bringup],
) -> None:
    one = bringup("--sim", "--drive")
    one.bridge("inactive: reading", "waiting for a first command", "driving")
    said = one.until("Ctrl-C ends")
    assert said.count("driving xs031 on ") == 1
    assert "NOT" not in said
    one.bridge("tripped: the enable switch is off")
    said = one.until("NOT driving xs031, valves at zero: the gate tripped: the enable switch")
    assert f"once its cause is gone: {one.folder}/stub clear_trip /can_bridge" in said
    one.bridge("clear_trip: cleared: the enable switch is off", "driving")
    one.until("driving xs031 on ", 2)
    one.bridge("waiting for a first command")
    one.until("NOT driving xs031 any more: the bridge is waiting for a first command")
    assert one.end() == 128 + signal.SIGTERM


def test_a_gate_that_trips_as_it_is_activated_is_not_said_to_drive(
    bringup: Callable[..., Bringup],
) -> None:
    """`activate` succeeds with the emergency stop pressed; the next cycle trips."""
    one = bringup("--sim", "--drive")
    one.bridge("inactive: reading", "tripped: the emergency stop is pressed")
    said = one.until("Ctrl-C ends")
    assert "NOT driving xs031, valves at zero: the gate tripped: the emergency stop" in said
    assert "driving xs031 on " not in said


def test_a_bridge_that_does_not_come_to_drive_is_told(bringup: Callable[..., Bringup]) -> None:
    one = bringup("--sim", "--drive")
    one.bridge("inactive: reading", "waiting for a first command")
    said = one.until("Ctrl-C ends")
    assert "NOT driving xs031 yet: the bridge is waiting for a first command" in said


LATCHED = "0 V: joint 'lift' is at 2.1 rad: latched until the controller is activated anew"


@pytest.mark.parametrize(
    ("said", "told"),
    [
        (LATCHED, "NOT moving xs031, valves at zero: the controller says "),
        (
            "stamps went back by 3.000 s, expected them to grow: activate the controller anew",
            "NOT moving xs031, valves at zero: the controller says ",
        ),
        (
            "path refused, holding: it begins 0.4 m from the tip",
            "NOT moving xs031 as asked: the controller says ",
        ),
    ],
)
def test_what_the_controller_does_not_drive_is_told_behind_a_gate_that_drives(
    bringup: Callable[..., Bringup], said: str, told: str
) -> None:
    """The gate goes on driving the controller's 0 V, and says no other word."""
    one = bringup("--sim", "--drive")
    one.bridge("driving")
    one.until("Ctrl-C ends")
    one.controller("gains are high", said)
    text = one.until(told + said)
    stub = f"{one.folder}/stub"
    again = f"{stub} deactivate /controller, then {stub} activate /controller"
    if "valves at zero" in told:
        text = one.until(f"once its cause is gone: {again}")
    assert (again in text) == ("valves at zero" in told)
    assert "gains are high" not in text
    time.sleep(1.0)  # several looks later
    assert one.said.read_text(encoding="utf-8").count(said) == 1


def test_a_gate_that_drives_again_is_not_said_to_move_behind_a_latched_fault(
    bringup: Callable[..., Bringup],
) -> None:
    """The controller says it no second time; activated anew, it is forgotten."""
    one = bringup("--sim", "--drive")
    one.bridge("driving")
    one.until("Ctrl-C ends")
    one.controller(LATCHED)
    one.until(LATCHED)
    one.bridge("tripped: the enable switch is off", "driving")
    one.until(f"NOT moved, unless the controller was activated anew since: {LATCHED}")
    one.bridge("waiting for a first command", "driving")
    said = one.until("driving xs031 on ", 3)
    time.sleep(0.5)
    assert one.said.read_text(encoding="utf-8").count("NOT moved") == 1, said
