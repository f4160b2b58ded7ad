"""Dependence without a name: in plain words for the strip, as a formula for its section."""

from __future__ import annotations

import math

from hydro_ident.everyday_units import told
from hydro_ident.mismatch.answer.outcome import Diagnosis
from hydro_ident.mismatch.answer.taken_out import off_words
from hydro_ident.mismatch.rows.channel_words import ChannelWords
from hydro_ident.mismatch.rows.state_space import OF_READINGS
from hydro_ident.mismatch.unnamed.describe import Form, each_form
from hydro_ident.mismatch.unnamed.unknown import HINT, Unexplained
from hydro_ident.report.figure import unit_text
from hydro_ident.report.page import also, folded, number, percent, table, written

#: What a variable is called, of a joint and its piston (or of the joint alone).
_THINGS = {
    "piston_velocity": "the velocity of the {joint} {part}",
    "piston_position": "the position of the {joint} {part}",
    "piston_acceleration": "the acceleration of the {joint} {part}",
    "piston_force": "the {force} of the {joint} {part}",
    "joint_angle": "the position of the {joint} joint",
    "pressure_a": "the pressure in chamber A of {joint}",
    "pressure_b": "the pressure in chamber B of {joint}",
    "supply_pressure": "the supply pressure",
    "valve_signal": "the opening of the {joint} valve",
    "valve_rate": "how fast the {joint} valve opens",
    "other_joint": "the velocity of another joint",
    "total_flow": "the flow of all valves",
    "oil_temperature": "the temperature of the oil",
    "time": "the time",
}
#: Where something is that repeats over a place.
_PLACES = {"piston_position": " of the {joint} {part}", "joint_angle": " of the {joint} joint"}
#: Short forms (`mismatch.locating.forms`) in words, of a thing and the form's own size, place or
#: period.
_FORMS = {
    "constant": "is there all along",
    "linear": "grows with {thing}",
    "magnitude": "grows with the size of {thing}, whichever its sign",
    "square": "grows with the square of {thing}",
    "odd_square": "grows with the square of {thing} and changes sign with it",
    "cube": "grows with the cube of {thing}",
    "root": "grows with the root of {thing}",
    "sign": "has the sign of {thing} and one size beyond {shape}",
    "bell": "is there while {thing} is within about {shape} of zero",
    "odd_bell": "is there while {thing} is within about {shape} of zero and has its sign",
    "decay": "fades as {thing} grows, to half of it at {shape}",
    "beyond": "sets in where {thing} is beyond {shape}",
    "below": "sets in where {thing} is below {shape}",
}
_TIMES = {
    "": "",
    "direction": ", with the direction of motion",
    "valve_signal": ", in proportion to the valve's opening",
    "compression": ", in proportion to the compression of the chamber's oil",
    "velocity": ", in proportion to the {part}'s velocity",
    "velocity_squared": ", in proportion to the square of the {part}'s velocity",
}
#: Factors that leave a form's numbers in the channel's own unit.
_PLAIN = ("", "direction")


def in_words(one: Unexplained, unit: str, words: ChannelWords) -> str:
    """A dependence without a name as a sentence without notation.

    Parameters
    ----------
    one : Unexplained
    unit : str
        Of its channel; empty where it is not known.
    words : ChannelWords
        Of its channel.

    Returns
    -------
    str
    """
    if " follows " not in one.text:
        # Something that follows nothing, or that comes and goes: the packages have words for it.
        return f"{told(one.text).replace('_', ' ')}."
    d, form = one.dependence, one.form
    variable = d.variable if form is None else form.variable
    names = {"joint": words.joint, "part": words.part, "force": words.force}
    of_shape = words.unit(variable)
    thing = _THINGS[variable].format(**names)
    how = f"follows {thing}"
    if form is not None and form.name in _FORMS:
        shape = next((v.value for v in form.values if v.name in ("scale", "place")), None)
        how = _FORMS[form.name].format(thing=thing, shape=_with_unit(shape, of_shape))
    elif form is not None or d.period:
        how = f"repeats every {_with_unit(_period(one), of_shape)}{_place(variable, names)}"
    hint = f" ({HINT})" if d.period and d.times in OF_READINGS else ""
    said = f"{how}{_TIMES[d.times].format(**names)}{hint}{_size(one, unit)}"
    below = "; a formula of it stands under Parameters" if form is not None else ""
    return (
        f"{percent(one.share)} of what is left in {one.channel} {said}; no effect of the"
        f" catalogue stands for it{below}."
    )


def _place(variable: str, names: dict[str, str]) -> str:
    if variable == "time":
        return ""
    of_place = _PLACES.get(variable, " of " + _THINGS[variable])
    return of_place.format(**names)


def _period(one: Unexplained) -> float:
    values = () if one.form is None else one.form.values
    return next((v.value for v in values if v.name == "period"), one.dependence.period)


def _with_unit(value: float | None, unit: str) -> str:
    if value is None:
        return ""
    beside = also((value,), unit)
    text = f"{number(value, 3)} {'' if unit == '1' else unit_text(unit)}".strip()
    return f"{text} ({beside})" if beside else text


def _size(one: Unexplained, unit: str) -> str:
    """How large it is, in the channel's unit: of what repeats the amplitude, where one is told."""
    if not unit:
        return ""
    values = () if one.form is None else one.form.values
    height = next((v for v in values if v.name == "amplitude"), None)
    if height is not None and one.dependence.times in _PLAIN:
        size, what, behind = height.value, "by about", " either way"
    else:
        size, what, behind = one.dependence.size, "about", " rms"
    beside = also((size,), unit)
    text = f", {what} {number(size, 2)} {unit_text(unit)}{behind}"
    return f"{text} ({beside})" if beside else text


def taken_out_lines(found: Diagnosis) -> list[str]:
    """What was taken out of the recordings, and what that leaves of the channels it was seen in.

    Parameters
    ----------
    found : Diagnosis
    """
    if found.work is None or not found.work.off:
        return []
    text = told(off_words(found.given, found.work.off))
    units = {channel.name: channel.unit for channel in (*found.channels, *found.fitted)}
    sizes = [
        f"{one.channel} {number(one.taken_out.before, 3)} → {number(one.taken_out.after, 3)}"
        f" {unit_text(units.get(one.channel, ''))}".rstrip()
        for one in found.unexplained
        if one.taken_out is not None and math.isfinite(one.taken_out.before)
    ]
    left = f" Without it held-out rows keep less: {', '.join(sizes)}." if sizes else ""
    return [
        f"{text[0].upper()}{text[1:]}.{left} It is taken out of the recordings for all else that"
        " is told here, and is not in the model."
    ]


def unnamed_part(found: Diagnosis) -> str:
    """What has no name: each with its numbers and formulas; empty where there is none.

    Parameters
    ----------
    found : Diagnosis
    """
    if not found.unexplained:
        return ""
    return "<h3>What has no name</h3>" + "".join(_entry(one) for one in found.unexplained)


def _entry(one: Unexplained) -> str:
    rows = [("shows", written(told(one.text)))]
    for form in each_form(one.form):
        rows += _form_rows(form)
    if one.p_value is not None:
        rows.append(("chance, over all that was tried", number(one.p_value, 2)))
    return folded(f"{one.channel}: no name", table(("", one.channel), rows, (0, 1)))


def _form_rows(form: Form) -> list[tuple[str, str]]:
    """A formula, its numbers and what it is worth."""
    sizes = [
        f"{v.name} {number(v.value, 3)}"
        + ("" if v.std is None else f" ± {number(v.std, 2)}")
        + ("" if v.unit in ("", "1") else f" {unit_text(v.unit)}")
        for v in form.values
    ]
    worth = (
        f"{percent(form.share)} of what a free curve through the same rows does, on held-out rows"
        f" {percent(form.held_share)}"
    )
    if max(form.share, form.held_share) > 1.0:
        worth += " (above 100 %: better than that curve)"
    return [
        ("as a formula that held-out rows confirm", written(form.text)),
        ("its numbers, ± one standard deviation", ", ".join(sizes)),
        ("it explains", worth),
    ]
