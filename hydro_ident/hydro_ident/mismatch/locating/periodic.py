"""Lines: dependence that repeats over time, over the joint's angle or over the stroke.

The whitened residual is transformed to wave numbers over each of these variables, alone and times
the channel's factor. A line is a wave number whose power stands far above its neighbours'; their
own power is the noise that it is held against (Thomson, Proc. IEEE 70 (1982) 1055, section XIII),
so that nothing smooth in the spectrum counts, whatever made it. The noise is a power of the wave
number near it: that of what drifts is steep. What repeats over time has another phase in every
recording: their powers are added up, not their sums.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.special import digamma, polygamma
from scipy.stats import f as ratio_law

from hydro_ident.mismatch.fitting.bench import Bench
from hydro_model.arrays import BoolArray, IndexArray
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
    apart : tuple of (n,) bool array
        Rows whose sums are apart, as a line may have any phase in each; together all of them.
    """

    bench: Bench
    at: FloatArray
    factor: FloatArray
    numbers: FloatArray
    apart: tuple[BoolArray, ...]

    @staticmethod
    def of(
        bench: Bench, at: FloatArray, factor: FloatArray, recording: IndexArray | None = None
    ) -> Lines | None:
        """None where the variable has too little range.

        Parameters
        ----------
        bench : Bench
        at, factor : (n,) array
            As the attributes.
        recording : (n,) int array, optional
            Of each row, where a line may have another phase in every one of them.
        """
        if not is_scanned(at):
            return None
        own = np.zeros(at.size, dtype=np.intp) if recording is None else recording
        shown = np.unique(own[factor != 0.0])
        return Lines(bench, at, factor, wave_numbers(at), tuple(own == r for r in shown))

    def strongest(self) -> tuple[int, ...]:
        """Wave numbers whose power is largest, by itself and beside its neighbours'.

        Through gaps and pauses of the motion a strong line lifts its neighbours, too.
        """
        found: list[int] = []
        background, _, _ = self._background(self._found, np.arange(self.numbers.size))
        powers = self._found.sum(axis=0)
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
        background, worth, shape = self._background(self._powers(rest), np.array([number]))
        ratio = float(self._found[:, number].sum()) / background[0]
        # The tail of so many powers over the mean of so many others.
        return float(ratio_law.sf(ratio, 2.0 * shape[0], 2.0 * worth[0]))

    def _background(
        self, powers: FloatArray, at: np.ndarray[tuple[int, ...], np.dtype[np.intp]]
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """What the neighbours of some wave numbers, by place, say of their power.

        And how many independent powers it is worth: least squares of a straight line of the
        logarithms over that of the wave number. Last how many powers of one size the sum of powers
        (R, K) is: so many of the largest have its mean, and a tail that is no lighter.
        """
        near = np.arange(-_REACH, _REACH + 1)
        beside = at[:, None] + near[np.abs(near) > _NEAREST][None]
        there = (beside >= 0) & (beside < self.numbers.size)
        beside = np.clip(beside, 0, self.numbers.size - 1)
        x = np.where(there, np.log(self.numbers[beside] / self.numbers[at][:, None]), 0.0)
        sizes = np.stack([_mean_log(own[beside], there) for own in powers])
        sizes = np.exp(sizes - sizes.max(axis=0))
        shape = sizes.sum(axis=0)
        y = np.where(there, np.log(np.maximum(powers.sum(axis=0)[beside], 1e-300)), 0.0)
        count, first, second = there.sum(axis=1), x.sum(axis=1), (x**2).sum(axis=1)
        determinant = count * second - first**2
        level = (second * y.sum(axis=1) - first * (x * y).sum(axis=1)) / determinant
        # So many steps of the scan are independent.
        variance = PER_PERIOD * polygamma(1, shape) * second / determinant
        # The logarithm of a power is on the average below that of its mean.
        below = np.log(shape) - digamma(shape)
        return np.exp(level + below), 1.0 / variance, shape

    @cached_property
    def _found(self) -> FloatArray:
        """Powers of the residual that the bench left, (R, K)."""
        return self._powers(self.bench.residual)

    def _powers(self, residual: FloatArray) -> FloatArray:
        """Squared Fourier sums of a whitened residual over each of `apart`, (R, K)."""
        bench, (coarse, fine) = self.bench, self._turns
        weights = bench.noise.adjoint(bench.layout, bench.rows, residual[: bench.measured])
        shown = self.factor != 0.0
        turned = coarse * (weights * self.factor)[shown]
        own = [rows[shown] for rows in self.apart]
        sums = np.stack([(turned[:, rows] @ fine[:, rows].T).ravel() for rows in own])
        return np.asarray(np.abs(sums[:, : self.numbers.size]) ** 2)

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


def _mean_log(powers: FloatArray, there: BoolArray) -> FloatArray:
    """Mean logarithm of powers (k, m), of those in `there` (k, m), (k,)."""
    logs = np.where(there, np.log(np.maximum(powers, 1e-300)), 0.0)
    return np.asarray(logs.sum(axis=1) / there.sum(axis=1))


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
