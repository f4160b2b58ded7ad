"""The recorder as a process: killed, on full, read-only and slow disks, with nobody listening."""

from __future__ import annotations

import json
import os
import resource
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hydro_ident.bag.reader import read_bag
from hydro_ident.bag.writer import BagWriter
from hydro_ident.study.kills import (
    PERIOD_NS,
    PROMISE_S,
    TOPICS,
    Publisher,
    publishing,
)
from hydro_ident.study.kills import _run as kills

ROOT = Path(__file__).resolve().parents[2]
DOMAIN = 10 + (os.getpid() + 73) % 90
PATIENCE_S = 120.0
TOPIC = "/joint_states"
RECORDER = "import sys; from hydro_ident.bag.recorder import main; sys.exit(main())"
#: The same with a file that takes 0.25 s for whatever it is given.
SLOW = """
import io, time
from hydro_ident.bag import writer
class Slow(io.FileIO):
    def write(self, data):
        time.sleep(0.25)
        return super().write(data)
writer.open = lambda path, mode: io.BufferedWriter(Slow(path, "x"))
"""


@pytest.fixture(autouse=True)
def domain(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", str(DOMAIN))
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")


@pytest.fixture
def publisher(domain: None) -> Iterator[Publisher]:
    """Four topics, a cycle every 2 ms."""
    with publishing() as publisher:
        yield publisher


@pytest.fixture
def record(tmp_path: Path) -> Iterator[Callable[..., subprocess.Popen[str]]]:
    """Starts a recorder; what it says goes to said.txt, errors to errors.txt."""
    started: list[subprocess.Popen[str]] = []

    def start(command: Sequence[str], **options: Any) -> subprocess.Popen[str]:
        with (
            open(tmp_path / "said.txt", "w") as said,
            open(tmp_path / "errors.txt", "w") as errors,
        ):
            process = subprocess.Popen(
                command, **{"stdout": said, "stderr": errors, "text": True, **options}
            )
        started.append(process)
        return process

    yield start
    for process in started:
        process.kill()
        process.wait()


def _command(out: Path, *more: str, code: str = RECORDER) -> list[str]:
    return [sys.executable, "-c", code, "--out", str(out), "--name", "t", *more]


def _wait_for(condition: Callable[[], bool]) -> None:
    deadline = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.02)


def _errors(folder: Path) -> list[str]:
    """What went wrong, but for what a busy machine's disk may be told of at any time."""
    lines = (folder / "errors.txt").read_text().splitlines()
    return [line for line in lines if not line.startswith("recorder: slow disk, ")]


def _unbroken(path: Path, topic: str = TOPIC) -> np.ndarray:
    """The cycles of a bag, of which none is missing between the first and the last."""
    cycles = read_bag(path).series[topic].stamp_ns // PERIOD_NS
    np.testing.assert_array_equal(np.diff(cycles), 1)
    return cycles


def _all_written(folder: Path) -> bool:
    """Whether chunks have come to the disk, and no more of them for longer than one is open."""
    before = sum(file.stat().st_size for file in folder.glob("*_t/*"))
    time.sleep(1.0)
    return 0 < before == sum(file.stat().st_size for file in folder.glob("*_t/*"))


def _private_mount(
    folder: Path, options: str, command: Sequence[str], meanwhile: str = ":"
) -> list[str]:
    """A command that sees a small disk of its own in `folder`, copied out at its end.

    `meanwhile` is done beside it, in the shell that knows its process as `$command`.
    """
    words = " ".join(f"'{word}'" for word in command)
    script = f"mount -t tmpfs -o {options} none '{folder}' || exit 77; {words} & command=$!;"
    script += f" {meanwhile}; wait $command; code=$?; cp -r '{folder}' '{folder}.kept'; exit $code"
    return ["unshare", "-rm", "sh", "-c", script]


def _skip_without_mounts(tmp_path: Path) -> None:
    if shutil.which("unshare") is None:
        pytest.skip("no unshare on this system")
    (tmp_path / "probe").mkdir()
    done = subprocess.run(
        _private_mount(tmp_path / "probe", "size=64k", ["true"]), capture_output=True, check=False
    )
    if done.returncode:
        pytest.skip("this system lets nobody mount a disk in a namespace of one's own")


@pytest.mark.ros
def test_killed_at_random_moments_it_loses_at_most_three_tenths_of_a_second(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "kills.json"
    words = ["--count", "6", "--seed", str(os.getpid()), "--json", str(file), "--root", str(ROOT)]
    code = kills(words)
    found = json.loads(file.read_text(encoding="utf-8"))["kills"]
    assert code == any(kill["lost_s"] > PROMISE_S for kill in found)
    assert capsys.readouterr().out.startswith("6 kills: lost ")
    for kill in found:
        # A machine that keeps the publisher waiting keeps the recorder waiting, too.
        assert kill["lost_s"] <= PROMISE_S + 3.0 * kill["late_s"], kill
        assert kill["missing"] == 0, kill


@pytest.mark.ros
def test_what_it_missed_while_it_stood_still_is_there_soon_after(
    tmp_path: Path, publisher: Publisher, record: Callable[..., subprocess.Popen[str]]
) -> None:
    """While it stands, more comes than the queue before it holds, and nothing after that would
    show what is missing: publishers say every 0.1 s up to where they sent, where Fast DDS itself
    would wait for up to 3 s."""
    process = record(_command(tmp_path))
    _wait_for(lambda: (tmp_path / "said.txt").read_text().count("receiving") == len(TOPICS))
    process.send_signal(signal.SIGSTOP)
    seen = len(publisher.times)
    _wait_for(lambda: len(publisher.times) > seen + 300)
    publisher.stop = True
    process.send_signal(signal.SIGCONT)
    time.sleep(1.5)  # what is sent again fills the queue anew: it takes some rounds
    process.send_signal(signal.SIGINT)
    assert process.wait(timeout=PATIENCE_S) == 0
    (path,) = tmp_path.glob("*_t")
    for topic in TOPICS:
        assert _unbroken(path, topic)[-1] == len(publisher.times) - 1, topic


@pytest.mark.ros
def test_a_file_that_may_not_grow_ends_in_one_line_and_a_readable_bag(
    tmp_path: Path, publisher: Publisher, record: Callable[..., subprocess.Popen[str]]
) -> None:
    def limited() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (300_000, 300_000))

    process = record(_command(tmp_path, "--compression", "none"), preexec_fn=limited)
    assert process.wait(timeout=PATIENCE_S) == 1
    (line,) = _errors(tmp_path)
    assert line.startswith("recorder: ")
    assert "File too large; what was written before is readable" in line
    (path,) = tmp_path.glob("*_t")
    assert len(_unbroken(path)) > 100
    assert any("cut off" in loss for loss in read_bag(path).losses)


@pytest.mark.ros
def test_a_full_disk_ends_in_one_line_and_a_readable_bag(
    tmp_path: Path, publisher: Publisher, record: Callable[..., subprocess.Popen[str]]
) -> None:
    _skip_without_mounts(tmp_path)
    disk = tmp_path / "disk"
    disk.mkdir()
    command = _command(disk, "--compression", "none")
    process = record(_private_mount(disk, "size=400k", command))
    assert process.wait(timeout=PATIENCE_S) == 1
    (line,) = _errors(tmp_path)
    assert "No space left on device; what was written before is readable" in line
    (path,) = (tmp_path / "disk.kept").glob("*_t")
    assert len(_unbroken(path)) > 100
    assert not list(path.glob("*.part"))


@pytest.mark.ros
def test_a_disk_that_is_full_when_it_closes_the_bag_ends_it_in_one_line(
    tmp_path: Path, record: Callable[..., subprocess.Popen[str]]
) -> None:
    """What came before had its place; the end of the file and metadata.yaml have none."""
    _skip_without_mounts(tmp_path)
    disk, now = tmp_path / "disk", tmp_path / "now"
    disk.mkdir()
    wait = f"while [ ! -e '{now}' ]; do sleep 0.05; done"
    fill = f"cat /dev/zero >'{disk}/other' 2>/dev/null; kill -TERM $command"
    with publishing() as publisher:
        process = record(_private_mount(disk, "size=4M", _command(disk), f"{wait}; {fill}"))
        _wait_for(lambda: (tmp_path / "said.txt").read_text().count("receiving") == 4)
        seen = len(publisher.times)
        _wait_for(lambda: len(publisher.times) > seen + 150)
        # Its writer stays until the recorder has all: with it would go what is not delivered yet.
        publisher.stop = True
        within = Path(f"/proc/{process.pid}/root{disk}")
        _wait_for(lambda: _all_written(within))
    now.touch()
    assert process.wait(timeout=PATIENCE_S) == 1
    (line,) = _errors(tmp_path)
    assert "No space left on device; what was written before is readable" in line
    (path,) = (tmp_path / "disk.kept").glob("*_t")
    assert len(_unbroken(path)) > 100
    assert [file.suffix for file in path.iterdir()] == [".mcap"]
    assert any("cut off" in loss for loss in read_bag(path).losses)


def test_a_read_only_disk_is_refused_in_one_line(tmp_path: Path) -> None:
    _skip_without_mounts(tmp_path)
    disk = tmp_path / "disk"
    disk.mkdir()
    done = subprocess.run(
        _private_mount(disk, "ro,size=64k", _command(disk)),
        capture_output=True,
        text=True,
        check=False,
        timeout=PATIENCE_S,
    )
    assert done.returncode == 2
    (line,) = done.stderr.splitlines()
    assert "cannot be written: Read-only file system" in line


@pytest.mark.ros
def test_a_slow_disk_is_said_and_loses_nothing_that_the_queues_hold(
    tmp_path: Path, publisher: Publisher, record: Callable[..., subprocess.Popen[str]]
) -> None:
    process = record(_command(tmp_path, "--topics", TOPIC, code=SLOW + RECORDER))
    _wait_for(lambda: "slow disk" in (tmp_path / "errors.txt").read_text())
    seen = len(publisher.times)
    _wait_for(lambda: len(publisher.times) > seen + 150)
    process.send_signal(signal.SIGINT)
    assert process.wait(timeout=PATIENCE_S) == 0
    (line,) = (tmp_path / "errors.txt").read_text().splitlines()
    assert "s for a chunk of 0.2 s" in line
    said = (tmp_path / "said.txt").read_text()
    assert "the disk took up to" in said
    assert "LOST" not in said
    (path,) = tmp_path.glob("*_t")
    assert len(_unbroken(path)) > 100
    assert read_bag(path).losses == ()


@pytest.mark.ros
def test_it_goes_on_when_nobody_reads_what_it_says(
    tmp_path: Path, publisher: Publisher, record: Callable[..., subprocess.Popen[str]]
) -> None:
    process = record(_command(tmp_path, "--topics", TOPIC), stdout=subprocess.PIPE)
    assert process.stdout is not None
    process.stdout.readline()
    process.stdout.close()
    (path,) = tmp_path.glob("*_t")
    file = path / f"{path.name}_0.mcap"
    _wait_for(lambda: file.stat().st_size > 20_000)
    process.send_signal(signal.SIGINT)
    process.wait(timeout=PATIENCE_S)
    assert read_bag(path).losses == ()
    assert len(_unbroken(path)) > 100


@pytest.mark.ros
def test_it_goes_on_where_what_it_says_stands_in_a_pipe_that_is_full(
    tmp_path: Path, publisher: Publisher, record: Callable[..., subprocess.Popen[str]]
) -> None:
    reading, writing = os.pipe()
    os.set_blocking(writing, False)
    with suppress(BlockingIOError):
        while True:
            os.write(writing, bytes(4096))
    os.set_blocking(writing, True)
    process = record(_command(tmp_path, "--topics", TOPIC), stdout=writing, stderr=writing)
    _wait_for(lambda: sum(file.stat().st_size for file in tmp_path.glob("*_t/*")) > 20_000)
    process.send_signal(signal.SIGINT)
    assert process.wait(timeout=PATIENCE_S) == 0
    (path,) = tmp_path.glob("*_t")
    assert read_bag(path).losses == ()
    assert len(_unbroken(path)) > 100
    os.close(writing)
    os.close(reading)


def test_chunks_of_a_clock_that_went_back_are_not_kept_waiting(tmp_path: Path) -> None:
    """Without a further message, too: the chunk is on the disk at the next look at the clock."""
    writer = BagWriter(tmp_path / "bag")
    writer.add_topic(TOPIC, "sensor_msgs/msg/JointState")
    writer.write_stamped(TOPIC, 10**18, {"position": [1.0]}, names=["lift"])
    writer.flush_older_than(10**18 - 3_600_000_000_000)
    assert len(read_bag(tmp_path / "bag").series[TOPIC]) == 1
    writer.abandon()
    writer.close()
    assert any("cut off" in loss for loss in read_bag(tmp_path / "bag").losses)
