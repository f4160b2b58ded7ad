"""State space on the rows: variables of a channel, and smooth functions of them."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.linalg import qr

from hydro_ident.estimate.flows.chambers import INVERSE_BULK
from hydro_ident.mismatch.rows.material import Stretch
from hydro_ident.mismatch.rows.prediction import Model, Predictor
from hydro_model.arrays import BoolArray
from hydro_model.effects import signals as sig
from hydro_model.robot import FloatArray

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
    "oil_temperature": sig.OIL_TEMPERATURE,
}
#: Of a cylinder and its turning joint; `channel_words` has those in a channel.
UNITS = {
    "piston_velocity": "m/s", "piston_position": "m", "piston_acceleration": "m/s^2",
    "piston_force": "N", "joint_angle": "rad", "pressure_a": "Pa", "pressure_b": "Pa",
    "supply_pressure": "Pa", "valve_signal": "1", "valve_rate": "1/s", "other_joint": "rad/s",
    "total_flow": "m^3/s", "oil_temperature": "deg C", "time": "s", "everywhere": "",
}  # fmt: skip
#: What a reading that is off by a function of the position does to the piston's velocity in a
#: flow, and to its acceleration in a force.
OF_READINGS = ("velocity", "velocity_squared")
#: Speed over which a direction is rounded, as a share of its usual size.
_ROUNDED = 0.05
#: Knots of the functions that noise is told from, and the variables they are of: alone and times
#: the channel's factor, and times it only where the variable holds the channel's own noise.
NUISANCE_KNOTS = 7
_OF_FORCES = ("piston_velocity", "piston_position", "piston_acceleration", "other_joint", "time")
_OF_FLOWS = ("valve_signal", "piston_position", "pressure_a", "pressure_b", "valve_rate", "time")
_TIMES_DIRECTION = ("pressure_a", "pressure_b", "piston_force")
#: Directions of functions below this share of the largest are the same as others.
_RANK = 1.0e-4
#: Functions take no more than one direction per so many rows.
_ROWS_EACH = 4


def row_values(predictor: Predictor, model: Model, channel: int, variable: str) -> FloatArray:
    """A variable of a channel's cylinder (or joint) on the channel's rows; NaN elsewhere."""
    material = predictor.material
    result = np.full(material.size, np.nan)
    for place in material.of_channels([channel]):
        stretch = predictor.signals.readings.stretches(model)[place.stretch]
        rows = _signals(predictor, model, stretch, channel)[:, SIGNALS[variable]]
        result[place.rows] = material.on_rows(stretch, channel, rows)
    return result


def factors_of(
    predictor: Predictor,
    model: Model,
    channel: int,
    values: Mapping[str, FloatArray],
    own: BoolArray,
    sizes: Mapping[str, float] | None = None,
) -> dict[str, FloatArray]:
    """What functions of a channel are multiplied by, (N,) each, by name.

    The direction of motion for forces; for flows the valve's signal, and the compression of the
    chamber at a unit modulus; and what a position that is read wrongly does to a balance
    (`OF_READINGS`). They are in units of `sizes`, by default those of the own rows.
    """
    sizes = sizes or factor_sizes(predictor, model, channel, values, own)
    found = _factors(predictor, model, channel, values)
    scaled = {name: f / sizes[name] for name, f in found.items() if name in sizes}
    if predictor.material.is_flow(channel):
        return scaled
    rounded = np.tanh(values["piston_velocity"] / rounding(sizes["direction"]))
    return scaled | {"direction": rounded}


def factor_sizes(
    predictor: Predictor,
    model: Model,
    channel: int,
    values: Mapping[str, FloatArray],
    own: BoolArray,
) -> dict[str, float]:
    """Usual sizes of a channel's factors on its own rows; of a direction, that of the speed."""
    found = _factors(predictor, model, channel, values)
    # What was not recorded has no size, and is told nowhere.
    known = {name: f[own][np.isfinite(f[own])] for name, f in found.items()}
    return {name: (float(np.std(f)) if f.size else 0.0) or 1.0 for name, f in known.items()}


def rounding(speed: float) -> float:
    """Speed over which a direction is rounded, of a usual speed."""
    return _ROUNDED * speed


def _factors(
    predictor: Predictor, model: Model, channel: int, values: Mapping[str, FloatArray]
) -> dict[str, FloatArray]:
    """A channel's factors in their own units; of the direction, the velocity."""
    velocity = values["piston_velocity"]
    if not predictor.material.is_flow(channel):
        return {"direction": velocity, "velocity_squared": velocity**2}
    return {
        "valve_signal": values["valve_signal"],
        "compression": compression(predictor, model, channel),
        "velocity": velocity,
    }


def compression(predictor: Predictor, model: Model, channel: int) -> FloatArray:
    """Base column of a flow channel's inverse bulk modulus, (N,)."""
    material = predictor.material
    cylinder = material.chambers[material.chamber_index(channel)].cylinder
    _, x = predictor.base(model)
    return x[:, predictor.names.index(f"{cylinder.name}.{INVERSE_BULK}")]


def knots_of(seen: FloatArray, count: int) -> FloatArray:
    """Knots at quantiles of a variable, each once."""
    return np.unique(np.quantile(seen, np.linspace(0.0, 1.0, count)))


def hats(seen: FloatArray, knots: FloatArray) -> FloatArray:
    """Straight pieces between knots: (M, m), rows sum to one."""
    return np.stack([np.interp(seen, knots, unit) for unit in np.eye(knots.size)], axis=1)


def smooth_basis(predictor: Predictor, model: Model, channel: int, own: BoolArray) -> FloatArray:
    """Orthonormal directions of smooth functions of a channel's state, (M, k).

    Parameters
    ----------
    predictor : Predictor
    model : Model
    channel : int
    own : (N,) bool array
        The M rows of the channel.
    """
    if not own.any():
        return np.zeros((0, 0))
    flow = predictor.material.is_flow(channel)
    plain = _OF_FLOWS if flow else _OF_FORCES
    times = plain if flow else (*plain, *_TIMES_DIRECTION)
    names = {*plain, *times, "piston_velocity", "valve_signal"}
    values = {name: row_values(predictor, model, channel, name) for name in names}
    factor = next(iter(factors_of(predictor, model, channel, values, own).values()))
    columns = [np.ones((int(own.sum()), 1))]
    for name in (n for n in dict.fromkeys((*plain, *times)) if np.isfinite(values[n][own]).all()):
        knots = knots_of(values[name][own], NUISANCE_KNOTS)
        if knots.size < 3:
            continue
        pieces = hats(values[name][own], knots)
        columns += [pieces] if name in plain else []
        if name in times and np.isfinite(factor[own]).all():
            columns.append(pieces * factor[own][:, None])
    q, r, _ = qr(np.concatenate(columns, axis=1), mode="economic", pivoting=True)
    size = np.abs(np.diag(r))
    rank = int(np.sum(size > _RANK * max(float(size[0]), 1e-300))) if size.size else 0
    return np.ascontiguousarray(q[:, : min(rank, int(own.sum()) // _ROWS_EACH)])


def _signals(predictor: Predictor, model: Model, stretch: Stretch, channel: int) -> FloatArray:
    material = predictor.material
    joint = material.robot.joint_names[material.joint_of(channel)]
    wet = [i for i, c in enumerate(material.robot.cylinders) if c.joint == joint]
    if wet and not (material.forces.torque and not material.is_flow(channel)):
        return predictor.signals.wet(model, stretch, wet[0])
    return predictor.signals.dry(stretch, material.joint_of(channel))
