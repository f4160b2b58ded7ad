"""Physical bounds of fitted parameters: what lies within noise of a bound is held at it.

Least squares knows no bounds, so a friction of zero is found below it as often as above. Such a
value is held at the bound and the others are fitted without its column; a value further outside
than noise explains is no parameter of this model, and its stage is rejected elsewhere.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from hydro_ident.estimate.forces.closed_chain import HeldPart, Solve, held_fit
from hydro_ident.estimate.statistics.least_squares import Fit
from hydro_model.robot import FloatArray

#: A value is clearly outside its bounds beyond so many standard deviations,
DEVIATIONS = 3.0
#: and beyond this share of the parameter's size: what a model leaves out moves it by that much.
NEGLIGIBLE = 1.0e-2


#: A parameter's size as a share of the largest plausible one.
_COMMON = 0.1


@dataclass(frozen=True, slots=True)
class Bounds:
    """Physical range of a parameter.

    Attributes
    ----------
    lower, upper : float
        Inclusive.
    size : float
        What such a parameter amounts to on a machine of this class.
    unit : str
    """

    lower: float = -math.inf
    upper: float = math.inf
    size: float = 0.0
    unit: str = ""

    def nearest(self, value: float) -> float:
        """The value itself, or the bound that it is beyond."""
        return min(max(value, self.lower), self.upper)

    def clear(self, value: float, std: float) -> bool:
        """Whether a value is outside by more than noise explains."""
        beyond = abs(value - self.nearest(value))
        return beyond > max(DEVIATIONS * std, NEGLIGIBLE * self.size)

    def text(self, name: str, value: float, std: float) -> str:
        """That a value is clearly outside."""
        unit = f" {self.unit}" if self.unit else ""
        return (
            f"expected {name} from {self.lower:g} to {self.upper:g}{unit},"
            f" found {value:.4g} +- {std:.2g}"
        )

    def held_text(self, value: float, std: float) -> str:
        """That a value is held at a bound."""
        unit = f" {self.unit}" if self.unit else ""
        return (
            f"held at its bound {self.nearest(value):g}{unit}: the fit gives {value:.3g}"
            f" +- {std:.2g}{unit}, outside it by no more than noise"
        )


def effect_bounds(name: str) -> Bounds:
    """Bounds of `<owner>.<effect>.<parameter>`: the catalogue's."""
    from hydro_model.effects.catalogue import CATALOGUE

    _, effect, parameter = name.rsplit(".", 2)
    specs = [p for form in CATALOGUE[effect].forms for p in form.parameters]
    spec = next(p for p in specs if p.name == parameter)
    return Bounds(spec.lower, spec.upper, abs(spec.typical), spec.unit)


def force_bounds(
    names: Sequence[str],
    base_names: Sequence[str],
    effect_names: Sequence[str],
    scales: FloatArray,
) -> tuple[Bounds, ...]:
    """Bounds of the parameters of a force regression.

    Parameters
    ----------
    names : sequence of str
        All of them: base parameters, viscous friction, effects.
    base_names, effect_names : sequence of str
    scales : (p,) array
        Largest plausible sizes.

    Returns
    -------
    tuple of Bounds
        Friction opposes motion; a base parameter may have either sign, unless it is a mass.
    """
    base, effects, found = set(base_names), set(effect_names), []
    for name, scale in zip(names, scales, strict=True):
        size = _COMMON * float(scale) if math.isfinite(scale) else 0.0
        if name in effects:
            found.append(effect_bounds(name))
        elif name not in base:
            found.append(Bounds(lower=0.0, size=size))
        elif name.endswith(".mass"):
            found.append(Bounds(lower=0.0, size=size, unit="kg"))
        else:
            found.append(Bounds())
    return tuple(found)


def fit_within_bounds(
    fit: Fit,
    held: tuple[HeldPart, ...],
    bounds: Sequence[Bounds],
    solve: Solve,
    determined: Callable[[Fit, tuple[HeldPart, ...]], Sequence[bool]],
) -> tuple[Fit, tuple[HeldPart, ...]]:
    """Hold what is outside its bounds by no more than noise, and fit the others again.

    Parameters
    ----------
    fit : Fit
        Of all parameters.
    held : tuple of HeldPart
        Parameters that are not free already.
    bounds : sequence of Bounds
    solve : callable
        The estimator.
    determined : callable
        Which parameters a fit determines: what the data do not show is not held for its value.

    Returns
    -------
    Fit
    tuple of HeldPart
        Those given, and the ones at a bound.
    """
    while True:
        fixed = {part.index for part in held}
        fresh = [
            HeldPart(i, limits.nearest(value), limits.held_text(value, std))
            for i, (limits, value, std, known) in enumerate(
                zip(
                    bounds,
                    fit.theta.tolist(),
                    fit.std.tolist(),
                    determined(fit, held),
                    strict=True,
                )
            )
            if known
            and i not in fixed
            and limits.nearest(value) != value
            and not limits.clear(value, std)
        ]
        if not fresh:
            return fit, held
        held = (*held, *fresh)
        fit = held_fit(fit, {part.index: part.value for part in held}, solve)


def conditioned(
    theta: FloatArray, covariance: FloatArray, values: Mapping[int, float]
) -> tuple[FloatArray, FloatArray]:
    """Estimates once some parameters are known: those of a fit without their columns.

    Parameters
    ----------
    theta : (p,) array
    covariance : (p, p) array
    values : mapping of int to float

    Returns
    -------
    theta : (p,) array
    covariance : (p, p) array
        Zero for what is known.
    """
    for i, value in values.items():
        column, variance = covariance[:, i], covariance[i, i]
        gain = column / variance if variance > 0.0 else np.zeros_like(column)
        theta = theta + gain * (value - theta[i])
        covariance = covariance - np.outer(gain, column)
        theta[i], covariance[i], covariance[:, i] = value, 0.0, 0.0
    return np.asarray(theta), np.asarray(covariance)
