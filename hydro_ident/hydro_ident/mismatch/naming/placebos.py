"""Placebos: the same contribution at other times, of equal freedom and no meaning."""

from __future__ import annotations

import numpy as np

from hydro_ident.mismatch.fitting.fitted import Fitted
from hydro_ident.mismatch.fitting.training import Training
from hydro_ident.mismatch.rows.prediction import Predictor
from hydro_ident.mismatch.split.check import Check
from hydro_ident.mismatch.trials.constancy import SHIFTS
from hydro_model.robot import FloatArray

#: Correlation with the finding from which a shifted one is the same.
_ALIKE = 0.7


def placebo_residuals(
    training: Training,
    without: Fitted,
    check: Check,
    plain: FloatArray,
    own: FloatArray,
    there: FloatArray,
) -> list[FloatArray]:
    """Residuals on all rows with a finding's contribution at other times in its place.

    Shifts after which it is still much the same are no placebo.

    Parameters
    ----------
    training : Training
    without : Fitted
        The model without the finding.
    check : Check
    plain : (M,) array
        Its residual on all rows of the check's material.
    own : (N,) array
        What the finding does to all rows of the training's material.
    there : (M,) array
        What it does to those of the check's.
    """
    mask = training.mask
    real = without.bench.beyond(own[mask][:, None])[:, 0]
    result = []
    for shift in SHIFTS:
        column = _rolled(training.predictor, own, shift)
        moved = without.bench.beyond(column[mask][:, None])[:, 0]
        sizes = float(np.linalg.norm(moved) * np.linalg.norm(real))
        if abs(float(moved @ real)) > _ALIKE * sizes:
            continue
        step = float(moved @ without.bench.residual) / max(float(moved @ moved), 1e-300)
        result.append(plain - step * _rolled(check.predictor, there, shift))
    return result


def _rolled(predictor: Predictor, values: FloatArray, shift: float) -> FloatArray:
    """Values shifted in time around each channel of each recording."""
    material = predictor.material
    result = values.copy()
    for place in material.places:
        count = place.rows.stop - place.rows.start
        result[place.rows] = np.roll(values[place.rows], round(shift * count))
    return result
