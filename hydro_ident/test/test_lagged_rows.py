"""Products of rows and their predecessors against those of rows laid side by side."""

from __future__ import annotations

import numpy as np
import pytest

from hydro_ident.estimate.statistics.lagged_rows import LaggedRows, lag_products
from hydro_model.robot import FloatArray

LAGS = 3


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(0)


def _side_by_side(rows: FloatArray, stride: int) -> FloatArray:
    """Rows with their predecessors, (T - lags stride, lags + 1, p)."""
    first = LAGS * stride
    lagged = [rows[first - lag * stride : len(rows) - lag * stride] for lag in range(LAGS + 1)]
    return np.stack(lagged, axis=1)


def _gathered(rows: FloatArray, chosen: np.ndarray, stride: int, pieces: int) -> LaggedRows:
    one = LaggedRows(rows.shape[1], LAGS, stride)
    every = np.concatenate([np.zeros(LAGS * stride, dtype=np.bool_), chosen])
    for at in np.array_split(np.arange(len(rows)), pieces):
        one.widen(rows[at].any(axis=0))
        one.add(rows[at], every[at])
    return one


@pytest.mark.parametrize("stride", [1, 4])
@pytest.mark.parametrize("share", [1.0, 0.9, 0.3, 0.0])
def test_products_are_those_of_rows_side_by_side(
    rng: np.random.Generator, share: float, stride: int
) -> None:
    rows = rng.normal(size=(120, 3))
    whole = _side_by_side(rows, stride)
    chosen = rng.uniform(size=len(whole)) < share
    expected = np.einsum("tap,tbq->apbq", whole[chosen], whole[chosen])
    found = lag_products(rows, chosen, LAGS, stride)
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-11)


@pytest.mark.parametrize("pieces", [1, 7, 60])
def test_the_factor_has_the_products_of_all_pieces(rng: np.random.Generator, pieces: int) -> None:
    """Of columns far apart in size, one of them zero until late, one always."""
    rows = rng.normal(size=(200, 5)) * np.array([1.0, 1e9, 1e-6, 1.0, 0.0])
    rows[:150, 3] = 0.0
    whole = _side_by_side(rows, 2)
    chosen = rng.uniform(size=len(whole)) < 0.8
    flat = whole[chosen].reshape(-1, 4 * 5)
    factor = _gathered(rows, chosen, 2, pieces).factor
    scale = np.maximum(np.linalg.norm(flat, axis=0), 1e-300)
    np.testing.assert_allclose((factor / scale).T @ (factor / scale), _gram(flat), atol=1e-13)


def _gram(flat: FloatArray) -> FloatArray:
    scaled = flat / np.maximum(np.linalg.norm(flat, axis=0), 1e-300)
    return np.asarray(scaled.T @ scaled)


def test_what_hardly_differs_is_told_apart(rng: np.random.Generator) -> None:
    """Columns alike to 1e-7, rows alike to 1e-3: sums of products would know one in a hundred."""
    at = 0.001 * np.arange(3000)
    smooth = np.stack([np.sin(3.0 * at), np.cos(5.0 * at), np.sin(7.0 * at + 1.0)], axis=1)
    mixed = smooth @ np.array([[1.0, 1.0, 1.0], [0.0, 1e-7, 0.0], [0.0, 0.0, 1e-7]])
    factor = _gathered(mixed, np.ones(3000 - LAGS, dtype=np.bool_), 1, 5).factor
    exact = np.linalg.qr(_side_by_side(mixed, 1).reshape(-1, 12), mode="r")
    # What is left of the last column beside the other two, in a row and in those before it.
    direction = np.linalg.lstsq(exact[:, :2], exact[:, 2], rcond=None)[0]
    for lag in range(LAGS + 1):
        columns = [matrix[:, 3 * lag : 3 * lag + 3] for matrix in (exact, factor)]
        left = [np.linalg.norm(one[:, 2] - one[:, :2] @ direction) for one in columns]
        assert left[1] == pytest.approx(left[0], rel=1e-7)


def test_dependent_columns_stay_so(rng: np.random.Generator) -> None:
    """A column that is the sum of two others: their singular value is rounding, as of the rows."""
    rows = rng.normal(size=(500, 2)) * np.array([1.0, 1e3])
    rows = np.concatenate([rows, rows.sum(axis=1, keepdims=True)], axis=1)
    factor = _gathered(rows, np.ones(500 - LAGS, dtype=np.bool_), 1, 4).factor
    singular = np.linalg.svd(factor[:, :3], compute_uv=False)
    assert singular[2] < 1e-12 * singular[0]
    whole = np.linalg.svd(rows[LAGS:], compute_uv=False)
    np.testing.assert_allclose(singular[:2], whole[:2], rtol=1e-12)
