"""Channels that laws hardly bring nearer to their sensors' noise are given up."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from hydro_ident.mismatch.naming.despair import Despair

CHANNEL = np.repeat([0, 1], 50)


def _left(first: float, second: float) -> Any:
    """A fit that leaves so much (rms) of two channels."""
    return SimpleNamespace(residual=np.where(CHANNEL == 0, first, second), model=None)


def _despair(acts_on: int | None = 0) -> Despair:
    """Of channels that leave 10 at first, with noise of 0.1; a law acts on one, or on both."""
    column = np.ones(100) if acts_on is None else (acts_on == CHANNEL).astype(float)
    material = SimpleNamespace(channels=("lift/flow_a", "lift/flow_b"), channel=CHANNEL)
    predictor = SimpleNamespace(material=material, contribution=lambda model, term: column)
    training: Any = SimpleNamespace(predictor=predictor, mask=np.ones(100, dtype=bool))
    return Despair(training, _left(10.0, 10.0), {"lift/flow_a": 0.1, "lift/flow_b": 0.1})


@pytest.mark.parametrize(
    ("had", "left", "vain"),
    [
        (10.0, 9.8, True),
        (10.0, 9.0, False),  # a fifth of the squares
        (4.0, 3.9, False),  # most of what the base left has been explained
        (0.95, 0.94, False),  # at the sensors' noise
    ],
)
def test_what_takes_out_hardly_anything_is_in_vain(had: float, left: float, vain: bool) -> None:
    despair = _despair()
    law: Any = object()
    assert despair.of(_left(had, 10.0), _left(left, 10.0), [law]) is vain
    assert despair.covers(CHANNEL == 0) is vain
    # What acts elsewhere, too, may be what is missing there.
    assert not despair.covers(CHANNEL == 1)
    assert not despair.covers(CHANNEL >= 0)


def test_what_helps_in_any_channel_is_not_in_vain() -> None:
    despair = _despair(acts_on=None)
    law: Any = object()
    assert not despair.of(_left(10.0, 10.0), _left(9.9, 5.0), [law])
    assert not despair.covers(CHANNEL == 0)
    assert despair.of(_left(10.0, 10.0), _left(9.9, 9.9), [law])
    assert despair.covers(CHANNEL >= 0)


def test_channels_of_unknown_noise_are_never_given_up() -> None:
    despair = _despair()
    despair = Despair(despair._training, _left(10.0, 10.0), {})
    law: Any = object()
    assert not despair.of(_left(10.0, 10.0), _left(10.0, 10.0), [law])
