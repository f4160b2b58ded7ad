"""What is told of a dependence without a name: its short form with units, in words and numbers."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from hydro_ident.mismatch.fitting.fitted import Fitted
from hydro_ident.mismatch.fitting.training import Training
from hydro_ident.mismatch.locating.dependence import Dependence, alone, values_of
from hydro_ident.mismatch.locating.forms import CONSTANT, COSINE, NONE
from hydro_ident.mismatch.locating.lines import independent_noise
from hydro_ident.mismatch.rows.channel_words import ChannelWords
from hydro_ident.mismatch.rows.state_space import factor_sizes, factors_of, rounding
from hydro_ident.mismatch.unnamed.fit_form import FittedForm, Rows
from hydro_ident.mismatch.unnamed.symbolic import Curve, Told, told_forms
from hydro_ident.mismatch.verifying.confirm import Confirmer
from hydro_model.robot import FloatArray

#: Variables that say the same, where the machine is, and over which something may repeat.
_TWINS = {"joint_angle": ("piston_position",), "piston_position": ("joint_angle",)}
#: Points at which a form is drawn.
_POINTS = 181
SYMBOLS = {
    "piston_velocity": "v", "piston_position": "x", "piston_acceleration": "a",
    "piston_force": "F", "joint_angle": "q", "pressure_a": "p_a", "pressure_b": "p_b",
    "supply_pressure": "p_s", "valve_signal": "u", "valve_rate": "r", "other_joint": "w",
    "time": "t",
}  # fmt: skip


#: Factors in a form's text, and its unit beside those that are no mere numbers.
_BESIDE = {
    "valve_signal": ("valve_signal", ""),
    "velocity": ("piston_velocity", ""),
    "velocity_squared": ("piston_velocity", "^2"),
}
_UNIT_BESIDE = {"compression": "1/Pa", "velocity": "m^2"}


@dataclass(frozen=True, slots=True)
class Value:
    """A number of a form.

    Attributes
    ----------
    name : str
        `coefficient`, `amplitude`, `phase`, `constant`, `scale`, `place` or `period`.
    value : float
    std : float or None
        None of a shape value that the rows do not tell from the coefficients.
    unit : str
    """

    name: str
    value: float
    std: float | None
    unit: str


@dataclass(frozen=True, slots=True)
class Form:
    """A short form of a dependence.

    Attributes
    ----------
    name, text, variable : str
    values : tuple of Value
        Coefficients with deviations, and shape values.
    share, held_share : float
        Its gain over the free curve's on training and on held-out rows.
    held_p_value : float
    at, curve : (m,) array
        The form as the free curve is given: in the same factor, less the mean at its knots;
        empty where it is of another variable.
    others : tuple of Form
        That do equally well.
    """

    name: str
    text: str
    variable: str
    values: tuple[Value, ...]
    share: float
    held_share: float
    held_p_value: float
    at: FloatArray
    curve: FloatArray
    others: tuple[Form, ...] = ()


def form_of(
    training: Training, fitted: Fitted, confirmer: Confirmer, found: Dependence
) -> Form | None:
    """A dependence's short form; None where held-out rows confirm none.

    Parameters
    ----------
    training : Training
    fitted : Fitted
        The final model on the training rows.
    confirmer : Confirmer
        Of the rows that took no part.
    found : Dependence
    """
    names = training.predictor.material.channels
    held = confirmer.training
    if held.predictor.material.channels != names:
        return None
    sizes = _sizes(training, fitted, found)
    elsewhere = found.variable == "time" and held.predictor is not training.predictor
    # Of other recordings no phase is known.
    seen = replace(found, lags=np.zeros(0)) if elsewhere else found
    words = ChannelWords.of(training.predictor.material, found.channel)
    both = [
        (_rows(training, fitted, found, sizes, v), _rows(held, confirmer.fitted, seen, sizes, v))
        for v in variables_of(found.variable, words)
    ]
    rows = [(here, there) for here, there in both if here is not None and there is not None]
    if not rows or rows[0][0].variable != found.variable:
        return None
    told = told_forms(*rows[0], Curve(found.knots, found.period, elsewhere), rows[1:])
    if not told:
        return None
    unit = training.predictor.material.units[found.channel]
    forms = [_form(one, found, words, unit, sizes) for one in told]
    return replace(forms[0], others=tuple(forms[1:]))


def variables_of(variable: str, words: ChannelWords) -> tuple[str, ...]:
    """Variables that a dependence may be told in: where the piston is the joint itself, one."""
    return (variable,) if words.is_joint else (variable, *_TWINS.get(variable, ()))


def each_form(form: Form | None) -> tuple[Form, ...]:
    """A form and those that do equally well; none of none."""
    return () if form is None else (form, *form.others)


def form_text(form: Form) -> str:
    """A form with its deviations and what it is worth, in words."""
    sizes = [
        f"{v.name} {v.value:.3g}" + ("" if v.std is None else f" +- {v.std:.2g}") + f" {v.unit}"
        for v in form.values
    ]
    return (
        f"{form.text} ({', '.join(sizes)}; {form.share:.0%} of the curve's gain,"
        f" {form.held_share:.0%} on held-out rows)"
    )


def _sizes(training: Training, fitted: Fitted, found: Dependence) -> dict[str, float]:
    """Sizes of the factors on the training rows of a channel."""
    own, _ = alone(training, fitted, found.channel)
    values = values_of(own, fitted, found.channel)
    return factor_sizes(own.predictor, fitted.model, found.channel, values, own.mask)


def _rows(
    training: Training,
    fitted: Fitted,
    found: Dependence,
    sizes: dict[str, float],
    variable: str,
) -> Rows | None:
    """Rows of a dependence's channel over a variable, its factor in its own unit."""
    own, bench = alone(training, fitted, found.channel)
    if bench is None:
        return None
    if found.period:
        noise = independent_noise(own, fitted)
        bench = own.bench(noise, fitted.residual, fitted.columns, fitted.offset)
    values = values_of(own, fitted, found.channel)
    factor = np.ones(own.mask.size)
    if found.times:
        units = {name: s if name == "direction" else 1.0 for name, s in sizes.items()}
        factors = factors_of(
            own.predictor, fitted.model, found.channel, values, own.mask, units
        )  # fmt: skip
        factor = factors[found.times]
    at, factor = values[variable][own.mask], factor[own.mask]
    if not np.isfinite(at).all() or not np.isfinite(factor).all():
        return None
    recording = own.layout.recording
    at = found.along(at, recording) if variable == found.variable else at
    return Rows(bench, at, factor, recording, variable)


def _form(
    told: Told, found: Dependence, words: ChannelWords, unit: str, sizes: dict[str, float]
) -> Form:
    one, variable = told.fitted, told.variable
    unit = _unit_beside(found.times, words, unit)
    own = words.unit(variable)
    values = (*_coefficients(one, unit, own), *_shape(one, own))
    at, drawn = np.zeros(0), np.zeros(0)
    if variable == found.variable:
        at = np.linspace(found.knots[0], found.knots[-1], _POINTS)
        # The curve's factor is in units of its size, a direction has none.
        size = sizes[found.times] if found.times not in ("", "direction") else 1.0
        drawn = size * (_function(one, at) - float(_function(one, found.knots).mean()))
    text = _text(told, values, found.times, words, unit, sizes)
    return Form(
        one.kind.name, text, variable, values, told.share, told.held_share, told.held_p_value,
        at, drawn,
    )  # fmt: skip


def _function(one: FittedForm, at: FloatArray) -> FloatArray:
    """A form's function of its variable, (m,), without its constant."""
    return np.asarray(one.kind.columns(at, one.shape) @ one.theta[: one.kind.count])


def _coefficients(one: FittedForm, unit: str, per: str) -> tuple[Value, ...]:
    """Coefficients with deviations; of a wave, amplitude and phase."""
    theta, covariance = one.theta, one.covariance
    std = np.sqrt(np.diag(covariance))
    last = theta.size - 1
    constant: tuple[Value, ...] = ()
    if one.offset:
        constant = (Value("constant", float(theta[last]), float(std[last]), unit),)
    if one.kind is not COSINE:
        power = one.kind.power
        name = "constant" if one.kind is CONSTANT else "coefficient"
        return Value(name, float(theta[0]), float(std[0]), _per(unit, per, power)), *constant
    a, b = theta[:2]
    size = float(np.hypot(a, b))
    slopes = np.array([[a, b], [b / size, -a / size]]) / size
    deviations = np.sqrt(np.maximum(np.diag(slopes @ covariance[:2, :2] @ slopes.T), 0.0))
    return (
        Value("amplitude", size, float(deviations[0]), unit),
        Value("phase", float(np.arctan2(-b, a)), float(deviations[1]), "rad"),
        *constant,
    )


def _per(unit: str, per: str, power: float) -> str:
    """A unit per another one to a power."""
    if not power or per in ("", "1"):
        return unit
    return f"{unit}/({per})" if power == 1.0 else f"{unit}/({per})^{power:g}"


def _shape(one: FittedForm, unit: str) -> tuple[Value, ...]:
    if one.kind.shape == NONE:
        return ()
    told = one.covariance.shape[0] > one.theta.size
    std = float(np.sqrt(one.covariance[-1, -1])) if told else None
    return (Value(one.kind.shape, one.shape, std, unit),)


def _text(
    told: Told,
    values: tuple[Value, ...],
    times: str,
    words: ChannelWords,
    unit: str,
    sizes: dict[str, float],
) -> str:
    """A form in words: numbers, its variable and what it is multiplied by."""
    one, number = told.fitted, {v.name: v.value for v in values}
    symbol, own = SYMBOLS[told.variable], words.unit(told.variable)
    own = "" if own == "1" else own
    if one.kind is CONSTANT:
        body = f"{number['constant']:.3g}"
    else:
        shape = f"{one.shape:.3g} {own}".strip()
        body = one.kind.text.format(v=symbol, s=shape)
        if one.kind is COSINE:
            phase = number["phase"]
            body += f" {'-' if phase < 0.0 else '+'} {abs(phase):.3g})"
        body = f"{number.get('amplitude', number.get('coefficient', 0.0)):.3g} {body}"
        if one.offset:
            body = f"({number['constant']:.3g} {_signed(body)})"
    body += _beside(times, words, sizes)
    text = f"{body} {unit}"
    if times == "compression":
        text += " times the compression of the chamber"
    if one.kind is CONSTANT:
        return text
    return f"{text}, {symbol} = {words.name(told.variable)} in {own or 1}"


def _beside(times: str, words: ChannelWords, sizes: dict[str, float]) -> str:
    """What a form is multiplied by."""
    if times == "direction":
        velocity, unit = words.name("piston_velocity"), words.unit("piston_velocity")
        return f" tanh({velocity} / {rounding(sizes['direction']):.2g} {unit})"
    if times not in _BESIDE:
        return ""
    variable, power = _BESIDE[times]
    return f" {words.name(variable)}{power}"


def _unit_beside(times: str, words: ChannelWords, unit: str) -> str:
    """Unit of a form's numbers beside a factor; of its channel beside a mere number."""
    if times != "velocity_squared":
        return _UNIT_BESIDE.get(times, unit)
    length = words.unit("piston_position")
    return f"{unit} s^2/{length}^2"


def _signed(body: str) -> str:
    """A term behind another one."""
    return f"- {body[1:]}" if body.startswith("-") else f"+ {body}"
