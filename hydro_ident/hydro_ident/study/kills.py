"""How much of a recording a kill costs: real recorder processes, killed at random moments.

python -m hydro_ident.study.kills [--count N] [--seed S] [--json FILE]
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

from hydro_ident.bag.metadata import write_atomically
from hydro_ident.bag.reader import read_bag
from hydro_ident.bag.series import Series
from hydro_ident.errors import BagError, IdentError
from hydro_model.command import run_command
from hydro_msgs_docs.local_topics import stay_local

TOPICS = ("/joint_states", "/chamber_pressures", "/valve_command", "/valve_state")
#: What may be lost, and how long to wait for what must come.
PROMISE_S, PATIENCE_S = 0.3, 300.0
PERIOD_NS = 2_000_000
_RECORDER = "import sys; from hydro_ident.bag.recorder import main; sys.exit(main())"


@dataclass(frozen=True, slots=True)
class Kill:
    """One recorder's end.

    Attributes
    ----------
    after_s : float
        From the first message of the last topic to the kill.
    lost_s : float
        From the publication of the oldest message that is not in the bag to the kill.
    late_s : float
        By how much the publisher beside it was late at worst in the second before: what the
        computer, not the recorder, costs.
    cycles : int
        In the bag.
    missing : int
        Of those between the first and the last: none is the aim.
    """

    after_s: float
    lost_s: float
    late_s: float
    cycles: int
    missing: int


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
    """Kill so many recorders, each at a random moment while 2000 messages a second come.

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
    for _ in range(count):
        # Anew for each: a publisher waits for readers that died until their lease is over.
        with publishing() as publisher:
            kills.append(_killed(publisher, rng.uniform(0.0, 2.0)))
    return kills


@contextmanager
def publishing() -> Iterator[Publisher]:
    """Publish a cycle every 2 ms in the background."""
    import rclpy
    from rclpy.node import Node

    context = rclpy.Context()
    stay_local()
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


def _killed(publisher: Publisher, after_s: float) -> Kill:
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        with open(place / "said.txt", "w", encoding="utf-8") as said:
            process = subprocess.Popen(
                [sys.executable, "-c", _RECORDER, "--out", folder, "--name", "killed"],
                stdout=said,
                stderr=subprocess.STDOUT,
            )
        try:
            received = _wait_until_received(place / "said.txt")
            time.sleep(after_s)
            killed_ns = time.monotonic_ns()
            os.kill(process.pid, signal.SIGKILL)
        finally:
            process.kill()
            process.wait()
        (bag,) = place.glob("*_killed")
        return _judged(bag, publisher.times, received, killed_ns, after_s)


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
    bag: Path, times: Sequence[int], received: Mapping[str, int], killed_ns: int, after_s: float
) -> Kill:
    try:
        series: Mapping[str, Series] = read_bag(bag, TOPICS).series
    except BagError:
        series = {}  # killed before the first chunk
    lost_s, missing = 0.0, 0
    for topic in TOPICS:
        cycles = series[topic].stamp_ns // PERIOD_NS if topic in series else np.zeros(0, int)
        if not len(cycles):  # killed before the first chunk of this topic
            lost_s = max(lost_s, (killed_ns - received[topic]) * 1e-9)
            continue
        missing += int(np.ptp(cycles)) + 1 - len(cycles)
        began_ns = times[min(int(cycles.max()) + 1, len(times) - 1)]
        lost_s = max(lost_s, (killed_ns - began_ns) * 1e-9)
    around = np.array([t for t in times if killed_ns - 1_000_000_000 < t < killed_ns + 10**8])
    late_s = float(np.diff(around).max(initial=PERIOD_NS) - PERIOD_NS) * 1e-9
    return Kill(
        after_s=round(after_s, 3),
        lost_s=round(lost_s, 4),
        late_s=round(late_s, 4),
        cycles=len(series[TOPICS[0]]) if TOPICS[0] in series else 0,
        missing=missing,
    )


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="kills", description="Kill recorders at random moments; measure what is lost."
    )
    parser.add_argument("--count", type=int, default=40)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", type=Path, metavar="FILE", help="result, dated")
    return parser


def _run(arguments: Sequence[str]) -> int:
    options = _parser().parse_args(arguments)
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
            "kills": [asdict(kill) for kill in kills],
        }
        write_atomically(options.json, json.dumps(result, indent=1) + "\n")
    return 1 if above else 0


if __name__ == "__main__":
    sys.exit(run_command("kills", _run))
