"""Rows and laws of a diagnosis as its report draws them: looked up, no search made again."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from hydro_ident.everyday_units import told
from hydro_ident.mismatch.answer.diagnosis_file import as_modelled, channel_dict, finding_dict
from hydro_ident.mismatch.answer.outcome import ChannelResult, Diagnosis, Finding
from hydro_ident.mismatch.fitting.fitted import Fitted, fitted
from hydro_ident.mismatch.fitting.training import Training
from hydro_ident.mismatch.locating.dependence import Dependence, alone, beyond_base, values_of
from hydro_ident.mismatch.locating.lines import waves
from hydro_ident.mismatch.rows.channel_words import ChannelWords
from hydro_ident.mismatch.rows.off_centre import term_of
from hydro_ident.mismatch.rows.prediction import Model, Predictor
from hydro_ident.mismatch.rows.state_space import SIGNALS, factors_of, row_values
from hydro_ident.mismatch.split.residuals import Residuals
from hydro_ident.mismatch.unnamed.unknown import Unexplained
from hydro_ident.report.channel_rows import ChannelRows, channel_rows, joint_speed
from hydro_ident.report.figure import Axis
from hydro_ident.report.law_section import LawView
from hydro_ident.report.verdict_words import plain
from hydro_model.arrays import BoolArray
from hydro_model.robot import FloatArray, Robot

#: Variables that a law without one of its own is held against.
_OTHERWISE = "time"


def diagnosis_rows(found: Diagnosis) -> tuple[list[ChannelRows], list[ChannelRows]]:
    """Rows that took no part, and rows that were fitted, channel by channel."""
    if found.work is None or found.whole is None:
        return [], []
    check, training = found.work.check.told(found.whole.model.terms), found.work.training
    sides = (
        (found.channels, check.predictor, check.mask),
        (found.fitted, training.predictor, training.mask),
    )
    held_out, fitted = (
        [_rows(one, predictor, found.whole.model, mask) for one in channels]
        for channels, predictor, mask in sides
    )
    return held_out, fitted


def _rows(one: ChannelResult, predictor: Predictor, model: Model, mask: BoolArray) -> ChannelRows:
    material = predictor.material
    number = material.channels.index(one.name)
    own = mask & (material.channel == number)
    speed = row_values(predictor, model, number, "piston_velocity")[own]
    named = _speed_of(material.robot, one.name.split("/")[0], material.forces.torque)
    return channel_rows(
        (one.name, one.unit),
        (one.time_s, one.measured, one.before, one.after),
        (speed, *named),
        channel_dict(one),
    )


def _speed_of(robot: Robot, joint: str, torque: bool) -> tuple[str, str]:
    if not torque and any(c.joint == joint for c in robot.cylinders):
        return "piston velocity", "m/s"
    return joint_speed(robot, joint)


def law_views(found: Diagnosis) -> list[LawView]:
    """Findings, then what is left unexplained; without either, the strongest dependences."""
    if found.work is None or found.whole is None:
        return []
    views = [_finding_view(found, found.work, one) for one in found.findings]
    # What a channel keeps beside a dependence has no other curve than that.
    firsts = {one.channel: one for one in reversed(found.unexplained)}
    views += [
        _off_centre_view(found.work, found.whole, one)
        if one.taken_out is not None
        else _dependence_view(found.work.training, found.whole, one.dependence, told(one.text))
        for one in found.unexplained
        if one is firsts[one.channel] or one.depends_on != ("everywhere",)
        # What was told of other rows may be of a channel that these lack.
        if one.channel in found.work.training.predictor.material.channels
    ]
    if views:
        return views
    strongest: dict[str, Dependence] = {}
    for one in found.located:
        strongest.setdefault(one.name, one)
    # Located is on the rows that are searched, which may have other channels than those fitted.
    channels = found.work.training.predictor.material.channels
    return [
        _dependence_view(
            found.work.training,
            found.work.base,
            replace(one, channel=channels.index(one.name)),
            f"the strongest of all dependences looked at in this channel: chance alone makes as"
            f" much with p = {one.p_value:.2g}",
        )
        for one in strongest.values()
        if one.variable in SIGNALS and one.name in channels
    ]


def _finding_view(found: Diagnosis, work: Residuals, one: Finding) -> LawView:
    modelled, term = as_modelled(found, one)
    training = work.training
    if not isinstance(modelled, Fitted):
        # A law that another stands for in the model was weighed on the rows that were searched.
        training = work.scan
        modelled = fitted(training, modelled.model, None)
    data = finding_dict(found, one)
    predictor, mask = training.predictor, training.mask
    channel = predictor.material.channels.index(data["channel"])
    own = mask & (predictor.material.channel == channel)
    variable = data["where"]["variable"]
    x_axis, x = _variable(training, modelled.model, channel, variable, own)
    law = predictor.contribution(modelled.model, term)[own]
    # A law that was weighed alone left the base where it was: its last step is taken here.
    left = modelled.residual[own] - modelled.columns[own] @ modelled.bench.solve()
    return LawView(
        title=f"{plain(term.target)}: {' or '.join(plain(name) for name in data['names'])}",
        note=f"{data['equation']}; {told(data['where']['text'])}",
        joint=data["channel"].split("/")[0],
        x_axis=x_axis,
        y_axis=Axis(f"{data['channel']}, error", predictor.material.units[channel]),
        x=x,
        residual=left + law,
        law=law,
        left=left,
    )


def _variable(
    training: Training, model: Model, channel: int, variable: str, own: BoolArray
) -> tuple[Axis, FloatArray]:
    if variable not in SIGNALS:
        variable = _OTHERWISE
    values = row_values(training.predictor, model, channel, variable)[own]
    words = ChannelWords.of(training.predictor.material, channel)
    return Axis(words.prose(variable), words.unit(variable)), values


def _dependence_view(training: Training, fitted: Fitted, d: Dependence, text: str) -> LawView:
    predictor = training.predictor
    material = predictor.material
    own = training.mask & (material.channel == d.channel)
    # Free of the channel's own noise: a curve is drawn over the values that it was fitted over.
    values = values_of(training, fitted, d.channel)
    if d.period:
        values[d.variable] = row_values(predictor, fitted.model, d.channel, d.variable)
    law = _law(training, fitted, d, values, own)
    residual = fitted.residual[own]
    name, unit = material.channels[d.channel], material.units[d.channel]
    words = ChannelWords(material.robot, name)
    return LawView(
        title=f"{name} against {words.prose(d.variable)}",
        note=text,
        joint=name.split("/")[0],
        x_axis=Axis(words.prose(d.variable), words.unit(d.variable)),
        y_axis=Axis(f"{name}, error", unit),
        x=values[d.variable][own],
        residual=residual,
        law=law,
        left=residual - law,
        legend="fitted curve",
    )


def _off_centre_view(work: Residuals, whole: Fitted, one: Unexplained) -> LawView:
    """What a position sensor's error had made of a channel, and what is left without it."""
    predictor, robot = work.training.predictor, work.robot
    material = predictor.material
    channel = material.channels.index(one.channel)
    own = work.training.mask & (material.channel == channel)
    law = np.zeros(material.size)
    for error in work.off:
        # Undone with the opposite sign it is back in recordings that are free of it.
        back = replace(error, sine=-error.sine, cosine=-error.cosine)
        law -= predictor.contribution(whole.model, term_of(robot, back))
    left, words = whole.residual[own], ChannelWords(robot, one.channel)
    return LawView(
        title=f"{one.channel} against {words.prose('joint_angle')}",
        note=told(one.text),
        joint=one.channel.split("/")[0],
        x_axis=Axis(words.prose("joint_angle"), words.unit("joint_angle")),
        y_axis=Axis(f"{one.channel}, error", material.units[channel]),
        x=row_values(predictor, whole.model, channel, "joint_angle")[own],
        residual=left + law[own],
        law=law[own],
        left=left,
        legend="the sensor's error",
    )


def _law(
    training: Training,
    fitted: Fitted,
    d: Dependence,
    values: Mapping[str, FloatArray],
    own: BoolArray,
) -> FloatArray:
    """What a dependence says of a channel's own rows.

    It was fitted together with the base: what the base's columns swallow of its curve is not in
    the residual, and is taken out.
    """
    law = np.zeros(own.size)
    recording = training.predictor.material.recording[own]
    law[own] = _curve(d, d.along(values[d.variable][own], recording))
    if d.times:
        factors = factors_of(training.predictor, fitted.model, d.channel, values, own)
        law[own] *= factors[d.times][own]
    bench = alone(training, fitted, d.channel)[1]
    return law[own] if bench is None else beyond_base(bench, fitted, law, own)


def _curve(d: Dependence, x: FloatArray) -> FloatArray:
    """The fitted function at a variable's values, by its own coefficients."""
    if d.period:
        return np.asarray(waves(x / d.period) @ d.coefficients)
    return np.asarray(np.interp(x, d.knots, d.coefficients))
