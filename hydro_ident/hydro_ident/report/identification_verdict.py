"""The verdict of an identification in plain words."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from hydro_ident.identify.consistent_robot import impossible
from hydro_ident.identify.identification import Identification
from hydro_ident.identify.model_error import left_out
from hydro_ident.identify.rejection import rejected_channels
from hydro_ident.identify.verdict import IDENTIFIED, NOT_ENOUGH, spoils_all
from hydro_ident.parameters.parameters import Parameter
from hydro_ident.report.channel_rows import ChannelRows
from hydro_ident.report.figure import unit_text
from hydro_ident.report.page import Verdict, also, number, percent
from hydro_ident.report.parameter_section import compared_with, identified_row
from hydro_ident.report.verdict_words import (
    DRIVE,
    error_line,
    free_run_line,
    health_line,
    limited,
    loss_line,
    plain,
    shortened,
)

#: Parameters that are named as differing.
_NAMED = 4


def identification_verdict(found: Identification, held_out: Sequence[ChannelRows]) -> Verdict:
    """What differs, what was left out, how sure, what to do next."""
    known = [p for p in found.parameters if p.identifiable and not p.held]
    weak = {p.name for p in known if identified_row(p, {}).off}
    told = [p for p in known if p.name not in weak]
    physics = left_out(found.channels or found.fitted)
    if found.verdict == NOT_ENOUGH:
        tone, headline = "bad", "These recordings are not enough to identify the machine."
    elif impossible(found.physical):
        tone, headline = "warn", "Numbers were identified that no machine can have."
    elif found.verdict != IDENTIFIED:
        tone, headline = "warn", "Part of the machine was identified; the rest stays as given."
    elif physics:
        tone = "warn"
        headline = "The machine was identified, but it does more than its model knows."
    elif not found.channels:
        tone, headline = "warn", "The machine was identified, and nothing else was looked at."
    else:
        tone, headline = "good", "The machine was identified."
    cards = (
        ("What differs", limited(_differs(known, found))),
        ("What was left out", limited(_left_out(found, weak, _modelled(found, physics)))),
        ("How sure", limited(_sure(found, told, physics, held_out))),
        ("What to do next", limited(_next(found, weak, physics))),
    )
    return Verdict(tone, headline, found.verdict, cards)


def _differs(known: Sequence[Parameter], found: Identification) -> list[str]:
    """Parameters whose interval leaves the given value out, largest change first."""
    if found.verdict == NOT_ENOUGH:
        return ["Not known."]
    given = compared_with(found.given)
    compared = [p for p in known if p.datasheet and p.ci95 is not None]
    off = [p for p in compared if not _inside(p)]
    if not off:
        return [f"None of {len(compared)} parameters differs from the {given}."]
    off.sort(key=lambda p: -abs(_change(p)))
    lines = [
        f"{len(off)} of {len(compared)} parameters differ from the {given} by more than their"
        " intervals, most of all:"
    ]
    for p in off[:_NAMED]:
        told = also((p.value, p.datasheet), p.unit, " instead of ")
        change = ", ".join(filter(None, (told, percent(_change(p), sign="+"))))
        lines.append(
            f"{plain(p.name)}: {number(p.value, 3)} instead of"
            f" {number(p.datasheet, 3)} {unit_text(p.unit)} ({change})"
        )
    return lines


def _inside(p: Parameter) -> bool:
    low, high = p.ci95 or (p.value, p.value)
    return low <= (p.datasheet or 0.0) <= high


def _change(p: Parameter) -> float:
    return (p.value - (p.datasheet or 0.0)) / abs(p.datasheet or 1.0)


def _modelled(found: Identification, physics: dict[str, float]) -> dict[str, float]:
    """Those channels whose fit is in the model: what a rejected one leaves says nothing of it."""
    rejected = rejected_channels(found.given, found.inertial, found.hydraulic)
    return {name: ratio for name, ratio in physics.items() if name not in rejected}


def _left_out(
    found: Identification, weak: Collection[str], physics: dict[str, float]
) -> list[str]:
    lines = []
    if physics:
        worst = max(physics, key=lambda name: physics[name])
        lines.append(
            f"Physics that the model does not have, in {shortened(list(physics))}: {worst} is off"
            f" by {physics[worst]:.0f} times sensor noise."
        )
    unknown = [plain(p.name) for p in found.parameters if not p.identifiable]
    if unknown:
        lines.append(f"Not determined or not used, greyed below: {shortened(unknown)}.")
    if weak:
        names = shortened([plain(p.name) for p in found.parameters if p.name in weak])
        lines.append(f"Hardly determined or not told from a bound, greyed, too: {names}.")
    lines += [f"{text[0].upper()}{text[1:]}." for text in found.problems]
    lines += loss_line(found.losses)
    return lines or ["Nothing."]


def _sure(
    found: Identification,
    known: Sequence[Parameter],
    physics: dict[str, float],
    held_out: Sequence[ChannelRows],
) -> list[str]:
    lines = health_line(found.recordings)
    if found.verdict == NOT_ENOUGH:
        return lines or ["Not at all."]
    if not found.channels:
        lines.append(
            "Nothing was scored on rows that took no part in the fit: how well it predicts is not"
            " known."
        )
    relative = sorted(
        (p.ci95[1] - p.ci95[0]) / (2.0 * abs(p.value)) for p in known if p.ci95 and p.value
    )
    if relative:
        width = percent(relative[len(relative) // 2], 1)
        width = width.replace("under ", "less than ±") if "under" in width else f"±{width}"
        text = (
            f"{len(known)} of {len(found.parameters)} parameters are determined, the middle one to"
            f" {width} (95 %)."
        )
        if physics:
            text += " These intervals count noise alone: what was left out may bias them further."
        lines.append(text)
    lines += error_line(held_out)
    rejected = [c.name for c in held_out if c.rejected]
    if rejected:
        lines.append(
            f"Nothing is claimed of {shortened(rejected)}: their fits were rejected and are not in"
            " model.yaml."
        )
    lines += free_run_line(found.free_run)
    return lines or ["Not at all."]


def _to_be_driven(found: Identification) -> bool:
    """Whether there is a model, of this machine, whose forces are those of one that can be."""
    forces = () if found.inertial is None else found.inertial.model.channels
    rejected = rejected_channels(found.given, found.inertial, found.hydraulic)
    return (
        found.robot is not None
        and not impossible(found.physical)
        and not any(spoils_all(text) for text in found.problems)
        and rejected.isdisjoint(forces)
    )


def _next(found: Identification, weak: Collection[str], physics: dict[str, float]) -> list[str]:
    if found.verdict == NOT_ENOUGH and found.problems:
        return [f"{text[0].upper()}{text[1:]}." for text in found.problems]
    lines = []
    if physics:
        lines.append("Run `diagnose` on the same bags: it names what the model leaves out.")
    if found.verdict != IDENTIFIED or weak or any(not p.identifiable for p in found.parameters):
        lines.append(
            "For what is greyed, record a designed experiment (`excite`) and identify again with"
            " both bags."
        )
    if _to_be_driven(found):
        lines.append(DRIVE)
    return lines
