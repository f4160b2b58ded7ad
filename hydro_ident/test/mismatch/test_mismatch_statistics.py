"""The statistics of the diagnosis on numbers whose truth is known: no robot in sight."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.stats import multivariate_normal

from hydro_ident.mismatch.fitting.bench import Bench
from hydro_ident.mismatch.fitting.training import block_of
from hydro_ident.mismatch.fitting.whitening import Layout, Noise, noise_of
from hydro_ident.mismatch.trials.chance import p_value, signs
from hydro_ident.mismatch.trials.scoring import best_subset

ROWS, STEP_S = 3000, 0.05


def _layout(count: int = ROWS, channels: int = 1) -> Layout:
    each = count // channels
    linked = np.ones(each, dtype=bool)
    linked[0] = False
    return Layout(
        np.repeat(np.arange(channels), each),
        np.zeros(each * channels, dtype=np.intp),
        np.tile(np.arange(each) * STEP_S, channels),
        np.tile(linked, channels),
    )


def _coloured(rng: np.random.Generator, count: int = ROWS, size: int = 1) -> np.ndarray:
    white = rng.normal(size=(count + 200, size))
    return np.asarray(lfilter([1.0], [1.0, -1.5, 0.6], white, axis=0)[200:])


def test_the_noise_model_finds_an_autoregression_and_whitens_with_it() -> None:
    rng, layout = np.random.default_rng(1), _layout(20000)
    residual = 7.0 * _coloured(rng, 20000)[:, 0]
    noise = noise_of(layout, residual, np.array([1e-9]))
    assert noise.phi[0][:2] == pytest.approx([1.5, -0.6], abs=0.05)
    assert noise.std[0] == pytest.approx(7.0, rel=0.03)
    white = noise.whitened(layout, residual)[noise.settled(layout)]
    assert white.std() == pytest.approx(1.0, rel=0.02)
    lagged = [float(np.mean(white[k:] * white[:-k])) for k in (1, 2, 3, 10)]
    assert np.abs(lagged).max() < 0.03


def test_gaps_are_never_bridged() -> None:
    layout = _layout()
    kept = np.ones(ROWS, dtype=bool)
    kept[1000:1010] = False
    cut = layout.take(kept)
    assert cut.age[999] == 999
    assert cut.age[1000] == 0
    noise = Noise((np.array([0.5, 0.2]),), np.array([1.0]))
    assert not noise.settled(cut)[[0, 1, 1000, 1001]].any()
    assert noise.settled(cut)[[2, 999, 1002]].all()


def test_blocks_of_what_was_held_out_are_as_many_as_its_time_gives() -> None:
    """Every fifth four seconds of a minute are twelve seconds."""
    layout = _layout(1200)
    kept = np.floor(layout.time_s / 4.0) % 5 == 4
    held = layout.take(kept)
    assert held.length_s > 40.0
    assert 8.0 < held.occupied_s < 12.5
    assert np.unique(held.blocks(block_of(held.occupied_s))).size >= 40
    assert np.unique(held.blocks(block_of(held.length_s))).size < 20


def test_time_without_rows_counts_once_and_by_recording() -> None:
    """Ten recordings of 30 s, each with rows of two channels in four seconds, at other times."""
    parts = []
    for channel, step_s in ((0, 0.05), (1, 0.1)):
        for recording in range(10):
            time_s = np.arange(0.0, 30.0, step_s)
            count = time_s.size
            linked = np.arange(count) > 0
            whole = Layout(np.full(count, channel), np.full(count, recording), time_s, linked)
            # The first and last rows are kept: recordings are as long as they are.
            begin = 2.0 * recording
            kept = ((time_s >= begin) & (time_s < begin + 4.0 - 1e-9)) | (time_s > 29.85)
            parts.append(whole.take(kept))
    columns = (
        np.concatenate([getattr(part, name) for part in parts])
        for name in ("channel", "recording", "time_s", "linked")
    )
    held = Layout(*columns)
    assert held.occupied_s == pytest.approx(42.0, abs=1.5)
    assert held.length_s > 100.0


def _bench(rng: np.random.Generator, extra: np.ndarray | None = None) -> tuple[Bench, np.ndarray]:
    layout = _layout()
    x = _coloured(rng, size=3)
    y = x @ np.array([2.0, -1.0, 0.5]) + 0.3 * rng.normal(size=ROWS)
    if extra is not None:
        y = y + extra
    noise = Noise((np.zeros(0),), np.array([0.3]))
    return Bench(layout, noise, y, x, 1.0), x


def test_a_column_that_the_base_says_already_gains_nothing() -> None:
    bench, x = _bench(np.random.default_rng(2))
    partial = bench.partial(x @ np.array([[1.0], [2.0], [-3.0]]))
    assert partial.gram[0, 0] < 1e-12 * partial.plain[0]
    assert bench.solve() == pytest.approx([2.0, -1.0, 0.5], abs=0.01)


def test_columns_of_some_channels_are_as_those_of_all_rows_beyond_the_base() -> None:
    """Products of residuals with columns laid out over all rows, zero in the other channels."""
    rng, count = np.random.default_rng(12), ROWS // 3
    channel = np.repeat(np.arange(3), count)
    time = np.tile(np.arange(count) * STEP_S, 3)
    first = np.tile(np.arange(count) > 0, 3)
    layout = Layout(channel, np.zeros(3 * count, dtype=np.intp), time, first)
    phi = (np.array([0.6]), np.array([0.3, 0.2]), np.zeros(0))
    noise = Noise(phi, np.array([0.3, 2.0, 1.0]))
    x, y, size = rng.normal(size=(3 * count, 4)), rng.normal(size=3 * count), 3 * count
    # Each of two channels by itself and both together; another that the base has, nearly.
    x[channel == 2, 0] = x[channel == 0, 1] = 0.0
    prior = rng.normal(size=(2, 4)), rng.normal(size=2)
    bench = Bench(layout, noise, y, x, 1.0, prior)
    other = rng.normal(size=bench.count)
    for acting in ([0], [1, 2], [0, 2]):
        rows = np.isin(channel, acting)
        z = np.zeros((size, 3))
        z[rows] = rng.normal(size=(int(rows.sum()), 3))
        z[rows, 1] = x[rows, 2] + 1e-2 * z[rows, 0]
        found = bench.partial(z[rows].astype(np.float32), bench.witness(other), rows)
        left = bench.beyond(z.astype(np.float32))
        np.testing.assert_allclose(found.gram, left.T @ left, rtol=1e-9, atol=1e-9)
        for got, residual in ((found.scores, bench.residual), (found.chance, other)):
            wanted = bench.by_block(left * residual[:, None])
            np.testing.assert_allclose(got, wanted, rtol=1e-9, atol=1e-9)
        whole = bench.partial(z.astype(np.float32))
        np.testing.assert_allclose(whole.scores, found.scores, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(whole.plain, found.plain, rtol=1e-12)


def test_gain_and_coefficient_are_those_of_the_joint_fit() -> None:
    rng = np.random.default_rng(3)
    z = np.sign(_coloured(rng))
    bench, x = _bench(rng, 0.2 * z[:, 0])
    partial = bench.partial(z)
    gain, coefficient = best_subset(
        partial.gram, partial.scores.sum(axis=0)[None], (False,), np.array([True])
    )
    joint = np.linalg.lstsq(np.hstack([x, z]), bench._y * 0.3, rcond=None)[0]
    assert coefficient[0, 0] == pytest.approx(joint[3], rel=1e-9)
    without = bench.residual @ bench.residual
    whole = bench._y * 0.3 - np.hstack([x, z]) @ joint
    assert gain[0] == pytest.approx(without - whole @ whole / 0.09, rel=1e-9)


def test_a_coefficient_of_an_impossible_sign_is_not_used() -> None:
    gram = np.array([[1.0, 0.5], [0.5, 1.0]])
    both = np.array([True, True])
    sums = gram @ np.array([[3.0], [-5.0]])
    gain, found = best_subset(gram, sums.T, (True, True), both)
    assert found[0] == pytest.approx([3.0, -5.0])
    gain, found = best_subset(gram, sums.T, (False, False), both)
    assert found[0] == pytest.approx([0.5, 0.0])
    assert gain[0] == pytest.approx(0.25)
    assert best_subset(gram, -sums.T * 0.0, (False, False), both)[0][0] == 0.0


def test_flipped_blocks_hold_the_level_where_rows_depend_on_each_other() -> None:
    """The largest of many candidates exceeds its 5 % level in about 5 % of clean recordings."""
    rng, found, draws = np.random.default_rng(4), 0, 150
    layout = _layout(2000)
    flips = signs(100)[:399]
    for _ in range(draws):
        residual = _coloured(rng, 2000)[:, 0] * (1.0 + (np.arange(2000) % 700 > 350))
        noise = noise_of(layout, residual, np.array([1e-9]))
        bench = Bench(layout, noise, residual, np.ones((2000, 1)), 1.0)
        partial = bench.partial(_coloured(rng, 2000, 20))
        scale = np.sqrt(np.diag(partial.gram))
        chance = np.abs(flips[:, : bench.blocks] @ (partial.scores / scale)).max(axis=1)
        value = np.abs(partial.scores.sum(axis=0) / scale).max()
        found += p_value(value, chance) <= 0.05
    assert found <= 0.05 * draws + 3.0 * np.sqrt(0.05 * 0.95 * draws)


def _folds() -> np.ndarray:
    """Of every five blocks one each, in another order every time."""
    order = [0, 1, 2, 3, 4, 2, 3, 4, 0, 1, 4, 0, 1, 2, 3, 1, 2, 3, 4, 0, 3, 4, 0, 1, 2]
    return np.array(order)[np.floor(np.arange(ROWS) * STEP_S / 3.0).astype(int) % 25]


def test_held_out_errors_come_from_fits_without_the_rows() -> None:
    """scipy's Gaussian of all rows of a fold together, as the other folds predict them."""
    rng = np.random.default_rng(5)
    bench, x = _bench(rng)
    errors, fold, y = bench.held_out(3.0, 5, 0.0), _folds(), bench._y * 0.3
    for k in (0, 3):
        kept, held = x[fold != k], x[fold == k]
        theta = np.linalg.lstsq(kept, y[fold != k], rcond=None)[0]
        lever = held @ np.linalg.inv(kept.T @ kept) @ held.T
        spread = 0.3**2 * (np.eye(len(held)) + lever)
        likely = multivariate_normal.logpdf(y[fold == k], held @ theta, spread)
        expected = -2.0 * likely - len(held) * np.log(2.0 * np.pi * 0.3**2)
        assert errors[k] == pytest.approx(expected, rel=1e-5)


def test_the_only_visit_to_a_place_is_no_evidence_against_it() -> None:
    """A coefficient that one block alone tells: its rows are predicted with what is unknown."""
    layout, rng = _layout(), np.random.default_rng(8)
    place = np.where(np.floor(np.arange(ROWS) * STEP_S / 3.0) == 7, 1.0, 0.0)
    y = rng.standard_normal(ROWS) + 50.0 * place
    noise = Noise((np.zeros(0),), np.array([1.0]))
    columns = np.ones((ROWS, 1)), np.stack([np.ones(ROWS), place], axis=1)
    without, with_it = (Bench(layout, noise, y, x, 1.0).held_out(3.0, 5, 0.0) for x in columns)
    count, rows = int(place.sum()), np.count_nonzero(_folds() == 4)
    assert without[4] > 2000.0 * count
    # What is unknown is so once, not row by row: the rows' own noise, and the one number.
    assert with_it[4] < rows + 5.0 * np.sqrt(2.0 * rows) + 50.0


def test_a_shape_that_other_folds_do_not_tell_stays_where_all_rows_have_it() -> None:
    """Two columns that one fold alone tells apart: without a reach the others run off there."""
    layout, rng = _layout(), np.random.default_rng(9)
    own = rng.standard_normal(ROWS)
    apart = own + np.where(_folds() == 1, rng.standard_normal(ROWS), 1e-3)
    noise = Noise((np.zeros(0),), np.array([1.0]))
    y = own + rng.standard_normal(ROWS)
    bench = Bench(layout, noise, y, np.stack([own, apart], axis=1), 1.0)
    free, held = (bench.held_out(3.0, 5, 0.0, r) for r in (None, np.array([np.inf, 0.1])))
    rows = np.count_nonzero(_folds() == 1)
    assert held[1] < free[1]
    assert held[1] < rows + 5.0 * np.sqrt(2.0 * rows)
    assert held[2] == pytest.approx(free[2], rel=0.02)


def test_what_is_known_beforehand_counts_like_rows() -> None:
    layout, rng = _layout(), np.random.default_rng(6)
    x = rng.normal(size=(ROWS, 2))
    y = x @ np.array([1.0, 1.0])
    noise = Noise((np.zeros(0),), np.array([1.0]))
    prior = (np.diag([1e6, 1e-6]), np.zeros(2))
    theta = Bench(layout, noise, y, x, 1.0, prior).solve()
    assert theta[0] == pytest.approx(0.0, abs=1e-6)
    assert theta[1] == pytest.approx(1.0, abs=0.1)


def test_blocks_that_flip_together_count_once() -> None:
    """Twelve blocks of one weight are worth twelve, or four where three go together."""
    count, every = 1_200, 0.1
    time_s = np.arange(count) * every
    layout = Layout(
        np.zeros(count, dtype=np.intp), np.zeros(count, dtype=np.intp), time_s,
        np.ones(count, dtype=np.bool_),
    )  # fmt: skip
    noise = Noise((np.zeros(0),), np.ones(1))
    bench = Bench(layout, noise, np.ones(count), np.ones((count, 1)), 1.0)
    column = np.where((time_s >= 30.0) & (time_s < 42.0), 1.0, 0.0)
    assert bench.spread(column) == pytest.approx(12.0)
    assert bench.spread(column, together=3) == pytest.approx(4.0)


@pytest.mark.parametrize("columns", [5, 30])
def test_intervals_hold_where_columns_are_nearly_as_many_as_blocks(columns: int) -> None:
    """Noise that blocks have in common: what the fit takes of it is given back by leverage."""
    rng, blocks, each = np.random.default_rng(7), 40, 20
    layout = _layout(blocks * each)
    x = lfilter([1.0], [1.0, -0.9], rng.normal(size=(blocks * each, columns)), axis=0)
    white = Noise((np.zeros(0),), np.ones(1))
    errors, variances = [], []
    for _ in range(150):
        common = np.repeat(rng.normal(size=blocks), each)
        bench = Bench(layout, white, 0.7 * (common + rng.normal(size=common.size)), x, 1.0)
        assert bench.blocks == blocks
        errors.append(bench.solve())
        variances.append(np.diag(bench.covariance))
    off = np.std(errors, axis=0) / np.sqrt(np.mean(variances, axis=0))
    assert 0.9 < np.sqrt(np.mean(off**2)) < 1.13
