"""Recursive least squares for slowly changing parameters within bounds."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hydro_model.robot import FloatArray


@dataclass(frozen=True, slots=True)
class Prior:
    """What is known of a parameter before any data.

    Attributes
    ----------
    lower, upper : float
        Bounds of the estimate.
    start : float
    std : float
        Of the start; the standard deviation never grows beyond it.
    drift : float
        Growth of the standard deviation in 1 s of excitation (random walk), per sqrt(s).
    """

    lower: float
    upper: float
    start: float
    std: float
    drift: float


class BoundedEstimator:
    """Least squares with forgetting by random walk, covariance limit, dead zone and projection.

    Per scalar equation ``y = phi^T theta + e``, with P the covariance and r the variance of e:
    ``s = phi^T P phi + r``, ``theta += P phi z(y - phi^T theta) / s``, ``P -= P phi phi^T P / s``.
    z is the dead zone ``z(e) = sign(e) max(|e| - d, 0)``: an error that unmodelled physics can
    cause moves nothing. Before the equations of a time step P grows by ``drift^2 dt``, and after
    them it is scaled back to the prior where it is larger, and theta is projected on its bounds.
    Without an equation nothing changes, P included, so waiting neither forgets nor winds up.

    Parameters
    ----------
    priors : sequence of Prior

    Attributes
    ----------
    value : (p,) array
    covariance : (p, p) array
    updates : int
        Time steps with an equation since the start.
    """

    def __init__(self, priors: tuple[Prior, ...]) -> None:
        self.lower = np.array([prior.lower for prior in priors])
        self.upper = np.array([prior.upper for prior in priors])
        self._start = np.array([prior.start for prior in priors])
        self._variance = np.array([prior.std for prior in priors]) ** 2
        self._growth = np.array([prior.drift for prior in priors]) ** 2
        self.reset()

    def reset(self) -> None:
        """Back to the prior."""
        self.value: FloatArray = self._start.copy()
        self.covariance: FloatArray = np.diag(self._variance)
        self.updates = 0

    @property
    def std(self) -> FloatArray:
        """Standard deviations (p,)."""
        return np.sqrt(np.diag(self.covariance))

    def update(
        self, rows: FloatArray, y: FloatArray, noise_density: float, dead_zone: float, dt_s: float
    ) -> None:
        """Take the equations of one time step.

        Parameters
        ----------
        rows : (k, p) array
        y : (k,) array
        noise_density : float
            Variance of e times its correlation time: samples closer than that tell less.
        dead_zone : float
            In the unit of y.
        dt_s : float
            Time since the last equations, at most that of one regular step.
        """
        if not len(rows):
            return
        self.updates += 1
        p = self.covariance
        p[np.diag_indices_from(p)] += self._growth * dt_s
        variance = noise_density / dt_s
        for row, wanted in zip(rows, y, strict=True):
            direction = p @ row
            scale = float(row @ direction) + variance
            error = float(wanted - row @ self.value)
            if abs(error) > dead_zone:
                kept = error - np.copysign(dead_zone, error)
                self.value = self.value + direction * (kept / scale)
            p -= np.outer(direction, direction) / scale
        self.value = np.clip(self.value, self.lower, self.upper)
        self._limit()

    def _limit(self) -> None:
        """Scale rows and columns of P back where a variance exceeds the prior's."""
        variance = np.diag(self.covariance)
        if np.any(variance > self._variance):
            scale = np.sqrt(np.minimum(1.0, self._variance / variance))
            self.covariance *= np.outer(scale, scale)
