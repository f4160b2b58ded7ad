"""What is said keeps nobody waiting: not the interpreter, not a loop, not the end of a process."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

import pytest

from hydro_msgs_docs import aside
from hydro_msgs_docs.aside import Aside, unread_streams

PATIENCE_S = 60.0
DOMAIN = 10 + (os.getpid() + 61) % 90


def test_who_puts_aside_does_not_wait_and_what_was_left_out_is_counted() -> None:
    go, done = threading.Event(), list[str]()

    def do(text: str) -> None:
        assert go.wait(PATIENCE_S)
        done.append(text)

    one = Aside(do, lambda count: f"{count} left out")
    for k in range(aside._MOST + 500):
        one.put(str(k))
    assert done == []
    assert not one.flush(0.1)
    go.set()
    assert one.flush(PATIENCE_S)
    kept = [int(text) for text in done if text.isdecimal()]
    assert kept == list(range(len(kept)))  # the first ones, in their order
    (told,) = [text for text in done if not text.isdecimal()]
    assert told == f"{aside._MOST + 500 - len(kept)} left out"


def test_nothing_is_done_after_the_end() -> None:
    done: list[str] = []
    one = Aside(done.append, str)
    one.put("first")
    one.end(PATIENCE_S)
    one.put("second")
    assert not one.flush(0.1)
    assert done == ["first"]


@pytest.mark.parametrize("stream", ["stdout", "stderr"])
def test_a_process_goes_on_and_ends_where_nobody_reads(stream: str, full_pipe: int) -> None:
    program = (
        "import sys, warnings\n"
        "from hydro_msgs_docs.aside import unread_streams\n"
        "with unread_streams():\n"
        f"    for k in range(3000): print(k, file=sys.{stream}, flush=True)\n"
        "    warnings.warn('the interpreter itself says so')\n"
        "sys.exit(7)\n"
    )
    how: dict[str, Any] = {stream: full_pipe}
    done = subprocess.run([sys.executable, "-c", program], timeout=PATIENCE_S, check=False, **how)
    assert done.returncode == 7


def test_all_of_it_is_there_where_somebody_reads(capfd: pytest.CaptureFixture[str]) -> None:
    before = sys.stdout, sys.stderr
    with unread_streams():
        print("one")
        print("two", "three", file=sys.stderr)
        assert not sys.stderr.isatty()
    assert (sys.stdout, sys.stderr) == before
    assert capfd.readouterr() == ("one\n", "two three\n")


def test_streams_that_are_no_files_stay(capsys: pytest.CaptureFixture[str]) -> None:
    with unread_streams():
        print("one")
    assert capsys.readouterr().out == "one\n"


NODE = """
import os, sys, time
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rcl_interfaces.msg import Log
from hydro_msgs_docs.aside import log_of, unread_streams
from hydro_msgs_docs.middleware import start_ros

def main():
    start_ros("speaker", sys.argv[1:], rosout_alone=True)
    node, heard = rclpy.create_node("speaker"), []
    node.create_subscription(Log, "/rosout", lambda m: heard.append((m.level, m.name, m.msg)), 10)
    log = log_of(node)
    assert log_of(node) is log
    say = [log.info, log.warn, log.error, log.fatal]
    end = time.monotonic() + 60
    while len(heard) < 4 and time.monotonic() < end:
        for one in say[len(heard):]:
            one("100 % of it")  # from one place, and with what a format would take
        for _ in range(10):
            rclpy.spin_once(node, timeout_sec=0.05)
    sets = sorted({(int.from_bytes(l, "little") if isinstance(l, bytes) else l, n, m)
                   for l, n, m in heard})
    os.write(1, repr(sets).encode())
    log.close()

with unread_streams():
    main()
"""


def _spoken(stderr: int, *arguments: str) -> subprocess.CompletedProcess[str]:
    own = {"ROS_DOMAIN_ID": str(DOMAIN), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    return subprocess.run(
        [sys.executable, "-c", NODE, *arguments],
        env=os.environ | own,
        stdout=subprocess.PIPE,
        stderr=stderr,
        text=True,
        timeout=2 * PATIENCE_S,
        check=False,
    )


@pytest.mark.ros
def test_a_node_says_it_as_ros_does_and_on_rosout_though_nobody_reads(
    full_pipe: int, tmp_path: Path
) -> None:
    pytest.importorskip("rclpy")
    rosout = str([(level, "speaker", "100 % of it") for level in (20, 30, 40, 50)])
    begin_s = time.time()
    read = _spoken(subprocess.PIPE)
    assert read.stdout == rosout
    lines = re.findall(
        r"^\[(INFO|WARN|ERROR|FATAL)\] \[(\d+\.\d{9})\] \[speaker\]: 100 % of it$",
        read.stderr,
        re.M,
    )
    # Once each, and not by ROS itself as well.
    assert [level for level, _ in lines[:4]] == ["INFO", "WARN", "ERROR", "FATAL"]
    assert len(set(lines)) == len(lines) == len(read.stderr.splitlines())
    assert begin_s < float(lines[0][1]) < time.time()
    unread = _spoken(full_pipe)
    assert (unread.returncode, unread.stdout) == (0, rosout)
    quiet = _spoken(subprocess.PIPE, "--ros-args", "--disable-stdout-logs", "--log-level", "warn")
    assert "(20, " not in quiet.stdout
    assert quiet.stderr == ""
