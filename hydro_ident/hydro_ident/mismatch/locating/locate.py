"""Where in state space a residual depends on something: channel by channel, variable by variable.

A residual is regressed on smooth functions of every variable of the contract (straight pieces
between quantiles), alone and, for forces, times the direction of motion, for flows times the
valve's signal. What counts is what such functions explain beyond a refit of the base, against
what they explain by chance under sign flips of whole blocks.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from hydro_ident.mismatch.fitting.bench import Bench
from hydro_ident.mismatch.fitting.fitted import Fitted
from hydro_ident.mismatch.fitting.training import Training
from hydro_ident.mismatch.locating.dependence import (
    Dependence,
    Function,
    Whitened,
    alone,
    dependence_of,
    inverse_of,
    values_of,
)
from hydro_ident.mismatch.locating.few_periods import POSITIONS, Tried, repeating
from hydro_ident.mismatch.locating.lines import Repeatable, lines_of
from hydro_ident.mismatch.rows.state_space import OF_READINGS, factors_of, hats, knots_of
from hydro_ident.mismatch.settings import FAMILY_ERROR_UNNAMED, LEAST_EFFECTIVE
from hydro_ident.mismatch.trials.chance import p_value, signs
from hydro_model.robot import FloatArray

#: Knots of the functions, at quantiles of the variable.
KNOTS = 9
#: Variables over which the stiffness of a chamber may change.
SOFTENING = ("piston_position", "joint_angle", "pressure_a", "pressure_b", "time")
#: Blocks that flip together where time is the variable.
TIME_BLOCKS = 3
#: Rows by which a variable is looked at later, and the value from which it is worth looking.
_AHEAD, _NOTABLE = (2, 3, 5), 3.0
#: Chance below which what comes later explains more.
_ANSWERED = 0.05


@dataclass(slots=True)
class _Looked:
    """What was looked at: dependence, what so many functions gain by chance, and lines."""

    found: list[Dependence] = field(default_factory=list)
    chances: list[FloatArray] = field(default_factory=list)
    lines: list[Dependence] = field(default_factory=list)
    answered: set[int] = field(default_factory=set)


def dependences(training: Training, fitted: Fitted) -> list[Dependence]:
    """Every channel's dependence on every variable, strongest first.

    Parameters
    ----------
    training : Training
    fitted : Fitted

    Returns
    -------
    list of Dependence
        Those that the recordings can tell at all.
    """
    looked = _Looked()
    for channel in range(len(training.predictor.material.channels)):
        _look(training, fitted, channel, looked)
    if not looked.found:
        return []
    result = _with_chances(looked)
    tried = max(len(looked.lines), 1)
    result += [replace(d, p_value=min(1.0, d.p_value * tried)) for d in looked.lines]
    return sorted(result, key=lambda d: -d.value)


def _with_chances(looked: _Looked) -> list[Dependence]:
    """Dependences with their p-values, over all channels that are no stronger.

    What a strong dependence of one channel leaves there is no measure of chance in another: step
    by step, channels that are told are left out (Westfall and Young, Resampling-based multiple
    testing, Wiley 1993, section 2.6).
    """
    kept = [d for k, d in enumerate(looked.found) if k not in looked.answered]
    channels = sorted({d.channel for d in kept}, key=lambda c: -_strongest(kept, c))
    chances = {
        c: np.max(
            [x for d, x in zip(looked.found, looked.chances, strict=True) if d.channel == c],
            axis=0,
        )
        for c in channels
    }
    result: list[Dependence] = []
    for c in channels:
        chance = np.max(list(chances.values()), axis=0)
        own = [replace(d, p_value=p_value(d.value, chance)) for d in kept if d.channel == c]
        if min(d.p_value for d in own) <= FAMILY_ERROR_UNNAMED and len(chances) > 1:
            del chances[c]
        result += own
    return result


def _strongest(found: Sequence[Dependence], channel: int) -> float:
    return max(d.value for d in found if d.channel == channel)


def _look(training: Training, fitted: Fitted, channel: int, into: _Looked) -> None:
    """Look at one channel."""
    own, bench = alone(training, fitted, channel)
    if bench is None:
        return
    values = values_of(own, fitted, channel)
    factors = factors_of(own.predictor, fitted.model, channel, values, own.mask)
    functions = _functions(own, channel, values, factors)
    tried = [
        one
        for one in _each(own, fitted, bench, channel, functions)
        if _spread(own, bench, one.columns, _together(one.found)) >= LEAST_EFFECTIVE
    ]
    if not tried:
        return
    best = max(tried, key=lambda one: one.found.value)
    left = _without(bench, best.columns[own.mask])
    # No other recording can confirm what follows time: of it, slow noise is no evidence either.
    flips = {together: _flips(bench, together) for together in (1, TIME_BLOCKS)}
    for one in tried:
        if one.found.variable != "time" and _answered(own, bench, one.found, one.columns):
            into.answered.add(len(into.found))
        into.found.append(one.found)
        draws, units = flips[_together(one.found)]
        # What took the best function out took noise out, too.
        lost = np.sqrt(units / max(units - best.found.freedom, 1))
        by_chance = [_by_chance(bench, each, left, lost * draws) for each in one.tried]
        into.chances.append(np.max(by_chance, axis=0))
    into.lines += lines_of(own, fitted, channel, _repeatable(own, functions, factors))


def _each(
    training: Training,
    fitted: Fitted,
    bench: Bench,
    channel: int,
    functions: Sequence[Function],
) -> Iterator[Tried]:
    """Smooth functions of a channel, and waves of a few periods."""
    for variable, times, knots, columns in functions:
        what = channel, variable, times
        one = dependence_of(training, fitted, bench, what, knots, columns)
        if one is not None:
            yield Tried(one[0], columns, (one[1],))
    yield from repeating(training, fitted, bench, channel)


def _together(one: Dependence) -> int:
    """Blocks that flip together for a dependence."""
    return TIME_BLOCKS if one.variable == "time" else 1


def _by_chance(bench: Bench, one: Whitened, left: FloatArray, draws: FloatArray) -> FloatArray:
    """Values of a function of the residual `left` (M,) whose blocks are flipped by `draws`."""
    drawn = draws @ bench.by_block(one.columns * left[:, None])
    gains = np.sum((drawn @ one.inverse) * drawn, axis=1)
    count = max(one.freedom, 1)
    return np.asarray((gains - count) / np.sqrt(2.0 * count))


def _spread(training: Training, bench: Bench, columns: FloatArray, together: int) -> float:
    """In how many blocks, so many flipped together, a function of columns (M, m) shows."""
    return bench.spread(_shown(bench, columns[training.mask]), together)


def _flips(bench: Bench, together: int) -> tuple[FloatArray, int]:
    """Signs of blocks, so many after one another flipped together, and how many there are."""
    groups = -(-bench.blocks // together)
    draws = np.repeat(signs(groups), together, axis=1)[:, : bench.blocks]
    return draws, np.unique(bench.block // together).size


def _answered(training: Training, bench: Bench, found: Dependence, columns: FloatArray) -> bool:
    """Whether it is rather the variable that answers to the residual: through a feedback loop.

    What a controller or the machine itself makes of a disturbance comes after it: the same
    function of the variable a little later explains more of the residual than now, by more than
    sign flips of whole blocks do.
    """
    if found.value < _NOTABLE:
        return False
    flips, _ = _flips(bench, 1)
    now = _explained(bench, columns[training.mask])
    for rows in _AHEAD:
        ahead = _later(training, columns, rows, found.channel)
        better = _explained(bench, ahead[training.mask]) - now
        total = float(better.sum())
        if total > 0.0 and np.mean(flips @ better >= total) <= _ANSWERED:
            return True
    return False


def _explained(bench: Bench, columns: FloatArray) -> FloatArray:
    """What a function of columns (M, m) takes off the sum of squares, by block, (B,)."""
    shown = _shown(bench, columns)
    return bench.by_block((shown * (2.0 * bench.residual - shown))[:, None])[:, 0]


def _shown(bench: Bench, columns: FloatArray) -> FloatArray:
    """What a function of columns (M, m) explains of the whitened residual."""
    white = bench.beyond(columns)
    _, inverse = inverse_of(white.T @ white)
    return np.asarray(white @ (inverse @ (white.T @ bench.residual)))


def _later(training: Training, columns: FloatArray, rows: int, channel: int) -> FloatArray:
    """Columns as they are so many rows later, within each stretch of a channel."""
    result = np.zeros_like(columns)
    for place in training.predictor.material.of_channels([channel]):
        own = columns[place.rows]
        result[place.rows] = np.concatenate([own[rows:], np.repeat(own[-1:], rows, axis=0)])[
            : len(own)
        ]
    return result


def _functions(
    training: Training,
    channel: int,
    values: Mapping[str, FloatArray],
    factors: Mapping[str, FloatArray],
) -> list[Function]:
    """Variable, factor, knots and columns (N, m) of every smooth function of a channel."""
    material = training.predictor.material
    own = (material.channel == channel) & training.mask
    result = []
    for name, column in values.items():
        seen = column[own]
        if not np.isfinite(seen).all() or np.ptp(seen) <= 0.0:
            continue
        knots = knots_of(seen, KNOTS)
        if knots.size < 3:
            continue
        columns = np.zeros((material.size, knots.size))
        columns[own] = hats(seen, knots)
        result.append((name, "", knots, columns))
        for kind, factor in factors.items():
            if kind in OF_READINGS or (kind == "compression" and name not in SOFTENING):
                continue
            if np.isfinite(factor[own]).all():
                result.append((name, kind, knots, columns * np.where(own, factor, 0.0)[:, None]))
    return result


def _repeatable(
    training: Training, functions: Sequence[Function], factors: Mapping[str, FloatArray]
) -> list[Repeatable]:
    """What may repeat: over every variable of a function, and readings over positions."""
    # Straight pieces add up to one: their sum is the factor.
    smooth = [(name, times, pieces.sum(axis=1)) for name, times, _, pieces in functions]
    seen, mask = {name for name, *_ in functions}, training.mask
    readings = [
        (name, times, np.where(mask, factors[times], 0.0))
        for name in POSITIONS
        for times in OF_READINGS
        if name in seen and times in factors and np.isfinite(factors[times][mask]).all()
    ]
    return smooth + readings


def _without(bench: Bench, columns: FloatArray) -> FloatArray:
    """The whitened residual without what columns (M, m) explain of it."""
    white = bench.beyond(columns)
    theta = np.linalg.lstsq(white, bench.residual, rcond=1e-2)[0]
    return np.asarray(bench.residual - white @ theta)
