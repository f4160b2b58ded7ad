"""`soak`: the whole chain in real time, with its latencies, lost cycles and memory.

    scripts/soak.sh [--minutes 10] [--rt-priority N] [--busy N] [--json F]

Rig, bridge and controller with the tip going to and fro. Prints a histogram of the times from
sensor frame to valve frame, the cycles that were not answered (infinitely late in the percentiles,
but for those between a trip and its end), how often the bridge's gate tripped (a command older
than its limit: 0 V until cleared, which the soak does), and how the memory of every process grew
after the first tenth of the time.
"""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from hydro_ident.bench import made
from hydro_ident.bench.chain import MAX_AGE_MS, Running, product
from hydro_ident.bench.timed_bus import lateness
from hydro_ident.errors import IdentError
from hydro_ident.study.peak import status_kb
from hydro_model.command_line.command import Parser, run_command

#: Upper ends of the histogram's bins, ms; the last bin has none.
EDGES_MS = (0.25, 0.5, 0.75, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0, 10.0, 20.0, 50.0, 100.0)
QUANTILES = (50.0, 99.0, 99.9, 100.0)
_SAMPLES, _BAR = 50, 40
_MOST_BUSY = 256
#: How often to look whether answers still come, s.
_LOOK_S = 0.5


@dataclass(frozen=True, slots=True)
class Memory:
    """Resident memory of a process, MiB.

    Attributes
    ----------
    begin, end, peak : float
        After the first tenth of the time, at the end, and the largest from the one to the other.
    """

    begin: float
    end: float
    peak: float


@dataclass(frozen=True, slots=True)
class Soaked:
    """What a soak measured.

    Attributes
    ----------
    minutes : float
    rt_priority : int
        SCHED_FIFO priority that bridge and controller asked for; 0: none.
    busy : int
        Processes beside them that did nothing but compute.
    cycles, lost : int
        All, and those not answered.
    trips : int
        Of the bridge's gate, each cleared.
    waited : int
        Of those lost, the ones from the last answer before a trip until it was cleared.
    latency_ms : mapping
        By percentile, over all cycles but those `waited`: infinite where that share was never
        answered, null in JSON.
    histogram : list of int
        Counts by `EDGES_MS`, then those above.
    memory : mapping from process to Memory
        The rig's is that of this process, with what it notes.
    """

    minutes: float
    rt_priority: int
    busy: int
    cycles: int
    lost: int
    trips: int
    waited: int
    latency_ms: Mapping[str, float]
    histogram: Sequence[int]
    memory: Mapping[str, Memory]


def soak(
    minutes: float, max_age_ms: float = MAX_AGE_MS, rt_priority: int = 0, busy: int = 0
) -> Soaked:
    """Run the chain.

    Parameters
    ----------
    minutes : float
        How long.
    max_age_ms : float
        Of the bridge.
    rt_priority : int
        Both as of `hydro_ident.bench.chain.product`.
    busy : int
        How many processes compute beside it.

    Raises
    ------
    IdentError
        It does not start, or a part ends before its time.
    """
    sizes: dict[str, list[float]] = {}
    # Long enough for the path to go on until the end.
    with computing(busy), product(minutes + 2.0, max_age_ms, rt_priority) as running:
        running.bus.begin()
        began = time.monotonic()
        trips = Trips(running)
        for k in range(1, _SAMPLES + 1):
            trips.watch(began + 60.0 * minutes * k / _SAMPLES)
            _take_sizes(running, sizes)
        cycles, lost = running.bus.cycles, running.bus.lost
        times_ms = 1e3 * running.bus.latencies_s()
    if not times_ms.size:
        raise IdentError("soak: no cycle was answered")
    edges, unanswered = [-np.inf, *EDGES_MS, np.inf], max(lost - trips.waited, 0)
    kept = {name: values[_SAMPLES // 10 :] for name, values in sizes.items()}
    return Soaked(
        minutes,
        rt_priority,
        busy,
        cycles,
        lost,
        trips.cleared,
        trips.waited,
        {f"p{q:g}": lateness(times_ms, unanswered, q) for q in QUANTILES},
        np.histogram(times_ms, edges)[0].tolist(),
        {name: Memory(v[0], v[-1], max(v)) for name, v in kept.items()},
    )


@contextmanager
def computing(count: int) -> Iterator[None]:
    """Processes that take all the time they get.

    Parameters
    ----------
    count : int
    """
    words = [sys.executable, "-c", "while True: pass"]
    with ExitStack() as stack:
        for _ in range(count):
            process = stack.enter_context(subprocess.Popen(words))
            stack.callback(process.kill)
        yield


class Trips:
    """Clears the bridge's trips as they come, and counts them.

    Parameters
    ----------
    running : Running

    Attributes
    ----------
    cleared : int
    waited : int
        Cycles from the last answer before a trip until it was cleared that got no answer.
    """

    def __init__(self, running: Running) -> None:
        self.cleared, self.waited, self._running = 0, 0, running
        self._counted = 0  # cycles up to the end of the last trip

    def watch(self, until: float) -> None:
        """Look out for trips.

        Parameters
        ----------
        until : float
            On the monotonic clock.

        Raises
        ------
        IdentError
            A part of the chain has ended.
        """
        bus = self._running.bus
        while (left := until - time.monotonic()) > 0.0:
            answered = bus.answered
            time.sleep(min(left, _LOOK_S))
            self._running.check()
            if bus.answered != answered:
                continue
            # A trip that follows on another before anything was answered goes on from there.
            cycles = bus.cycles
            silence = min(bus.silence, cycles - self._counted)
            if self._running.rearm():
                self.cleared += 1
                # Answers come again before the command that clears has ended.
                self.waited += silence + (bus.cycles - cycles) - (bus.answered - answered)
                self._counted = bus.cycles


def _take_sizes(running: Running, sizes: dict[str, list[float]]) -> None:
    pids = {"rig": os.getpid()} | {name: one.pid for name, one in running.processes.items()}
    for name, pid in pids.items():
        sizes.setdefault(name, []).append(status_kb(pid, "VmRSS") / 1024.0)


def text_of(found: Soaked) -> str:
    """A soak as lines for a person."""
    lines = [
        f"{found.minutes:g} minutes: {found.cycles} cycles, {found.lost} not answered,"
        f" {found.waited} of them until one of {found.trips} trips was cleared",
        "",
    ]
    lines += ["sensor frame to valve frame:"]
    lines += [
        f"  {name:6} {value:8.3f} ms" if math.isfinite(value) else f"  {name:6} never answered"
        for name, value in found.latency_ms.items()
    ]
    most = max(found.histogram) or 1
    ends = [f"up to {edge:g} ms" for edge in EDGES_MS] + [f"above {EDGES_MS[-1]:g} ms"]
    for end, count in zip(ends, found.histogram, strict=True):
        if count:
            # A log scale: single late cycles must be seen beside hundreds of thousands.
            bar = "#" * max(1, round(_BAR * np.log1p(count) / np.log1p(most)))
            lines.append(f"  {end:>14} {count:9d} {bar}")
    lines += ["", "memory, MiB, after the first tenth, at the end, growth, largest:"]
    for name, m in found.memory.items():
        lines.append(
            f"  {name:10} {m.begin:8.1f} {m.end:8.1f} {m.end - m.begin:+8.2f} {m.peak:8.1f}"
        )
    return "\n".join(lines)


def json_of(found: Soaked) -> str:
    """A soak as JSON, null for what was never answered.

    Parameters
    ----------
    found : Soaked
    """
    said = asdict(found)
    times = found.latency_ms.items()
    said["latency_ms"] = {name: t if math.isfinite(t) else None for name, t in times}
    return json.dumps(said, indent=2, allow_nan=False) + "\n"


def _run(arguments: Sequence[str]) -> int:
    parser = Parser(prog="soak", description=(__doc__ or "").split("\n\n")[2])
    parser.add_argument("--minutes", type=float, default=10.0, help="how long (default 10)")
    parser.add_argument("--json", type=Path, metavar="F", help="write the result as JSON")
    parser.add_argument(
        "--rt-priority",
        type=int,
        default=0,
        metavar="N",
        help="ask for SCHED_FIFO of this priority and locked memory (default 0: do not)",
    )
    parser.add_argument(
        "--busy",
        type=int,
        default=0,
        metavar="N",
        help="as many processes beside it that compute without end (default 0)",
    )
    parser.add_argument(
        "--root", type=Path, default=Path(), metavar="DIR", help="repository (default: here)"
    )
    options = parser.parse_args(arguments)
    if not 0.0 < options.minutes <= 500.0:
        raise IdentError(f"--minutes: expected more than 0, at most 500, found {options.minutes}")
    if not 0 <= options.busy <= _MOST_BUSY:
        raise IdentError(f"--busy: expected 0 to {_MOST_BUSY} processes, found {options.busy}")
    # What runs, whatever is edited meanwhile.
    of = None if options.json is None else made.made(options.root)
    found = soak(options.minutes, rt_priority=options.rt_priority, busy=options.busy)
    print(text_of(found), flush=True)
    if of is not None:
        try:
            made.write(options.json, json_of(found), of)
        except OSError as error:
            raise IdentError(f"{options.json}: cannot be written: {error.strerror}") from error
    return 0


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point of `python -m hydro_ident.bench.soak`."""
    return run_command("soak", _run, arguments)


if __name__ == "__main__":
    sys.exit(main())
