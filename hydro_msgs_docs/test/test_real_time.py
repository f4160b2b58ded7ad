"""What the 500 Hz loops share: times in fixed bins, lateness, garbage collection, rights."""

from __future__ import annotations

import gc
import os
import resource
import subprocess
import sys
import threading
import weakref
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hydro_msgs_docs import real_time
from hydro_msgs_docs.loop_times import LatencyHistogram, LoopTimes, RecentTimes
from hydro_msgs_docs.real_time import RealTime, RealTimeError, RealTimeOptions, cores_of

PERIOD_NS = 2_000_000
START_NS = 1_700_000_000_000_000_000


def histogram_of(values: Any) -> LatencyHistogram:
    histogram = LatencyHistogram()
    for value in values:
        histogram.add(int(value))
    return histogram


@pytest.mark.parametrize("percent", [0.0, 1.0, 50.0, 90.0, 99.0, 99.9, 100.0])
@pytest.mark.parametrize("median_ns", [20.0, 3e3, 1.5e5, 4e9])
def test_percentiles_are_those_of_numpy_within_a_bin(percent: float, median_ns: float) -> None:
    rng = np.random.default_rng(7)
    values = np.rint(median_ns * rng.lognormal(0.0, 1.2, 5000)).astype(np.int64)
    true = int(np.percentile(values, percent, method="inverted_cdf"))
    found = histogram_of(values).percentile_ns(percent)
    assert true <= found <= true * (1 + 1 / 32)


@given(st.lists(st.integers(-5, 1 << 41), min_size=1), st.floats(0.0, 100.0))
def test_any_times_at_all(values: list[int], percent: float) -> None:
    kept = np.clip(values, 0, (1 << 40) - 1)
    histogram = histogram_of(values)
    assert histogram.max_ns == kept.max()
    rank = max(int(np.ceil(percent / 100.0 * len(kept))), 1)
    true = int(np.sort(kept)[rank - 1])
    assert true <= histogram.percentile_ns(percent) <= true * (1 + 1 / 32)
    assert histogram_of(values[1:]).merged(histogram_of(values[:1])).percentile_ns(
        percent
    ) == histogram.percentile_ns(percent)


def test_without_values_there_is_nothing_to_say() -> None:
    assert LatencyHistogram().percentile_ns(99.0) == 0
    assert set(LoopTimes(0.002).values().values()) == {0, "0"}


def test_recent_times_forget_all_but_the_worst() -> None:
    times = RecentTimes()
    times.add(9_000_000)
    for _ in range(2600):
        times.add(50_000)
    assert times.values("loop")["loop_max_us"] == "9000"
    for _ in range(5000):
        times.add(50_000)
    assert times.values("loop") == {
        "loop_p50_us": "50",
        "loop_p99_us": "50",
        "loop_max_us": "50",
        "loop_worst_us": "9000",
    }


def loop(arrivals: Callable[[int], float], cycles: int) -> LoopTimes:
    """A loop that takes sample k so many ns after it is due."""
    times = LoopTimes(1e-9 * PERIOD_NS)
    for k in range(cycles):
        times.took(START_NS + k * PERIOD_NS, int(k * PERIOD_NS + arrivals(k)))
    return times


def test_a_loop_in_time_has_no_late_cycle_whatever_the_clocks() -> None:
    for drift in (-1e-4, 0.0, 1e-4):
        times = loop(lambda k, d=drift: 5e6 + d * k * PERIOD_NS + 1e5 * (k % 3), 20_000)  # type: ignore[misc]
        assert times.late_cycles == 0
        assert times.lateness.worst_ns <= 2e5 + 1e5


def test_a_machine_clock_that_stood_still_is_forgotten_within_a_second() -> None:
    times = loop(lambda k: 3e5 + 1e10 * (k >= 1000), 20_000)
    assert 250 <= times.late_cycles <= 500
    assert times.values()["lateness_max_us"] == "0"
    assert times.values()["lateness_worst_us"] == "10000000"


def test_a_blocked_loop_counts_the_cycles_that_waited() -> None:
    # Nothing is taken for 20 ms from sample 100 on; then all that waited at once.
    times = loop(lambda k: 3e5 + max(0.0, 20e6 - (k - 100) * PERIOD_NS) * (k >= 100), 1000)
    assert times.late_cycles == 9
    assert times.values()["late_cycles"] == 9
    assert times.lateness.worst_ns == pytest.approx(20e6, abs=1e4)
    assert int(str(times.values()["lateness_worst_us"])) == pytest.approx(20_000, abs=10)


def test_repeated_and_older_samples_are_not_late() -> None:
    times = LoopTimes(1e-9 * PERIOD_NS)
    for stamp_ns, now_ns in ((START_NS, 0), (START_NS, 10**9), (START_NS - PERIOD_NS, 10**9)):
        times.took(stamp_ns, now_ns)
    assert times.late_cycles == 0
    assert times.lateness.worst_ns == 0


@pytest.mark.parametrize(
    ("text", "cores"),
    [("", ()), ("2", (2,)), ("2 4-5", (2, 4, 5)), (" 5,4,,4-4 ", (4, 5)), ("0-3", (0, 1, 2, 3))],
)
def test_lists_of_cores(text: str, cores: tuple[int, ...]) -> None:
    assert cores_of(text) == cores


@pytest.mark.parametrize("text", ["two", "-1", "3-", "3-1", "1.5", "0x2", "99999"])
def test_what_is_no_list_of_cores_is_refused(text: str) -> None:
    values = {"rt_priority": 0, "lock_memory": False, "cpu_affinity": f"1 {text}"}
    with pytest.raises(RealTimeError, match=f"cpu_affinity.*found '{text}'"):
        RealTimeOptions.of(values)


class Node:
    """A container that refers to itself, as futures and exceptions with a traceback do."""

    def __init__(self) -> None:
        self.own = self


@pytest.fixture
def prepared() -> Iterator[RealTime]:
    measures = RealTime(RealTimeOptions(), print)
    measures.prepare()
    yield measures
    measures.leave()


def test_collection_is_off_in_the_loop_and_on_again_after() -> None:
    assert gc.isenabled()
    gc.unfreeze()  # what a worker of pytest-xdist has collected (conftest.py)
    measures = RealTime(RealTimeOptions(), print)
    measures.prepare()
    measures.prepare()
    assert not gc.isenabled()
    assert gc.get_freeze_count() > 0
    measures.leave()
    measures.leave()
    assert gc.isenabled()
    assert gc.get_freeze_count() == 0


def test_cycles_of_references_are_collected_in_idle_time_and_not_before(
    prepared: RealTime,
) -> None:
    kept = [weakref.ref(Node()) for _ in range(2000)]
    assert all(ref() is not None for ref in kept)
    prepared.idle()
    assert prepared.collections == 1
    assert all(ref() is None for ref in kept)


def test_what_outlives_young_collections_is_collected_too(
    prepared: RealTime, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(real_time, "_COSTLY_NS", 10**12)
    node = Node()
    ref = weakref.ref(node)
    for collected in range(200):
        if collected == 12:  # it has grown old: in the oldest generation
            del node
        filler = [[] for _ in range(400)]  # type: ignore[var-annotated]
        prepared.idle()
        del filler
    assert ref() is None
    assert prepared.collections == 200


def test_a_costly_collection_is_not_made_twice(
    prepared: RealTime, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(real_time, "_COSTLY_NS", -1)
    frozen = gc.get_freeze_count()
    kept = [[] for _ in range(400)]  # type: ignore[var-annotated]
    prepared.idle()
    assert prepared.collections == 1
    assert gc.get_freeze_count() >= frozen + len(kept)


def test_few_young_ones_are_left_and_a_burst_is_not_walked(prepared: RealTime) -> None:
    prepared.idle()
    before, frozen = prepared.collections, gc.get_freeze_count()
    few = [[] for _ in range(10)]  # type: ignore[var-annotated]
    prepared.idle()
    assert prepared.collections == before
    many = [[] for _ in range(20_000)]  # type: ignore[var-annotated]
    prepared.idle()
    assert prepared.collections == before
    assert gc.get_freeze_count() >= frozen + len(few) + len(many)
    assert gc.get_count()[0] < 1000


@pytest.fixture
def said() -> list[str]:
    return []


def test_refusals_are_said_once_and_the_process_goes_on(
    said: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def refused(*_arguments: object) -> None:
        raise PermissionError(1, "Operation not permitted")

    for name in ("sched_setscheduler", "sched_setaffinity"):
        monkeypatch.setattr(os, name, refused)
    monkeypatch.setattr(resource, "getrlimit", lambda _which: (65536, 65536))
    monkeypatch.setattr(real_time, "_may_lock", lambda: False)
    measures = RealTime(RealTimeOptions(40, True, (0, 1)), said.append)
    for _ in range(2):
        measures.prepare()
        measures.enter()
        measures.leave()
    assert len(said) == 3
    assert "memory lock refused, going on without: memlock limit 64 KiB" in said[0]
    assert "SCHED_FIFO 40 refused, going on without: Operation not permitted" in said[1]
    assert "core 0 1 refused" in said[2]
    values = measures.values()
    assert values["real_time"] == "off"
    assert values["real_time_refused"] == "memory lock; SCHED_FIFO 40; core 0 1"


def test_cores_are_bound_for_the_thread_of_the_loop_alone(said: list[str]) -> None:
    mine = os.sched_getaffinity(0)
    core = min(mine)
    measures = RealTime(RealTimeOptions(cpu_affinity=(core,)), said.append)
    found: list[set[int]] = []

    def body() -> None:
        measures.enter()
        found.append(os.sched_getaffinity(0))

    thread = threading.Thread(target=body)
    thread.start()
    thread.join()
    assert found == [{core}]
    assert os.sched_getaffinity(0) == mine
    assert measures.values()["real_time"] == f"core {core}"
    assert not said


#: What a process gets that asks for everything: of each thread policy and priority, and the memory
#: that is locked. In a process of its own, as no thread gives back what it was given.
_ASKS = """
import os, re, threading
from hydro_msgs_docs.real_time import RealTime, RealTimeOptions
told, go = [], threading.Event()
measures = RealTime(RealTimeOptions(40, True), told.append)
other = threading.Thread(target=go.wait)
other.start()
measures.prepare()
loop = threading.Thread(target=lambda: (measures.enter(), ready.set(), go.wait()))
ready = threading.Event()
loop.start()
ready.wait()
for thread in (loop, other):
    number = thread.native_id
    print(os.sched_getscheduler(number), os.sched_getparam(number).sched_priority)
print(re.search(r"VmLck:\\s*(\\d+)", open("/proc/self/status").read())[1])
print(measures.values()["real_time"], told)
go.set()
"""


def test_what_the_system_grants_is_had() -> None:
    """The loop comes before the threads that bring its samples, these before all others'."""
    done = subprocess.run(
        [sys.executable, "-c", _ASKS], capture_output=True, text=True, check=True
    )
    *threads, locked_kb, granted = done.stdout.splitlines()
    if "refused" in granted:
        pytest.skip(f"this machine grants less: {granted}")
    assert threads == [f"{os.SCHED_FIFO} 40", f"{os.SCHED_FIFO} 39"]
    assert int(locked_kb) > 1000
    assert granted == "memory lock; SCHED_FIFO 40 []"


def test_the_loop_asks_for_more_than_the_other_threads(
    said: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """One that has ended meanwhile is no refusal, and raises the others none the less."""
    asked: list[tuple[int, int, int]] = []

    def grant(thread: int, policy: int, param: os.sched_param) -> None:
        if thread == gone:
            raise ProcessLookupError
        asked.append((thread, policy, param.sched_priority))

    mine, gone = threading.get_native_id(), 1 << 22
    monkeypatch.setattr(os, "sched_setscheduler", grant)
    monkeypatch.setattr(real_time, "_threads", lambda: [gone, mine])
    measures = RealTime(RealTimeOptions(40), said.append)
    measures.prepare()
    measures.enter()
    measures.leave()
    assert asked == [(mine, os.SCHED_FIFO, 39), (0, os.SCHED_FIFO, 40)]
    assert measures.values()["real_time"] == "SCHED_FIFO 40"
    assert not said
