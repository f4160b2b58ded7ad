"""What repeats a few times over a joint's range: too few neighbours for a line of a spectrum.

Waves of every such number of periods are tried by themselves, and held against what the strongest
of them explains by chance, as smooth functions are.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from hydro_ident.mismatch.bench import Bench
from hydro_ident.mismatch.dependence import Dependence, dependence_of, inverse_of, values_of
from hydro_ident.mismatch.fitting import Fitted
from hydro_ident.mismatch.lines import repeats, waves
from hydro_ident.mismatch.periodic import is_scanned, most_periods
from hydro_ident.mismatch.state_space import OF_READINGS, factors_of
from hydro_ident.mismatch.training import Training
from hydro_model.robot import FloatArray

#: Variables over which a machine's parts and its sensors repeat.
POSITIONS = ("joint_angle", "piston_position")
#: What a wave is multiplied by: nothing, what a reading's error does, the chamber's compression.
_KINDS = ("", *OF_READINGS, "compression")
#: Least number of periods, what a smooth function of so many pieces cannot follow, and steps.
_LEAST, _STEP = 2.5, 0.5

#: Whitened columns and the inverse of their products.
Pair = tuple[FloatArray, FloatArray]


@dataclass(frozen=True, slots=True)
class Tried:
    """A dependence, its columns (N, m), and all that were tried for it, whitened."""

    found: Dependence
    columns: FloatArray
    tried: tuple[Pair, ...]


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
        numbers = numbers / max(float(np.ptp(seen)), 1e-300)
        at = np.where(mask, values[variable], 0.0)
        turned = [waves(at * number) for number in numbers]
        for times in _KINDS:
            factor = np.where(mask, factors.get(times, 1.0), 0.0)
            if times and (times not in factors or not np.isfinite(factor).all()):
                continue
            what = channel, variable, times
            every = [wave * factor[:, None] for wave in turned]
            one = _strongest(training, fitted, bench, what, every, numbers)
            if one is not None:
                yield one


def _strongest(
    training: Training,
    fitted: Fitted,
    bench: Bench,
    what: tuple[int, str, str],
    every: list[FloatArray],
    numbers: FloatArray,
) -> Tried | None:
    """The strongest of some waves, (N, 2) each, of so many periods per unit."""
    if numbers.size == 0:
        return None
    white = bench.beyond(np.concatenate(every, axis=1)[training.mask])
    tried, gains = [], []
    for k in range(numbers.size):
        own = white[:, 2 * k : 2 * k + 2]
        _, inverse = inverse_of(own.T @ own)
        sums = own.T @ bench.residual
        tried.append((own, inverse))
        gains.append(float(sums @ inverse @ sums))
    best = int(np.argmax(gains))
    one = dependence_of(training, fitted, bench, what, np.zeros(2), every[best])
    if one is None:
        return None
    return Tried(repeats(one[0], 1.0 / float(numbers[best])), every[best], tuple(tried))
