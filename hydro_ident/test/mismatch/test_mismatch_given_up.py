"""Channels that laws hardly bring nearer to their sensors' noise are given up."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from hydro_ident.mismatch.naming.given_up import GivenUp

CHANNEL = np.repeat([0, 1], 50)


def _left(first: float, second: float) -> Any:
    """A fit that leaves so much (rms) of two channels."""
    return SimpleNamespace(residual=np.where(CHANNEL == 0, first, second), model=None)


def _given_up(acts_on: int | None = 0) -> GivenUp:
    """Of channels that leave 10 at first, with noise of 0.1; a law acts on one, or on both."""
    column = np.ones(100) if acts_on is None else (acts_on == CHANNEL).astype(float)
    material = SimpleNamespace(channels=("lift/flow_a", "lift/flow_b"), channel=CHANNEL)
    predictor = SimpleNamespace(material=material, contribution=lambda model, term: column)
    training: Any = SimpleNamespace(predictor=predictor, mask=np.ones(100, dtype=bool))
    return GivenUp(training, _left(10.0, 10.0), {"lift/flow_a": 0.1, "lift/flow_b": 0.1})


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
    lost = _given_up()
    law: Any = object()
    assert lost.of(_left(had, 10.0), _left(left, 10.0), [law]) is vain
    assert lost.covers(CHANNEL == 0) is vain
    # What acts elsewhere, too, may be what is missing there.
    assert not lost.covers(CHANNEL == 1)
    assert not lost.covers(CHANNEL >= 0)


def test_what_helps_in_any_channel_is_not_in_vain() -> None:
    lost = _given_up(acts_on=None)
    law: Any = object()
    assert not lost.of(_left(10.0, 10.0), _left(9.9, 5.0), [law])
    assert not lost.covers(CHANNEL == 0)
    assert lost.of(_left(10.0, 10.0), _left(9.9, 9.9), [law])
    assert lost.covers(CHANNEL >= 0)


def test_channels_of_unknown_noise_are_never_given_up() -> None:
    lost = _given_up()
    lost = GivenUp(lost._training, _left(10.0, 10.0), {})
    law: Any = object()
    assert not lost.of(_left(10.0, 10.0), _left(10.0, 10.0), [law])
