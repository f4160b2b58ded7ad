"""Where in state space a residual depends on something: channel by channel, variable by variable.

A residual is regressed on smooth functions of every variable of the contract (straight pieces
between quantiles), alone and, for forces, times the direction of motion, for flows times the
valve's signal. What counts is what such functions explain beyond a refit of the base, against
what they explain by chance under sign flips of whole blocks.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from hydro_ident.estimate.chambers import INVERSE_BULK
from hydro_ident.estimate.rows import BoolArray
from hydro_ident.mismatch.bench import Bench
from hydro_ident.mismatch.fitting import Fitted, Training, layout_of
from hydro_ident.mismatch.periodic import VARIABLES, Lines
from hydro_ident.mismatch.scoring import signs
from hydro_ident.mismatch.state_space import SIGNALS, factor_of, hats, knots_of, row_values
from hydro_ident.mismatch.whitening import Noise
from hydro_model.robot import FloatArray

#: Knots of the functions, at quantiles of the variable.
KNOTS = 9
#: Rows by which a variable is looked at later, and the value from which it is worth looking.
_AHEAD, _NOTABLE = (2, 3, 5), 3.0
#: Directions of functions below this share of the strongest are not told.
_RANK = 1.0e-4
#: Variable, factor, knots and columns (N, m).
_Function = tuple[str, str, FloatArray, FloatArray]


@dataclass(frozen=True, slots=True)
class Dependence:
    """How a channel's residual depends on a variable.

    Attributes
    ----------
    channel : int
    variable : str
    times : str
        What the function is multiplied by: empty, `direction` or `valve_signal`.
    gain : float
        Reduction of the sum of squares, in units of the noise's variance.
    freedom : int
        Coefficients that it took.
    value : float
        The gain in deviations of what so many coefficients gain of white noise.
    p_value : float
        Over all channels and variables.
    share : float
        Of the residual's variance, on the rows fitted.
    size : float
        Rms of the function on these rows, in the channel's unit.
    knots, curve : (m,) array
        The function, less its mean; of one that repeats, a period of it.
    coefficients : (k,) array
        Of the straight pieces at the knots; of cosine and sine.
    period : float
        After which it repeats; 0 where it does not.
    """

    channel: int
    variable: str
    times: str
    gain: float
    freedom: int
    value: float
    p_value: float
    share: float
    size: float
    knots: FloatArray
    curve: FloatArray
    coefficients: FloatArray
    period: float = 0.0


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
    found: list[Dependence] = []
    chances: list[FloatArray] = []
    lines: list[Dependence] = []
    answered = set[tuple[int, str, str]]()
    for channel in range(len(training.predictor.material.channels)):
        first = len(found)
        sums: list[tuple[FloatArray, FloatArray]] = []
        own, bench = alone(training, fitted, channel)
        if bench is None:
            continue
        functions = _functions(own, fitted, channel)
        for variable, times, knots, columns in functions:
            what = channel, variable, times
            one = _dependence(own, fitted, bench, what, knots, columns)
            if one is not None:
                if variable != "time" and _answered(own, bench, one[0], columns):
                    answered.add((channel, variable, times))
                found.append(one[0])
                sums.append(one[1])
        if first == len(found):
            continue
        left = _without(own, bench, functions, found[first:])
        flips = signs(bench.blocks)
        for white, inverse in sums:
            drawn = flips @ bench.by_block(white * left[:, None])
            gains = np.einsum("fi,ij,fj->f", drawn, inverse, drawn)
            count = round(float(np.trace(inverse @ (white.T @ white))))
            chances.append((gains - count) / np.sqrt(2.0 * count))
        lines += _lines(own, fitted, channel, functions)
    if not found:
        return []
    chance = np.max(chances, axis=0)
    result = [
        replace(d, p_value=float((1 + np.sum(chance >= d.value)) / (1 + chance.size)))
        for d in found
        if (d.channel, d.variable, d.times) not in answered
    ]
    tried = max(len(lines), 1)
    result += [replace(d, p_value=min(1.0, d.p_value * tried)) for d in lines]
    return sorted(result, key=lambda d: -d.value)


def _answered(training: Training, bench: Bench, found: Dependence, columns: FloatArray) -> bool:
    """Whether it is rather the variable that answers to the residual: through a feedback loop.

    What a controller or the machine itself makes of a disturbance comes after it: the same
    function of the variable a little later explains more of the residual than now.
    """
    if found.value < _NOTABLE:
        return False
    seen, ahead = columns[training.mask], np.zeros_like(columns)
    for rows in _AHEAD:
        ahead[training.mask] = np.roll(seen, -rows, axis=0)
        white = bench.beyond(ahead[training.mask])
        _, inverse = _inverse(white.T @ white)
        sums = white.T @ bench.residual
        if float(sums @ inverse @ sums) > found.gain:
            return True
    return False


def _inverse(gram: FloatArray) -> tuple[int, FloatArray]:
    """Rank and pseudo-inverse of a Gram matrix, directions that columns hardly have left out."""
    values, vectors = np.linalg.eigh(gram)
    kept = values > _RANK * max(float(values[-1]), 1e-300)
    if values[-1] <= 0.0:
        return 0, np.zeros_like(gram)
    return int(kept.sum()), (vectors[:, kept] / values[kept]) @ vectors[:, kept].T


def _lines(
    training: Training,
    fitted: Fitted,
    channel: int,
    functions: Sequence[_Function],
) -> list[Dependence]:
    """The strongest line of a channel over every variable, each with its own p-value.

    The rows are not whitened: a strong line is what their autoregression would take away first.
    """
    mask, found = training.mask, []
    noise = whitened_alike(training, fitted)
    bench = training.bench(noise, fitted.residual, fitted.columns, fitted.offset)
    for variable, times, _, pieces in functions:
        if variable not in VARIABLES:
            continue
        values = row_values(training.predictor, fitted.model, channel, variable)
        # Straight pieces add up to one: their sum is the factor.
        factor = pieces.sum(axis=1)
        lines = Lines.of(bench, values[mask], factor[mask])
        if lines is None:
            continue
        what = channel, variable, times
        tried = [
            _line(training, fitted, lines, what, (np.where(mask, values, 0.0), factor), number)
            for number in lines.strongest()
        ]
        found += sorted((d for d in tried if d is not None), key=lambda d: -d.value)[:1]
    return found


def whitened_alike(training: Training, fitted: Fitted) -> Noise:
    """Independent noise of the size of each channel's residual on the training rows."""
    channel = training.predictor.material.channel[training.mask]
    residual = fitted.residual[training.mask]
    std = training.floor.copy()
    for k in np.unique(channel):
        std[k] = max(float(std[k]), float(np.std(residual[channel == k])))
    return Noise(tuple(np.zeros(0) for _ in std), std)


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
    one = _dependence(training, fitted, bench, what, np.zeros(2), columns)
    if one is None:
        return None
    white, inverse = one[1]
    theta = inverse @ (white.T @ bench.residual)
    p = lines.p_value(number, bench.residual - white @ theta)
    knots = np.linspace(0.0, period, KNOTS)
    curve = waves(knots / period) @ theta
    return replace(one[0], p_value=p, knots=knots, curve=curve, period=period)


def waves(turns: FloatArray) -> FloatArray:
    """Cosine and sine of so many turns, (N, 2)."""
    return np.stack([np.cos(2.0 * np.pi * turns), np.sin(2.0 * np.pi * turns)], axis=1)


def alone(training: Training, fitted: Fitted, channel: int) -> tuple[Training, Bench | None]:
    """Training rows of one channel, and their bench: the base is refitted to them alone.

    Parameters are shared between channels. What one channel's misfit does to another through
    them is no dependence of the other's.
    """
    mask = training.mask & (training.predictor.material.channel == channel)
    own = replace(training, mask=mask, layout=layout_of(training.predictor).take(mask))
    if np.count_nonzero(mask) <= fitted.columns.shape[1]:
        return own, None
    noise = fitted.bench.noise
    return own, own.bench(noise, fitted.residual, fitted.columns, fitted.offset)


def _functions(training: Training, fitted: Fitted, channel: int) -> list[_Function]:
    """Variable, factor, knots and columns (N, m) of every smooth function of a channel."""
    predictor = training.predictor
    material = predictor.material
    own = (material.channel == channel) & training.mask
    values = values_of(training, fitted, channel)
    factor, kind = factor_of(predictor, channel, values, own)
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
        if np.isfinite(factor[own]).all():
            result.append((name, kind, knots, columns * np.where(own, factor, 0.0)[:, None]))
    return result


def values_of(training: Training, fitted: Fitted, channel: int) -> dict[str, FloatArray]:
    """Every variable of a channel on the rows, (N,) each, free of the channel's own noise."""
    predictor = training.predictor
    values = {name: row_values(predictor, fitted.model, channel, name) for name in SIGNALS}
    return values | _undisturbed(training, fitted, channel, values)


def _undisturbed(
    training: Training, fitted: Fitted, channel: int, values: Mapping[str, FloatArray]
) -> dict[str, FloatArray]:
    """Variables that answer to a channel's own noise, as the model has them.

    A piston moves with whatever flow the valve adds by chance, and a measured force holds the
    noise of its transducers: held against either, a residual of mere noise would depend on it.
    """
    predictor = training.predictor
    material, residual = predictor.material, fitted.residual
    y, x = predictor.base(fitted.model)
    if not material.is_flow(channel):
        joint = material.robot.joint_names[material.joint_of(channel)]
        wet = [c for c in material.robot.cylinders if c.joint == joint]
        if not wet or material.forces.torque:
            return {"piston_force": y - residual}
        a, b = wet[0].area_a_m2, wet[0].area_b_m2
        share = residual / (a * a + b * b)
        return {
            "piston_force": y - residual,
            "pressure_a": values["pressure_a"] - a * share,
            "pressure_b": values["pressure_b"] + b * share,
        }
    chamber = material.chambers[material.chamber_index(channel)]
    bulk = predictor.names.index(f"{chamber.cylinder.name}.{INVERSE_BULK}")
    squeezed = x[:, bulk] * predictor.parameters(fitted.model)[bulk]
    cylinder = chamber.cylinder
    area = cylinder.area_a_m2 if chamber.side == "a" else -cylinder.area_b_m2
    return {"piston_velocity": (y - residual - squeezed) / area}


def _dependence(
    training: Training,
    fitted: Fitted,
    bench: Bench,
    what: tuple[int, str, str],
    knots: FloatArray,
    columns: FloatArray,
) -> tuple[Dependence, tuple[FloatArray, FloatArray]] | None:
    channel, variable, times = what
    mask = training.mask
    white = bench.beyond(columns[mask])
    freedom, inverse = _inverse(white.T @ white)
    if not freedom:
        return None
    sums = white.T @ bench.residual
    theta = inverse @ sums
    gain = float(sums @ theta)
    own = (training.predictor.material.channel == channel) & mask
    function = _raw(bench, fitted, columns, theta, mask, channel)
    residual = fitted.residual[own]
    before = float(np.mean(residual**2))
    after = float(np.mean((residual - function) ** 2))
    found = Dependence(
        channel, variable, times, gain, freedom, (gain - freedom) / np.sqrt(2.0 * freedom), 1.0,
        max(0.0, 1.0 - after / before) if before > 0.0 else 0.0,
        float(np.sqrt(np.mean(function**2))), knots, theta - theta.mean(), theta,
    )  # fmt: skip
    return found, (white, inverse)


def _raw(
    bench: Bench,
    fitted: Fitted,
    columns: FloatArray,
    theta: FloatArray,
    mask: BoolArray,
    channel: int,
) -> FloatArray:
    """What the function adds to a channel's rows once the base is refitted around it."""
    fresh = columns @ theta
    moved = bench.refit(fresh[mask])
    whole = fresh - fitted.columns @ moved
    rows = bench.layout.channel == channel
    return np.asarray(whole[mask][rows])


def _without(
    training: Training,
    bench: Bench,
    functions: Sequence[_Function],
    found: Sequence[Dependence],
) -> FloatArray:
    """The whitened residual without a channel's strongest dependence."""
    best = max(found, key=lambda d: d.value)
    for variable, times, _, columns in functions:
        if (variable, times) == (best.variable, best.times):
            white = bench.beyond(columns[training.mask])
            theta = np.linalg.lstsq(white, bench.residual, rcond=1e-2)[0]
            return np.asarray(bench.residual - white @ theta)
    return bench.residual
