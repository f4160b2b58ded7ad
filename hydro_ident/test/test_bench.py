"""The benchmark's jobs at tiny sizes: the same work, real processes, no times asserted."""

from __future__ import annotations

import json
import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, replace
from pathlib import Path

import can
import numpy as np
import pytest

from hydro_hw_bridge.bus.bus_name import BusName
from hydro_hw_bridge.protocol.codec import Codec
from hydro_hw_bridge.protocol.frames import Readings, Status
from hydro_ident.bench import fit, fit_jobs, growth
from hydro_ident.bench.chain import LARGEST_AGE_MS, echo, product
from hydro_ident.bench.chain_jobs import QUANTILES, measured
from hydro_ident.bench.command import main
from hydro_ident.bench.diagnose_jobs import EFFECTS, diagnosed
from hydro_ident.bench.job import Row, against_limit
from hydro_ident.bench.limits import BASE, HELP
from hydro_ident.bench.page import line, with_tables
from hydro_ident.bench.soak import EDGES_MS, Memory, Soaked, Trips, soak, text_of
from hydro_ident.bench.timed_bus import TimedBus
from hydro_ident.errors import IdentError
from hydro_ident.study.long_bag import bag_of
from hydro_ident.study.peak import spent
from hydro_ident.study.synthetic import synthetic_recording
from hydro_model.robot_files import load_robot

SAMPLES = 600


@pytest.fixture(scope="module")
def task() -> fit.Task:
    return fit.make_task(SAMPLES)


@pytest.fixture(scope="module")
def ours(task: fit.Task) -> fit.Fit:
    return fit.fit_ours(task)


def test_the_fit_finds_the_chain_that_made_the_torques(task: fit.Task, ours: fit.Fit) -> None:
    x = fit._columns(fit.chain(fit.DOF), task, slice(None), fit.base_map(fit.chain(6)).leading)
    left = task.torque - x @ ours.theta
    assert ours.rows == SAMPLES * fit.DOF
    assert np.sqrt(np.mean(left**2)) == pytest.approx(fit.NOISE_N_M, rel=0.1)


def test_the_peer_finds_the_same(task: fit.Task, ours: fit.Fit) -> None:
    if reason := fit_jobs.missing_peer():
        pytest.skip(reason)
    theirs = fit.fit_theirs(task)
    fit.compare(ours, theirs)
    with pytest.raises(AssertionError, match="parameters differ"):
        fit.compare(ours, replace(theirs, values=1.01 * theirs.values))
    with pytest.raises(AssertionError, match="deviations differ"):
        fit.compare(ours, replace(theirs, std=3.0 * theirs.std))


def test_the_peer_finds_the_same_to_its_digits_where_noise_is_taken_for_white(
    task: fit.Task, ours: fit.Fit
) -> None:
    if reason := fit_jobs.missing_peer():
        pytest.skip(reason)
    theirs = fit.fit_theirs(task)
    fit.compare(fit.fit_ours(task, 0), theirs, 0)
    with pytest.raises(AssertionError, match="parameters differ"):
        fit.compare(ours, theirs, 0)


def test_memory_is_that_of_processes_which_do_the_fit(tmp_path: Path) -> None:
    if reason := fit_jobs.missing_peer():
        pytest.skip(reason)
    row = fit_jobs.memory_row(tmp_path, 1, SAMPLES)
    assert row.job.endswith("MiB")
    assert min(row.ours, row.theirs) > 30.0
    assert row.ratio == row.theirs / row.ours


@pytest.mark.thorough
def test_a_diagnosis_says_when_it_had_named(tmp_path: Path) -> None:
    one = diagnosed(tmp_path, 0.2)
    assert 0.0 < one.named_s < one.seconds
    assert one.peak_mb > 30.0
    assert EFFECTS[0].name in one.names


def test_exponents_are_slopes_of_logarithms() -> None:
    assert growth.exponent([1.0, 10.0, 100.0], [2.0, 20.0, 200.0]) == pytest.approx(1.0)
    assert growth.exponent([1.0, 10.0, 100.0], [90.0, 90.0, 90.0]) == pytest.approx(0.0)
    assert growth.exponent([1.0, 100.0], [1.0, 10.0]) == pytest.approx(0.5)


def _short_bag(folder: Path) -> Path:
    """What is asked of its player and recorder, three seconds tell."""
    return bag_of(0.05, folder, synthetic_recording(load_robot("xs031"), 3.0, seed=1))


@pytest.mark.ros
def test_what_is_played_is_recorded_and_both_are_watched(tmp_path: Path) -> None:
    bag = _short_bag(tmp_path)
    passed = growth.passed_on(bag, tmp_path / "live")
    assert set(passed.used) == set(growth.LIVE)
    used = passed.used.values()
    assert all(0.0 < seconds < 60.0 and peak_mb > 30.0 for seconds, peak_mb in used)
    # On a busy machine some may be lost, and are counted.
    assert 0 < passed.recorded <= passed.played
    assert list(tmp_path.iterdir()) == [bag]


@pytest.mark.ros
def test_a_loss_on_the_way_is_counted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Nobody has found the player yet when it begins: its first messages go nowhere."""
    monkeypatch.setattr(growth, "_MEET_S", 0.0)
    passed = growth.passed_on(_short_bag(tmp_path), tmp_path / "live")
    assert passed.recorded < passed.played
    row = growth.lost_row([0.05, 0.5], [passed, growth.Passed({}, 10 * passed.played, 0)])
    lost = 11 * passed.played - passed.recorded
    assert row.ours == pytest.approx(lost / (11 * passed.played))
    assert not row.met
    assert growth.lost_row([0.05], [growth.Passed({}, 1000, 1000)]).met


def test_what_is_measured_is_the_command(tmp_path: Path) -> None:
    """A module that ends without a word would be quick, and flat."""
    with pytest.raises(IdentError, match=r"inspect ended with 2: .*no bag"):
        spent("hydro_ident.commands.inspect", [str(tmp_path / "nowhere")])


FORKING = """
import os, time
shared = bytearray(60 * 2**20)
pid = os.fork()
if not pid:
    own = bytearray(100 * 2**20)
    time.sleep(1.0)
    os._exit(0)
os.waitpid(pid, 0)
"""


def test_memory_of_what_it_forks_counts_once() -> None:
    """60 MiB that both see, and 100 that the forked process has for itself.

    Both are zeros that are written in place: a copy in passing would count where it is met.
    """
    taken = spent("timeit", ["-n", "1", "-r", "1", "-s", FORKING, "pass"])
    assert 160.0 < taken.peak_mb < 200.0


class _Wire(can.BusABC):
    """A wire that gives back what was put on it."""

    def __init__(self) -> None:
        super().__init__("wire")
        self.waiting: list[can.Message] = []

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """The device's own frames go nowhere."""

    def recv(self, timeout: float | None = None) -> can.Message | None:
        return self.waiting.pop(0) if self.waiting else None


def test_a_cycle_ends_with_its_first_enabled_answer() -> None:
    codec, wire = Codec.load(None, None, load_robot("xs031")), _Wire()
    bus = TimedBus(BusName("test", "wire"), wire, codec)
    for counter in range(7):
        readings = Readings(counter, Status(), (0.5, -1.0), (1e6,) * 6, (0.0, 0.0))
        for message in codec.encode_cycle(readings):
            bus.send(message)
    answers = [(0, True), (0, True), (3, False), (2, True), (99, True)]
    wire.waiting = [codec.encode_command(c, (0.0, 0.0), enable=e) for c, e in answers]
    for _ in answers:
        assert bus.receive(0.0) is not None
    assert bus.receive(0.0) is None
    # Of seven, 0 and 2 have been answered, and the newest two may be yet.
    assert (bus.cycles, bus.answered, bus.lost) == (7, 2, 3)
    late, soon = bus.latencies_s()
    assert 0.0 < soon < late
    # The answer to 2 knows of 1, which came later than 0 was answered and waited longer than 2.
    first, passed_over, own = bus.reactions_s()
    assert (first, own) == (late, soon)
    assert passed_over > soon
    bus.begin()
    assert (bus.cycles, bus.answered, bus.lost) == (0, 0, 0)
    assert not bus.reactions_s().size
    bus.close()


@contextmanager
def unless_too_busy() -> Iterator[None]:
    """Skip where the machine cannot keep 500 Hz: then the benchmark refuses to measure."""
    try:
        yield
    except IdentError as error:
        if "answered" not in str(error):
            raise
        pytest.skip(str(error))


@pytest.mark.ros
def test_the_echo_answers_the_rig() -> None:
    """As the product does in a soak."""
    with unless_too_busy():
        one = measured(echo(), 1.0)
    assert set(one.latency_s) == set(QUANTILES)
    assert 0.0 < one.latency_s["p50"] <= one.latency_s["p99.9"]
    assert len(one.core_share) == 2
    assert all(0.0 <= share < 2.0 for share in one.core_share.values())


@pytest.mark.thorough
@pytest.mark.ros
def test_a_soak_counts_every_cycle_and_watches_every_process() -> None:
    with unless_too_busy():
        one = soak(0.05, LARGEST_AGE_MS)
    assert sum(one.histogram) + one.lost <= one.cycles
    assert len(one.histogram) == len(EDGES_MS) + 1
    assert set(one.memory) == {"rig", "bridge", "controller"}
    assert all(0.0 < m.begin <= m.peak for m in one.memory.values())
    said = text_of(one)
    assert f"{one.cycles} cycles, {one.lost} not answered" in said
    assert f"one of {one.trips} trips" in said
    assert "p99.9" in said


@pytest.mark.thorough
@pytest.mark.ros
def test_a_trip_is_cleared_and_counted() -> None:
    """A controller that stands still for a while: 0 V until cleared, then answers again."""
    with unless_too_busy(), product(1.0, LARGEST_AGE_MS) as running:
        trips, controller = Trips(running), running.processes["controller"]
        controller.send_signal(signal.SIGSTOP)
        time.sleep(0.5)
        controller.send_signal(signal.SIGCONT)
        before, end = running.bus.answered, time.monotonic() + 120.0
        while not trips.cleared and time.monotonic() < end:
            trips.watch(time.monotonic() + 1.0)
        assert trips.cleared >= 1
        assert trips.waited > 0
        while running.bus.answered == before and time.monotonic() < end:
            trips.watch(time.monotonic() + 1.0)
        assert running.bus.answered > before


def test_the_page_is_made_from_the_results(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    page, results = tmp_path / "performance.md", tmp_path / "results"
    names = ("bench", "growth", "soaks")
    places = [f"<!-- {name}: begin -->\nold\n<!-- {name}: end -->" for name in names]
    page.write_text("\nbetween\n".join(["before", *places, "behind"]) + "\n")
    assert with_tables(page.read_text(), results).count("No run has been published") == 2
    rows = [Row(BASE, "a peer", 0.5, 2.0, 4.0, 3.0), against_limit(HELP, "1 s", 2.0, 1.0)]
    results.mkdir()
    (results / "bench.json").write_text(json.dumps([asdict(row) for row in rows]))
    assert main(["--publish", str(tmp_path)]) == 0
    text = page.read_text()
    assert f"{line(rows[0])} yes |" in text
    assert f"{line(rows[1])} no |" in text
    assert text.startswith("before\n")
    assert text.endswith("behind\n")
    assert "old" not in text
    assert text.count("No run has been published") == 2
    (results / "growth.json").write_text(json.dumps([asdict(rows[1])]))
    assert main(["--publish", str(tmp_path)]) == 0
    text = page.read_text()
    assert text.count(f"{line(rows[1])} no |") == 2
    assert text.count("No run has been published") == 1
    soaked = {"p50": 0.5, "p99": 2.0, "p99.9": None, "p100": None}
    memory = {name: Memory(1.0, 2.0, 2.0) for name in ("rig", "bridge", "controller")}
    run = Soaked(1.0, 40, 4, 30_000, 100, 1, 10, soaked, [0, 1200] + [0] * 13, memory)
    (results / "soak_busy_rt.json").write_text(json.dumps(asdict(run)))
    assert main(["--publish", str(tmp_path)]) == 0
    text = page.read_text()
    for row in ("up to 0.5 ms | 1 200", "p99.9, ms | never answered", "not answered | 90"):
        assert f"{row} |\n" in text
    assert with_tables(text, results) == text
    assert main(["--publish", str(tmp_path / "absent")]) == 2
    assert "cannot be published" in capsys.readouterr().err
