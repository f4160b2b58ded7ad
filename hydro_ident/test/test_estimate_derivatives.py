"""Filters without phase, derivatives without bias."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import butter, freqz, sosfiltfilt

from hydro_ident.errors import IdentError
from hydro_ident.estimate.signals.derivatives import (
    FilterSettings,
    central_differences,
    kept_samples,
    low_pass,
    motion,
    parallel_filter,
)

H = 0.002
TIME = np.arange(5000) * H


def _amplitude_and_phase(signal: np.ndarray, frequency_hz: float) -> tuple[float, float]:
    inner = slice(1000, 4000)
    basis = np.exp(-2j * np.pi * frequency_hz * TIME[inner])
    value = 2.0 * np.mean(signal[inner] * basis)
    return float(np.abs(value)), float(np.angle(value))


@pytest.mark.parametrize("frequency_hz", [1.0, 5.0, 10.0, 20.0])
def test_low_pass_has_the_squared_butterworth_gain_and_no_phase(frequency_hz: float) -> None:
    b, a = butter(4, 10.0, fs=1.0 / H)
    gain = np.abs(freqz(b, a, worN=[frequency_hz], fs=1.0 / H)[1][0]) ** 2
    filtered = low_pass(np.cos(2 * np.pi * frequency_hz * TIME), H, 10.0, 4)
    amplitude, phase = _amplitude_and_phase(filtered, frequency_hz)
    assert amplitude == pytest.approx(gain, rel=1e-3, abs=1e-6)
    assert abs(phase) < 1e-3


def test_derivatives_of_a_sine_up_to_10_hz() -> None:
    w = 2.0 * np.pi * 10.0
    first, second = central_differences(np.sin(w * TIME), H)
    inner = slice(5, -5)
    assert np.max(np.abs(first - w * np.cos(w * TIME))[inner]) < 1e-3 * w
    assert np.max(np.abs(second + w * w * np.sin(w * TIME))[inner]) < 1e-3 * w * w


def test_a_quartic_is_differentiated_exactly() -> None:
    t = TIME[:50]
    first, second = central_differences(np.stack([t**4, t**3], axis=1), H)
    assert np.allclose(first[2:-2, 0], 4 * t[2:-2] ** 3, atol=1e-9)
    assert np.allclose(second[2:-2, 1], 6 * t[2:-2], atol=1e-7)


def test_slow_motion_keeps_its_derivatives_through_the_filter() -> None:
    w = 2.0 * np.pi * 3.0
    q, qd, qdd = motion(np.sin(w * TIME)[:, None], H, FilterSettings())
    keep = kept_samples(TIME.size, H, FilterSettings())
    assert np.max(np.abs(q[keep, 0] - np.sin(w * TIME[keep]))) < 1e-6
    assert np.max(np.abs(qd[keep, 0] - w * np.cos(w * TIME[keep]))) < 1e-6 * w * 3
    assert np.max(np.abs(qdd[keep, 0] + w * w * np.sin(w * TIME[keep]))) < 1e-5 * w * w


def test_the_parallel_filter_is_linear_so_it_cancels_from_an_equation() -> None:
    rng = np.random.default_rng(1)
    x = rng.normal(size=(2000, 3))
    theta = np.array([1.0, -2.0, 0.5])
    settings = FilterSettings()
    assert np.allclose(
        parallel_filter(x @ theta, H, settings), parallel_filter(x, H, settings) @ theta
    )


def test_encoder_noise_leaves_the_acceleration_that_the_docs_claim() -> None:
    rng = np.random.default_rng(2)
    noise = rng.normal(0.0, 3.5e-6, (50_000, 1))
    settings = FilterSettings()
    qdd = motion(noise, H, settings)[2]
    after = parallel_filter(qdd, H, settings)
    assert 0.5e-3 < np.std(after) < 2e-3


def test_a_slow_recording_is_refused_with_the_rate_it_needs() -> None:
    with pytest.raises(IdentError, match="more than 56 samples per second, found 50"):
        low_pass(np.zeros(100), 0.02, 25.0, 4)


def test_a_segment_shorter_than_its_edges_keeps_nothing() -> None:
    assert kept_samples(200, H, FilterSettings()).size == 0


@pytest.mark.parametrize("order", [1, 2, 4, 5, 6])
@pytest.mark.parametrize("shape", [(1,), (2, 3), (40, 2), (700,), (700, 2, 3)])
def test_low_pass_is_scipys_filter_both_ways(shape: tuple[int, ...], order: int) -> None:
    data = np.random.default_rng(3).normal(size=shape).cumsum(axis=0) + 1e3
    sections = butter(order, 10.0, fs=500.0, output="sos")
    expected = sosfiltfilt(sections, data, axis=0, padlen=min(shape[0] - 1, 100))
    np.testing.assert_allclose(low_pass(data, 0.002, 10.0, order), expected, rtol=1e-11)


def test_few_columns_are_filtered_as_many_are() -> None:
    data = np.random.default_rng(4).normal(size=(700, 9))
    all_at_once = low_pass(data, 0.002, 10.0, 4)
    assert np.array_equal(low_pass(data[:, :3], 0.002, 10.0, 4), all_at_once[:, :3])
    assert np.array_equal(low_pass(data[:, 5], 0.002, 10.0, 4), all_at_once[:, 5])
