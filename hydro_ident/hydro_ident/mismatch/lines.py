"""Lines as dependences: what repeats over time, over the joint's angle or over the stroke."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from hydro_ident.mismatch.dependence import Dependence, dependence_of
from hydro_ident.mismatch.fitting import Fitted
from hydro_ident.mismatch.periodic import VARIABLES, Lines
from hydro_ident.mismatch.state_space import row_values
from hydro_ident.mismatch.training import Training
from hydro_ident.mismatch.whitening import Noise
from hydro_model.robot import FloatArray

#: A variable, the factor's name and its values (N,), 0 on other rows.
Repeatable = tuple[str, str, FloatArray]
#: Rows that carry a line: where a few do, its neighbours are no measure of chance.
LEAST_ROWS = 400.0
#: Points of a period that are given.
_POINTS = 9


def lines_of(
    training: Training,
    fitted: Fitted,
    channel: int,
    repeatable: Sequence[Repeatable],
) -> list[Dependence]:
    """The strongest line of a channel over every variable, each with its own p-value.

    The rows are not whitened: a strong line is what their autoregression would take away first.

    Parameters
    ----------
    training : Training
    fitted : Fitted
    channel : int
    repeatable : sequence of Repeatable

    Returns
    -------
    list of Dependence
        At most one for each.
    """
    mask, found = training.mask, []
    noise = independent_noise(training, fitted)
    bench = training.bench(noise, fitted.residual, fitted.columns, fitted.offset)
    for variable, times, factor in repeatable:
        if variable not in VARIABLES:
            continue
        values = row_values(training.predictor, fitted.model, channel, variable)
        lines = Lines.of(bench, values[mask], factor[mask])
        if lines is None or _worth(factor[mask]) < LEAST_ROWS:
            continue
        what = channel, variable, times
        tried = [
            _line(training, fitted, lines, what, (np.where(mask, values, 0.0), factor), number)
            for number in lines.strongest()
        ]
        found += sorted((d for d in tried if d is not None), key=lambda d: -d.value)[:1]
    return found


def _worth(factor: FloatArray) -> float:
    """How many rows of one size a factor is worth."""
    squares = factor**2
    total = float(np.sum(squares**2))
    return float(np.sum(squares)) ** 2 / total if total > 0.0 else 0.0


def _line(
    training: Training,
    fitted: Fitted,
    lines: Lines,
    what: tuple[int, str, str],
    over: tuple[FloatArray, FloatArray],
    number: int,
) -> Dependence | None:
    """A line of a wave number as a dependence."""
    bench, (values, factor) = lines.bench, over
    period = 1.0 / float(lines.numbers[number])
    columns = waves(values / period) * factor[:, None]
    one = dependence_of(training, fitted, bench, what, np.zeros(2), columns)
    if one is None:
        return None
    white, inverse, _ = one[1]
    theta = inverse @ (white.T @ bench.residual)
    p = lines.p_value(number, bench.residual - white @ theta)
    return replace(repeats(one[0], period), p_value=p)


def repeats(one: Dependence, period: float) -> Dependence:
    """A dependence on cosine and sine as what it is: a curve over a period."""
    knots = np.linspace(0.0, period, _POINTS)
    return replace(one, knots=knots, curve=waves(knots / period) @ one.coefficients, period=period)


def waves(turns: FloatArray) -> FloatArray:
    """Cosine and sine of so many turns, (N, 2)."""
    return np.stack([np.cos(2.0 * np.pi * turns), np.sin(2.0 * np.pi * turns)], axis=1)


def independent_noise(training: Training, fitted: Fitted) -> Noise:
    """Independent noise of the size of each channel's residual on the training rows."""
    channel = training.predictor.material.channel[training.mask]
    residual = fitted.residual[training.mask]
    std = training.floor.copy()
    for k in np.unique(channel):
        std[k] = max(float(std[k]), float(np.std(residual[channel == k])))
    return Noise(tuple(np.zeros(0) for _ in std), std)
