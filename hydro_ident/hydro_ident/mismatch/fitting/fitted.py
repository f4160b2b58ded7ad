"""A model on the training rows, with what a last linear step would still change taken out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from hydro_ident.mismatch.fitting.bench import Bench
from hydro_ident.mismatch.fitting.slopes import Start, slopes_at, start_at
from hydro_ident.mismatch.fitting.stepping import bounded_columns, listed_columns, said_columns
from hydro_ident.mismatch.fitting.training import Training
from hydro_ident.mismatch.fitting.weighed import Weighed, deviations_of
from hydro_ident.mismatch.fitting.whitening import Noise
from hydro_ident.mismatch.rows.prediction import Model
from hydro_model.arrays import BoolArray
from hydro_model.robot import FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Fitted:
    """A model fitted to the training rows.

    Attributes
    ----------
    model : Model
    residual : (N,) array
        Measured less predicted on all rows of the material.
    columns : (N, p) array
        Base columns, then the slopes of every effect's parameters.
    names : tuple of str
    bench : Bench
        Of the residual on the training rows: behind it nothing is left in these columns.
    offset : (m,) array
        How far the base is from what was known of it, in deviations.
    refined : (p, p) array or None
        Covariance of an output-error refinement, where the model is one's.
    held : tuple of str
        Numbers of the base at a bound: not estimated, whatever the covariance has of them.
    """

    model: Model
    residual: FloatArray
    columns: FloatArray
    names: tuple[str, ...]
    bench: Bench
    offset: FloatArray
    refined: FloatArray | None = None
    held: tuple[str, ...] = ()

    @property
    def covariance(self) -> FloatArray:
        """Covariance of the numbers by `names`, robust against dependence in blocks."""
        return self.bench.covariance if self.refined is None else self.refined

    @property
    def deviations(self) -> dict[str, float]:
        """Standard deviations of the numbers, by `names`."""
        return deviations_of(self.names, self.covariance)

    @property
    def weighed(self) -> Weighed:
        """Its numbers and what it leaves, without its rows."""
        return Weighed(self.model, self.names, self.covariance, self.bench.residual)

    @property
    def start_squares(self) -> float:
        """Sum of squares of the whitened residual before any further linear step."""
        return self.bench.squares

    @property
    def squares(self) -> float:
        """Sum of squares of the whitened residual."""
        return float(self.bench.residual @ self.bench.residual)


def fitted(training: Training, model: Model, noise: Noise | None) -> Fitted:
    """A model as it is, with what a last linear step would still change taken out.

    Parameters
    ----------
    training : Training
    model : Model
    noise : Noise or None
        How rows are weighed; None for that of the residual.
    """
    return fitted_at(training, start_at(training.predictor, model), noise)


def fitted_at(training: Training, start: Start, noise: Noise | None) -> Fitted:
    """A model at which the residual is known, as `fitted`.

    Parameters
    ----------
    training : Training
    start : Start
        The model and its residual.
    noise : Noise or None
        As for `fitted`.
    """
    columns, names = slopes_at(training.predictor, start)
    return fitted_with(training, start, columns, names, noise)


def fitted_with(
    training: Training,
    start: Start,
    columns: FloatArray,
    names: Sequence[str],
    noise: Noise | None,
) -> Fitted:
    """A model at which residual and slopes are known, as `fitted`.

    Parameters
    ----------
    training : Training
    start : Start
    columns : (N, p) array
        As `slopes_at`; those that nothing is left to fit by are set to zero.
    names : sequence of str
        Of the columns.
    noise : Noise or None
        As for `fitted`.
    """
    model, residual = start.model, start.residual
    columns[:, listed_columns(training, model)] = 0.0
    offset = training.offset(model)
    noise = noise or training.noise(_refitted(training, None, residual, columns, offset))
    bench = training.bench(noise, residual, columns, offset)
    said = said_columns(training, model)
    bounded = bounded_columns(training, model, bench.solve())
    if held := {*said, *bounded}:
        # A bound that holds leaves nothing to fit: what goes beyond it is a finding's.
        columns[:, sorted(held)] = 0.0
        del bench  # as large as the one that is made
        bench = training.bench(noise, residual, columns, offset)
    at_bound = tuple(names[k] for k in bounded if k not in said)
    return Fitted(model, residual, columns, tuple(names), bench, offset, held=at_bound)


def reweighed(training: Training, one: Fitted) -> Fitted:
    """A fit with the noise that its own residual has.

    Parameters
    ----------
    training : Training
    one : Fitted
        Weighed by another.
    """
    left = _refitted(training, one.bench.noise, one.residual, one.columns, one.offset)
    bench = training.bench(training.noise(left), one.residual, one.columns, one.offset)
    return replace(one, bench=bench)


def _refitted(
    training: Training,
    noise: Noise | None,
    residual: FloatArray,
    columns: FloatArray,
    offset: FloatArray,
) -> FloatArray:
    """The residual after a linear refit, for estimating its noise."""
    if noise is None:
        own = [residual[training.mask & m] for m in _by_channel(training)]
        spread = [float(np.std(rows)) if rows.size else 0.0 for rows in own]
        white = tuple(np.zeros(0) for _ in spread)
        noise = Noise(white, np.maximum(np.array(spread), training.floor))
    bench = training.bench(noise, residual, columns, offset)
    return np.asarray(residual - columns @ bench.solve())


def _by_channel(training: Training) -> list[BoolArray]:
    material = training.predictor.material
    return [material.channel == k for k in range(len(material.channels))]
