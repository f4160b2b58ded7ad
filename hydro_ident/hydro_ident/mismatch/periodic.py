"""Lines: dependence that repeats over time, over the joint's angle or over the stroke.

The whitened residual is transformed to wave numbers over each of these variables, alone and times
the channel's factor. A line is a wave number whose power stands far above its neighbours'; their
own power is the noise that it is held against (Thomson, Proc. IEEE 70 (1982) 1055, section XIII),
so that nothing smooth in the spectrum counts, whatever made it. The noise is a power of the wave
number near it: that of what drifts is steep.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from hydro_ident.mismatch.bench import Bench
from hydro_model.robot import FloatArray

ComplexArray = np.ndarray[tuple[int, ...], np.dtype[np.complexfloating]]

#: Variables over which something may repeat.
VARIABLES = ("time", "joint_angle", "piston_position")
#: Least and most periods over a variable's range; steps of the scan per period.
LEAST_PERIODS, MOST_PERIODS, PER_PERIOD = 2.5, 1500.0, 2
#: Rows that a period has at least while the variable moves fast.
_ROWS = 3.0
#: Steps of the scan to either side whose power is the background, without the nearest ones.
_REACH, _NEAREST = 60, 4
#: Strongest wave numbers that are looked at more closely, by either measure.
_PEAKS = 4
#: Of the logarithm of a power over its mean, for the exponential law: less the mean (Euler's
#: constant), and variance.
_BELOW, _VARIANCE = float(np.euler_gamma), np.pi**2 / 6.0


@dataclass(frozen=True)
class Lines:
    """Fourier sums of a channel over one variable.

    Attributes
    ----------
    bench : Bench
        Of the channel's rows, behind a refit.
    at, factor : (n,) array
        The variable on the bench's rows, and what a repeating function is multiplied by.
    numbers : (K,) array
        Periods per unit of the variable that are looked at, evenly spaced.
    """

    bench: Bench
    at: FloatArray
    factor: FloatArray
    numbers: FloatArray

    @staticmethod
    def of(bench: Bench, at: FloatArray, factor: FloatArray) -> Lines | None:
        """None where the variable has too little range."""
        return Lines(bench, at, factor, wave_numbers(at)) if is_scanned(at) else None

    def strongest(self) -> tuple[int, ...]:
        """Wave numbers whose power is largest, by itself and beside its neighbours'.

        Through gaps and pauses of the motion a strong line lifts its neighbours, too.
        """
        powers = self._found
        found: list[int] = []
        background, _ = self._background(powers, np.arange(powers.size))
        for size in (powers, powers / background):
            left = size.copy()
            for _ in range(_PEAKS):
                best = int(np.argmax(left))
                found.append(best)
                left[max(best - _NEAREST, 0) : best + _NEAREST + 1] = 0.0
        return tuple(dict.fromkeys(found))

    def p_value(self, number: int, rest: FloatArray) -> float:
        """Chance of so strong a line at any of the wave numbers; as `chance`.

        `rest` is what the line is looked for in.
        """
        return min(1.0, self.numbers.size * self.chance(number, rest))

    def chance(self, number: int, rest: FloatArray) -> float:
        """Chance of so strong a line at one wave number.

        Parameters
        ----------
        number : int
            Of the line.
        rest : (M,) array
            The whitened residual without it: what its neighbours hold of it through gaps and
            pauses of the motion is not their own.
        """
        background, worth = self._background(self._powers(rest), np.array([number]))
        ratio = self._found[number] / background[0]
        # The tail of a power over the mean of so many others.
        return float((1.0 + ratio / worth[0]) ** -worth[0])

    def _background(
        self, powers: FloatArray, at: np.ndarray[tuple[int, ...], np.dtype[np.intp]]
    ) -> tuple[FloatArray, FloatArray]:
        """What the neighbours of some wave numbers, by place, say of their power.

        And how many independent powers it is worth: least squares of a straight line of the
        logarithms over that of the wave number.
        """
        near = np.arange(-_REACH, _REACH + 1)
        beside = at[:, None] + near[np.abs(near) > _NEAREST][None]
        there = (beside >= 0) & (beside < powers.size)
        beside = np.clip(beside, 0, powers.size - 1)
        x = np.where(there, np.log(self.numbers[beside] / self.numbers[at][:, None]), 0.0)
        y = np.where(there, np.log(np.maximum(powers[beside], 1e-300)), 0.0)
        count, first, second = there.sum(axis=1), x.sum(axis=1), (x**2).sum(axis=1)
        determinant = count * second - first**2
        level = (second * y.sum(axis=1) - first * (x * y).sum(axis=1)) / determinant
        # So many steps of the scan are independent.
        variance = PER_PERIOD * _VARIANCE * second / determinant
        return np.exp(level + _BELOW), 1.0 / variance

    @cached_property
    def _found(self) -> FloatArray:
        """Powers of the residual that the bench left, (K,)."""
        return self._powers(self.bench.residual)

    def _powers(self, residual: FloatArray) -> FloatArray:
        """Squared Fourier sums of a whitened residual, (K,)."""
        bench, (coarse, fine) = self.bench, self._turns
        weights = bench.noise.adjoint(bench.layout, bench.rows, residual[: bench.measured])
        sums = (coarse * (weights * self.factor)[self.factor != 0.0]) @ fine.T
        return np.asarray(np.abs(sums.ravel()[: self.numbers.size]) ** 2)

    @cached_property
    def _turns(self) -> tuple[ComplexArray, ComplexArray]:
        """Phases of wave number `a B + b`: of every `a`, (A, m), and of every `b`, (B, m).

        A row's phase at evenly spaced numbers is the product of the two, which makes the sums of
        all numbers one product of matrices. Rows without a factor are left out.
        """
        at = -2j * np.pi * (self.at - self.at.min())[self.factor != 0.0]
        side = math.isqrt(self.numbers.size - 1) + 1
        step = self.numbers[1] - self.numbers[0]
        return (
            np.exp(self.numbers[::side, None] * at[None]),
            np.exp(step * np.arange(side)[:, None] * at[None]),
        )


def wave_numbers(at: FloatArray) -> FloatArray:
    """Periods per unit of a variable that its rows can tell apart.

    `at` (N,) are the variable's values.
    """
    span = float(np.ptp(at)) if at.size > 1 else 0.0
    if span <= 0.0:
        return np.zeros(0)
    count = int((most_periods(at) - LEAST_PERIODS) * PER_PERIOD)
    return np.asarray((LEAST_PERIODS + np.arange(max(count, 0)) / PER_PERIOD) / span)


def most_periods(at: FloatArray) -> float:
    """Most periods over a variable's range that its rows can tell; 0 where it has none.

    `at` (N,) are the variable's values.
    """
    span = float(np.ptp(at)) if at.size > 1 else 0.0
    if span <= 0.0:
        return 0.0
    step = float(np.quantile(np.abs(np.diff(at)), 0.9))
    return min(MOST_PERIODS, span / max(_ROWS * step, 1e-12))


def is_scanned(at: FloatArray) -> bool:
    """Whether a variable has the range for lines: each needs its neighbours.

    `at` (N,) are the variable's values.
    """
    return wave_numbers(at).size >= 2 * _REACH
