"""Rows that took no part: what findings are verified on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hydro_ident.estimate.rows import BoolArray
from hydro_ident.mismatch.prediction import Model, Predictor
from hydro_model.robot import FloatArray


@dataclass(frozen=True, slots=True)
class Check:
    """Rows that took no part in fitting or selecting.

    Attributes
    ----------
    predictor : Predictor
        Of the training material, or of other recordings.
    mask : (N,) bool array
    moving : (N,) bool array
        Rows on which friction laws can be judged.
    """

    predictor: Predictor
    mask: BoolArray
    moving: BoolArray

    def residual(self, model: Model) -> FloatArray:
        """Residual of a model on all rows of the material."""
        return self.predictor.residual(model)

    def rows(self, channel: int, name: str) -> BoolArray:
        """The check's rows of a channel, by its name."""
        material = self.predictor.material
        at = material.channels.index(name) if name in material.channels else -1
        return np.asarray(self.mask & (material.channel == at))
