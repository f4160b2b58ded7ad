"""What a report's figures draw: curves without loss, correlograms, reversals, laws."""

from __future__ import annotations

import base64
from typing import Any

import numpy as np
import pytest

from hydro_ident.report.channel_rows import channel_rows
from hydro_ident.report.correlation import autocorrelation, cross_correlation
from hydro_ident.report.figure import BINS, line, one_after_another, path, thinned
from hydro_ident.report.law_section import binned


def values(trace: dict[str, Any], axis: str) -> np.ndarray:
    return np.frombuffer(base64.b64decode(trace[axis]["bdata"]), dtype="<f4")


def test_a_peak_of_one_sample_survives_thinning() -> None:
    x, y = np.linspace(0.0, 10.0, 100_000), np.zeros(100_000)
    y[61_234] = 1.0
    xs, ys = thinned(x, y)
    assert xs.size <= 2 * BINS + 2
    assert ys.max() == 1.0
    assert xs[np.argmax(ys)] == x[61_234]


def test_lines_break_where_time_jumps_and_recordings_follow_each_other() -> None:
    x = np.concatenate([np.arange(100) * 0.1, 50.0 + np.arange(100) * 0.1])
    assert np.isnan(thinned(x, np.sin(x))[0]).sum() == 1
    again = one_after_another(np.concatenate([x, x]))
    assert np.all(np.diff(again) > 0.0)
    assert np.array_equal(again[:200], x)


def test_a_constant_or_single_sample_or_nothing_still_plots() -> None:
    for count in (5, 1, 0):
        trace = line("y", (np.arange(float(count)), np.full(count, 3.0)), "#000000")
        assert values(trace, "y").size == count


def test_a_path_keeps_its_order_and_its_extremes() -> None:
    t = np.linspace(0.0, 60.0, 50_000)
    x, y = np.sin(t), np.cos(3.0 * t)
    trace = path("p", (x, y), "#000000")
    assert values(trace, "x").size < 6 * BINS
    assert values(trace, "x").max() == pytest.approx(x.max(), abs=1e-6)
    assert values(trace, "y").min() == pytest.approx(y.min(), abs=1e-6)


def test_white_noise_stays_in_its_band_and_a_tied_residual_leaves_it() -> None:
    rng = np.random.default_rng(1)
    time_s = np.arange(4000) * 0.02
    white = rng.normal(size=4000)
    slow = np.convolve(white, np.ones(25) / 25.0, mode="same")
    calm, tied = autocorrelation(time_s, white), autocorrelation(time_s, slow)
    assert calm is not None
    assert tied is not None
    assert calm.value[0] == pytest.approx(1.0)
    assert calm.outside < 0.15
    assert tied.outside > 0.2
    # Fifty rows of a moving mean over twenty-five share half of them at half its length.
    assert tied.value[12] == pytest.approx(0.5, abs=0.1)


def test_gaps_do_not_make_a_correlation() -> None:
    rng = np.random.default_rng(2)
    time_s = np.arange(6000) * 0.02
    kept = (time_s % 20.0) > 4.0
    found = autocorrelation(time_s[kept], rng.normal(size=6000)[kept])
    assert found is not None
    assert found.outside < 0.15


def test_a_residual_that_follows_the_motion_shows_at_its_lag() -> None:
    rng = np.random.default_rng(3)
    time_s = np.arange(4000) * 0.02
    motion = np.convolve(rng.normal(size=4000), np.ones(5), mode="same")
    residual = np.roll(motion, 10) + rng.normal(size=4000)
    found = cross_correlation(time_s, residual, motion)
    assert found is not None
    assert found.lag_s[np.argmax(found.value)] == pytest.approx(0.2)
    calm = cross_correlation(time_s, rng.normal(size=4000), motion)
    assert calm is not None
    assert calm.outside < 0.2


def test_too_few_rows_have_no_correlogram() -> None:
    assert autocorrelation(np.arange(10.0), np.arange(10.0)) is None
    assert autocorrelation(np.arange(100.0), np.zeros(100)) is None


def test_reversals_lie_where_the_motion_turns() -> None:
    t = np.arange(2000) * 0.02
    speed = np.sin(2.0 * np.pi * t / 8.0)
    flat = np.zeros_like(t)
    rows = channel_rows(
        ("lift/force", "N"), (t, flat, flat, flat), (speed, "joint velocity", "rad/s"), {}
    )
    turns = rows.reversals()
    assert len(turns) == 3
    for one in turns:
        inside = speed[one]
        assert inside.min() < 0.0 < inside.max()
        assert abs(np.mean(inside)) < 0.1
    assert rows.joint == "lift"


def test_a_law_is_drawn_through_the_medians_of_its_rows() -> None:
    x = np.linspace(-1.0, 1.0, 2001)
    at, middle, low, high = binned(x, np.sign(x))
    assert np.all(np.diff(at) > 0.0)
    assert middle[0] == -1.0
    assert middle[-1] == 1.0
    assert np.all(low <= middle)
    assert np.all(middle <= high)
