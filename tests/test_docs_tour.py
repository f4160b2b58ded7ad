"""The README's commands as they stand there, run one after another in an empty folder."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path

import pytest

from hydro_ident.bag.reader import read_bag

pytestmark = pytest.mark.ros
ROOT = Path(__file__).resolve().parents[1]
DOMAIN = 10 + (os.getpid() + 52) % 90
#: How long to wait for what must come, however busy the machine is.
PATIENCE_S = 480.0
#: What the commands' own options shorten; the paths in the lines are made absolute, no more.
SHORTER = {"rig_run.sh": "--duration 9", "replay.sh": "--rate 10"}
#: A bus of this test alone: the line has that of every reader of the page.
OWN_BUS = f"--bus udp_multicast:239.74.163.2:{2_000 + (os.getpid() + 3_000) % 5_000}"


def block(after: str) -> list[str]:
    """Commands of the README's first indented block after some words."""
    text = (ROOT / "README.md").read_text(encoding="utf-8").split(after, 1)[1]
    found = re.search(r"(?:^    .+\n)+", text, re.M)
    assert found is not None
    return [re.sub(r"\s+#\s.*", "", line).strip() for line in found[0].splitlines()]


def runnable(line: str, extra: str = "") -> str:
    """A line for a shell that stands in another folder."""
    return re.sub(r"(?<![\w/])scripts/", f"{ROOT}/scripts/", f"{line} {extra}".strip())


def environment() -> dict[str, str]:
    own = {"ROS_DOMAIN_ID": str(DOMAIN), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    return os.environ | own


@pytest.fixture(scope="module")
def tour(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, str]]:
    """Folder of the tour, and what each of its commands printed."""
    folder = tmp_path_factory.mktemp("tour")
    source, *lines = block("## Five-minute tour")
    said: dict[str, str] = {}
    for line in lines:
        found = re.match(r"scripts/([\w.]+)|\$\(hydro_exe \w+ (\w+)\)", line)
        assert found is not None, line
        name = found[1] or found[2]
        script = f"set -euo pipefail; {runnable(source)}; {runnable(line, SHORTER.get(name, ''))}"
        done = subprocess.run(
            ["bash", "-c", script],
            cwd=folder,
            env=environment(),
            capture_output=True,
            text=True,
            timeout=PATIENCE_S,
            check=False,
        )
        assert done.returncode == 0, f"{line}\n{done.stdout}{done.stderr}"
        said[name] = done.stdout
    return folder, said


def test_the_tour_is_run_as_it_stands(tour: tuple[Path, dict[str, str]]) -> None:
    folder, said = tour
    assert list(said) == ["rig_run.sh", "inspect", "tracking", "identify.sh", "replay.sh"]
    assert [entry.name for entry in folder.iterdir()] == ["out"]


def test_the_first_bag_is_healthy(tour: tuple[Path, dict[str, str]]) -> None:
    said = tour[1]["inspect"]
    lines = said.splitlines()
    assert lines[0].endswith("_first: healthy"), said
    assert "  nothing irregular" in lines
    assert "4500 cycles at 500.00 Hz" in lines[1]


def test_the_tip_followed(tour: tuple[Path, dict[str, str]]) -> None:
    [row] = [ln for ln in tour[1]["tracking"].splitlines() if ln.startswith("encoders")]
    assert 0.1 < float(row.split()[1]) < 60.0  # RMSE in mm of a datasheet's model


def test_the_identification_leaves_its_files(tour: tuple[Path, dict[str, str]]) -> None:
    out = tour[0] / "out/tour/identified"
    result = json.loads((out / "result.json").read_text(encoding="utf-8"))
    assert f"verdict: {result['verdict']}" in tour[1]["identify.sh"]
    assert {"report.html", "model.yaml", "controller.yaml"} <= {f.name for f in out.iterdir()}


def test_every_message_is_replayed(tour: tuple[Path, dict[str, str]]) -> None:
    [bag] = (tour[0] / "out/tour/bags").iterdir()
    count = sum(info.count for info in read_bag(bag).topics.values())
    assert f"played {count} messages" in tour[1]["replay.sh"]


class Shell:
    """A command that goes on until Ctrl-C."""

    def __init__(self, line: str, folder: Path) -> None:
        script = f"source {ROOT}/scripts/env.sh; exec {line}"
        self.log = folder / f"{len(list(folder.glob('*.said')))}.said"
        with self.log.open("w") as log:
            self.process = subprocess.Popen(
                ["bash", "-c", script],
                cwd=folder,
                env=environment(),
                stdout=log,
                stderr=log,
                start_new_session=True,
                # A shell neither traps nor resets a signal that was ignored at its start.
                preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL) and None,
            )

    def until(self, text: str) -> None:
        deadline = time.monotonic() + PATIENCE_S
        while text not in self.log.read_text():
            assert time.monotonic() < deadline, self.log.read_text()
            assert self.process.poll() is None, self.log.read_text()
            time.sleep(0.1)

    def interrupt(self) -> int:
        """As a terminal does: the whole foreground group."""
        if self.process.poll() is None:
            os.killpg(self.process.pid, signal.SIGINT)
        return self.process.wait(PATIENCE_S)


def child(folder: Path, words: str) -> int:
    """The process that runs in a folder with these words in its command line."""
    found = []
    for process in Path("/proc").iterdir():
        with suppress(OSError):
            line = (process / "cmdline").read_bytes().replace(b"\0", b" ").decode()
            if words in line and (process / "cwd").resolve() == folder:
                found.append(int(process.name))
    [number] = found
    return number


@pytest.fixture
def shell(tmp_path: Path) -> Iterator[Callable[[str], Shell]]:
    started: list[Shell] = []

    def start(line: str) -> Shell:
        started.append(Shell(line, tmp_path))
        return started[-1]

    yield start
    for one in reversed(started):
        one.interrupt()


@pytest.mark.thorough
def test_the_labs_commands_bring_up_ask_and_record(
    shell: Callable[[str], Shell], tmp_path: Path
) -> None:
    simulated, _, record = block("In the lab, each until Ctrl-C")
    own = tmp_path / "bridge.yaml"
    own.write_text("can_bridge: {ros__parameters: {slow_rate_hz: 5.0}}\n", encoding="utf-8")
    crane = shell(runnable(simulated, f"{OWN_BUS} --bridge bridge.yaml"))
    crane.until("driving xs031")
    recorder = shell(runnable(record.replace("NAME", "second")))
    recorder.until("receiving /joint_states")
    # On a busy computer the gate has tripped by now; the node is active all the same.
    asked = "$(hydro_exe hydro_control lifecycle) get /can_bridge --timeout 120 --json -"
    done = subprocess.run(
        ["bash", "-c", f"source {ROOT}/scripts/env.sh; {asked}"],
        cwd=tmp_path,
        env=environment(),
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
        check=True,
    )
    assert json.loads(done.stdout)["state"] == "active"
    assert recorder.interrupt() == 0
    # A recorder that ends takes nothing else with it, and nobody has to look into a log for it.
    os.kill(child(tmp_path, "--name first"), signal.SIGTERM)
    crane.until("NOT RECORDING any more, and going on")
    assert crane.interrupt() == 128 + signal.SIGINT
    assert re.search(r"^recorded \d+ messages in .*_first$", crane.log.read_text(), re.M)
    bags = {bag.name.partition("_")[2]: bag for bag in (tmp_path / "bags").iterdir()}
    assert set(bags) == {"first", "second"}
    for bag in bags.values():
        assert {"/joint_states", "/chamber_pressures"} <= set(read_bag(bag).topics)
    assert read_bag(bags["first"]).metadata["bridge_parameters"] == own.read_text()


def test_a_new_robot_is_written_checked_and_drawn(tmp_path: Path) -> None:
    page = (ROOT / "hydro_msgs_docs/extending.md").read_text(encoding="utf-8")
    [urdf] = re.findall(r"^( *)```xml\n(.*?)^\1```", page, re.M | re.S)
    [command] = re.findall(r"^ *(scripts/new_robot\.sh mycrane\.urdf .*)$", page, re.M)
    (tmp_path / "mycrane.urdf").write_text(urdf[1], encoding="utf-8")
    done = subprocess.run(
        ["bash", "-c", runnable(command)],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    written = {"mycrane.urdf", "mycrane.hydraulics.yaml", "mycrane.html"}
    assert {file.name for file in tmp_path.iterdir()} == written
    assert done.stdout.startswith("mycrane: 1 joint, 1 cylinder")
