"""What stamps say of rate and gaps: coarse clocks, jitter, late and queued messages."""

from __future__ import annotations

import numpy as np
import pytest

from hydro_ident.bag.gaps import contiguous, find_gaps, usual_period_s
from hydro_ident.bag.intervals import Intervals
from hydro_ident.bag.recording import read_recording
from hydro_ident.estimate.flows.chambers import EDGES
from hydro_ident.estimate.flows.hydraulics import fit_hydraulics
from hydro_ident.estimate.signals.traces import traces_of
from hydro_ident.inspecting.inspection_reading import inspect_bag

START_NS = 1_700_000_000_000_000_000
PERIOD_NS = 2_000_000


def jittered(kept: np.ndarray, sigma_ns: float, seed: int) -> np.ndarray:
    """Stamps of some cycles, each late or early by chance, in order."""
    late = sigma_ns * np.random.default_rng(seed).normal(size=len(kept))
    return np.sort(START_NS + PERIOD_NS * kept + np.round(late).astype(np.int64))


def on_clock(kept: np.ndarray, period_ns: float, tick_ns: int) -> np.ndarray:
    """Stamps of some cycles as a clock of such ticks has them."""
    return START_NS + tick_ns * np.round(kept * period_ns / tick_ns).astype(np.int64)


@pytest.mark.parametrize("rate_hz", [300.0, 400.0, 600.0])
def test_the_period_is_no_whole_number_of_the_clocks_ticks(
    rate_hz: float, write_bag, run_columns, robot
) -> None:
    stamps = on_clock(np.arange(3000), 1e9 / rate_hz, 1_000_000)
    r = read_recording(write_bag(run_columns(3000), stamps=stamps), robot)
    assert r.period_s == pytest.approx(1.0 / rate_hz, rel=1.5e-4)
    assert r.gaps == ()
    gapped = np.delete(stamps, [700, 701, 1900])
    assert usual_period_s(gapped) == pytest.approx(1.0 / rate_hz, rel=1e-3)
    assert [gap.missing for gap in find_gaps(gapped, usual_period_s(gapped))] == [2, 1]
    topics = {one.topic: one for one in inspect_bag(r.path, robot).topics}
    assert topics["/joint_states"].rate_hz == pytest.approx(rate_hz, rel=1.5e-4)


def test_a_coarse_clock_scales_no_flow(write_bag, crane_run) -> None:
    robot = crane_run.robot
    count, edges = len(crane_run.q), []
    for name, tick_ns in (("fine", 1), ("coarse", 600_000)):
        stamps = on_clock(np.arange(count), PERIOD_NS, tick_ns)
        bag = write_bag(crane_run.columns(), name=name, stamps=stamps)
        fit = fit_hydraulics(robot, traces_of([read_recording(bag, robot)]))
        assert fit is not None
        edges.append([c.value(e)[0] for c in fit.cylinders for side in "ab" for e in EDGES[side]])
    np.testing.assert_allclose(edges[1], edges[0], rtol=0.01)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("sigma_ns", [2e5, 4e5])
def test_stamps_that_jitter_are_no_gaps(sigma_ns: float, seed: int) -> None:
    stamps = jittered(np.arange(30_000), sigma_ns, seed)
    period_s = float(np.median(np.diff(stamps))) * 1e-9
    assert contiguous(stamps, period_s) == (slice(0, 30_000),)
    assert find_gaps(stamps, period_s) == ()


@pytest.mark.parametrize("sigma_ns", [0.0, 2e5, 3e5])
def test_missing_cycles_are_found_among_stamps_that_jitter(sigma_ns: float) -> None:
    gone = {1: 1, 700: 1, 712: 1, 1500: 3, 2000: 40, 2998: 1}
    lost = np.concatenate([np.arange(at, at + n) for at, n in gone.items()])
    kept = np.setdiff1d(np.arange(3000), lost)
    for seed in range(5):
        stamps = jittered(kept, sigma_ns, seed)
        found = find_gaps(stamps, 0.002)
        assert [g.missing for g in found] == list(gone.values())
        cuts = np.searchsorted(kept, list(gone))
        # A neighbour may be as wide as the interval of a lone cycle that is missing.
        edges = np.array([part.stop for part in contiguous(stamps, 0.002)][:-1])
        assert np.abs(edges - cuts).max() <= (1 if sigma_ns else 0)


def test_a_late_stamp_and_those_queued_behind_it_are_no_gap() -> None:
    stamps = START_NS + PERIOD_NS * np.arange(400)
    stamps[200:204] = stamps[203] + 1000 * np.arange(4)
    assert contiguous(stamps, 0.002) == (slice(0, 400),)


def test_gaps_of_a_log_whose_times_were_rounded() -> None:
    """64 Hz in whole milliseconds: intervals of 15 and 16 ms, whose median is 2 % too long."""
    kept = np.setdiff1d(np.arange(2000), [500, 1000, 1001])
    stamps = np.round(kept * 1e3 / 64.0).astype(np.int64) * 1_000_000
    assert [g.missing for g in find_gaps(stamps, 0.016)] == [1, 2]


def test_gaps_close_to_one_another_are_told_apart() -> None:
    kept = np.array([*range(10), 12, 15, 16, 18, *range(20, 40), *range(90, 200, 1)])
    stamps = START_NS + PERIOD_NS * kept
    wide = np.flatnonzero(np.diff(kept) > 1)
    assert [g.missing for g in find_gaps(stamps, 0.002)] == (np.diff(kept)[wide] - 1).tolist()
    assert [part.start for part in contiguous(stamps, 0.002)[1:]] == (wide + 1).tolist()


@pytest.mark.parametrize("seed", range(6))
def test_the_period_is_that_of_intervals_counted_in_stretches(seed: int) -> None:
    """To the last digit, whatever is missing."""
    random = np.random.default_rng(seed)
    steps = 2_000_000 + np.round(2e5 * random.normal(size=4000 + seed)).astype(np.int64)
    steps[random.integers(0, 4000, 40)] *= 3
    counted = Intervals(most=500)
    for part in np.array_split(steps, 7):
        counted.add(part)
    stamps = 1_700_000_000_000_000_000 + np.cumsum(np.concatenate([[0], steps]))
    assert usual_period_s(stamps) == counted.period_s
