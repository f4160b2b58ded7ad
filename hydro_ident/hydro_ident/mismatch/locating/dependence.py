"""How a channel's residual depends on a variable, behind a refit of that channel alone."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from hydro_ident.estimate.flows.chambers import INVERSE_BULK
from hydro_ident.mismatch.fitting.bench import Bench
from hydro_ident.mismatch.fitting.fitted import Fitted
from hydro_ident.mismatch.fitting.training import Training, layout_of
from hydro_ident.mismatch.rows.state_space import SIGNALS, row_values
from hydro_model.arrays import BoolArray, IndexArray
from hydro_model.robot import FloatArray

#: Variable, factor, knots and columns (N, m).
Function = tuple[str, str, FloatArray, FloatArray]
#: Directions of functions below this share of the strongest are not told.
_RANK = 1.0e-4


@dataclass(frozen=True, slots=True)
class Dependence:
    """How a channel's residual depends on a variable.

    Attributes
    ----------
    channel : int
        By the channels of the rows that it was found on.
    name : str
        The channel's: other rows of the same recordings may lack some.
    variable : str
    times : str
        What the function is multiplied by: empty, `direction`, `valve_signal`, `compression`,
        `velocity` or `velocity_squared`.
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
    lags : (R,) array
        What the variable is ahead by in each recording, so that a wave over time has one phase in
        all; empty where it has.
    """

    channel: int
    name: str
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
    lags: FloatArray = field(default_factory=lambda: np.zeros(0))

    def along(self, at: FloatArray, recording: IndexArray) -> FloatArray:
        """Where along the function, or its wave, rows are.

        Parameters
        ----------
        at : (n,) array
            The variable.
        recording : (n,) int array
        """
        return at + self.lags[recording] if self.lags.size else at


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


def values_of(training: Training, fitted: Fitted, channel: int) -> dict[str, FloatArray]:
    """Every variable of a channel on the rows, (N,) each, free of the channel's own noise.

    No flow depends on an acceleration; a piston's is what the valve's chance flow makes of it.
    Within a recording the oil's temperature goes with time, which is looked at.
    """
    predictor = training.predictor
    flow = predictor.material.is_flow(channel)
    left_out = {"oil_temperature", *(("piston_acceleration",) if flow else ())}
    names = [name for name in SIGNALS if name not in left_out]
    values = {name: row_values(predictor, fitted.model, channel, name) for name in names}
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


class Whitened(NamedTuple):
    """Whitened columns of a function beyond the base.

    Attributes
    ----------
    columns : (M, m) array
    inverse : (m, m) array
        Pseudo-inverse of their products.
    freedom : int
        Its rank.
    """

    columns: FloatArray
    inverse: FloatArray
    freedom: int


def dependence_of(
    training: Training,
    fitted: Fitted,
    bench: Bench,
    what: tuple[int, str, str],
    knots: FloatArray,
    columns: FloatArray,
) -> tuple[Dependence, Whitened] | None:
    """A function of given columns (N, m) as a dependence, and its whitened columns.

    Parameters
    ----------
    training : Training
        Of the channel's rows.
    fitted : Fitted
    bench : Bench
        Of these rows.
    what : tuple
        Channel, variable and factor.
    knots : (m,) array
    columns : (N, m) array

    Returns
    -------
    tuple or None
        None where a refit of the base swallows the columns.
    """
    channel, variable, times = what
    mask = training.mask
    white = bench.beyond(columns[mask])
    freedom, inverse = inverse_of(white.T @ white)
    if not freedom:
        return None
    sums = white.T @ bench.residual
    theta = inverse @ sums
    gain = float(sums @ theta)
    own = (training.predictor.material.channel == channel) & mask
    function = beyond_base(bench, fitted, columns @ theta, mask)[own[mask]]
    residual = fitted.residual[own]
    before = float(np.mean(residual**2))
    after = float(np.mean((residual - function) ** 2))
    name = training.predictor.material.channels[channel]
    found = Dependence(
        channel, name, variable, times, gain, freedom,
        (gain - freedom) / np.sqrt(2.0 * freedom), 1.0,
        max(0.0, 1.0 - after / before) if before > 0.0 else 0.0,
        float(np.sqrt(np.mean(function**2))), knots, theta - theta.mean(), theta,
    )  # fmt: skip
    return found, Whitened(white, inverse, freedom)


def beyond_base(bench: Bench, fitted: Fitted, function: FloatArray, mask: BoolArray) -> FloatArray:
    """What a function (N,) adds to the rows once the base is refitted around it.

    Parameters
    ----------
    bench : Bench
        Of the rows in the mask.
    fitted : Fitted
    function : (N,) array
    mask : (N,) bool array

    Returns
    -------
    (M,) array
        On the rows in the mask.
    """
    moved = bench.refit(function[mask])
    return np.asarray(function[mask] - fitted.columns[mask] @ moved)


def inverse_of(gram: FloatArray) -> tuple[int, FloatArray]:
    """Rank and pseudo-inverse of a Gram matrix, directions that columns hardly have left out."""
    values, vectors = np.linalg.eigh(gram)
    kept = values > _RANK * max(float(values[-1]), 1e-300)
    if values[-1] <= 0.0:
        return 0, np.zeros_like(gram)
    return int(kept.sum()), (vectors[:, kept] / values[kept]) @ vectors[:, kept].T
