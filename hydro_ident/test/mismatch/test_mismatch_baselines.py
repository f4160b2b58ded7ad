"""The simple ways of naming that the diagnosis is measured against."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from hydro_ident.mismatch.fitting.bench import Bench
from hydro_ident.mismatch.fitting.whitening import Layout, Noise
from hydro_ident.mismatch.naming.baselines import _channel

ROWS = 500


@pytest.mark.parametrize(("noise", "channel"), [((1.0, 2.0), "flow"), ((1.0, 1e4), "force")])
def test_an_effect_is_told_of_the_channel_in_which_it_gains_most(
    noise: tuple[float, float], channel: str
) -> None:
    """A constant that is lost in noise gains nothing, whatever does not vary in it."""
    rng = np.random.default_rng(2)
    own = np.repeat([0, 1], ROWS)
    times = np.tile(0.05 * np.arange(ROWS), 2)
    layout = Layout(own, np.zeros_like(own), times, np.diff(times, prepend=0.0) > 0.0)
    base = rng.normal(size=(2 * ROWS, 2))
    white = Noise((np.zeros(0), np.zeros(0)), np.array(noise))
    bench = Bench(layout, white, rng.normal(size=2 * ROWS), base, 1.0)
    column = np.concatenate([np.full(ROWS, 0.05), 10.0 * np.sin(times[ROWS:])])
    entry = SimpleNamespace(columns=lambda size: np.reshape(column, (size, 1)))
    training: Any = SimpleNamespace(
        mask=np.ones(2 * ROWS, dtype=bool),
        predictor=SimpleNamespace(material=SimpleNamespace(channels=("force", "flow"))),
    )
    best: Any = SimpleNamespace(entry=entry, coefficients=np.ones(1))
    assert _channel(training, bench, best) == channel
