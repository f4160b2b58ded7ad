"""The report of `diagnose`: one page, in the order in which its questions are asked."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from hydro_ident.everyday_units import bracketed, told
from hydro_ident.mismatch.answer.diagnosis_file import finding_dict
from hydro_ident.mismatch.answer.outcome import Diagnosis, Finding
from hydro_ident.report.correlation_section import correlation_section
from hydro_ident.report.diagnosis_verdict import diagnosis_verdict
from hydro_ident.report.diagnosis_views import diagnosis_rows, law_views
from hydro_ident.report.figure import unit_text
from hydro_ident.report.found_words import law_in_model, not_shown
from hydro_ident.report.free_run_section import free_run_section
from hydro_ident.report.law_section import law_section
from hydro_ident.report.model_parameters import finding_rows, model_rows
from hydro_ident.report.page import (
    Section,
    bullets,
    folded,
    number,
    page,
    paragraph,
    percent,
    table,
    written,
)
from hydro_ident.report.parameter_section import (
    change_figure,
    compared_with,
    owners,
    parameter_table,
    signs,
)
from hydro_ident.report.prediction_section import prediction_section
from hydro_ident.report.provenance_section import provenance_section
from hydro_ident.report.recording_sections import (
    control_section,
    excitation_section,
    health_section,
)
from hydro_ident.report.unnamed_words import unnamed_part
from hydro_ident.report.verdict_words import plain

_LABELS = (
    "the robot's own structure, refitted to the training rows (or as given, with a fixed base)",
    "the same with the findings",
)
_LAWS = (
    "Each point is what the model without the law leaves of a training row, against the variable"
    " that the law is best seen against. The coloured line is the law that was found, or the curve"
    " that was fitted where it has no name: the median of what it says of such rows, with a band"
    " that holds 80 % of them, as it may depend on more than this. Where points and line go"
    " together and the dashed line is at zero, the law holds."
)
#: Where nothing was found.
_NO_LAWS = (
    "Nothing was found. Each point is what the model leaves of a training row, against what goes"
    " with it most in its channel; the coloured line is the curve that fits them best, no law."
    " Chance alone makes as much."
)


def report_html(found: Diagnosis, origin: Mapping[str, Any]) -> str:
    """One self-contained HTML page.

    Parameters
    ----------
    found : Diagnosis
    origin : mapping
        Provenance, as in the result file.

    Returns
    -------
    str
    """
    joints = found.given.joint_names
    held_out, fitted = diagnosis_rows(found)
    missed = [(n.name, n.why) for n in not_shown(found)]
    sections = [
        health_section(found.recordings, found.losses, joints),
        excitation_section(found.recordings, joints, missed),
        _parameters(found),
        prediction_section(held_out, fitted, joints, _LABELS),
        law_section(law_views(found), _LAWS if _named(found) else _NO_LAWS, joints),
        correlation_section(held_out or fitted, joints),
        free_run_section(found.free_run, joints),
        control_section(found.recordings),
        provenance_section(origin, (), found.notes, found.recordings),
    ]
    title = f"Diagnosis of {found.given.name}"
    return page(title, diagnosis_verdict(found, held_out), sections)


def _named(found: Diagnosis) -> bool:
    """Whether there is a finding or something unexplained to draw."""
    return bool(found.findings or found.unexplained)


def _parameters(found: Diagnosis) -> Section:
    lead = (
        "What was found, with its numbers, then the numbers of the model around it, all as"
        " model.yaml has them. Grey: these recordings do not or hardly determine it or do not tell"
        " it from a bound, or it was held; below its name stands which, and whose value that is."
    )
    owner, joints = owners(found.given), found.given.joint_names
    body = bullets(found.problems, "no")
    if found.findings:
        rows = [row for one in found.findings for row in finding_rows(found, one, owner)]
        body += "<h3>What was found</h3>" + parameter_table(rows, joints)
        body += "".join(_finding(found, one) for one in found.findings)
    else:
        body += paragraph("No finding: no parameters beyond the model's own.")
    body += unnamed_part(found)
    rows = model_rows(found, owner)
    if rows:
        given = compared_with(found.given)
        body += "<h3>The model around the findings</h3>" + signs(rows)
        body += parameter_table(rows, joints, given) + change_figure(rows, joints, given)
    return Section("parameters", "Parameters", lead, body)


def _held_out_errors(found: Diagnosis, data: Mapping[str, Any]) -> str:
    if data["heldout_rmse_before"] is None:
        return "these rows do not measure it"
    units = {channel.name: channel.unit for channel in (*found.channels, *found.fitted)}
    sides = (("heldout_rmse_before", "without it"), ("heldout_rmse_after", "with it"))
    si = units.get(data["channel"], "")
    return ", ".join(
        f"{number(data[key])} {unit_text(si)}{written(bracketed((data[key],), si))} {what}"
        for key, what in sides
    )


def _unexercised(found: Diagnosis, one: Finding, data: Mapping[str, Any]) -> str:
    """What rows to verify on say of a finding that they do not exercise."""
    text = "these rows do not exercise it"
    if not one.verification.by_base(one.channels[0]):
        return text
    return f"{text}; by the base that it frees: {_held_out_errors(found, data)}"


def _other_law(data: Mapping[str, Any], law: str) -> list[tuple[str, str]]:
    """Where the model has a law of another name: which, and the numbers of what it stands for.

    A law near another one's limit bears that one's name and has no other numbers.
    """
    weighed = [
        f"{plain(p['name'].split('.')[-1])} {number(p['value'])}"
        + ("" if p["unit"] in ("", "1") else f" {unit_text(p['unit'])}")
        for p in data["parameters"]
        if not p["name"].startswith(f"{law}.")
    ]
    numbers = [("its numbers, not in model.yaml", ", ".join(weighed))] if weighed else []
    return [*numbers, ("law in model.yaml", plain(law))]


def _finding(found: Diagnosis, one: Finding) -> str:
    data = finding_dict(found, one)
    law = law_in_model(data)
    pairs = zip(data["names"], data["probability"], strict=True)
    names = " or ".join(f"{plain(name)} ({percent(share)})" for name, share in pairs)
    rows = [
        ("shows", written(told(data["where"]["text"]))),
        ("also in", ", ".join(data["also"]) or "–"),
        ("law", data["equation"]),
        *(_other_law(data, law) if law else ()),
        (
            "held-out error in motion, with every other finding in the model",
            _held_out_errors(found, data)
            if data["heldout_exercised"]
            else _unexercised(found, one, data),
        ),
        ("chance, over all that was tried", number(data["p_value"], 2)),
        ("experiment that tells it apart", data["separating_experiment"]),
    ]
    body = table(("", data["channel"]), rows, (0, 1))
    return folded(f"{plain(data['target'])}: {names}", body)
