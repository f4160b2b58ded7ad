"""How much of a recording a kill costs: real recorder processes, killed at random moments,
around the beginning of a new file, and while they close the bag.

python -m hydro_ident.study.kills [--count N] [--seed S] [--json FILE] [--root DIR]
"""

from __future__ import annotations

import argparse
import json
import os
import random
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from hydro_ident.bag.reader import METADATA_FILE, read_bag
from hydro_ident.bag.series import Series
from hydro_ident.errors import BagError, IdentError
from hydro_ident.study.sources import digests_of
from hydro_model.command_line.command import Parser, run_command
from hydro_model.command_line.output import write_atomically
from hydro_msgs_docs.middleware import prepare_middleware
from hydro_msgs_docs.topics import CHAMBER_PRESSURES, JOINT_STATES, VALVE_COMMAND, VALVE_STATE

TOPICS = (JOINT_STATES, CHAMBER_PRESSURES, VALVE_COMMAND, VALVE_STATE)
#: What may be lost, and how long to wait for what must come.
PROMISE_S, PATIENCE_S = 0.3, 300.0
PERIOD_NS = 2_000_000
#: Log time per file where the roll-over is aimed at, and how far from it kills fall.
ROLL_S, AROUND_S = 0.5, (-0.02, 0.08)
#: From the request to end to the kill at most: on a quiet computer half of the bags are closed
#: before it.
CLOSING_S = 0.03
MOMENTS = ("running", "roll-over", "closing")
#: What such a result is of: what records, and what reads the bags that are left.
SOURCES = (
    "chunks", "definitions", "described_chunks", "mcap_records", "mcap_summary", "metadata",
    "publisher_numbers", "reader", "record_walk", "recorder", "recorder_topics", "writer",
)  # fmt: skip
_RECORDER = "import sys; from hydro_ident.bag.recorder import main; sys.exit(main())"
_ROLLING = f"""
from hydro_ident.bag.writer import BagWriter
BagWriter.__init__.__kwdefaults__["split_ns"] = {round(ROLL_S * 1e9)}
"""


@dataclass(frozen=True, slots=True)
class Kill:
    """One recorder's end.

    Attributes
    ----------
    moment : str
        One of `MOMENTS`.
    after_s : float
        From the first message of the last topic to the kill; where it was closing, from the
        request to end.
    lost_s : float
        From the publication of the oldest message that is not in the bag to the kill, or to the
        request to end.
    late_s : float
        By how much the publisher beside it was late at worst in the second before: what the
        computer, not the recorder, costs.
    cycles : int
        In the bag.
    missing : int
        Of those between the first and the last: none is the aim.
    files : int
        In the bag.
    closed : bool
        The bag was whole before the kill.
    """

    moment: str
    after_s: float
    lost_s: float
    late_s: float
    cycles: int
    missing: int
    files: int
    closed: bool


@dataclass(slots=True)
class Publisher:
    """Publishes a cycle every 2 ms from a thread and remembers when.

    `node` is the ROS node; `stop` ends the thread.
    """

    node: Any
    #: When cycle k was published, monotonic ns.
    times: list[int] = field(default_factory=list)
    stop: bool = False

    def run(self) -> None:
        """Publish until told to stop."""
        from sensor_msgs.msg import JointState

        from hydro_msgs_docs.messages import joint_state
        from hydro_msgs_docs.topics import reliable

        # Deep enough that nothing is lost before the recorder, however late this thread is.
        made = [self.node.create_publisher(JointState, t, reliable(2000)) for t in TOPICS]
        due_ns = time.monotonic_ns()
        while not self.stop:
            cycle = len(self.times)
            message = joint_state(cycle * PERIOD_NS, ["lift", "tilt"], position=[cycle, -cycle])
            self.times.append(time.monotonic_ns())
            for publisher in made:
                publisher.publish(message)
            due_ns += PERIOD_NS
            time.sleep(max(0.0, (due_ns - time.monotonic_ns()) * 1e-9))


def kill_recorders(count: int, seed: int) -> list[Kill]:
    """Kill so many recorders while 2000 messages a second come, at each of `MOMENTS` in turn.

    Parameters
    ----------
    count : int
    seed : int
        Of the moments.

    Returns
    -------
    list of Kill
    """
    rng = random.Random(seed)
    kills = []
    for k in range(count):
        # Anew for each: a publisher waits for readers that died until their lease is over.
        with publishing() as publisher:
            kills.append(_killed(publisher, MOMENTS[k % len(MOMENTS)], rng))
    return kills


@contextmanager
def publishing() -> Iterator[Publisher]:
    """Publish a cycle every 2 ms in the background."""
    import rclpy
    from rclpy.node import Node

    context = rclpy.Context()
    prepare_middleware()
    rclpy.init(context=context)
    publisher = Publisher(Node("kills", context=context))
    thread = threading.Thread(target=publisher.run, daemon=True)
    thread.start()
    try:
        yield publisher
    finally:
        publisher.stop = True
        thread.join()
        publisher.node.destroy_node()
        rclpy.shutdown(context=context)


def _killed(publisher: Publisher, moment: str, rng: random.Random) -> Kill:
    code = (_ROLLING if moment == "roll-over" else "") + _RECORDER
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        with open(place / "said.txt", "w", encoding="utf-8") as said:
            process = subprocess.Popen(
                [sys.executable, "-c", code, "--out", folder, "--name", "killed"],
                stdout=said,
                stderr=subprocess.STDOUT,
            )
        try:
            received = _wait_until_received(place / "said.txt")
            end_ns = _end(process, moment, received, rng)
        finally:
            process.kill()
            process.wait()
        (bag,) = place.glob("*_killed")
        return _judged(bag, publisher.times, received, end_ns, moment)


def _end(
    process: subprocess.Popen[bytes], moment: str, received: Mapping[str, int], rng: random.Random
) -> tuple[int, int]:
    """Kill a recorder; when it was to have everything up to, and the kill, monotonic ns."""
    if moment == "roll-over":
        # Files begin this far apart from the first message of any topic on.
        files = (max(received.values()) - min(received.values())) // round(ROLL_S * 1e9)
        due_s = (files + rng.randint(1, 4)) * ROLL_S + rng.uniform(*AROUND_S)
        time.sleep(max(0.0, min(received.values()) * 1e-9 + due_s - time.monotonic()))
    else:
        time.sleep(rng.uniform(0.0, 2.0))
    asked_ns = time.monotonic_ns()
    if moment == "closing":
        process.send_signal(signal.SIGINT)
        time.sleep(rng.uniform(0.0, CLOSING_S))
    killed_ns = time.monotonic_ns()
    os.kill(process.pid, signal.SIGKILL)
    return (asked_ns if moment == "closing" else killed_ns), killed_ns


def _wait_until_received(said: Path) -> dict[str, int]:
    """When the recorder said of each topic that it comes, monotonic ns."""
    deadline_s = time.monotonic() + PATIENCE_S
    received: dict[str, int] = {}
    while len(received) < len(TOPICS):
        text = said.read_text(encoding="utf-8")
        for topic in TOPICS:
            if f"receiving {topic}\n" in text:
                received.setdefault(topic, time.monotonic_ns())
        if time.monotonic() > deadline_s:
            raise IdentError(f"the recorder received nothing in {PATIENCE_S:g} s")
        time.sleep(0.01)
    return received


def _judged(
    bag: Path,
    times: Sequence[int],
    received: Mapping[str, int],
    end_ns: tuple[int, int],
    moment: str,
) -> Kill:
    wanted_ns, killed_ns = end_ns
    try:
        series: Mapping[str, Series] = read_bag(bag, TOPICS).series
    except BagError:
        series = {}  # killed before the first chunk
    lost_s, missing = 0.0, 0
    for topic in TOPICS:
        cycles = series[topic].stamp_ns // PERIOD_NS if topic in series else np.zeros(0, int)
        if not len(cycles):  # killed before the first chunk of this topic
            lost_s = max(lost_s, (wanted_ns - received[topic]) * 1e-9)
            continue
        missing += int(np.ptp(cycles)) + 1 - len(cycles)
        began_ns = times[min(int(cycles.max()) + 1, len(times) - 1)]
        lost_s = max(lost_s, (wanted_ns - began_ns) * 1e-9)
    around = np.array([t for t in times if killed_ns - 1_000_000_000 < t < killed_ns + 10**8])
    late_s = float(np.diff(around).max(initial=PERIOD_NS) - PERIOD_NS) * 1e-9
    began_ns = wanted_ns if moment == "closing" else max(received.values())
    return Kill(
        moment=moment,
        after_s=round((killed_ns - began_ns) * 1e-9, 3),
        lost_s=round(lost_s, 4),
        late_s=round(late_s, 4),
        cycles=len(series[TOPICS[0]]) if TOPICS[0] in series else 0,
        missing=missing,
        files=len(list(bag.glob("*.mcap"))),
        closed=(bag / METADATA_FILE).is_file(),
    )


def digests(root: Path) -> dict[str, str]:
    """SHA-256 of the sources that a run is of, by their paths from the repository's top.

    Parameters
    ----------
    root : Path
        That top.
    """
    folder = root / "hydro_ident/hydro_ident/bag"
    paths = [folder / f"{name}.py" for name in SOURCES]
    contract = root / "hydro_msgs_docs/hydro_msgs_docs"
    return digests_of(root, [*paths, contract / "cdr.py", contract / "endings.py"], ())


def _parser() -> argparse.ArgumentParser:
    parser = Parser(
        prog="kills",
        description="Kill recorders at random moments, at roll-overs and while closing.",
    )
    parser.add_argument("--count", type=int, default=60, help="kills (%(default)s)")
    parser.add_argument("--seed", type=int, default=1, help="of moments (%(default)s)")
    parser.add_argument("--json", type=Path, metavar="FILE", help="result, dated")
    parser.add_argument(
        "--root", type=Path, default=Path(), metavar="DIR", help="repository (default: here)"
    )
    return parser


def _run(arguments: Sequence[str]) -> int:
    options = _parser().parse_args(arguments)
    of = digests(options.root.resolve())  # what runs, whatever is edited meanwhile
    kills = kill_recorders(options.count, options.seed)
    lost = np.array([kill.lost_s for kill in kills])
    above = [kill for kill in kills if kill.lost_s > PROMISE_S]
    print(
        f"{len(kills)} kills: lost {np.median(lost):.3f} s (median), {lost.max():.3f} s (worst),"
        f" {len(above)} above {PROMISE_S} s, {sum(k.missing for k in kills)} messages missing"
    )
    if options.json is not None:
        result = {
            "schema": "hydro_ident/recorder_kills/1",
            "date": time.strftime("%Y-%m-%d"),
            "seed": options.seed,
            "sources": of,
            "kills": [asdict(kill) for kill in kills],
        }
        write_atomically(options.json, json.dumps(result, indent=1) + "\n")
    return 1 if above else 0


if __name__ == "__main__":
    sys.exit(run_command("kills", _run))
