"""True signals from what sensors show: offsets, biases and gains that the model file lists."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from hydro_control.errors import ControlError
from hydro_control.state.sample import Sample
from hydro_model.effects import ActiveEffect
from hydro_model.effects.readings import Readings
from hydro_model.robot import FloatArray, Robot

#: A reading that lags has no inverse sample by sample; the law looks ahead for it instead.
_LAGS = frozenset({"pressure_delay", "command_delay"})


@dataclass(frozen=True, slots=True)
class _Line:
    """Readings ``r = offset + gain * true``."""

    offset: FloatArray
    gain: FloatArray

    def true(self, readings: FloatArray) -> FloatArray:
        return np.asarray((readings - self.offset) / self.gain)


class SensorCorrection:
    """The inverse of the listed effects of instruments.

    Every such effect is affine in each signal by itself, so the offset and gain of all of them
    together follow from what they make of the constant signals 0 and 1.

    Parameters
    ----------
    robot : Robot
    effects : sequence of ActiveEffect
        Those without a reading are passed over.

    Attributes
    ----------
    nothing : bool
        No listed effect is one of instruments.

    Raises
    ------
    ControlError
        A gain is not above 0.
    """

    def __init__(self, robot: Robot, effects: Sequence[ActiveEffect]) -> None:
        own = [a for a in effects if a.effect.reading and a.effect.name not in _LAGS]
        self.nothing = not own
        self._atmosphere_pa = robot.atmospheric_pressure_pa
        zero, one = _read(robot, own, 0.0), _read(robot, own, 1.0)
        self._q = _line(zero.q, one.q)
        self._p_a, self._p_b = _line(zero.p_a, one.p_a), _line(zero.p_b, one.p_b)
        self._supply = _line(zero.supply, one.supply)
        self._tank = _line(zero.tank, one.tank)

    def corrected(self, sample: Sample) -> Sample:
        """The sample as it would be without these effects; the same where there are none."""
        if self.nothing:
            return sample
        return replace(
            sample,
            q=self._q.true(sample.q),
            p_a=self._absolute(self._p_a, sample.p_a),
            p_b=self._absolute(self._p_b, sample.p_b),
            p_s=self._scalar(self._supply, sample.p_s),
            p_t=self._scalar(self._tank, sample.p_t),
        )

    def _absolute(self, line: _Line, pressure: FloatArray) -> FloatArray:
        return line.true(pressure - self._atmosphere_pa) + self._atmosphere_pa

    def _scalar(self, line: _Line, pressure: float | None) -> float | None:
        if pressure is None:
            return None
        return float(self._absolute(line, np.array(pressure)))


def _read(robot: Robot, effects: Sequence[ActiveEffect], value: float) -> Readings:
    """What sensors show of a single sample in which every signal has one value."""
    n, m = robot.dof, len(robot.cylinders)
    step_s = 1.0 / robot.sensors.rate_hz
    chambers = np.full((1, m), value)
    line, q = np.full(1, value), np.full((1, n), value)
    shown = Readings(
        step_s, q, chambers, chambers.copy(), line, line, chambers, np.full_like(q, np.nan)
    )
    for one in effects:
        if one.effect.reading is not None:
            shown = one.effect.reading(shown, one.index, one.parameters)
    return shown


def _line(zero: FloatArray, one: FloatArray) -> _Line:
    offset, gain = zero[0], one[0] - zero[0]
    if not np.all(gain > 0.0):
        raise ControlError(f"expected sensors with a gain above 0, found {gain}")
    return _Line(np.asarray(offset), np.asarray(gain))
