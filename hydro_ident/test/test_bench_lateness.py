"""Cycles that nobody answered are late without end: in percentiles, in JSON and on the page."""

from __future__ import annotations

import json
import math
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from hydro_ident.bench import chain_jobs, page
from hydro_ident.bench import soak as soak_module
from hydro_ident.bench.command import _write
from hydro_ident.bench.job import Row
from hydro_ident.bench.made import file_of
from hydro_ident.bench.soak import Memory, Soaked, Trips, computing, json_of, text_of
from hydro_ident.bench.timed_bus import lateness


def test_percentiles_are_over_all_cycles_those_without_an_answer_infinitely_late() -> None:
    times = np.arange(1.0, 991.0)  # 990 answers of 1000 cycles
    assert lateness(times, 10, 50.0) == 500.0
    assert lateness(times, 10, 99.0) == 990.0
    assert math.isinf(lateness(times, 10, 99.1))
    assert lateness(times, 0, 100.0) == 990.0


def _chain(times: np.ndarray, lost: int) -> Any:
    bus = SimpleNamespace(
        begin=lambda: None,
        lost=lost,
        cycles=len(times) + lost,
        latencies_s=lambda: times,
        reactions_s=lambda: times,
    )

    @contextmanager
    def chain() -> Any:
        yield SimpleNamespace(bus=bus, processes={}, check=lambda: None)

    return chain()


def test_a_chain_that_drops_its_late_cycles_is_no_faster_than_one_that_answers_them(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(chain_jobs.time, "sleep", lambda _: None)
    quick = np.full(9_980, 1e-3)
    dropped = chain_jobs.measured(_chain(quick, 20), 1.0)
    answered = chain_jobs.measured(_chain(np.append(quick, np.full(20, 0.04)), 0), 1.0)
    assert dropped.latency_s["p50"] == answered.latency_s["p50"] == 1e-3
    assert answered.latency_s["p99.9"] == 0.04
    assert math.isinf(dropped.latency_s["p99.9"])
    assert (dropped.lost, dropped.cycles) == (20, 10_000)


def test_lost_cycles_of_both_are_in_the_rows(monkeypatch: pytest.MonkeyPatch) -> None:
    def measured(chain: str, _seconds: float) -> chain_jobs.Round:
        late, lost = {"ours": (math.inf, 30), "echo": (2e-3, 4)}[chain]
        shares = {"bridge": 0.2, "controller": 0.1}
        own, reacted = {"p50": 1e-3, "p99.9": late}, {"p50": 1e-3, "p99.9": 5e-3}
        return chain_jobs.Round(own, reacted, shares, lost, 10_000)

    monkeypatch.setattr(chain_jobs, "_patient", lambda _: "ours")
    monkeypatch.setattr(chain_jobs, "echo", lambda: "echo")
    monkeypatch.setattr(chain_jobs, "measured", measured)
    middle, late, *reacted, _, _ = chain_jobs.chain_rows(3, 1.0)
    assert [row.ratio for row in reacted] == [1.0, 1.0]
    for row in (middle, late, *reacted):
        assert (row.lost_ours, row.cycles_ours) == (90, 30_000)
        assert (row.lost_theirs, row.cycles_theirs) == (12, 30_000)
        assert row.rounds == 3
    assert middle.met
    assert (late.ratio, late.met) == (0.0, False)


def test_a_row_without_an_end_is_valid_json_and_said_in_words(tmp_path: Any) -> None:
    counts = {"lost_ours": 90, "cycles_ours": 30_000, "lost_theirs": 12, "cycles_theirs": 30_000}
    ours = Row("a job, p99.9", "an echo", math.inf, 0.002, 0.0, 0.667, 3, **counts)
    theirs = Row("a job, p99.9", "an echo", 0.002, math.inf, math.inf, 0.667, 3, **counts)
    both = Row("a job, p99.9", "an echo", math.inf, math.inf, 0.0, 0.667, 3, **counts)
    file = tmp_path / "bench.json"
    _write(file, [ours, theirs, both], {})
    file_of(file).unlink()

    def refuse(constant: str) -> None:
        raise AssertionError(f"{constant} is not JSON")

    found = json.loads(file.read_text(), parse_constant=refuse)
    assert [one["ours"] for one in found] == [None, 0.002, None]
    assert [Row.of_json(one) for one in found] == [ours, theirs, both]
    assert [row.met for row in (ours, theirs, both)] == [False, True, False]
    said = page.table(tmp_path, "bench.json")
    assert "| an echo | never answered | 0.002 | 0.00 | 0.667 | no |" in said
    assert "| an echo | 0.002 | never answered | any | 0.667 | yes |" in said
    assert "90 of 30000 by bridge and controller, 12 of 30000 by the echo." in said


def test_a_goal_missed_by_a_little_is_not_met() -> None:
    assert not Row("a job", "a peer", 1.001, 1.0, 1.0 / 1.001, 1.0).met
    assert Row("a job", "a peer", 1.0, 1.0, 1.0, 1.0).met


class _Bus:
    """Trips in its 200th cycle; clearing takes 300 cycles, of which the last 100 are answered."""

    def __init__(self) -> None:
        self.cycles, self.answered, self.silence = 450, 195, 250

    def rearm(self) -> bool:
        self.cycles, self.answered, self.silence = 750, 295, 0
        return True


def test_a_trip_excludes_what_was_not_answered_from_the_last_answer_until_it_is_cleared(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    clock = iter((0.0, 1.0))
    stopped = SimpleNamespace(monotonic=lambda: next(clock), sleep=lambda _: None)
    monkeypatch.setattr("hydro_ident.bench.soak.time", stopped)
    bus = _Bus()
    trips = Trips(SimpleNamespace(bus=bus, check=lambda: None, rearm=bus.rearm))  # type: ignore[arg-type]
    trips.watch(0.5)
    # Five of the 200 before the trip were lost without one: they stay.
    assert (trips.cleared, trips.waited) == (1, 450)
    assert bus.cycles - bus.answered - trips.waited == 5


def test_a_soak_says_what_was_never_answered() -> None:
    times = {"p50": 1.0, "p99.9": math.inf}
    found = Soaked(1.0, 0, 0, 30_000, 100, 1, 10, times, [0] * 15, {"rig": Memory(1.0, 1.0, 1.0)})
    assert json.loads(json_of(found))["latency_ms"] == {"p50": 1.0, "p99.9": None}
    assert "p99.9  never answered" in text_of(found)


def test_what_computes_beside_a_soak_ends_with_it() -> None:
    before = children()
    with computing(2):
        busy = children() - before
        assert len(busy) == 2
    assert children() == before


def children() -> set[int]:
    """Processes that this one has started and that have not ended."""
    own = Path("/proc/self/task")
    return {int(pid) for task in own.iterdir() for pid in (task / "children").read_text().split()}


def test_trips_that_follow_on_each_other_do_not_count_a_cycle_twice(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Three in a row, and nothing was answered in between: 250 cycles each."""
    bus = SimpleNamespace(cycles=0, answered=0, silence=0)
    now = [0.0]

    def sleep(seconds: float) -> None:
        now[0] += seconds
        bus.cycles = bus.silence = round(500.0 * now[0])

    clock = SimpleNamespace(sleep=sleep, monotonic=lambda: now[0])
    monkeypatch.setattr(soak_module, "time", clock)
    running = SimpleNamespace(bus=bus, check=lambda: None, rearm=lambda: True)
    trips = Trips(running)  # type: ignore[arg-type]
    trips.watch(1.5)
    assert trips.cleared == 3
    assert trips.waited == bus.cycles == 750
