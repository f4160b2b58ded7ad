"""What repeats a few times over a joint's range: too few neighbours for a line of a spectrum.

Waves of every such number of periods are tried by themselves, and held against what the strongest
of them explains by chance, as smooth functions are.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from hydro_ident.mismatch.fitting.bench import Bench
from hydro_ident.mismatch.fitting.fitted import Fitted
from hydro_ident.mismatch.fitting.training import Training
from hydro_ident.mismatch.locating.dependence import (
    Dependence,
    Whitened,
    dependence_of,
    inverse_of,
    values_of,
)
from hydro_ident.mismatch.locating.lines import repeats, waves
from hydro_ident.mismatch.locating.periodic import is_scanned, most_periods
from hydro_ident.mismatch.rows.state_space import OF_READINGS, factors_of
from hydro_model.robot import FloatArray

#: Variables over which a machine's parts and its sensors repeat.
POSITIONS = ("joint_angle", "piston_position")
#: What a wave is multiplied by: nothing, what a reading's error does, the chamber's compression.
_KINDS = ("", *OF_READINGS, "compression")
#: Least number of periods, what a smooth function of so many pieces cannot follow, and steps.
_LEAST, _STEP = 2.5, 0.5


@dataclass(frozen=True, slots=True)
class Tried:
    """A dependence, its columns (N, m), and all that were tried for it, whitened."""

    found: Dependence
    columns: FloatArray
    tried: tuple[Whitened, ...]


def repeating(training: Training, fitted: Fitted, bench: Bench, channel: int) -> Iterator[Tried]:
    """The strongest wave over each position, alone and times each factor.

    Parameters
    ----------
    training : Training
        Of the channel's rows.
    fitted : Fitted
    bench : Bench
        Of these rows.
    channel : int

    Yields
    ------
    Tried
        Where the position's range has few periods at most that the rows can tell.
    """
    mask = training.mask
    values = values_of(training, fitted, channel)
    factors = factors_of(training.predictor, fitted.model, channel, values, mask)
    for variable in POSITIONS:
        seen = values[variable][mask]
        if not np.isfinite(seen).all() or is_scanned(seen):
            continue
        numbers = np.arange(_LEAST, most_periods(seen) + _STEP, _STEP)
        if not numbers.size:
            continue
        numbers = numbers / max(float(np.ptp(seen)), 1e-300)
        turned = np.concatenate([waves(seen * number) for number in numbers], axis=1)
        for times in _KINDS:
            factor = factors[times][mask] if times in factors else np.ones(seen.size)
            if times and (times not in factors or not np.isfinite(factor).all()):
                continue
            what = channel, variable, times
            one = _strongest(training, fitted, bench, what, turned * factor[:, None], numbers)
            if one is not None:
                yield one


def _strongest(
    training: Training,
    fitted: Fitted,
    bench: Bench,
    what: tuple[int, str, str],
    every: FloatArray,
    numbers: FloatArray,
) -> Tried | None:
    """The strongest of K waves, (M, 2 K) on the training rows, of so many periods per unit."""
    white = np.asfortranarray(bench.beyond(every))
    every_sum = white.T @ bench.residual
    tried, gains = [], []
    for k in range(numbers.size):
        own, sums = white[:, 2 * k : 2 * k + 2], every_sum[2 * k : 2 * k + 2]
        freedom, inverse = inverse_of(own.T @ own)
        tried.append(Whitened(own, inverse, freedom))
        gains.append(float(sums @ inverse @ sums))
    best = int(np.argmax(gains))
    columns = np.zeros((training.mask.size, 2))
    columns[training.mask] = every[:, 2 * best : 2 * best + 2]
    one = dependence_of(training, fitted, bench, what, np.zeros(2), columns)
    if one is None:
        return None
    return Tried(repeats(one[0], 1.0 / float(numbers[best])), columns, tuple(tried))
