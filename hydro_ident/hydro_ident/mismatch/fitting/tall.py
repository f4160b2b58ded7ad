"""Orthonormal bases of tall matrices whose rows come channel by channel, mostly zero elsewhere."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import qr, solve_triangular

from hydro_model.robot import FloatArray

#: Rows that are worked on at a time: tall as the matrix is, none of it is there twice.
_TOGETHER = 4096


def factored(
    matrix: FloatArray, rank_tolerance: float
) -> tuple[FloatArray, FloatArray, NDArray[np.intp]]:
    """Pivoted QR decomposition, ``matrix[:, pivot] = basis @ r``, of the columns that say more.

    Triangles of some rows at a time are stacked, and that of the stack is pivoted (Golub and Van
    Loan, Matrix Computations, 4th ed., 2013, section 5.2): rows of a channel have few columns that
    are not zero. The basis follows by substitution and is made orthonormal once more (Yamamoto et
    al., Electronic Trans. Numer. Analysis 44 (2015) 306-326).

    Parameters
    ----------
    matrix : (N, p) array
    rank_tolerance : float
        Share of the largest diagonal element from which a direction counts.

    Returns
    -------
    basis : (N, r) array
        Orthonormal.
    r : (r, r) array
        Upper triangular.
    pivot : (r,) int array
    """
    rows, count = matrix.shape
    if not matrix.any():
        return np.zeros((rows, 0)), np.zeros((0, 0)), np.zeros(0, dtype=np.intp)
    triangle: FloatArray = np.zeros((0, count))
    for begin in range(0, rows, _TOGETHER):
        part = matrix[begin : begin + _TOGETHER]
        used = np.flatnonzero(part.any(axis=0))
        own = np.zeros((min(part.shape[0], used.size), count))
        own[:, used] = np.linalg.qr(part[:, used], mode="r")
        triangle = np.concatenate([triangle, own])
        if triangle.shape[0] > 4 * count:
            triangle = np.asarray(np.linalg.qr(triangle, mode="r"))
    _, r, order = qr(triangle, mode="economic", pivoting=True)
    size = np.abs(np.diag(r))
    rank = int(np.sum(size > rank_tolerance * max(float(size[0]), 1e-300)))
    r, pivot = r[:rank, :rank], order[:rank].astype(np.intp)
    basis, inverse = np.empty((rows, rank)), solve_triangular(r, np.eye(rank))
    for begin in range(0, rows, _TOGETHER):
        some = slice(begin, begin + _TOGETHER)
        basis[some] = matrix[some][:, pivot] @ inverse
    upper = np.linalg.cholesky(basis.T @ basis).T if rank else r
    inverse = solve_triangular(upper, np.eye(rank))
    for begin in range(0, rows, _TOGETHER):
        some = slice(begin, begin + _TOGETHER)
        basis[some] = basis[some] @ inverse
    return basis, upper @ r, pivot
