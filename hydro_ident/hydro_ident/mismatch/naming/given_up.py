"""Channels in which no law of the catalogue is what is missing.

Physics of no catalogue draws one law after the other: each takes out a little, each is fitted
beside all others, and none of them stands in the end. A search that goes on there takes many
times as long as any other.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from hydro_ident.mismatch.fitting.fitted import Fitted
from hydro_ident.mismatch.fitting.training import Training
from hydro_ident.mismatch.settings import FAR
from hydro_model.arrays import BoolArray
from hydro_model.effects.targets import ActiveEffect
from hydro_model.robot import FloatArray

#: Share of what is left in a channel (of its squares) that a law takes out at least.
_TAKEN = 0.1
#: Share of what the base leaves that is explained where a channel's laws have been found.
_EXPLAINED = 0.75


class GivenUp:
    """Which channels are given up.

    Parameters
    ----------
    training : Training
    base : Fitted
    floors : mapping of str to float
        What the sensors' noise leaves of channels, rms; others are never given up.
    """

    def __init__(self, training: Training, base: Fitted, floors: Mapping[str, float]) -> None:
        self._training = training
        self._base = self._squares(base)
        channels = training.predictor.material.channels
        self._floor = np.array([floors.get(name, np.inf) for name in channels])
        self._given_up = np.zeros(len(channels), dtype=bool)

    def of(self, before: Fitted, after: Fitted, terms: Sequence[ActiveEffect]) -> bool:
        """Whether what was added is hardly anything of what is missing.

        The channels in which it acts are given up then: each is far from its sensors' noise
        still, keeps nearly all that was left in it, and much of what the base leaves.

        Parameters
        ----------
        before, after : Fitted
            Without it and with it.
        terms : sequence of ActiveEffect
            What was added.
        """
        had, left = self._squares(before), self._squares(after)
        predictor = self._training.predictor
        columns = [predictor.contribution(after.model, term) for term in terms]
        rows = np.any([column != 0.0 for column in columns], axis=0)
        acting = np.isin(np.arange(had.size), predictor.material.channel[rows])
        hardly = (
            (left > (FAR * self._floor) ** 2)
            & (left > (1.0 - _TAKEN) * had)
            & (left > (1.0 - _EXPLAINED) * self._base)
        )
        if not acting.any() or not hardly[acting].all():
            return False
        self._given_up |= acting
        return True

    def covers(self, rows: BoolArray) -> bool:
        """Whether something acts in channels alone that are given up, by its rows (N,)."""
        if not self._given_up.any():
            return False
        channel = self._training.predictor.material.channel
        return bool(self._given_up[np.unique(channel[rows])].all())

    def _squares(self, fitted: Fitted) -> FloatArray:
        """Mean square that is left of every channel."""
        material, mask = self._training.predictor.material, self._training.mask
        own = [(material.channel == k) & mask for k in range(len(material.channels))]
        return np.array([np.mean(fitted.residual[o] ** 2) if o.any() else 0.0 for o in own])
