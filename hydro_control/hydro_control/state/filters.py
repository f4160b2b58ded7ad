"""The paper's real-time filters (section V): a moving average and a filtered difference.

The exponentially weighted moving average is ``y(n) = (1 - a) y(n - 1) + a z(n)``. Its pole
``1 - a`` is a time constant of ``-dt / ln(1 - a)``: at dt = 2 ms, a = 0.04 gives 49 ms (3.2 Hz)
and a = 0.3 gives 5.6 ms (28 Hz).
"""

from __future__ import annotations

import math

import numpy as np

from hydro_model.robot import FloatArray


def time_constant_s(alpha: float, dt_s: float) -> float:
    """Time constant of the average in s.

    Parameters
    ----------
    alpha : float
        Weight of the newest input, ``0 < alpha <= 1``; at 1 nothing is filtered.
    dt_s : float
        Sample time.

    >>> round(time_constant_s(0.04, 0.002), 4)
    0.049
    """
    return 0.0 if alpha >= 1.0 else -dt_s / math.log(1.0 - alpha)


def alpha_for(time_constant: float, dt_s: float) -> float:
    """The weight with a given time constant: the inverse of `time_constant_s`."""
    return 1.0 if time_constant <= 0.0 else 1.0 - math.exp(-dt_s / time_constant)


def average_lag_s(alpha: float, dt_s: float) -> float:
    """By how much the average trails a steady ramp: ``dt (1 - a) / a``.

    `alpha` is the weight of the newest input.
    """
    return dt_s * (1.0 - alpha) / alpha


def average_age_s2(alpha: float, dt_s: float) -> float:
    """Mean square of how old the average's inputs are: ``dt^2 (1 - a) (2 - a) / a^2``.

    Half of it, times the acceleration, is what the average trails a parabola by less than its
    ramp. `alpha` is the weight of the newest input.
    """
    return dt_s**2 * (1.0 - alpha) * (2.0 - alpha) / alpha**2


def difference_lag_s(alpha: float, dt_s: float) -> float:
    """By how much `FilteredDifference` is late: half a sample more than its average.

    `alpha` is the weight of the newest input.
    """
    return 0.5 * dt_s + average_lag_s(alpha, dt_s)


class Ewma:
    """Exponentially weighted moving average; the first input is the first output.

    Parameters
    ----------
    alpha : float
        Weight of the newest input, ``0 < alpha <= 1``.
    """

    def __init__(self, alpha: float) -> None:
        self.alpha = alpha
        self._y: FloatArray | None = None

    def reset(self) -> None:
        """Forget the past."""
        self._y = None

    def update(self, z: FloatArray, steps: int = 1) -> FloatArray:
        """Filter one input.

        Parameters
        ----------
        z : array
        steps : int
            Sample times since the last input; after lost samples the past has faded as if the
            newest input had stood in their place.

        Returns
        -------
        array
            Of the shape of `z`.
        """
        if self._y is None:
            self._y = np.array(z, dtype=float)
        else:
            past = (1.0 - self.alpha) ** steps
            self._y = past * self._y + (1.0 - past) * z
        return self._y


class FilteredDifference:
    """Time derivative: backward difference, then a moving average; 0 until the second input.

    Parameters
    ----------
    alpha : float
        Weight of the newest difference, ``0 < alpha <= 1``.
    dt_s : float
        Sample time.
    """

    def __init__(self, alpha: float, dt_s: float) -> None:
        self.alpha, self.dt_s = alpha, dt_s
        self._z: FloatArray | None = None
        self._average = Ewma(alpha)

    def reset(self) -> None:
        """Forget the past."""
        self._z = None
        self._average.reset()

    def update(self, z: FloatArray, steps: int = 1) -> FloatArray:
        """Differentiate one input.

        Parameters
        ----------
        z : array
        steps : int
            Sample times since the last input.

        Returns
        -------
        array
            Unit of `z` per second.
        """
        if self._z is None:
            # An average that starts at 0 lets a derivative rise from rest instead of taking
            # the noise of the first difference for the truth.
            self._z = np.array(z, dtype=float)
            return self._average.update(np.zeros_like(self._z))
        slope = (z - self._z) / (steps * self.dt_s)
        self._z = np.array(z, dtype=float)
        return self._average.update(slope, steps)
