"""Compiled solution of small systems of linear equations.

`matrix` (n, n) is overwritten by its factors, `pivot` (n,) by the rows that were exchanged, `b`
(n,) by the solution.
"""

from __future__ import annotations

import math
from typing import Any

from hydro_model.numerics.kernel import kernel

Array = Any  # numba types the kernels; mypy follows no numba import


@kernel
def solve_spd(mass: Array, rhs: Array) -> bool:
    """Solve ``mass x = rhs`` in place by Cholesky; `mass` is overwritten, `rhs` becomes x.

    Returns
    -------
    bool
        False where the matrix is not positive definite (or not finite).
    """
    n = rhs.shape[0]
    for i in range(n):
        for j in range(i + 1):
            value = mass[i, j]
            for k in range(j):
                value -= mass[i, k] * mass[j, k]
            if j < i:
                mass[i, j] = value / mass[j, j]
            elif value > 0.0:
                mass[i, i] = math.sqrt(value)
            else:
                return False
    for i in range(n):
        for k in range(i):
            rhs[i] -= mass[i, k] * rhs[k]
        rhs[i] /= mass[i, i]
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, n):
            rhs[i] -= mass[k, i] * rhs[k]
        rhs[i] /= mass[i, i]
    return True


@kernel
def factorise(matrix: Array, pivot: Array) -> bool:
    """LU with partial pivoting in place; False where singular or not finite."""
    size = matrix.shape[0]
    for k in range(size):
        best = k
        for i in range(k + 1, size):
            if abs(matrix[i, k]) > abs(matrix[best, k]):
                best = i
        pivot[k] = best
        if not abs(matrix[best, k]) > 0.0:
            return False
        if best != k:
            for j in range(size):
                matrix[k, j], matrix[best, j] = matrix[best, j], matrix[k, j]
        for i in range(k + 1, size):
            if matrix[i, k] != 0.0:
                factor = matrix[i, k] / matrix[k, k]
                matrix[i, k] = factor
                for j in range(k + 1, size):
                    matrix[i, j] -= factor * matrix[k, j]
    return True


@kernel
def solve_factored(matrix: Array, pivot: Array, b: Array) -> None:
    """Solve a system in place of its right-hand side, with what `factorise` left."""
    size = matrix.shape[0]
    for k in range(size):
        b[k], b[pivot[k]] = b[pivot[k]], b[k]
    for i in range(size):
        total = b[i]
        for j in range(i):
            total -= matrix[i, j] * b[j]
        b[i] = total
    for i in range(size - 1, -1, -1):
        total = b[i]
        for j in range(i + 1, size):
            total -= matrix[i, j] * b[j]
        b[i] = total / matrix[i, i]
