"""Sums of products by lag against the whole sum, pair by pair."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import toeplitz

from hydro_ident.estimate.statistics.lag_sums import LONGEST, NODES, LagSums, autocovariance
from hydro_model.robot import FloatArray

STEP_S = 0.002


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(0)


def _sums(x: FloatArray, stride: int = 1, pieces: int = 1) -> FloatArray:
    """Of one channel, (nodes, p, p)."""
    one = LagSums(1, x.shape[1], stride)
    for part in np.array_split(x[:, None], pieces):
        one.add(part, 0, np.ones(part.shape[:2], dtype=np.bool_))
    return np.asarray(one.total[0])


def _columns(count: int) -> FloatArray:
    """Of a regression: harmonics, a direction and a constant, (count, 4)."""
    at = STEP_S * np.arange(count)
    columns = [np.sin(3.0 * at), np.cos(7.3 * at), np.sign(np.sin(2.0 * at)), np.ones(count)]
    return np.stack(columns, axis=1)


def _impulse_response(phi: FloatArray, count: int) -> FloatArray:
    """What one innovation does to the noise after it: the moving average of the regression."""
    response = np.zeros(count)
    response[0] = 1.0
    for t in range(1, count):
        response[t] = sum(p * response[t - 1 - i] for i, p in enumerate(phi) if t - 1 - i >= 0)
    return response


def _autocovariance(phi: FloatArray, count: int) -> FloatArray:
    """By the moving average, whose sum of products it is; no equation of the code under test."""
    response = _impulse_response(phi, 6000)
    return np.array([response[: 6000 - j] @ response[j:] for j in range(count)])


def test_every_pair_of_rows_counts_once(rng: np.random.Generator) -> None:
    """With gamma one all along, the sum is the square of the rows' sum, however they come."""
    x = rng.normal(size=(1500, 3))
    total = x.sum(axis=0)
    for stride in (1, 3):
        whole = _sums(x, stride).sum(axis=0)
        np.testing.assert_allclose(whole, np.outer(total, total), atol=1e-9)


def test_near_lags_are_sums_of_their_own(rng: np.random.Generator) -> None:
    x = rng.normal(size=(400, 2))
    found = _sums(x)
    np.testing.assert_allclose(found[0], x.T @ x, rtol=1e-12)
    for lag in range(1, 14):
        assert NODES[lag] == lag
        one = x[lag:].T @ x[:-lag]
        np.testing.assert_allclose(found[lag], one + one.T, rtol=1e-12, atol=1e-10)


@pytest.mark.parametrize(
    ("phi", "near"),
    [
        ([0.0], 1e-12),
        ([0.9], 2e-4),
        ([0.99], 2e-3),
        ([1.2, -0.5, 0.1], 1e-5),
        # Noise that swings, its period between nodes of the coarser octaves.
        ([0.5, -0.8, 0.1], 2e-3),
        ([0.2, -0.9], 0.03),
    ],
)
def test_variances_are_those_of_the_whole_sum(phi: list[float], near: float) -> None:
    coefficients = np.array(phi)
    x = _columns(6000)
    gamma = np.zeros(6000)
    gamma[:LONGEST] = _autocovariance(coefficients, LONGEST)
    whole = np.diag(x.T @ toeplitz(gamma) @ x)
    at_nodes = autocovariance(coefficients)
    found = np.einsum("n,npp->p", at_nodes, _sums(x))
    np.testing.assert_allclose(found, whole, rtol=near)


@pytest.mark.parametrize("stride", [1, 5])
def test_between_nodes_lags_are_shared_as_on_a_straight_line(
    rng: np.random.Generator, stride: int
) -> None:
    """A gamma that falls straight to zero: its sum has no error but that of the pairs' places."""
    count = 40_000
    x = np.stack([np.convolve(rng.normal(size=count), np.ones(400) / 20.0, "same")], axis=1)
    lags = np.arange(count) / stride
    gamma = np.maximum(1.0 - lags / 1500.0, 0.0)
    spectrum = np.abs(np.fft.rfft(x[:, 0], 2 * count)) ** 2
    products = np.fft.irfft(spectrum)[:count]
    whole = gamma[0] * products[0] + 2.0 * gamma[1:] @ products[1:]
    found = np.maximum(1.0 - NODES / 1500.0, 0.0) @ _sums(x, stride)[:, 0, 0]
    np.testing.assert_allclose(found, whole, rtol=5e-3)


#: Sums of thousands of products of the size of one, in whatever order a BLAS takes them: which one
#: that is hangs on the processor and on the matrices' sizes.
ROUNDING = 1e-10


def test_pieces_give_the_same_but_for_the_order_of_sums(rng: np.random.Generator) -> None:
    x = rng.normal(size=(5000, 3))
    np.testing.assert_allclose(_sums(x, 2, 9), _sums(x, 2), rtol=0.0, atol=ROUNDING)


def test_a_gap_keeps_its_length(rng: np.random.Generator) -> None:
    """Rows that are missing are as if they were there, and zero."""
    x = rng.normal(size=(3000, 1, 2))
    known = np.ones((3000, 1), dtype=np.bool_)
    known[1200:1900] = False
    whole, holed = LagSums(1, 2), LagSums(1, 2)
    whole.add(x, 0, known)
    holed.add(x[:1200], 0, known[:1200])
    holed.add(x[1900:], 700, known[1900:])
    np.testing.assert_allclose(holed.total, whole.total, rtol=0.0, atol=ROUNDING)


def test_a_column_that_is_zero_for_long_changes_nothing(rng: np.random.Generator) -> None:
    """Columns are taken in when they begin: as if they had been there from the start."""
    x = rng.normal(size=(5000, 3))
    x[:3100, 1] = 0.0
    whole, cut = _sums(x), _sums(x, pieces=8)
    np.testing.assert_allclose(cut, whole, rtol=0.0, atol=ROUNDING)
    np.testing.assert_allclose(whole[:, ::2, ::2], _sums(x[:, ::2]), rtol=0.0, atol=1e-10)
    assert not _sums(np.zeros((3000, 2))).any()


def test_asking_in_between_changes_nothing(rng: np.random.Generator) -> None:
    x = rng.normal(size=(2500, 1, 2))
    known = np.ones((2500, 1), dtype=np.bool_)
    asked, silent = LagSums(1, 2), LagSums(1, 2)
    for part in (slice(0, 700), slice(700, 2500)):
        for one in (asked, silent):
            one.add(x[part], 0, known[part])
        assert asked.total.shape == (1, NODES.size, 2, 2)
    np.testing.assert_array_equal(asked.total, silent.total)
