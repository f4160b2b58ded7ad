"""The estimators on what each is for, and the sums that they start from."""

from __future__ import annotations

import pickle

import numpy as np
import pytest
from scipy.signal import lfilter

from hydro_ident.estimate.statistics.blocks import blocks_of
from hydro_ident.estimate.statistics.histogram import Histogram
from hydro_ident.estimate.statistics.least_squares import (
    Fit,
    Rows,
    weighted_least_squares,
)
from hydro_ident.estimate.statistics.moments import LAGS, Moments
from hydro_ident.estimate.statistics.regression import solve_wls
from hydro_ident.estimate.statistics.robust import CUT, EXCESS

THETA = np.array([3.0, -2.0])


def _closed_loop(seed: int) -> Rows:
    """A mass with friction that follows its reference by a loop on noisy readings."""
    rng = np.random.default_rng(seed)
    count, h = 6000, 0.02
    time = h * np.arange(count)
    wanted = sum(a * np.sin(w * time + p) for a, w, p in ((1, 0.9, 0), (0.5, 2.3, 1), (0.2, 5, 2)))
    loop = ([0.02], [1.0, -1.72, 0.74])  # complementary sensitivity, unit gain at rest
    reading = 0.01 * rng.normal(size=count)
    true = lfilter(*loop, wanted - reading)

    def derivatives(q: np.ndarray) -> np.ndarray:
        return np.stack([np.gradient(np.gradient(q, h), h), np.gradient(q, h)], axis=1)

    force = derivatives(true) @ THETA + 0.05 * rng.normal(size=count)
    own = slice(100, None)
    x, z = derivatives(true + reading)[own], derivatives(lfilter(*loop, wanted))[own]
    return Rows(force[own, None], x[:, None], time[own], "loop", z[:, None])


def test_instruments_remove_the_bias_of_noisy_derivatives_in_closed_loop() -> None:
    """Averaged over runs, what is left of the instruments' error is chance."""
    errors = {"ols": [], "wls": [], "iv": []}
    for seed in range(20):
        rows = _closed_loop(seed)
        for name, found in errors.items():
            fit = weighted_least_squares([rows], name)  # type: ignore[arg-type]
            found.append((fit.theta - THETA) / THETA)
    mean = {name: np.abs(np.mean(found, axis=0)) for name, found in errors.items()}
    scatter = np.std(errors["iv"], axis=0) / np.sqrt(20)
    assert mean["ols"][0] > 0.3
    assert mean["wls"][0] > 0.3
    assert np.all(mean["iv"] < 3.0 * scatter)
    assert np.all(mean["iv"] < 0.05)


def test_instruments_state_their_own_uncertainty() -> None:
    covered = 0
    for seed in range(40):
        fit = weighted_least_squares([_closed_loop(seed)], "iv")
        covered += int(np.sum(np.abs(fit.theta - THETA) < 1.96 * fit.std))
    assert 0.85 < covered / 80 <= 1.0


def _spoilt(seed: int, share: float) -> tuple[Fit, Fit, np.ndarray]:
    rng = np.random.default_rng(seed)
    x = lfilter([0.05], [1.0, -0.95], rng.normal(size=(3000, 1, 2)), axis=0)
    noise = lfilter([1.0], [1.0, -0.8], 0.02 * rng.normal(size=(3000, 1)), axis=0)
    noise += 5.0 * (rng.random((3000, 1)) < share)
    rows = Rows(x @ THETA + noise, x, 0.02 * np.arange(3000), "spoilt")
    robust = weighted_least_squares([rows], "robust")
    return weighted_least_squares([rows], "wls"), robust, THETA


def test_biweights_survive_outliers_that_least_squares_does_not() -> None:
    plain, robust, truth = _spoilt(0, 0.02)
    clean, _, _ = _spoilt(0, 0.0)
    assert np.max(np.abs(robust.theta - truth)) < 4.0 * np.max(clean.std)
    assert np.all(robust.std < 1.5 * clean.std)
    assert np.all(plain.std > 5.0 * robust.std)


def test_biweights_cost_little_where_nothing_is_wrong() -> None:
    plain, robust, _ = _spoilt(1, 0.0)
    assert robust.theta == pytest.approx(plain.theta, abs=float(plain.std.max()))
    assert robust.std == pytest.approx(plain.std, rel=0.15)


def test_the_excess_is_what_the_biweight_adds_on_normal_noise() -> None:
    e = np.linspace(-CUT, CUT, 100_001)
    density = np.exp(-0.5 * e**2) / np.sqrt(2.0 * np.pi)
    psi = e * (1.0 - (e / CUT) ** 2) ** 2

    def mean(values: np.ndarray) -> float:
        return float(np.trapezoid(values * density, e))

    linear = mean(e * psi)  # = E psi', by parts
    assert mean(psi**2) / linear**2 - 1.0 == pytest.approx(EXCESS, abs=1e-3)
    cubic = mean((e**3 - 3.0 * e) * psi) ** 2 / 6.0
    assert cubic / linear**2 > 0.8 * EXCESS


def test_moments_do_not_depend_on_the_pieces() -> None:
    rng = np.random.default_rng(6)
    y, x = rng.normal(size=(400, 2)), rng.normal(size=(400, 2, 3))
    y[150:160, 1] = np.nan
    time = 0.05 * np.arange(400)
    time[250:] += 3.0  # a gap
    rows = Rows(y, x, time, "run", step_s=0.05, stride=2)
    whole = Moments.like(rows, "run")
    whole.add(rows)
    cut = Moments.like(rows, "run")
    for begin, end in ((0, 3), (3, 155), (155, 156), (156, 251), (251, 400)):
        cut.add(rows.take(np.arange(400)[begin:end]))  # type: ignore[arg-type]
    products = [np.swapaxes(m.factor, 1, 2) @ m.factor for m in (whole, cut)]
    assert np.allclose(products[0], products[1], rtol=1e-12, atol=1e-9)
    assert np.array_equal(whole.rows, [400, 390])
    assert np.array_equal(whole.lagged, cut.lagged)
    assert whole.lagged[0] == 400 - 2 * 2 * LAGS
    assert pickle.loads(pickle.dumps(cut)).rows.tolist() == [400, 390]


def test_oversampled_rows_count_once() -> None:
    """Three copies of every row hold no more than one of them."""
    rng = np.random.default_rng(7)
    x = lfilter([0.1], [1.0, -0.9], rng.normal(size=(800, 1, 2)), axis=0)
    y = x @ THETA + rng.normal(size=(800, 1))
    once, thrice = Rows(y, x, np.arange(800.0)), None
    thrice = Rows(np.repeat(y, 3, 0), np.repeat(x, 3, 0), np.arange(2400.0), stride=3)
    solutions = []
    for rows in (once, thrice):
        moments = Moments.like(rows, "run")
        moments.add(rows)
        solutions.append(solve_wls(blocks_of([moments])))
    assert solutions[1].theta == pytest.approx(solutions[0].theta, rel=1e-3)
    assert np.sqrt(np.diag(solutions[1].covariance)) == pytest.approx(
        np.sqrt(np.diag(solutions[0].covariance)), rel=0.02
    )


def test_a_histogram_gives_quantiles_and_shares() -> None:
    rng = np.random.default_rng(8)
    sizes = np.abs(rng.normal(size=200_000)) * 3e-6
    whole, parts = Histogram(), Histogram()
    whole.add(sizes)
    for part in np.array_split(sizes, 7):
        one = Histogram()
        one.add(part)
        parts.merge(one)
    assert np.array_equal(whole.counts, parts.counts)
    assert whole.quantile(0.6827) == pytest.approx(3e-6, rel=0.02)
    assert whole.share_above(6e-6) == pytest.approx(0.0455, abs=0.004)
    assert Histogram().quantile(0.5) == 0.0
