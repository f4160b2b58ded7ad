"""The verdict of a diagnosis in plain words."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from hydro_ident.identify.channel_scores import LEFT_OUT
from hydro_ident.identify.verdict import spoils_all
from hydro_ident.mismatch.answer.diagnosis_file import finding_dict
from hydro_ident.mismatch.answer.outcome import (
    EXPLAINED,
    MATCHES,
    NO_IMPROVEMENT,
    NOT_ENOUGH,
    PARTLY,
    UNKNOWN,
    Diagnosis,
    Finding,
)
from hydro_ident.mismatch.rows.channel_words import ChannelWords
from hydro_ident.report.channel_rows import ChannelRows
from hydro_ident.report.figure import unit_text
from hydro_ident.report.found_words import as_share, corners, law_in_model, not_shown
from hydro_ident.report.page import Verdict, also, number, percent
from hydro_ident.report.unnamed_words import in_words, taken_out_lines
from hydro_ident.report.verdict_words import (
    DRIVE,
    NEAR_NOISE,
    error_line,
    few_rows,
    free_run_line,
    health_line,
    limited,
    loss_line,
    most_left,
    noise_line,
    plain,
    shortened,
)

_HEADLINES = {
    MATCHES: (
        "good",
        "The model matches these recordings: nothing is missing that they can show.",
    ),
    EXPLAINED: ("good", "The model left physics out. It has been found and named."),
    PARTLY: (
        "warn",
        "The model left physics out. Some of it has been named and verified, some has not.",
    ),
    UNKNOWN: ("warn", "Something is missing from the model that has no name in the catalogue."),
    NO_IMPROVEMENT: (
        "warn",
        "What looked like missing physics did not hold up on data that took no part.",
    ),
    NOT_ENOUGH: ("bad", "These recordings are not enough to say anything."),
}
_MISREAD = (
    "A position sensor misreads. Beside that, nothing is missing that these recordings show."
)
_RESERVED = "The model left physics out. It has been found and named, with a reservation."
_ERRORS = (
    "Before anything is added to the model, by the root mean square error over all held-out rows:"
)
#: Probability below which a name alone is not enough.
_SURE = 0.9
#: Channels whose error is told.
_WORST = 3
#: Probability above which there is no saying how sure.
_CERTAIN = 0.99


def diagnosis_verdict(found: Diagnosis, held_out: Sequence[ChannelRows]) -> Verdict:
    """What differs, what was left out, how sure, what to do next."""
    tone, headline = _headline(found, held_out)
    cards = (
        ("What differs", limited(_differs(found, held_out))),
        ("What was left out", limited(_left_out(found))),
        ("How sure", limited(_sure(found, held_out))),
        ("What to do next", limited(_next(found))),
    )
    return Verdict(tone, headline, found.verdict, cards)


def _headline(found: Diagnosis, held_out: Sequence[ChannelRows]) -> tuple[str, str]:
    """Tone and headline: green only where names are told apart and little is left."""
    tone, headline = _HEADLINES[found.verdict]
    if found.verdict == PARTLY and not found.unexplained:
        return tone, _RESERVED
    if found.verdict == UNKNOWN and _all_taken_out(found):
        return tone, _MISREAD
    if found.verdict != EXPLAINED:
        return tone, headline
    unsure = sum(f.named.probability[0] < _SURE for f in found.findings)
    name, ratio = most_left(held_out)
    limits = []
    if unsure:
        of = f"{unsure} of {len(found.findings)} names" if len(found.findings) > 1 else "its name"
        limits.append(f"{of} could be another as well")
    if ratio > LEFT_OUT:
        limits.append(f"what is left is up to {ratio:.0f} times sensor noise ({name})")
    if not limits:
        return tone, headline
    return "warn", f"The model left physics out. It has been found, but {', and '.join(limits)}."


def _all_taken_out(found: Diagnosis) -> bool:
    """Whether all that has no name is an error of a sensor, and is in the recordings no more."""
    return bool(found.unexplained) and all(u.taken_out is not None for u in found.unexplained)


def _differs(found: Diagnosis, held_out: Sequence[ChannelRows]) -> list[str]:
    """By how much the model is off before anything is added to it, the worst channels first."""
    if found.verdict == NOT_ENOUGH:
        return ["Not known."]
    sizes = {c.name: (c, c.value("rmse_before"), c.value("noise_floor")) for c in held_out}
    off = {
        name: before / noise
        for name, (_, before, noise) in sizes.items()
        if noise > 0.0 and before > NEAR_NOISE * noise
    }
    if not off:
        return [_hardly_off(found, held_out)]
    worst = sorted(off, key=lambda name: -off[name])
    lines = [_ERRORS]
    if found.work is not None and found.work.off:
        lines = [f"{_ERRORS[:-1]}, without the error of a position sensor:"]
    lines += [
        f"{name} is off by {_with_unit(sizes[name][1], sizes[name][0].unit)},"
        f" {off[name]:.0f} times sensor noise alone{few_rows(sizes[name][0])}."
        for name in worst[:_WORST]
    ]
    if len(worst) > _WORST:
        lines.append(f"{shortened(worst[_WORST:])}: off by less.")
    return lines


def _hardly_off(found: Diagnosis, held_out: Sequence[ChannelRows]) -> str:
    """What is said where no channel is far off: something may be missing all the same."""
    ratios = {
        c.name: c.value("rmse_before") / c.value("noise_floor")
        for c in held_out
        if c.value("noise_floor") > 0.0
    }
    if found.verdict in (MATCHES, NO_IMPROVEMENT) or not ratios:
        return "Nothing beyond what sensor noise leaves."
    name = max(ratios, key=lambda k: ratios[k])
    if _all_taken_out(found):
        return (
            "Without the error of a position sensor no channel is off by more than"
            f" {NEAR_NOISE:g} times sensor noise (at most {ratios[name]:.1f} times, {name})."
        )
    return (
        f"No channel is off by more than {NEAR_NOISE:g} times sensor noise (at most"
        f" {ratios[name]:.1f} times, {name}), but what is left still follows a pattern: see what"
        " was left out."
    )


def _with_unit(value: float, unit: str) -> str:
    beside = also((value,), unit)
    return f"{number(value, 3)} {unit_text(unit)}{f' ({beside})' if beside else ''}"


def _causes(found: Diagnosis) -> list[str]:
    """What was found, with its size, by what it sits in."""
    by_target: dict[str, list[str]] = {}
    for one in found.findings:
        data = finding_dict(found, one)
        names = " or ".join(plain(name) for name in data["names"])
        law = law_in_model(data)
        law = f", modelled as {plain(law)}" if law else ""
        by_target.setdefault(plain(data["target"]), []).append(f"{names}{_size(data)}{law}")
    return [f"{target}: {'; '.join(causes)}." for target, causes in by_target.items()]


def _size(data: dict[str, Any]) -> str:
    """The first number of a law that is told from 0, which says how much of it there is."""
    if not data["parameters"]:
        return ""
    told = [p for p in data["parameters"] if abs(p["value"]) > (p["std"] or 0.0)]
    # Of a lag that is damped beyond 1 it is where its slower pole is.
    slow = corners(data)
    first = (slow or told or data["parameters"])[0]
    what = "corner" if slow else plain(first["name"].split(".")[-1])
    value = number(first["value"], 3)
    if first["unit"] in ("", "1"):
        return f" ({what} {as_share(first['name'], first['value']) or value})"
    beside = also((first["value"],), first["unit"])
    return f" ({what} {value} {unit_text(first['unit'])}{f', {beside}' if beside else ''})"


def _left_out(found: Diagnosis) -> list[str]:
    if found.verdict == NOT_ENOUGH:
        return ["Not known."]
    lines = _causes(found) + taken_out_lines(found)
    units = {channel.name: channel.unit for channel in (*found.channels, *found.fitted)}
    for one in (u for u in found.unexplained if u.taken_out is None):
        words = ChannelWords(found.given, one.channel)
        lines.append(in_words(one, units.get(one.channel, ""), words))
    if found.rejected:
        names = [plain(f.named.names[0]) for f in found.rejected]
        lines.append(f"Tried and not confirmed on held-out rows: {shortened(names)}.")
    return lines or ["Nothing that these recordings could show."]


def _sure(found: Diagnosis, held_out: Sequence[ChannelRows]) -> list[str]:
    lines = [f"{note[0].upper()}{note[1:]}." for note in found.notes if spoils_all(note)]
    lines += health_line(found.recordings)
    if found.verdict == NOT_ENOUGH:
        return [*lines, *loss_line(found.losses)] or ["Not at all."]
    if found.findings:
        lines.append(_chance(found.findings))
        lines += error_line(held_out)
    silent = [_place(f) for f in found.findings if f.verification.silent]
    if silent:
        lines.append(
            f"The rows to verify on do not exercise {shortened(silent)}: only cross-validation"
            " within the training rows speaks for that, and for its name."
        )
    freed = [_place(f) for f in found.findings if f.verification.by_base(f.channels[0])]
    if freed:
        lines.append(
            f"Beside {shortened(freed)} the base predicts these rows better: without it, the base"
            " had taken up something in the recordings that were fitted that is not in these."
        )
    lines += [f"Reservation: {one}." for one in found.reservations]
    lines += noise_line(held_out)
    lines += free_run_line(found.free_run)
    lines += loss_line(found.losses)
    names = [plain(n.name) for n in not_shown(found)]
    if names:
        lines.append(f"Could not have shown in these recordings: {shortened(names)}.")
    return lines or ["Not at all."]


def _chance(findings: Sequence[Finding]) -> str:
    """What chance finds, and how sure the names are that held-out rows could refuse."""
    largest = max(f.named.p_value for f in findings)
    text = (
        "Chance alone, over everything that was tried, finds as much with a probability of at"
        f" most {largest:.2g}."
    )
    heard = [f for f in findings if not f.verification.silent]
    if not heard:
        return text
    which = "The names" if len(heard) == len(findings) else "The names that could be verified"
    return f"{text} {which} fit better than any other of the catalogue {_odds(heard)}."


def _place(one: Finding) -> str:
    """A finding's name and where it is: another of the same name may be elsewhere."""
    return f"{plain(one.named.names[0])} of {plain(one.named.term.target)}"


def _odds(findings: Sequence[Finding]) -> str:
    probability = min(f.named.probability[0] for f in findings)
    return (
        "(over 99 %)"
        if probability > _CERTAIN
        else f"(the least sure of them {percent(probability)})"
    )


def _experiments(found: Diagnosis) -> list[str]:
    """What would tell names apart that are not, each experiment once with all its places."""
    places: dict[tuple[str, str], list[str]] = {}
    for one in found.findings:
        data = finding_dict(found, one)
        if len(data["names"]) > 1 or data["probability"][0] < _SURE:
            names = " from ".join(plain(name) for name in data["names"][:2])
            key = names, data["separating_experiment"]
            places.setdefault(key, []).append(one.named.term.target)
    return [
        f"To tell {names} ({shortened(at)}): {experiment}."
        for (names, experiment), at in places.items()
    ]


def _next(found: Diagnosis) -> list[str]:
    if found.verdict == NOT_ENOUGH:
        return [f"{text[0].upper()}{text[1:]}." for text in found.problems]
    lines = _experiments(found)
    if found.work is not None and found.work.off:
        lines.append(
            "Look at how that position is read, or correct it by `off_centre` of result.json:"
            " whoever drives by it is off by as much."
        )
    if where := [u.channel for u in found.unexplained if u.taken_out is None]:
        lines.append(
            f"Look at {shortened(where)} under 'Residuals against what matters': what is it that"
            " follows this variable? Do not trust the model there."
        )
    if found.findings and not any(spoils_all(note) for note in found.notes):
        lines.append(DRIVE)
    if found.verdict in (MATCHES, NO_IMPROVEMENT):
        lines.append("Keep the model.")
    if not_shown(found):
        lines.append(
            "To test what could not show, record a designed experiment (`excite`); for payload,"
            " offsets and tilt, diagnose an identified model with `--fixed-base`."
        )
    return lines
