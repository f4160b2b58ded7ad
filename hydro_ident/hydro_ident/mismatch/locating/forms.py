"""Short forms of one variable: what a dependence without a name may be written as.

Each is linear in its coefficients, with at most one shape value (a scale, a place or a period).
They say how something looks, not what it is: none is the name of a cause.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from hydro_ident.mismatch.locating.lines import waves
from hydro_model.robot import FloatArray

#: What a shape value is: none, a size of the variable, a place within its range, a period.
NONE, SCALE, PLACE, PERIOD = "", "scale", "place", "period"
#: Quantiles at which scales (of the variable's size) and places (of the variable) are tried.
_SCALES = (0.05, 0.15, 0.3, 0.5, 0.7, 0.9, 1.0)
_PLACES = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9)
#: Least and most periods over the variable's range, and their step: finer ones are lines.
_FEWEST, _MOST, _STEP = 0.5, 20.0, 0.25


@dataclass(frozen=True, slots=True)
class Kind:
    """A short form.

    Attributes
    ----------
    name : str
    text : str
        In the variable `{v}` and its shape value `{s}`; empty for a constant.
    columns : callable
        Of the variable (N,) and the shape value: (N, k), one column per coefficient.
    shape : str
        What the shape value is; empty where there is none.
    power : float
        Of the variable's unit that the coefficient is per.
    signed : bool
        Whether it says nothing that others do not unless the variable takes both signs.
    count : int
        Coefficients.
    """

    name: str
    text: str
    columns: Callable[[FloatArray, float], FloatArray]
    shape: str = NONE
    power: float = 0.0
    signed: bool = False
    count: int = 1

    @property
    def freedom(self) -> int:
        """Coefficients, and the shape value."""
        return self.count + bool(self.shape)


def _one(function: Callable[[FloatArray, float], FloatArray]) -> Callable[..., FloatArray]:
    """A function of a variable and a shape value as a single column."""
    return lambda v, s: np.asarray(function(v, s))[:, None]


CONSTANT = Kind("constant", "", _one(lambda v, s: np.ones_like(v)))
COSINE = Kind("cosine", "cos(2 pi {v} / {s}", lambda v, s: waves(v / s), PERIOD, count=2)
#: The simplest first.
KINDS = (
    CONSTANT,
    Kind("linear", "{v}", _one(lambda v, s: v), power=1.0),
    Kind("magnitude", "|{v}|", _one(lambda v, s: np.abs(v)), power=1.0, signed=True),
    Kind("square", "{v}^2", _one(lambda v, s: v**2), power=2.0),
    Kind("odd_square", "{v} |{v}|", _one(lambda v, s: v * np.abs(v)), power=2.0, signed=True),
    Kind("cube", "{v}^3", _one(lambda v, s: v**3), power=3.0),
    Kind(
        "root", "sgn({v}) sqrt|{v}|", _one(lambda v, s: np.sign(v) * np.sqrt(np.abs(v))),
        power=0.5,
    ),
    Kind("sign", "tanh({v} / {s})", _one(lambda v, s: np.tanh(v / s)), SCALE, signed=True),
    Kind("bell", "exp(-({v} / {s})^2)", _one(lambda v, s: np.exp(-((v / s) ** 2))), SCALE),
    Kind(
        "odd_bell", "sgn({v}) exp(-({v} / {s})^2)",
        _one(lambda v, s: np.sign(v) * np.exp(-((v / s) ** 2))), SCALE, signed=True,
    ),
    Kind("decay", "1 / (1 + |{v}| / {s})", _one(lambda v, s: 1.0 / (1.0 + np.abs(v) / s)), SCALE),
    Kind(
        "beyond", "max({v} - {s}, 0)", _one(lambda v, s: np.maximum(v - s, 0.0)), PLACE,
        power=1.0,
    ),
    Kind(
        "below", "max({s} - {v}, 0)", _one(lambda v, s: np.maximum(s - v, 0.0)), PLACE,
        power=1.0,
    ),
    COSINE,
)  # fmt: skip


def shape_values(kind: Kind, seen: FloatArray) -> FloatArray:
    """Ascending shape values of a form that are tried, (m,), from the variable's own rows."""
    if kind.shape == SCALE:
        found = np.unique(np.quantile(np.abs(seen), _SCALES))
        return np.asarray(found[found > 0.0])
    if kind.shape == PLACE:
        return np.unique(np.quantile(seen, _PLACES))
    if kind.shape == PERIOD:
        span = float(np.ptp(seen))
        return span / np.arange(_MOST, _FEWEST - 0.5 * _STEP, -_STEP)
    return np.ones(1)


def kinds_for(seen: FloatArray) -> tuple[Kind, ...]:
    """Forms that differ from each other over the values that a variable takes."""
    both = bool(seen.min() < 0.0 < seen.max())
    return tuple(kind for kind in KINDS if both or not kind.signed)
