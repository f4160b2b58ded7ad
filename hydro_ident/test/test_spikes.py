"""Order statistics of short windows, which spikes are told by."""

from __future__ import annotations

import numpy as np
import pytest

from hydro_ident.estimate.signals.rank_kernels import running_ranks
from hydro_ident.estimate.signals.spikes import running_median

_WINDOWS = np.lib.stride_tricks.sliding_window_view


def _readings(ties: bool) -> np.ndarray:
    values = np.cumsum(np.random.default_rng(3).normal(size=400))
    return np.round(values) if ties else values


@pytest.mark.parametrize("ties", [False, True])
@pytest.mark.parametrize("width", [1, 2, 5, 11, 12, 400])
def test_a_running_median_is_that_of_every_window(width: int, ties: bool) -> None:
    values = _readings(ties)
    expected = np.median(_WINDOWS(values, width), axis=1)
    np.testing.assert_array_equal(running_median(values, width), expected)


@pytest.mark.parametrize("step", [1, 2, 6, 9])
def test_ranks_are_those_of_every_sorted_window(step: int) -> None:
    """Windows that overlap are sorted one from the other, those that do not by themselves."""
    values, width = _readings(True), 6
    ordered = np.sort(_WINDOWS(values, width)[::step], axis=1)
    out = np.empty(len(ordered))
    running_ranks(values, width, step, 1, 4, out)
    np.testing.assert_array_equal(out, 0.5 * (ordered[:, 1] + ordered[:, 4]))
