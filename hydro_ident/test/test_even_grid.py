"""Readings taken at stamps that jitter are brought to even times; others stay as they are."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from hydro_ident.bag.gaps import find_gaps, usual_period_s
from hydro_ident.bag.recording import Recording
from hydro_ident.bag.stamp_jitter import StampJitter
from hydro_ident.bag.streaming import COLUMNS, Piece, cut_recording, map_columns
from hydro_ident.identify.identification import identify
from hydro_ident.inspecting.health import find_irregularities
from hydro_ident.recordings.even_grid import on_even_grid
from hydro_ident.recordings.sources import MemorySource
from hydro_model.robot_files import load_robot

START_NS, PERIOD_S, SECONDS = 1_700_000_000_000_000_000, 0.01, 20.0


def positions(time: np.ndarray) -> np.ndarray:
    """What the reference crane's joints do."""
    return np.stack([0.6 + 0.3 * np.sin(3.0 * time), -1.2 + 0.3 * np.sin(4.0 * time)], axis=1)


def taken_at(
    jitter_s: float, *, evenly: bool = False, noise: float = 1e-6, amplitude: float = 1.0
) -> Recording:
    """Readings at stamps that jitter, or of a device that samples evenly and is stamped so."""
    random, robot = np.random.default_rng(3), load_robot("xs031")
    even = np.arange(round(SECONDS / PERIOD_S)) * PERIOD_S
    stamps = even + random.uniform(-jitter_s, jitter_s, even.size)
    time = even if evenly else stamps
    q = amplitude * positions(time) + noise * random.standard_normal((even.size, 2))
    pressure = 5e6 + amplitude * 1e6 * np.sin(2.0 * time[:, None] + [0.0, 1.0])
    pressure += 4e9 * noise * random.standard_normal(q.shape)
    volts = 4.0 * np.sign(np.sin(9.0 * stamps[:, None] + [0.0, 1.0]))
    none = dict.fromkeys(
        ("stroke", "effort", "supply", "tank", "command_v", "spool", "q_ref", "qd_ref",
         "force_ref", "tip_ref", "temperature_stamp_ns", "temperature_c")
    )  # fmt: skip
    stamp_ns = START_NS + np.round(stamps * 1e9).astype(np.int64)
    period_s = usual_period_s(stamp_ns)
    return Recording(
        path=Path("bag"), robot=robot, stamp_ns=stamp_ns, period_s=period_s, q=q,
        p_a=pressure, p_b=pressure[:, ::-1].copy(),
        valve_v=volts, valve_source="/valve_state", latched=np.zeros(even.size, dtype=bool),
        losses=(), gaps=find_gaps(stamp_ns, period_s), duplicates={}, notes=(), metadata={},
        **none,
    )  # fmt: skip


def used(read: Recording) -> Recording:
    return next(MemorySource(read).pieces()).recording


def jitter_of(read: Recording) -> StampJitter:
    jitter = StampJitter(read.period_s)
    jitter.add(read)
    return jitter


@pytest.mark.parametrize("jitter_s", [1e-3, 3e-3])
def test_readings_at_stamps_that_jitter_are_brought_to_even_times(jitter_s: float) -> None:
    read = taken_at(jitter_s)
    laid = used(read)
    assert len(laid) == pytest.approx(SECONDS / read.period_s, abs=2)
    assert np.ptp(np.diff(laid.stamp_ns)) <= 1
    time = (laid.stamp_ns - START_NS) * 1e-9
    # Taken for even ones they were off by speed times jitter, 0.9 rad/s times 0.6 ms.
    assert np.abs(laid.q - positions(time)).max() < 8e-6
    [note] = laid.notes
    assert "readings were taken at them: they are interpolated" in note
    assert jitter_of(read).rms_s == pytest.approx(jitter_s / np.sqrt(3.0), rel=0.1)
    [found] = [f for f in find_irregularities(read) if f.kind == "jitter"]
    assert not found.harmless
    assert "taken at them" in found.text


def test_evenly_sampled_readings_are_left_alone_however_their_stamps_jitter() -> None:
    read = taken_at(2e-3, evenly=True)
    laid = used(read)
    assert laid is read
    [found] = [f for f in find_irregularities(read) if f.kind == "jitter"]
    assert found.harmless
    assert "taken at even times" in found.text


def test_steps_of_a_simulator_that_change_slowly_are_times_of_readings() -> None:
    """By 12 % within two seconds: no difference from cycle to cycle sees that."""
    count = round(SECONDS / PERIOD_S)
    steps = PERIOD_S * (1.0 + 0.12 * np.sin(np.pi * PERIOD_S * np.arange(count)))
    time = np.cumsum(steps)
    read = replace(taken_at(0.0), stamp_ns=START_NS + np.round(time * 1e9).astype(np.int64))
    read = replace(read, q=positions(time), period_s=usual_period_s(read.stamp_ns))
    assert jitter_of(read).rms_s < 1e-3 * read.period_s
    laid = used(read)
    assert np.ptp(np.diff(laid.stamp_ns)) <= 1
    assert np.abs(laid.q - positions((laid.stamp_ns - START_NS) * 1e-9)).max() < 5e-6
    [note] = laid.notes
    assert "now closer, now further apart" in note


def test_stamps_that_jitter_much_tell_the_period_all_the_same() -> None:
    """By the mean of what is about one interval it was 0.1 % off, and every edge with it."""
    random, read = np.random.default_rng(2), taken_at(0.0)
    late = np.round(random.uniform(-3.5e-3, 3.5e-3, len(read)) * 1e9).astype(np.int64)
    stamp_ns = read.stamp_ns + late
    period_s = usual_period_s(stamp_ns)
    assert abs(period_s / PERIOD_S - 1.0) > 5e-4
    read = replace(read, stamp_ns=stamp_ns, period_s=period_s, gaps=find_gaps(stamp_ns, period_s))
    laid = used(read)
    assert laid.period_s == pytest.approx(PERIOD_S, rel=5e-5)
    np.testing.assert_array_equal(laid.q, read.q)


@pytest.mark.parametrize("evenly", [True, False])
def test_the_share_of_the_jitter_that_readings_have(evenly: bool) -> None:
    share, std = jitter_of(taken_at(1e-3, evenly=evenly)).share()
    assert share == pytest.approx(0.0 if evenly else 1.0, abs=4.0 * std)
    assert std < 0.02


def test_readings_that_do_not_tell_are_left_alone() -> None:
    """At rest, and where noise is far more than speed times jitter."""
    for read in (taken_at(2e-3, amplitude=0.0), taken_at(1e-4, noise=1e-2)):
        assert jitter_of(read).of_readings is None
        assert used(read) is read
        [found] = [f for f in find_irregularities(read) if f.kind == "jitter"]
        assert "do not tell" in found.text


def test_even_stamps_are_not_touched() -> None:
    for read in (taken_at(0.0), taken_at(1e-5)):
        assert used(read) is read
        assert not [f for f in find_irregularities(read) if f.kind == "jitter"]


def test_ticks_of_a_clock_are_no_times_of_readings() -> None:
    """300 Hz stamped by a clock of 1 ms."""
    read = taken_at(0.0)
    ms = np.round(np.arange(len(read)) * 10.0 / 3.0).astype(np.int64)
    read = replace(read, stamp_ns=START_NS + ms * 1_000_000)
    read = replace(read, period_s=usual_period_s(read.stamp_ns))
    assert used(read) is read


def test_lost_cycles_stay_lost_and_lost_readings_unknown() -> None:
    read = taken_at(1e-3)
    kept = np.ones(len(read), dtype=bool)
    kept[[500, 1000, *range(1500, 1540)]] = False
    read = map_columns(read, lambda values: values[kept])
    read = replace(read, gaps=find_gaps(read.stamp_ns, read.period_s))
    q = read.q.copy()
    q[200, 0] = np.nan
    laid = used(replace(read, q=q))
    steps = np.diff(laid.stamp_ns) * 1e-9 / read.period_s
    assert sorted(np.round(steps[steps > 1.5])) == [2.0, 2.0, pytest.approx(41.0, abs=1.0)]
    assert np.isnan(laid.q).sum() == 1
    known = np.isfinite(laid.q)
    truth = positions((laid.stamp_ns - START_NS) * 1e-9)
    assert np.abs(laid.q - truth)[known].max() < 2e-5


def test_what_a_valve_was_told_holds_and_is_not_interpolated() -> None:
    read = taken_at(3e-3)
    laid = used(read)
    stamps, even = read.stamp_ns - START_NS, laid.stamp_ns - START_NS
    assert read.valve_v is not None
    assert laid.valve_v is not None
    step_ns = np.diff(even)[0]
    for k in (100, 321, 777):
        fine = even[k] + step_ns * (np.arange(2000) + 0.5) / 2000.0
        at = np.searchsorted(stamps, fine, side="right") - 1
        mean = read.valve_v[at].mean(axis=0)
        assert laid.valve_v[k] == pytest.approx(mean, abs=0.01)


def test_pieces_meet_without_a_seam() -> None:
    read = taken_at(1e-3)
    cuts, overlap = [0, 700, 1400, len(read)], 200
    pieces = []
    for begin, end in pairwise(cuts):
        first, last = max(0, begin - overlap), min(len(read), end + overlap)
        core = slice(begin - first, end - first)
        pieces.append(Piece(cut_recording(read, slice(first, last)), core, int(read.stamp_ns[0])))
    laid, whole = list(on_even_grid(pieces)), used(read)
    for name in COLUMNS:
        values = getattr(whole, name)
        if values is not None:
            parts = [getattr(p.recording, name)[p.core] for p in laid]
            np.testing.assert_allclose(np.concatenate(parts), values, rtol=1e-9, atol=1e-9)


@pytest.mark.needs("clarabel")
def test_inertias_hold_where_stamps_jitter(crane_run: Callable[[], object]) -> None:
    """A loop of 100 Hz timed by software: 8 standard deviations off where stamps went for even."""
    run, random = crane_run, np.random.default_rng(5)
    time = np.arange(len(run.q)) * 2e-3  # type: ignore[attr-defined]
    at = np.arange(0, time.size, 5)
    stamps = np.clip(time[at] + random.uniform(-1e-3, 1e-3, at.size), 0.0, time[-1])
    stamp_ns = START_NS + np.round(stamps * 1e9).astype(np.int64)
    period_s = usual_period_s(stamp_ns)
    whole = run.recording()  # type: ignore[attr-defined]
    read = {name: CubicSpline(time, getattr(whole, name))(stamps) for name in ("q", "p_a", "p_b")}
    read |= {name: getattr(whole, name)[at] for name in ("supply", "tank", "valve_v", "latched")}
    jittery = replace(
        whole, stamp_ns=stamp_ns, period_s=period_s, command_v=read["valve_v"],
        gaps=find_gaps(stamp_ns, period_s), **read,
    )  # fmt: skip
    even = replace(
        map_columns(whole, lambda values: values[::5]), period_s=0.01, path=Path("even")
    )
    of_jittery, of_even = (identify(whole.robot, [one]).parameters for one in (jittery, even))
    for one, other in zip(of_jittery, of_even, strict=True):
        if one.name.endswith((".iyy", ".mcz", ".mcx")):
            assert one.value == pytest.approx(other.value, rel=2e-3, abs=2.0 * other.std)
