"""Where in state space a residual depends on something: channel by channel, variable by variable.

A residual is regressed on smooth functions of every variable of the contract (straight pieces
between quantiles), alone and, for forces, times the direction of motion, for flows times the
valve's signal. What counts is what such functions explain beyond a refit of the base, against
what they explain by chance under sign flips of whole blocks.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hydro_ident.estimate.rows import BoolArray
from hydro_ident.mismatch.bench import Bench
from hydro_ident.mismatch.fitting import Fitted, Training
from hydro_ident.mismatch.material import Material, Stretch
from hydro_ident.mismatch.prediction import Predictor
from hydro_ident.mismatch.scoring import signs
from hydro_model import signals as sig
from hydro_model.robot import FloatArray

#: Knots of the functions, at quantiles of the variable.
KNOTS = 9
#: Variables by signal of the channel's own cylinder.
SIGNALS = {
    "piston_velocity": sig.PISTON_VELOCITY,
    "piston_position": sig.PISTON_POSITION,
    "piston_acceleration": sig.PISTON_ACCELERATION,
    "piston_force": sig.PISTON_FORCE,
    "joint_angle": sig.JOINT_POSITION,
    "pressure_a": sig.PRESSURE_A,
    "pressure_b": sig.PRESSURE_B,
    "supply_pressure": sig.SUPPLY_PRESSURE,
    "valve_signal": sig.VALVE_SIGNAL,
    "valve_rate": sig.VALVE_RATE,
    "other_joint": sig.OTHER_VELOCITY,
    "time": sig.TIME,
}
UNITS = {
    "piston_velocity": "m/s", "piston_position": "m", "piston_acceleration": "m/s^2",
    "piston_force": "N", "joint_angle": "rad", "pressure_a": "Pa", "pressure_b": "Pa",
    "supply_pressure": "Pa", "valve_signal": "1", "valve_rate": "1/s", "other_joint": "rad/s",
    "total_flow": "m^3/s", "oil_temperature": "deg C", "time": "s", "everywhere": "",
}  # fmt: skip
#: Speed and signal over which a direction is rounded, as shares of their usual size.
_ROUNDED = 0.05


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
        The function, less its mean.
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


def row_values(predictor: Predictor, fitted: Fitted, channel: int, signal: int) -> FloatArray:
    """A signal of a channel's cylinder (or joint) on the channel's rows; NaN elsewhere."""
    material = predictor.material
    result = np.full(material.size, np.nan)
    for place in material.of_channels([channel]):
        stretch = predictor.signals.stretches(fitted.model)[place.stretch]
        rows = _signals(predictor, fitted, stretch, channel)[:, signal]
        result[place.rows] = _on_rows(material, stretch, channel, rows)
    return result


def _signals(predictor: Predictor, fitted: Fitted, stretch: Stretch, channel: int) -> FloatArray:
    material = predictor.material
    joint = material.robot.joint_names[material.joint_of(channel)]
    wet = [i for i, c in enumerate(material.robot.cylinders) if c.joint == joint]
    if wet and not (material.forces.torque and not material.is_flow(channel)):
        return predictor.signals.wet(fitted.model, stretch, wet[0])
    return predictor.signals.dry(stretch, material.joint_of(channel))


def _on_rows(material: Material, stretch: Stretch, channel: int, values: FloatArray) -> FloatArray:
    if not material.is_flow(channel):
        return values[stretch.kept]
    start = stretch.starts[material.chamber_index(channel)]
    return np.asarray(values[start + stretch.span // 2])


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
    bench = fitted.bench
    flips = signs(bench.blocks)
    for channel in range(len(training.predictor.material.channels)):
        first = len(found)
        sums: list[tuple[FloatArray, FloatArray]] = []
        for variable, times, knots, columns in _functions(training, fitted, channel):
            one = _dependence(training, fitted, (channel, variable, times), knots, columns)
            if one is not None:
                found.append(one[0])
                sums.append(one[1])
        if first == len(found):
            continue
        left = _without(training, fitted, channel, found[first:])
        for white, inverse in sums:
            drawn = flips @ bench.by_block(white * left[:, None])
            gains = np.einsum("fi,ij,fj->f", drawn, inverse, drawn)
            count = round(float(np.trace(inverse @ (white.T @ white))))
            chances.append((gains - count) / np.sqrt(2.0 * count))
    if not found:
        return []
    chance = np.max(chances, axis=0)
    result = [
        Dependence(
            d.channel, d.variable, d.times, d.gain, d.freedom, d.value,
            float((1 + np.sum(chance >= d.value)) / (1 + chance.size)),
            d.share, d.size, d.knots, d.curve,
        )
        for d in found
    ]  # fmt: skip
    return sorted(result, key=lambda d: -d.value)


def _functions(
    training: Training, fitted: Fitted, channel: int
) -> list[tuple[str, str, FloatArray, FloatArray]]:
    """Variable, factor, knots and columns (N, m) of every smooth function of a channel."""
    predictor = training.predictor
    material = predictor.material
    own = (material.channel == channel) & training.mask
    values = {
        name: row_values(predictor, fitted, channel, index) for name, index in SIGNALS.items()
    }
    if not material.is_flow(channel):
        # The residual is part of the measured force: against that, it would follow itself.
        values["piston_force"] = values["piston_force"] - fitted.residual
        values["pressure_a"] = values["pressure_a"] - fitted.residual / _area_a(material, channel)
    factor = values["valve_signal" if material.is_flow(channel) else "piston_velocity"]
    kind = "valve_signal" if material.is_flow(channel) else "direction"
    usual = float(np.nanstd(factor[own])) or 1.0
    rounded = np.tanh(factor / (_ROUNDED * usual)) if kind == "direction" else factor / usual
    result = []
    for name, column in values.items():
        seen = column[own]
        if not np.isfinite(seen).all() or np.ptp(seen) <= 0.0:
            continue
        knots = np.unique(np.quantile(seen, np.linspace(0.0, 1.0, KNOTS)))
        if knots.size < 3:
            continue
        hats = np.zeros((material.size, knots.size))
        hats[own] = _hats(seen, knots)
        result.append((name, "", knots, hats))
        if np.isfinite(rounded[own]).all():
            result.append((name, kind, knots, hats * np.where(own, rounded, 0.0)[:, None]))
    return result


def _area_a(material: Material, channel: int) -> float:
    """Bore area of the channel's cylinder, m^2; of a joint without one, infinite."""
    joint = material.robot.joint_names[material.joint_of(channel)]
    areas = [c.area_a_m2 for c in material.robot.cylinders if c.joint == joint]
    return areas[0] if areas and not material.forces.torque else np.inf


def _hats(values: FloatArray, knots: FloatArray) -> FloatArray:
    """Straight pieces between knots: (M, m), rows sum to one."""
    return np.stack([np.interp(values, knots, unit) for unit in np.eye(knots.size)], axis=1)


def _dependence(
    training: Training,
    fitted: Fitted,
    what: tuple[int, str, str],
    knots: FloatArray,
    columns: FloatArray,
) -> tuple[Dependence, tuple[FloatArray, FloatArray]] | None:
    channel, variable, times = what
    bench, mask = fitted.bench, training.mask
    white = bench.beyond(columns[mask])
    gram = white.T @ white
    values, vectors = np.linalg.eigh(gram)
    kept = values > 1e-4 * max(float(values[-1]), 1e-300)
    if not kept.any() or values[-1] <= 0.0:
        return None
    inverse = (vectors[:, kept] / values[kept]) @ vectors[:, kept].T
    sums = white.T @ bench.residual
    theta = inverse @ sums
    gain, freedom = float(sums @ theta), int(kept.sum())
    own = (training.predictor.material.channel == channel) & mask
    function = _raw(bench, fitted, columns, theta, mask, channel)
    residual = fitted.residual[own]
    before = float(np.mean(residual**2))
    after = float(np.mean((residual - function) ** 2))
    found = Dependence(
        channel, variable, times, gain, freedom, (gain - freedom) / np.sqrt(2.0 * freedom), 1.0,
        max(0.0, 1.0 - after / before) if before > 0.0 else 0.0,
        float(np.sqrt(np.mean(function**2))), knots, theta - theta.mean(),
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
    training: Training, fitted: Fitted, channel: int, found: list[Dependence]
) -> FloatArray:
    """The whitened residual without a channel's strongest dependence."""
    best = max(found, key=lambda d: d.value)
    for variable, times, _, columns in _functions(training, fitted, channel):
        if (variable, times) == (best.variable, best.times):
            white = fitted.bench.beyond(columns[training.mask])
            theta = np.linalg.lstsq(white, fitted.bench.residual, rcond=1e-2)[0]
            return np.asarray(fitted.bench.residual - white @ theta)
    return fitted.bench.residual
