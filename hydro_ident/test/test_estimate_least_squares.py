"""Weighted least squares: exact on exact data, and intervals that hold under autocorrelation."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.stats import t

from hydro_ident.errors import IdentError
from hydro_ident.estimate.statistics.blocks import blocks_of
from hydro_ident.estimate.statistics.least_squares import (
    Rows,
    collinearity,
    fit_of_solution,
    weighted_least_squares,
)
from hydro_ident.estimate.statistics.moments import Moments
from hydro_ident.estimate.statistics.regression import solve_ols

THETA = np.array([2.0e3, -3.0e-7])


def _regressors(rng: np.random.Generator, count: int, channels: int = 1) -> np.ndarray:
    slow = lfilter([0.05], [1.0, -0.95], rng.normal(size=(count, channels)), axis=0)
    return np.stack([slow, 1e9 * np.roll(slow, count // 3, axis=0)], axis=2)


def _rows(x: np.ndarray, noise: np.ndarray | float = 0.0) -> Rows:
    return Rows(x @ THETA + noise, x, np.arange(x.shape[0]) * 0.02, "bag#0")


def test_exact_data_give_the_parameters_across_ten_orders_of_magnitude() -> None:
    fit = weighted_least_squares([_rows(_regressors(np.random.default_rng(0), 500, 2))])
    assert np.allclose(fit.theta, THETA, rtol=1e-9)


def test_channels_weigh_by_their_own_residual() -> None:
    rng = np.random.default_rng(1)
    x = _regressors(rng, 4000, 2)
    noise = rng.normal(size=(4000, 2)) * np.array([1.0, 100.0])
    fit = weighted_least_squares([_rows(x, noise)])
    quiet = weighted_least_squares([_rows(x[:, :1], noise[:, :1])])
    assert fit.channel_std == pytest.approx([1.0, 100.0], rel=0.05)
    assert fit.std == pytest.approx(quiet.std, rel=0.1)


def test_gaps_in_one_channel_leave_the_others_alone() -> None:
    rng = np.random.default_rng(2)
    rows = _rows(_regressors(rng, 500, 2))
    rows.y[100:400, 1] = np.nan
    fit = weighted_least_squares([rows])
    assert np.allclose(fit.theta, THETA, rtol=1e-9)
    assert fit.rows == 2 * 500 - 300


def test_white_noise_gives_the_textbook_standard_errors() -> None:
    rng = np.random.default_rng(3)
    x = _regressors(rng, 5000)
    fit = weighted_least_squares([_rows(x, rng.normal(size=(5000, 1)))])
    flat = x.reshape(-1, 2)
    textbook = np.sqrt(np.diag(np.linalg.inv(flat.T @ flat)))
    assert fit.std == pytest.approx(textbook, rel=0.03)


@pytest.mark.parametrize("pieces", [1, 7])
def test_noise_taken_for_white_gives_the_textbook_s_own_numbers(pieces: int) -> None:
    """Gaps and columns that are zero at first take part like others; no row is left out."""
    rng = np.random.default_rng(4)
    x = _regressors(rng, 3000, 2)
    x[:1000, 0, 1] = 0.0
    y = x @ THETA + rng.normal(size=(3000, 2))
    y[100:400, 1] = np.nan
    moments = Moments.like(Rows(y, x, np.arange(3000) * 0.02, "bag#0"), "bag", lags=0)
    for at in np.array_split(np.arange(3000), pieces):
        moments.add(Rows(y[at].copy(), x[at].copy(), at * 0.02, "bag#0"))
    blocks = blocks_of([moments])
    fit = fit_of_solution(solve_ols(blocks), blocks, int(moments.rows.sum()))
    known = np.isfinite(y)
    flat, values = x[known], y[known]
    theta = np.linalg.lstsq(flat, values, rcond=None)[0]
    by_channel = np.array([np.mean((y - x @ theta)[known[:, k], k] ** 2) for k in range(2)])
    inverse = np.linalg.inv(flat.T @ flat)
    middle = np.einsum("k,tkp,tkq->pq", by_channel, x * known[..., None], x * known[..., None])
    assert fit.rows == flat.shape[0]
    np.testing.assert_allclose(fit.theta, theta, rtol=1e-9)
    textbook = np.sqrt(np.diag(inverse @ middle @ inverse))
    # What two parameters of 5700 rows took out of the residuals is given back.
    np.testing.assert_allclose(fit.std, textbook, rtol=2e-3)


def test_intervals_hold_where_residuals_are_strongly_autocorrelated() -> None:
    covered_iid, covered, covered_ols, runs = 0, 0, 0, 60
    for seed in range(runs):
        rng = np.random.default_rng(100 + seed)
        x = _regressors(rng, 3000)
        noise = lfilter([1.0], [1.0, -0.95], rng.normal(size=(3000, 1)), axis=0)
        fit = weighted_least_squares([_rows(x, noise)])
        flat = x.reshape(-1, 2)
        plain = weighted_least_squares([_rows(x, noise)], "ols")
        iid = plain.channel_std[0] * np.sqrt(np.diag(np.linalg.inv(flat.T @ flat)))
        covered += int(np.sum(np.abs(fit.theta - THETA) < t.ppf(0.975, fit.dof) * fit.std))
        error = np.abs(plain.theta - THETA)
        covered_ols += int(np.sum(error < t.ppf(0.975, plain.dof) * plain.std))
        covered_iid += int(np.sum(error < 1.96 * iid))
    assert 0.90 < covered / (2 * runs) < 0.99
    assert 0.90 < covered_ols / (2 * runs) <= 1.0
    assert covered_iid / (2 * runs) < 0.60


def test_collinearity_names_what_cannot_be_told_apart() -> None:
    rng = np.random.default_rng(4)
    a, b = rng.normal(size=(2, 1000))
    factors = collinearity(np.stack([a, 1e-9 * b, 3.0 * a + 1e-5 * b, np.zeros(1000)], axis=1))
    assert factors[0] > 1e4
    assert factors[2] > 1e4
    assert np.isinf(factors[3])
    assert collinearity(np.stack([a, b], axis=1)) == pytest.approx([1.0, 1.0], abs=0.01)


def test_the_noise_model_of_an_autoregression_is_found() -> None:
    rng = np.random.default_rng(5)
    x = _regressors(rng, 20_000)
    noise = lfilter([1.0], [1.0, -1.2, 0.5], rng.normal(size=(20_000, 1)), axis=0)
    fit = weighted_least_squares([_rows(x, noise)])
    assert fit.noise[0] == pytest.approx([1.2, -0.5, 0.0], abs=0.03)
    assert fit.channel_std[0] == pytest.approx(float(np.std(noise)), rel=0.02)


def test_too_few_rows_are_refused() -> None:
    with pytest.raises(IdentError, match="2 rows cannot determine 2 parameters"):
        weighted_least_squares([_rows(_regressors(np.random.default_rng(0), 2))])


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_rows_beyond_all_measure_are_refused_by_name() -> None:
    """It had been LinAlgError, of eigenvalues that do not converge."""
    x = _regressors(np.random.default_rng(0), 200)
    noise = np.random.default_rng(1).normal(size=(200, 1))
    noise[100] = 1e180
    with pytest.raises(IdentError, match="expected a finite covariance of the parameters"):
        weighted_least_squares([_rows(x, noise)])
