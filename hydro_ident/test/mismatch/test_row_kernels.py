"""Compiled passes over rows against what they are said to be, row by row."""

from __future__ import annotations

import numpy as np
import pytest

from hydro_ident.mismatch.rows.row_kernels import between, window_means
from hydro_model.arrays import IndexArray
from hydro_model.robot import FloatArray

COUNT, SPAN, LENGTH = 200, 15, 0.03


def means(steps: FloatArray, start: IndexArray) -> FloatArray:
    return np.asarray(window_means(steps, start, SPAN, LENGTH))


@pytest.fixture
def steps() -> FloatArray:
    return np.random.default_rng(3).normal(size=(COUNT, 3))


def test_means_are_sums_over_each_window(steps: FloatArray) -> None:
    start = np.arange(4, COUNT - SPAN + 1, 5)
    expected = [steps[k : k + SPAN].sum(axis=0) / LENGTH for k in start]
    assert start[-1] + SPAN > COUNT - 5
    assert means(steps, start) == pytest.approx(np.array(expected), rel=1e-9, abs=1e-9)
    assert means(steps, start[:0]).shape == (0, 3)


@pytest.mark.parametrize("unknown", [np.nan, np.inf])
def test_a_window_that_touches_an_unknown_value_counts_nothing_in_any_column(
    steps: FloatArray, unknown: float
) -> None:
    start = np.arange(0, COUNT - SPAN + 1)
    whole = means(steps, start)
    steps[60, 1] = unknown
    found = means(steps, start)
    touched = (start <= 60) & (start + SPAN > 60)
    assert np.count_nonzero(touched) == SPAN
    assert not found[touched].any()
    assert found[~touched][:, [0, 2]] == pytest.approx(whole[~touched][:, [0, 2]])
    assert found[~touched][:, 1] == pytest.approx(whole[~touched][:, 1])


@pytest.mark.parametrize("share", [0.0, 0.3, 1.0])
def test_rows_between_samples_lie_on_the_line_from_each_to_the_next(
    steps: FloatArray, share: float
) -> None:
    out = between(steps, share)
    places = np.arange(COUNT - 1) + share
    lines = [np.interp(places, np.arange(COUNT), steps[:, c]) for c in range(3)]
    assert out == pytest.approx(np.stack(lines, axis=1), rel=1e-9, abs=1e-12)
