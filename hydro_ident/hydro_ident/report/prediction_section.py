"""Measured against predicted, before and after: rows that took no part, and rows that did."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

import numpy as np

from hydro_ident.report.channel_rows import LONGEST_STOP_S, REJECTED, ChannelRows
from hydro_ident.report.correlation import FEWEST_ROWS
from hydro_ident.report.figure import APART_S, Axis, Figure, band, line, unit_text
from hydro_ident.report.page import Row, Section, also, folded, number, paragraph, table
from hydro_ident.report.palette import BEFORE, INK, joint_colour

_HEAD = (
    "channel",
    "unit",
    "error before",
    "error after",
    "sensor noise alone",
    "fit before %",
    "fit after %",
    "training: before",
    "after",
)


def prediction_section(
    held_out: Sequence[ChannelRows],
    fitted: Sequence[ChannelRows],
    joints: Sequence[str],
    labels: tuple[str, str],
) -> Section:
    """The section.

    Parameters
    ----------
    held_out, fitted : sequence of ChannelRows
    joints : sequence of str
        Of the robot, for the colours.
    labels : pair of str
        What "before" and "after" are.
    """
    lead = (
        f"Before: {labels[0]}. After: {labels[1]}. The verdict rests on held-out rows, which took"
        " no part in the fit; a model that does much better on training rows than on these has"
        " learnt noise. Errors are root mean squares."
    )
    few = [one.name for one in held_out if 0 < one.count < FEWEST_ROWS]
    if few:
        lead += (
            f" Of {', '.join(few)} they are of fewer than {FEWEST_ROWS} held-out rows and hang on"
            " chance: a longer recording, or whole ones to check on (`--validate`), give more."
        )
    if any(one.rejected for one in (*held_out, *fitted)):
        lead += (
            f" What is marked as {REJECTED} is what the rejected fit predicts: the robot file's"
            " own numbers stay there."
        )
    if not held_out and not fitted:
        return Section("predictions", _TITLE, lead, paragraph("No channel could be predicted."))
    body = _table(held_out, fitted, joints)
    if not held_out:
        body += paragraph("Nothing was held out: every row shown was fitted.", "no")
    of_training = {one.name: one for one in fitted}
    for joint in dict.fromkeys(one.joint for one in (*held_out, *fitted)):
        colour = joint_colour(joints, joint)
        body += f"<h3>{escape(joint)}</h3>"
        for one in (c for c in held_out if c.joint == joint):
            body += _figure(one, colour, _HELD_OUT).html()
            body += _turns(one, of_training.get(one.name), colour)
        rest = [one for one in fitted if one.joint == joint]
        alone = {one.name for one in rest} - {one.name for one in held_out}
        shown = "".join(
            _figure(one, colour, _TRAINING).html()
            + (_turns(None, one, colour) if one.name in alone else "")
            for one in rest
        )
        body += folded("Training rows", shown) if held_out else shown
    return Section("predictions", _TITLE, lead, body)


_TITLE = "Measured against predicted"
_HELD_OUT, _TRAINING = "held-out rows", "training rows"


def _table(
    held_out: Sequence[ChannelRows], fitted: Sequence[ChannelRows], joints: Sequence[str]
) -> str:
    trained = {one.name: one for one in fitted}
    checked = {one.name: one for one in held_out}
    rows = []
    for name in dict.fromkeys([*checked, *trained]):
        one, other = checked.get(name), trained.get(name)
        first = one or other
        if first is None:
            continue
        keys = ("rmse_before", "rmse_after", "noise_floor", "fit_before_pct", "fit_after_pct")
        cells = [number(one.value(k)) if one else "–" for k in keys]
        cells += [number(other.value(k)) if other else "–" for k in keys[:2]]
        dot = joint_colour(joints, first.joint)
        texts = (name, unit_text(first.unit), *cells)
        said = (_as_people_tell(one, other), _counts(one, other), first.remark)
        below = "; ".join(filter(None, said))
        rows.append(Row(texts, below=below, dot=dot, off=first.rejected))
    return table(_HEAD, rows)


def _counts(held_out: ChannelRows | None, fitted: ChannelRows | None) -> str:
    """How many rows figures are of, and how long these take together."""
    texts = [
        f"{name}{one.count} rows ({number(one.seconds, 2)} s)"
        for name, one in (("", held_out), ("training ", fitted))
        if one is not None
    ]
    return ", ".join(texts)


def _as_people_tell(held_out: ChannelRows | None, fitted: ChannelRows | None) -> str:
    """Errors in the unit that people use; empty where SI is."""
    texts = []
    for one, what in ((held_out, ""), (fitted, "training ")):
        if one is not None:
            errors = also((one.value("rmse_before"), one.value("rmse_after")), one.unit, " → ")
            texts += [what + errors] if errors else []
    return "; ".join(texts)


def _figure(one: ChannelRows, colour: str, kind: str) -> Figure:
    """Values above, residuals with the noise's band below."""
    before, after = one.residuals
    floor = one.value("noise_floor")
    ends = one.time_s[[0, -1]]
    t, value, error = one.time_s, Axis(one.quantity, one.unit), Axis("error", one.unit)
    high = error.of(np.full(2, 2.0 * floor))
    return Figure(
        f"{one.title}, {kind}",
        _time_title(one),
        (value, error),
        [
            line("measured", (t, value.of(one.measured)), INK, width=1.2),
            line("before", (t, value.of(one.before)), BEFORE, dash="dot"),
            line("after", (t, value.of(one.after)), colour),
            band("noise ±2σ", ends, -high, high, panel=1),
            line("b", (t, error.of(before)), BEFORE, panel=1, dash="dot", legend=False),
            line("a", (t, error.of(after)), colour, panel=1, legend=False),
        ],
        note=_note(one),
    )


def _note(one: ChannelRows) -> str:
    return f"After: {one.remark}." if one.rejected else ""


def _time_title(one: ChannelRows) -> str:
    several = bool((np.diff(one.time_s) == APART_S).any())
    return "time in s, recordings one after the other" if several else "time in s"


def _turns(held_out: ChannelRows | None, fitted: ChannelRows | None, colour: str) -> str:
    """Close-ups of held-out rows, else of training rows, else why there are none."""
    sides = [(_HELD_OUT, held_out), (_TRAINING, fitted)]
    there = [(kind, one) for kind, one in sides if one is not None]
    for kind, one in there:
        shown = _reversals(one, colour, "" if one is held_out else f", {kind}")
        if shown:
            return shown
    kinds = " or ".join(kind for kind, _ in there)
    if not any(np.isfinite(one.speed).any() for _, one in there):
        return paragraph(f"No close-up of a reversal: the motion of the {kinds} is not known.")
    name = there[0][1].name
    return paragraph(
        f"No close-up of a reversal: {name} has no {kinds} on both sides of a turn with a stop of"
        f" at most {LONGEST_STOP_S:g} s. Other channels of the joint may."
    )


def _reversals(one: ChannelRows, colour: str, kind: str) -> str:
    """Close-ups where the motion turns: what friction and valves leave out shows there first."""
    figures, value = [], Axis(one.quantity, one.unit)
    for rows in one.reversals():
        t = one.time_s[rows]
        middle = 0.5 * (t[0] + t[-1])
        figures.append(
            Figure(
                f"{one.title}, reversal at {middle:.1f} s{kind}",
                "time in s",
                (value,),
                [
                    line("measured", (t, value.of(one.measured[rows])), INK, width=1.2),
                    line("before", (t, value.of(one.before[rows])), BEFORE, dash="dot"),
                    line("after", (t, value.of(one.after[rows])), colour, width=2.0),
                ],
                note=_note(one),
            )
        )
    inner = "".join(f.html() for f in figures)
    return f'<div class="pair">{inner}</div>' if inner else ""
