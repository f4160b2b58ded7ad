"""Every promise that a kind of injection was held to is told, each with how many and how well."""

from __future__ import annotations

import random
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from hydro_hw_bridge.faults.bus_injections import lost, sensor
from hydro_hw_bridge.faults.injection import AGE, AT_ONCE, Injection
from hydro_hw_bridge.faults.measured_rig import record_of
from hydro_hw_bridge.faults.naming import Diagnosis, Named
from hydro_hw_bridge.faults.other_injections import machine
from hydro_hw_bridge.faults.trial import Outcome
from hydro_hw_bridge.protocol.codec import Codec
from hydro_ident.study.faults.device_time import summary as device_summary
from hydro_ident.study.faults.page import told
from hydro_ident.study.faults.stage import Stage
from hydro_ident.study.faults.wall_outcomes import Judgement, WallOutcome, summary, worst_of
from hydro_ident.study.faults.wall_time import NOT_DRIVEN, WallRun
from hydro_model.robot import Robot

LOST = "bus, drawn: lost"


@pytest.fixture
def stage(tmp_path: Path, robot: Robot) -> Stage:
    """With the record of a bare timer that woke three times."""
    pairs = np.array([[0, 1_000], [2_000_000, 5_000], [4_000_000, 2_000]], dtype="<i8")
    (tmp_path / "timer.bin").write_bytes(pairs.tobytes())
    return Stage(tmp_path, robot)


def wall(*found: tuple[float | None, float | None], kind: str = LOST) -> list[WallOutcome]:
    return [WallOutcome(kind, limit, stop, 0.1, "") for limit, stop in found]


def published(part: str, result: dict[str, Any]) -> list[list[str]]:
    """Cells of the rows of the table of faults."""
    run = {"date": "2026-01-01", "minutes": 1.0, "changed_since": [], **result}
    lines = told({part: run}).split("\n\n")[1].splitlines()[2:]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]


def test_of_a_kind_in_processes_every_promise_has_its_row(stage: Stage) -> None:
    found = wall((54.0, 49.0), (None, None), (16.0, 12.0), (16.0, 17.0), (None, None))
    found += wall((6.0, 1.0), (6.0, 2.0), kind="machine: pump") + wall((None, None), kind="none")
    result = summary(found, stage, 0, 0)
    rows = published("wall_time", result)
    # Kind, injections, excused, promised, median, 90 %, worst, above, with the timer as late.
    assert [[*row[:2], row[3], *row[6:8]] for row in rows] == [
        [LOST, "2", "16.0", "17.0", "1"],
        [LOST, "1", "54.0", "49.0", "0"],
        [LOST, "2", "-", "-", "-"],
        ["machine: pump", "2", "6.0", "2.0", "0"],
        ["none", "1", "-", "-", "-"],
    ]
    # What was published of a kind before is there as it was.
    row = result["kinds"][LOST]
    assert (row["injections"], row["max_ms"], row["above"]) == (5, 49.0, 1)


def test_of_all_kinds_together_it_is_told_how_far_from_the_promise_they_ended(
    stage: Stage,
) -> None:
    found = wall((54.0, 49.0), (None, None), (16.0, 17.5)) + wall((6.0, 4.0), kind="machine: pump")
    result = summary(found, stage, 0, 0)
    beyond = result["beyond_promise_ms"]
    assert (beyond["injections"], beyond["p50"], beyond["max"]) == (3, -2.0, 1.5)
    run = {"date": "2026-01-01", "minutes": 1.0, "changed_since": [], **result}
    assert "0 V -2.0 ms from it (median)" in told({"wall_time": run})
    del run["beyond_promise_ms"]
    assert "from it (median)" not in told({"wall_time": run})


def test_a_run_of_before_is_told_by_kind(stage: Stage) -> None:
    result = summary(wall((54.0, 49.0), (54.0, 50.0), (None, None)), stage, 0, 0)
    for row in result["kinds"].values():
        del row["promises"], row["excused_by_a_stall"]
    del result["excused_by_a_stall"]
    # What was not counted then is not told as none.
    assert [row[:4] for row in published("wall_time", result)] == [[LOST, "3", "-", "54.0"]]


STALL, FAULT = "no command for 14 ms", "lift: position jumped"


class Told(WallRun):
    """Diagnostics, one after another, with these reasons of a trip."""

    def __init__(self, *reasons: str) -> None:
        self._told = iter(reasons)

    def diagnosed(self) -> Diagnosis:
        return Diagnosis({"trips": 1}, ("", next(self._told), ""))


BEFORE = Diagnosis({"trips": 1}, ("", "", ""))


def test_a_stall_in_the_place_of_what_had_to_be_seen_is_told_and_nothing_else_excuses() -> None:
    missed, named = Named(("trips",), "emergency stop"), Named()
    assert Told(STALL).not_shown(missed, BEFORE, drives_on=False) == Judgement(excused=STALL)
    assert "shows in none of" in Told(FAULT).not_shown(missed, BEFORE, drives_on=False).broken
    assert "shows in none of" in Told("").not_shown(missed, BEFORE, drives_on=False).broken
    # A trip is no excuse where nothing is missing: a silent publisher's is named so.
    assert Told(STALL).not_shown(named, BEFORE, drives_on=False) == Judgement()
    assert Told(STALL).tripped() == Judgement(excused=STALL)
    assert Told(FAULT).tripped() == Judgement(f"the bridge tripped: {FAULT}")
    assert Told("").tripped() == Judgement()
    # A diagnosis without a reason tells of no trip, however long that takes.
    assert Told("", "", FAULT).until_tripped() == FAULT


def test_what_was_excused_is_counted_by_kind_and_published(stage: Stage) -> None:
    stalled = WallOutcome(LOST, 16.0, 12.0, 0.1, "")
    found = [*wall((16.0, 11.0), (16.0, 12.0), (None, None)), worst_of(stalled, Judgement())]
    found += [worst_of(stalled, Judgement(excused=STALL))] * 2
    found += [worst_of(w, Judgement(excused=STALL)) for w in wall((None, None), kind="none")]
    result = summary(found, stage, 0, 0)
    assert (result["excused_by_a_stall"], result["broken"]) == (3, [])
    assert result["kinds"][LOST]["excused_by_a_stall"] == 2
    rows = published("wall_time", result)
    assert [row[:4] for row in rows] == [
        [LOST, "5", "2", "16.0"],
        [LOST, "1", "0", "-"],
        ["none", "1", "1", "-"],
    ]
    run = {"date": "2026-01-01", "minutes": 1.0, "changed_since": [], **result}
    assert "0 broken promises beyond the time, 3 injections of which" in told({"wall_time": run})


def test_of_a_kind_in_device_time_every_promise_has_its_row(robot: Robot) -> None:
    codec = Codec.load(None, None, robot)
    by_limit: dict[int | None, Injection] = {}
    for number in range(200):
        injection = machine(random.Random(number), codec, 0, "bridge_stopped")
        by_limit.setdefault(injection.limit_cycles, injection)
    assert set(by_limit) == {None, 13, 25}
    found = [
        Outcome(by_limit[limit], False, stop, stop is not None, "", (), 1.0, 0.0, ())
        for limit, stop in ((None, None), (25, 8), (13, 6), (13, 5), (None, None))
    ]
    result = device_summary(found, 0.002)
    # Kind, injections, of them with a promised stop, promised, worst.
    kind = "machine: bridge_stopped"
    assert published("device_time", result | {"silent": {}}) == [
        [kind, "5", "2", "26", "12"],
        [kind, "", "1", "50", "16"],
    ]
    assert result["kinds"][kind]["promised_ms"] == 50.0


def test_in_lockstep_only_what_stops_at_once_is_a_promised_stop_and_the_page_says_so(
    robot: Robot,
) -> None:
    codec = Codec.load(None, None, robot)
    draws = [lost(random.Random(number), codec, 0) for number in range(200)]
    slow = next(one for one in draws if one.limit_cycles == AGE)
    at_once = sensor(random.Random(1), codec, 0)
    assert at_once.limit_cycles == AT_ONCE
    found = [
        Outcome(injection, lockstep, stop, True, "", (), 1.0, 0.0, ())
        for injection, lockstep, stop in (
            (slow, False, 6),
            (slow, True, 60),
            (at_once, False, 1),
            (at_once, True, 1),
        )
    ]
    result = device_summary(found, 0.002) | {"silent": {}}
    assert published("device_time", result) == [
        [f"bus: {at_once.kind}", "2", "2", "2", "2"],
        ["bus: lost (device)", "2", "1", "12", "12"],
    ]
    text = told({"device_time": {"date": "2026-01-01", "changed_since": [], **result}})
    assert "with a promised stop, above 2 ms not in lockstep" in text


def test_what_waiting_for_a_core_can_have_cost_is_told_from_what_it_cannot(stage: Stage) -> None:
    """Of stops later than promised: by the timer, by the processes' waiting, or by neither."""
    found = [
        # Promised 16 ms; the timer late by 0.1 ms, the processes waited one after the other.
        WallOutcome(LOST, 16.0, stop, 0.1, "", waited_ms={"bridge": bridge, "rig": rig})
        for stop, bridge, rig in ((12.0, 0.2, 0.1), (18.0, 1.5, 1.0), (18.0, 1.0, 0.5))
    ]
    found.append(WallOutcome(LOST, 16.0, 18.0, 2.5, "", waited_ms={"bridge": 0.0}))
    row = summary(found, stage, 0, 0)["kinds"][LOST]
    assert (row["above"], row["above_with_the_timer_as_late"]) == (3, 1)
    assert (row["above_with_as_much_waiting"], row["above_with_neither"]) == (1, 1)
    assert (row["waited_p50_ms"], row["waited_max_ms"]) == pytest.approx((0.9, 2.5))
    assert row["waited_max_ms_by_process"] == {"bridge": 1.5, "rig": 1.0}
    [cells] = published("wall_time", summary(found, stage, 0, 0))
    # Above, with the timer, with waiting, with neither; timer at worst, waited median and worst.
    assert cells[7:] == ["3", "1", "1", "1", "2.5", "0.9", "2.5"]


def recorded(stage: Stage, *rows: tuple[int, float, float]) -> None:
    """A rig's record of (ms, enabled, V) per cycle, of two valves."""
    record = record_of(2)
    body = [record.pack(10**6 * ms, on, 0.0, 1.0, volts, -volts) for ms, on, volts in rows]
    stage.rig_file.write_bytes(b"".join(body))


def test_of_valves_that_were_at_0_v_before_a_fault_nothing_can_be_said(stage: Stage) -> None:
    """A computer that stalls trips the gate: 0 V then is no answer to what comes after it."""
    run = WallRun(stage, SimpleNamespace(publishing=True), None, ("", ""))  # type: ignore[arg-type]
    driven = [(ms, 1.0, 5.0) for ms in range(0, 100, 2)]
    off = [(ms, 0.0, 0.0) for ms in range(100, 140, 2)]
    recorded(stage, *driven, *off)
    stage.mark()
    found = run.measured(LOST, 98_000_000, 16.0)
    assert (found.stop_ms, found.excused) == (2.0, "")
    for since_ms in (102, 110, 139):
        for limit_ms in (16.0, None):
            late = run.measured(LOST, 10**6 * since_ms, limit_ms)
            assert (late.stop_ms, late.excused, late.broken) == (None, NOT_DRIVEN, "")
    # A machine that stood still until its fault ends: what it did last counts.
    assert stage.driven_at(98_000_000)
    recorded(stage, *driven)
    assert stage.driven_at(400_000_000)
    recorded(stage, *driven, *off)
    assert not stage.driven_at(400_000_000)
    assert not stage.driven_at(0)
    # It counts as excused, and not among the times.
    row = summary([found, late], stage, 0, 0)["kinds"][LOST]
    assert (row["injections"], row["excused_by_a_stall"], row["max_ms"]) == (2, 1, 2.0)
