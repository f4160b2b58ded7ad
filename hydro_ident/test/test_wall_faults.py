"""Faults put into running processes: those at the machine's two ends and at the bridge's own.

In real time, and so for a computer that has nothing else to do: three minutes beside other tests
would say more of these than of the bridge. `scripts/faults.sh` runs every kind, these and the
others: bad commands of every sort, what a proxy does to the bus, and signals to every process.
"""

from __future__ import annotations

import os
import random
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from hydro_hw_bridge.faults.bus_faults import LINK
from hydro_hw_bridge.faults.machine_faults import MISSING
from hydro_ident.errors import IdentError
from hydro_ident.study.faults.device_time import limits_of
from hydro_ident.study.faults.ros_end import RosEnd
from hydro_ident.study.faults.stage import Stage
from hydro_ident.study.faults.valve_record import excess_v
from hydro_ident.study.faults.wall_ends import EndDeeds
from hydro_ident.study.faults.wall_link import LinkDeeds
from hydro_ident.study.faults.wall_outcomes import WallOutcome
from hydro_ident.study.faults.wall_processes import ProcessDeeds
from hydro_ident.study.faults.wall_time import WallRun
from hydro_model.robot_files import load_robot

pytestmark = pytest.mark.ros
quiet = pytest.mark.skipif(
    "HYDRO_WALL_FAULTS" not in os.environ,
    reason="in real time: set HYDRO_WALL_FAULTS on a computer that does nothing else",
)
DOMAIN = 10 + os.getpid() % 90
PORT = 2_000 + (os.getpid() + 3_500) % 5_000
#: A computer may be too busy to drive or to start a process in time: then there is no outcome.
TRIES = 5
DRIVES_ON = ("publisher: twice", "publisher: backwards", "driven again after a trip")
STOPS = (
    *(f"machine: {kind}" for kind in MISSING),
    "publisher: nan",
    "publisher: second_controller",
    "publisher: silent",
)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Iterator[WallRun]:
    before = dict(os.environ)
    os.environ |= {"ROS_DOMAIN_ID": str(DOMAIN), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    robot = load_robot("xs031")
    limits = limits_of(robot)
    stage = Stage(tmp_path_factory.mktemp("stage"), robot)
    ros = RosEnd(limits)
    buses = (f"udp_multicast:239.74.163.2:{PORT}", f"udp_multicast:239.74.163.2:{PORT + 1}")
    try:
        found = WallRun(stage, ros, limits, buses)
        found.begin()
        yield found
    finally:
        ros.close()
        stage.end()
        os.environ.clear()
        os.environ.update(before)


def outcome_of(run: WallRun, deed: Callable[[random.Random], WallOutcome]) -> WallOutcome:
    source = random.Random(1)
    for _ in range(TRIES):
        try:
            return deed(source)
        except IdentError as error:
            print(error)
            run.stage.end("controller", "second")
            run.recover()
    raise AssertionError(f"no outcome in {TRIES} tries")


@quiet
@pytest.mark.parametrize("kind", STOPS)
def test_it_stops_is_named_and_stays_so(run: WallRun, kind: str) -> None:
    found = outcome_of(run, EndDeeds(run).deeds()[kind])
    assert found.kind == kind
    assert found.broken == ""
    assert found.stop_ms is not None


@quiet
@pytest.mark.parametrize("kind", DRIVES_ON)
def test_it_is_driven_on(run: WallRun, kind: str) -> None:
    found = outcome_of(run, EndDeeds(run).deeds()[kind])
    assert found.kind == kind
    assert found.broken == ""
    assert found.limit_ms is None


@quiet
@pytest.mark.parametrize("kind", LINK)
def test_the_bridges_own_end_of_the_bus_fails(run: WallRun, kind: str) -> None:
    found = outcome_of(run, LinkDeeds(run).deeds()[f"bus, own end: {kind}"])
    assert found.broken == ""
    assert found.stop_ms is not None


@quiet
def test_a_second_controller_ends_driving(run: WallRun, tmp_path: Path) -> None:
    deeds = ProcessDeeds(run, tmp_path).deeds()
    found = outcome_of(run, deeds["process: a second controller"])
    assert found.broken == ""


def test_the_page_says_how_many_of_the_campaigns_kinds_are_tried_here() -> None:
    page = (Path(__file__).parents[2] / "hydro_msgs_docs/safety_case.md").read_text("utf-8")
    count = len({*STOPS, *DRIVES_ON, *LINK}) + 1  # and a second controller
    assert f"{count} of them are tried once each in `test_wall_faults.py`" in page


def record(*rows: tuple[int, int, float]) -> np.ndarray:
    """Cycles with (enabled, heard, V) as the rig writes them down, of two valves."""
    return np.array([(on, 0.0, heard, volts, -volts) for on, heard, volts in rows])


def test_a_step_of_the_record_is_held_to_the_cycles_that_lie_between() -> None:
    limits = limits_of(load_robot("xs031"))  # 0.02 V a cycle; a frame may be 5 cycles old
    off, ramp = [(0, 1, 0.0)] * 3, [(1, 1, 0.02 * k) for k in range(1, 40)]
    assert excess_v(record(*off), limits) == 0.0
    assert excess_v(record(*off, *ramp), limits) < 0.0
    # Nothing heard for ten cycles, and then what was commanded meanwhile at once.
    held = [(1, 0, 0.78)] * 10
    assert excess_v(record(*off, *ramp, *held, (1, 1, 0.78 + 0.31)), limits) < 0.0
    assert excess_v(record(*off, *ramp, *held, (1, 1, 0.78 + 0.33)), limits) > 0.0
    assert excess_v(record(*off, *ramp, (1, 1, 0.78 + 0.2)), limits) == pytest.approx(0.079)
    # On at 0 V, or one frame of the ramp later.
    assert excess_v(record(*off, (1, 1, 0.0), *ramp), limits) < 0.0
    assert excess_v(record(*off, (1, 1, 6.6), *ramp), limits) > 6.0
    # 0 V may come at once, and after a second any legal step.
    assert excess_v(record(*off, *ramp, (1, 1, 0.0), (0, 1, 0.0)), limits) < 0.0
    late = [(1, 1, 0.78)] * 461
    assert excess_v(record(*off, *ramp, *late, (1, 1, 2.78)), limits) < 0.0
    assert excess_v(record(*off, *ramp, *late[1:], (1, 1, 2.78)), limits) > 0.0
