"""What to ask of a valve so that its edges open as wanted: the listed signal laws inverted.

The laws of `Stage.SIGNAL` are split by how they answer. Those without a state are chained, in
catalogue order, into one curve, opening over signal, which is inverted numerically. Those with a
state are asked to follow ramps, behind which they trail by their lag.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence

import numpy as np

from hydro_control.errors import ControlError
from hydro_model.effects import ActiveEffect, Stage
from hydro_model.effects.signals import SIGNAL_COUNT, VALVE_SIGNAL
from hydro_model.robot import FloatArray

#: The curve reaches a little beyond full signal, so that a null bias leaves full opening in it.
REACH = 1.5
#: Of the curve and of its inverse.
POINTS = 30_001
#: The inverse is averaged over openings this far either way. Overlap makes it leap at zero; the
#: average crosses the leap in a ramp this wide, so that noise of the wanted opening is not
#: thrown from edge to edge. Straight parts of the curve are unchanged by it.
SMOOTHING = 0.004
#: Two ramps, slow against any spool's limit, and when their answers are compared.
_SLOPES_1_S = (0.2, 0.4)
_RAMP_S, _RAMP_STEP_S = 1.0, 5.0e-4


class SignalInverse:
    """The inverse of a chain of signal laws without states.

    Parameters
    ----------
    effects : sequence of ActiveEffect
        Of one valve, in catalogue order; those with states are left out.
    valve : str
        For messages.
    smoothing : float

    Raises
    ------
    ControlError
        The curve falls somewhere, is not finite or never opens.
    """

    def __init__(
        self, effects: Sequence[ActiveEffect], valve: str, smoothing: float = SMOOTHING
    ) -> None:
        signal = np.linspace(-REACH, REACH, POINTS)
        opening = _chain(effects, signal)
        names = ", ".join(one.effect.name for one in effects)
        if not np.all(np.isfinite(opening)):
            raise ControlError(f"valve '{valve}': {names} give no finite opening")
        used = opening[np.abs(signal) <= 1.0]
        if np.any(np.diff(used) < -1e-12) or not used[0] < 0.0 < used[-1]:
            raise ControlError(
                f"valve '{valve}': expected {names} to open it ever wider with the signal,"
                " found a curve that falls or never opens: it cannot be inverted"
            )
        # Beyond full signal, where no valve is driven, a law may turn round.
        middle = len(opening) // 2
        opening[middle:] = np.maximum.accumulate(opening[middle:])
        opening[: middle + 1] = np.minimum.accumulate(opening[middle::-1])[::-1]
        self._signal, self._opening = signal.tolist(), opening.tolist()
        wanted = np.linspace(opening[0] + smoothing, opening[-1] - smoothing, POINTS)
        averaged = _averaged_inverse(signal, opening, wanted, smoothing)
        self._wanted, self._averaged = wanted.tolist(), averaged.tolist()

    @property
    def table(self) -> tuple[tuple[float, float], list[float]]:
        """First of `POINTS` openings and their spacing, and the signals to give for them."""
        start, last = self._wanted[0], self._wanted[-1]
        return (start, (last - start) / (POINTS - 1)), self._averaged

    def signal(self, opening: float) -> float:
        """The signal to give for an opening; beyond the curve in parallel to the identity."""
        return _interpolated(self._wanted, self._averaged, opening)

    def opening(self, signal: float) -> float:
        """The opening that a signal gives."""
        return _interpolated(self._signal, self._opening, signal)


def lag_s(one: ActiveEffect) -> float:
    """By how much a signal law with states trails a steady ramp, in time.

    Two slopes tell the lag, in proportion to the slope, from a play, the same at both.

    Parameters
    ----------
    one : ActiveEffect
        With states.

    Returns
    -------
    float
        s; for a second-order spool ``2 zeta / w``.
    """
    time = np.arange(0.0, _RAMP_S + _RAMP_STEP_S, _RAMP_STEP_S)
    behind = []
    for slope in _SLOPES_1_S:
        rows = np.zeros((len(time), SIGNAL_COUNT))
        rows[:, VALVE_SIGNAL] = slope * time
        out = one.effect.evaluate(rows, one.parameters, Stage.SIGNAL, _RAMP_STEP_S)
        # Rows are held for a step each, which delays the ramp by half of it.
        behind.append(slope * (time[-1] - 0.5 * _RAMP_STEP_S) - float(out[-1]))
    return float((behind[1] - behind[0]) / (_SLOPES_1_S[1] - _SLOPES_1_S[0]))


def _chain(effects: Sequence[ActiveEffect], signal: FloatArray) -> FloatArray:
    """Openings that signals give, through the laws one after the other."""
    rows = np.full((len(signal), SIGNAL_COUNT), np.nan)
    rows[:, VALVE_SIGNAL] = signal
    for one in effects:
        if not one.effect.states:
            rows[:, VALVE_SIGNAL] = one.effect.evaluate(rows, one.parameters, Stage.SIGNAL)
    return rows[:, VALVE_SIGNAL].copy()


def _averaged_inverse(
    signal: FloatArray, opening: FloatArray, wanted: FloatArray, width: float
) -> FloatArray:
    """Mean of the inverse over ``wanted +- width``.

    With the area ``I(y) = int u dy`` under the inverse, taken along the curve, the mean is
    ``(I(y + w) - I(y - w)) / (2 w)``; where the curve is flat I stands still, so the leap of the
    inverse needs no special case.
    """
    steps = np.diff(opening) * 0.5 * (signal[1:] + signal[:-1])
    area = np.concatenate([[0.0], np.cumsum(steps)])
    high = np.interp(wanted + width, opening, area)
    return np.asarray((high - np.interp(wanted - width, opening, area)) / (2.0 * width))


def _interpolated(x: list[float], y: list[float], at: float) -> float:
    if at <= x[0]:
        return y[0] + at - x[0]
    if at >= x[-1]:
        return y[-1] + at - x[-1]
    k = bisect_right(x, at)
    return y[k - 1] + (y[k] - y[k - 1]) * (at - x[k - 1]) / (x[k] - x[k - 1])
