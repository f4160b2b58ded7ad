"""Compiled vectors of three numbers, as tuples that stay in registers.

`a` and `b` are such triples.
"""

from __future__ import annotations

from typing import Any

from hydro_model.numerics.kernel import kernel

Array = Any  # numba types the kernels; mypy follows no numba import
Triple = tuple[float, float, float]


@kernel
def triple(array: Array, row: int, column: int) -> Triple:
    """Three entries of a row from a column on."""
    return array[row, column], array[row, column + 1], array[row, column + 2]


@kernel
def cross(a: Triple, b: Triple) -> Triple:
    """a x b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@kernel
def dot(a: Triple, b: Triple) -> float:
    """Scalar product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@kernel
def plus(a: Triple, x: float, b: Triple) -> Triple:
    """a + x b."""
    return a[0] + x * b[0], a[1] + x * b[1], a[2] + x * b[2]


@kernel
def to_parent(array: Array, row: int, a: Triple) -> Triple:
    """R a, with the rotation R in the first nine columns of a row."""
    return (
        dot(triple(array, row, 0), a),
        dot(triple(array, row, 3), a),
        dot(triple(array, row, 6), a),
    )


@kernel
def to_child(array: Array, row: int, a: Triple) -> Triple:
    """R^T a, with the rotation R in the first nine columns of a row."""
    turned: Triple = plus((0.0, 0.0, 0.0), a[0], triple(array, row, 0))
    turned = plus(turned, a[1], triple(array, row, 3))
    return (
        turned[0] + a[2] * array[row, 6],
        turned[1] + a[2] * array[row, 7],
        turned[2] + a[2] * array[row, 8],
    )
