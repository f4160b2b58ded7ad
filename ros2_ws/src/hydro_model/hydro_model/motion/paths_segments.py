"""Pieces of a path: motion laws that give position, velocity and acceleration at a time.

A path (`hydro_model.motion.paths`) strings them together. Every segment that a path file can name
starts and ends at rest; `Quintic` alone can also join moving ends, for trajectory messages.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Protocol, TypeVar

import numpy as np

from hydro_model.robot import FloatArray

Sample = tuple[FloatArray, FloatArray, FloatArray]
_Number = TypeVar("_Number", float, FloatArray)


class Segment(Protocol):
    """A motion over ``0 <= t <= duration_s`` of k coordinates."""

    @property
    def duration_s(self) -> float:
        """Length in time."""

    @property
    def polynomial(self) -> bool:
        """True where its ends alone give the whole motion back as a quintic."""

    def sample(self, t: float) -> Sample:
        """Position, velocity and acceleration, (k,) each; `t` is inside the segment."""

    def sample_many(self, times_s: FloatArray) -> Sample:
        """Position, velocity and acceleration at N times inside the segment, (N, k) each."""


def smooth_step(s: _Number) -> tuple[_Number, _Number, _Number]:
    """The quintic ``10 s^3 - 15 s^4 + 6 s^5`` on [0, 1] and its two derivatives.

    Value goes 0 to 1; both derivatives vanish at both ends.

    >>> smooth_step(0.5)
    (0.5, 1.875, 0.0)
    """
    value = s * s * s * (10.0 + s * (-15.0 + 6.0 * s))
    first = 30.0 * s * s * (1.0 - s) * (1.0 - s)
    second = 60.0 * s * (1.0 - s) * (1.0 - 2.0 * s)
    return value, first, second


@dataclass(frozen=True, slots=True)
class Quintic:
    """Fifth-order polynomial through position, velocity and acceleration at both ends.

    Attributes
    ----------
    coefficients : (6, k) array
        Of ``s = t / duration_s``, constant first.
    duration_s : float
    polynomial : bool
    """

    coefficients: FloatArray
    duration_s: float
    polynomial: bool = True
    _by_power: FloatArray = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        # Of position, velocity and acceleration alike: (3, k, 6), so that one product with the
        # powers of s gives all three; for a few coordinates the quickest way there is.
        rates = [self.coefficients]
        for _ in range(2):
            powers = np.arange(1.0, len(rates[-1]))
            rates.append(rates[-1][1:] * powers[:, None] / self.duration_s)
        padded = [np.pad(rate, [(0, 6 - len(rate)), (0, 0)]).T for rate in rates]
        object.__setattr__(self, "_by_power", np.array(padded))

    @staticmethod
    def between(start: Sample, end: Sample, duration_s: float) -> Quintic:
        """The quintic from one state to another.

        Parameters
        ----------
        start, end : tuple of (k,) arrays
            Position, velocity and acceleration.
        duration_s : float

        Returns
        -------
        Quintic
        """
        span = np.array([1.0, duration_s, duration_s**2])
        p0, v0, a0 = (np.asarray(x, dtype=float) * s for x, s in zip(start, span, strict=True))
        p1, v1, a1 = (np.asarray(x, dtype=float) * s for x, s in zip(end, span, strict=True))
        d = p1 - p0
        rows = [
            p0,
            v0,
            0.5 * a0,
            10.0 * d - 6.0 * v0 - 4.0 * v1 - 1.5 * a0 + 0.5 * a1,
            -15.0 * d + 8.0 * v0 + 7.0 * v1 + 1.5 * a0 - a1,
            6.0 * d - 3.0 * (v0 + v1) - 0.5 * a0 + 0.5 * a1,
        ]
        return Quintic(np.array(rows), duration_s)

    @staticmethod
    def at_rest(start: Sequence[float], end: Sequence[float], duration_s: float) -> Quintic:
        """The quintic from rest to rest; its peak speed is 1.875 times the mean."""
        still = np.zeros(len(start))
        first, last = np.array(start, dtype=float), np.array(end, dtype=float)
        return Quintic.between((first, still, still), (last, still, still), duration_s)

    def sample(self, t: float) -> Sample:
        """Position, velocity and acceleration at `t`."""
        s = float(t) / self.duration_s
        square = s * s
        powers = 1.0, s, square, square * s, square * square, square * square * s
        position, velocity, acceleration = self._by_power @ powers
        return position, velocity, acceleration

    def sample_many(self, times_s: FloatArray) -> Sample:
        """Position, velocity and acceleration at N times, (N, k) each."""
        powers = np.vander(times_s / self.duration_s, 6, increasing=True)
        position, velocity, acceleration = powers @ self._by_power.swapaxes(1, 2)
        return position, velocity, acceleration


@dataclass(frozen=True, slots=True)
class Hold:
    """Rest at a position.

    Attributes
    ----------
    position : (k,) array
    duration_s : float
    polynomial : bool
    """

    position: FloatArray
    duration_s: float
    polynomial: bool = True

    def sample(self, t: float) -> Sample:
        """Position, velocity and acceleration at `t`."""
        del t
        still = np.zeros_like(self.position)
        return self.position, still, still

    def sample_many(self, times_s: FloatArray) -> Sample:
        """Position, velocity and acceleration at N times, (N, k) each."""
        still = np.zeros((len(times_s), len(self.position)))
        return still + self.position, still, still.copy()


# A controller samples one time in every cycle: by plain numbers, where they are quicker.


def _from_end(times_s: FloatArray, duration_s: float) -> tuple[FloatArray, FloatArray]:
    """Time from the nearer end, and 1 on the first half and -1 on the second, (N, 1) each."""
    at = times_s[:, None]
    return np.minimum(at, duration_s - at), np.where(at < 0.5 * duration_s, 1.0, -1.0)


def _window(t: float, duration_s: float, ramp_s: float) -> tuple[float, float, float]:
    """A window with quintic flanks: 0 at both ends with two vanishing derivatives, 1 between."""
    if t < ramp_s:
        w, first, second = smooth_step(t / ramp_s)
        return w, first / ramp_s, second / ramp_s**2
    if t > duration_s - ramp_s:
        w, first, second = smooth_step((duration_s - t) / ramp_s)
        return w, -first / ramp_s, second / ramp_s**2
    return 1.0, 0.0, 0.0


def _windows(times_s: FloatArray, duration_s: float, ramp_s: float) -> Sample:
    """The same at N times, (N, 1) each."""
    near_s, way = _from_end(times_s, duration_s)
    w, first, second = smooth_step(np.minimum(near_s / ramp_s, 1.0))
    return w, way * first / ramp_s, second / ramp_s**2


def _windowed(
    centre: FloatArray, window: tuple[_Number, _Number, _Number], signal: Sample
) -> Sample:
    """`centre` plus window times signal, by the product rule."""
    w, w1, w2 = window
    g, g1, g2 = signal
    return centre + w * g, w * g1 + w1 * g, w * g2 + 2.0 * w1 * g1 + w2 * g


@dataclass(frozen=True, slots=True)
class Fourier:
    """Finite Fourier series about a position, under a window that starts and ends at rest.

    ``q(t) = centre + w(t) sum_h [sine_h sin(h w0 t) + cosine_h cos(h w0 t)]``.

    Attributes
    ----------
    centre : (k,) array
    sine, cosine : (k, H) array
        Amplitudes of harmonics 1 to H.
    fundamental_hz, ramp_s, duration_s : float
        `ramp_s` is the length of each flank of the window.
    polynomial : bool
    """

    centre: FloatArray
    sine: FloatArray
    cosine: FloatArray
    fundamental_hz: float
    ramp_s: float
    duration_s: float
    polynomial: bool = False

    def sample(self, t: float) -> Sample:
        """Position, velocity and acceleration at `t`."""
        rate = 2.0 * np.pi * self.fundamental_hz * np.arange(1, self.sine.shape[1] + 1)
        s, c = np.sin(rate * t), np.cos(rate * t)
        signal = (
            self.sine @ s + self.cosine @ c,
            self.sine @ (rate * c) - self.cosine @ (rate * s),
            -self.sine @ (rate * rate * s) - self.cosine @ (rate * rate * c),
        )
        return _windowed(self.centre, _window(t, self.duration_s, self.ramp_s), signal)

    def sample_many(self, times_s: FloatArray) -> Sample:
        """Position, velocity and acceleration at N times, (N, k) each."""
        rate = 2.0 * np.pi * self.fundamental_hz * np.arange(1, self.sine.shape[1] + 1)
        angle = np.multiply.outer(times_s, rate)
        s, c = np.sin(angle), np.cos(angle)
        sine, cosine = self.sine.T, self.cosine.T
        signal = (
            s @ sine + c @ cosine,
            (rate * c) @ sine - (rate * s) @ cosine,
            -(rate * rate * s) @ sine - (rate * rate * c) @ cosine,
        )
        windows = _windows(times_s, self.duration_s, self.ramp_s)
        return _windowed(self.centre, windows, signal)


@dataclass(frozen=True, slots=True)
class Chirp:
    """Sine of linearly rising frequency about a position, under a window.

    ``q(t) = centre + w(t) amplitude sin(2 pi (f0 t + (f1 - f0) t^2 / (2 T)))``.

    Attributes
    ----------
    centre, amplitude : (k,) array
    from_hz, to_hz, ramp_s, duration_s : float
    polynomial : bool
    """

    centre: FloatArray
    amplitude: FloatArray
    from_hz: float
    to_hz: float
    ramp_s: float
    duration_s: float
    polynomial: bool = False

    def sample(self, t: float) -> Sample:
        """Position, velocity and acceleration at `t`."""
        sweep = (self.to_hz - self.from_hz) / self.duration_s
        angle = 2.0 * np.pi * (self.from_hz * t + 0.5 * sweep * t * t)
        rate, rise = 2.0 * np.pi * (self.from_hz + sweep * t), 2.0 * np.pi * sweep
        s, c = np.sin(angle), np.cos(angle)
        a = self.amplitude
        signal = (a * s, a * (rate * c), a * (rise * c - rate * rate * s))
        return _windowed(self.centre, _window(t, self.duration_s, self.ramp_s), signal)

    def sample_many(self, times_s: FloatArray) -> Sample:
        """Position, velocity and acceleration at N times, (N, k) each."""
        at, sweep = times_s, (self.to_hz - self.from_hz) / self.duration_s
        angle = 2.0 * np.pi * (self.from_hz * at + 0.5 * sweep * at * at)
        rate, rise = 2.0 * np.pi * (self.from_hz + sweep * at), 2.0 * np.pi * sweep
        s, c = np.sin(angle), np.cos(angle)
        signal = (s, rate * c, rise * c - rate * rate * s)
        of_joints = [np.multiply.outer(part, self.amplitude) for part in signal]
        windows = _windows(times_s, self.duration_s, self.ramp_s)
        return _windowed(self.centre, windows, (of_joints[0], of_joints[1], of_joints[2]))


@dataclass(frozen=True, slots=True)
class Cruise:
    """A move at constant speed with smooth flanks: velocity rises by a quintic and falls again.

    Attributes
    ----------
    start, travel : (k,) array
    ramp_s, duration_s : float
        Length of each flank, and of the whole (at least two flanks). The speed between the
        flanks is ``travel / (duration_s - ramp_s)``.
    polynomial : bool
    """

    start: FloatArray
    travel: FloatArray
    ramp_s: float
    duration_s: float
    polynomial: bool = False

    def sample(self, t: float) -> Sample:
        """Position, velocity and acceleration at `t`."""
        speed = self.travel / (self.duration_s - self.ramp_s)
        if t > self.duration_s - self.ramp_s:
            # The second flank is the first one run backwards from the end.
            covered, rate, slope = self._flank(self.duration_s - t)
            return self.start + self.travel - speed * covered, speed * rate, -speed * slope
        if t < self.ramp_s:
            covered, rate, slope = self._flank(t)
            return self.start + speed * covered, speed * rate, speed * slope
        return self.start + speed * (t - 0.5 * self.ramp_s), speed, np.zeros_like(speed)

    def sample_many(self, times_s: FloatArray) -> Sample:
        """Position, velocity and acceleration at N times, (N, k) each."""
        near_s, way = _from_end(times_s, self.duration_s)
        s = np.minimum(near_s / self.ramp_s, 1.0)
        rate, slope, _ = smooth_step(s)
        covered_s = self.ramp_s * s**4 * (2.5 + s * (-3.0 + s)) + np.maximum(
            near_s - self.ramp_s, 0.0
        )
        # The second half is the first one run backwards from the end.
        speed = self.travel / (self.duration_s - self.ramp_s)
        end = np.where(way > 0.0, self.start, self.start + self.travel)
        return end + way * covered_s * speed, rate * speed, way * slope / self.ramp_s * speed

    def _flank(self, t: float) -> tuple[float, float, float]:
        """Distance, speed and acceleration of the rising flank at unit cruise speed."""
        s = t / self.ramp_s
        value, first, _ = smooth_step(s)
        covered = self.ramp_s * s**4 * (2.5 + s * (-3.0 + s))
        return covered, value, first / self.ramp_s
