"""Lines as dependences: what repeats over time, over the joint's angle or over the stroke."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from hydro_ident.mismatch.fitting.fitted import Fitted
from hydro_ident.mismatch.fitting.training import Training
from hydro_ident.mismatch.fitting.whitening import Noise
from hydro_ident.mismatch.locating.dependence import Dependence, dependence_of
from hydro_ident.mismatch.locating.periodic import VARIABLES, Lines
from hydro_ident.mismatch.rows.state_space import row_values
from hydro_model.arrays import IndexArray
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
        # Each recording has its own time: nothing says when in it something swings to and fro.
        apart = training.layout.recording if variable == "time" else None
        lines = Lines.of(bench, values[mask], factor[mask], apart)
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
    recording = training.predictor.material.recording
    groups = np.unique(recording[training.mask]) if len(lines.apart) > 1 else np.zeros(0, int)
    each = [columns * (recording == r)[:, None] for r in groups] or [columns]
    pairs = np.concatenate(each, axis=1)
    found = dependence_of(training, fitted, bench, what, np.zeros(2), pairs)
    if found is None:
        return None
    one, (white, inverse, _) = found
    p = lines.p_value(number, bench.residual - white @ (inverse @ (white.T @ bench.residual)))
    if groups.size:
        lags = _lags(one.coefficients, period, groups, recording)
        columns = waves((values + lags[recording]) / period) * factor[:, None]
        found = dependence_of(training, fitted, bench, what, np.zeros(2), columns)
        if found is None:
            return None
        # One size, and a phase in each recording.
        freedom = groups.size + 1
        value = (found[0].gain - freedom) / np.sqrt(2.0 * freedom)
        one = replace(found[0], freedom=freedom, value=value, lags=lags)
    return replace(repeats(one, period), p_value=p)


def _lags(
    theta: FloatArray, period: float, groups: IndexArray, recording: IndexArray
) -> FloatArray:
    """What brings a wave to the phase of the first of some recordings, for all of them, (R,).

    Parameters
    ----------
    theta : (2 k,) array
        Of cosine and sine in each of the groups.
    period : float
    groups : (k,) int array
        Recordings that have the wave.
    recording : (N,) int array
    """
    phase = np.arctan2(theta[1::2], theta[::2])
    lags = np.zeros(int(recording.max()) + 1)
    lags[groups] = (phase[0] - phase) / (2.0 * np.pi) * period
    return lags


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
