"""The basis of tall matrices beside scipy's pivoted QR decomposition."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import qr

from hydro_ident.mismatch.fitting.tall import factored

TOLERANCE = 1.0e-9


def channels(rows: int, columns: int, seed: int) -> np.ndarray:
    """Rows of six channels, each with some columns of its own."""
    random = np.random.default_rng(seed)
    matrix = np.zeros((rows, columns))
    for own in np.array_split(np.arange(rows), 6):
        used = random.choice(columns, columns // 3, replace=False)
        matrix[np.ix_(own, used)] = random.standard_normal((own.size, used.size))
    return matrix


@pytest.mark.parametrize(("rows", "columns"), [(20_000, 24), (300, 24), (12, 24)])
def test_the_basis_spans_what_the_columns_span(rows: int, columns: int) -> None:
    matrix = channels(rows, columns, 1)
    basis, r, pivot = factored(matrix, TOLERANCE)
    assert np.allclose(basis.T @ basis, np.eye(pivot.size), atol=1e-13)
    assert np.allclose(basis @ r, matrix[:, pivot], atol=1e-12)
    assert np.allclose(basis @ (basis.T @ matrix), matrix, atol=1e-9)
    assert np.allclose(r, np.triu(r))


def test_columns_that_say_the_same_count_once() -> None:
    matrix = channels(5_000, 18, 2)
    matrix[:, 3] = matrix[:, 4]
    matrix[:, 7] = 0.0
    matrix[:, 9] = matrix[:, 10] + 1e-6 * np.linspace(0.0, 1.0, 5_000) * (matrix[:, 10] != 0.0)
    plain, triangle, _ = qr(matrix, mode="economic", pivoting=True)
    size = np.abs(np.diag(triangle))
    rank = int(np.sum(size > TOLERANCE * size[0]))
    basis, _, pivot = factored(matrix, TOLERANCE)
    values = np.random.default_rng(3).standard_normal(5_000)
    own = plain[:, :rank]
    assert pivot.size == rank
    assert np.allclose(basis @ (basis.T @ values), own @ (own.T @ values), atol=1e-7)


@pytest.mark.parametrize("shape", [(0, 4), (7, 0)])
def test_nothing_has_no_basis(shape: tuple[int, int]) -> None:
    basis, r, pivot = factored(np.zeros(shape), TOLERANCE)
    assert basis.shape == (shape[0], 0)
    assert r.size == pivot.size == 0


def test_zero_columns_have_no_basis() -> None:
    assert factored(np.zeros((9, 3)), TOLERANCE)[2].size == 0
