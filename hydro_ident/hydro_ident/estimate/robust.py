"""Weights of rows by their own residual: Tukey's biweight on the scale of the median.

A row more than `CUT` deviations off counts for nothing, and one within a deviation almost fully:
95 % efficient on normal noise. The weights of a pass come from the fit of the pass before; the
first of them are Huber's, which bring any start near enough for the biweight.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from hydro_ident.estimate.histogram import Histogram
from hydro_model.robot import FloatArray

CUT = 4.685
_HUBER = 1.345
#: (E w)^2 E psi^2 / (E psi')^3 of the biweight on normal noise: the variance of the estimate over
#: the one that the weighted sum of squares would state.
VARIANCE_FACTOR = 1.1633
#: Median of |r| over the standard deviation of normal noise.
_MEDIAN = 0.6744897501960817


@dataclass(slots=True)
class Weights:
    """Robust weights by the residuals of an earlier fit.

    Attributes
    ----------
    theta : (w,) array
        Acts on a row's last entries: the negative parameters, then 1 for y.
    scale : mapping of (int, str) to float
        Standard deviation of the residual by channel and recording.
    biweight : bool
        Tukey's; False: Huber's.
    residuals : dict of (int, str) to Histogram
        Sizes met, for the scale of the next pass.
    """

    theta: FloatArray
    scale: Mapping[tuple[int, str], float]
    biweight: bool
    residuals: dict[tuple[int, str], Histogram] = field(default_factory=dict)

    def of(self, channel: int, label: str, block: FloatArray) -> FloatArray:
        """Weights of rows with their lags, ``block`` of shape (T, lags + 1, w)."""
        size = np.abs(block[:, 0, block.shape[2] - self.theta.size :] @ self.theta)
        key = channel, label
        self.residuals.setdefault(key, Histogram()).add(size)
        ratio = size / self.scale[key]
        if not self.biweight:
            return np.asarray(1.0 / np.maximum(1.0, ratio / _HUBER))
        return np.asarray(np.maximum(1.0 - (ratio / CUT) ** 2, 0.0) ** 2)


def robust_scale(sizes: Histogram) -> float:
    """Standard deviation of normal noise with this median size."""
    return sizes.quantile(0.5) / _MEDIAN
