"""Weights of rows by their own residual: Tukey's biweight on the scale of the median.

A row more than `CUT` deviations off counts for nothing, and one within a deviation almost fully:
95 % efficient on normal noise. The weights of a pass come from the fit of the pass before; the
first of them are Huber's, which bring any start near enough for the biweight.

The estimate solves ``sum psi(e_t) x_t = 0``, psi(e) = w(e) e. On normal noise of deviation 1 and
autocorrelation rho, psi is a series of Hermite polynomials c_k He_k(e), whose terms do not
correlate with each other and have the autocovariances k! c_k^2 rho^k:

    psi(e) = E[psi'] e + c_3 He_3(e) + ...,  theta - truth = (E[psi'] sum x x')^-1 sum psi(e_t) x_t

so that the estimate errs as least squares do on the rows that were not rejected, from noise of
autocorrelation rho + `EXCESS` rho^3. The noise itself is thus to be found in the residuals as they
are: weights take the peaks off, and the noise looks smaller and whiter than it is.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from hydro_ident.estimate.statistics.histogram import Histogram
from hydro_model.arrays import BoolArray
from hydro_model.robot import FloatArray

CUT = 4.685
_HUBER = 1.345
#: E psi^2 / (E psi')^2 - 1 of the biweight on normal noise: what the terms beyond the linear one
#: add; all but nothing is left for those beyond the third.
EXCESS = 0.0526
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

    def of_gathered(self, combine: FloatArray) -> Weights:
        """Those of rows with other columns, of which the fitted ones are combinations.

        Parameters
        ----------
        combine : (w, p) array
        """
        return replace(self, theta=np.append(combine @ self.theta[:-1], 1.0))

    def of(self, channel: int, label: str, block: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Weights of rows with their lags.

        Parameters
        ----------
        channel : int
        label : str
            Of the recording.
        block : (T, lags + 1, w) array

        Returns
        -------
        weight : (T,) array
        kept : (T,) bool array
            Neither the row nor any of its lags is rejected.
        """
        size = np.abs(block[..., block.shape[2] - self.theta.size :] @ self.theta)
        key = channel, label
        self.residuals.setdefault(key, Histogram()).add(size[:, 0])
        ratio = size / self.scale[key]
        if not self.biweight:
            huber = 1.0 / np.maximum(1.0, ratio[:, 0] / _HUBER)
            return np.asarray(huber), np.ones(ratio.shape[0], dtype=bool)
        weight = np.maximum(1.0 - (ratio[:, 0] / CUT) ** 2, 0.0) ** 2
        return np.asarray(weight), np.asarray((ratio < CUT).all(axis=1))


def robust_scale(sizes: Histogram) -> float:
    """Standard deviation of normal noise with this median size.

    `sizes` counts the residuals' absolute values.
    """
    return sizes.quantile(0.5) / _MEDIAN
