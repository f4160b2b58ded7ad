"""The column that gains most by itself, against a search through all of them."""

from __future__ import annotations

import numpy as np
import pytest

from hydro_ident.mismatch.trials.subset_kernels import best_single


@pytest.mark.parametrize("free", [(True, True, True), (False, True, False), (False,) * 3])
@pytest.mark.parametrize("kept", [(True, True, True), (False, True, True), (False,) * 3])
def test_no_other_possible_column_gains_more(
    free: tuple[bool, ...], kept: tuple[bool, ...]
) -> None:
    rng = np.random.default_rng(8)
    square, sums = rng.uniform(0.5, 9.0, 3), rng.normal(size=(400, 3))
    gains, coefficients = np.full(400, np.nan), np.full((400, 3), np.nan)
    best_single(square, sums, np.array(free), np.array(kept), gains, coefficients)
    for m in range(400):
        # By theta a column takes 2 theta c'e - theta^2 c'c off; most of it at c'e / c'c.
        possible = [
            (sums[m, c] ** 2 / square[c], c)
            for c in range(3)
            if kept[c] and (free[c] or sums[m, c] > 0.0)
        ]
        gain, at = max(possible, default=(0.0, -1))
        expected = np.zeros(3)
        if at >= 0:
            expected[at] = sums[m, at] / square[at]
        assert gains[m] == pytest.approx(gain, rel=1e-12)
        assert coefficients[m] == pytest.approx(expected, rel=1e-12)
