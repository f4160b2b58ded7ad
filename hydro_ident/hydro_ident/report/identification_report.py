"""The report of `identify`: one page, in the order in which its questions are asked."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from hydro_ident.estimate.scoring.scores import ChannelScore
from hydro_ident.identify.identification import Identification
from hydro_ident.identify.model_error import model_error_note
from hydro_ident.identify.rejection import rejected_channels, rejections
from hydro_ident.report.channel_rows import ChannelRows, channel_rows, joint_speed
from hydro_ident.report.comparison_section import comparison_part
from hydro_ident.report.correlation_section import correlation_section
from hydro_ident.report.free_run_section import free_run_section
from hydro_ident.report.identification_verdict import identification_verdict
from hydro_ident.report.law_section import law_section, speed_views
from hydro_ident.report.page import Section, bullets, folded, page, paragraph
from hydro_ident.report.parameter_section import (
    change_figure,
    compared_with,
    identified_row,
    owners,
    parameter_table,
    signs,
)
from hydro_ident.report.physical_section import physical_part, summed_part
from hydro_ident.report.prediction_section import prediction_section
from hydro_ident.report.provenance_section import provenance_section
from hydro_ident.report.recording_sections import (
    control_section,
    excitation_section,
    health_section,
)

_LABELS = ("the robot file as given", "the identified robot")
_LAWS = (
    "Residuals of the identified robot against the motion, with their median and a band that holds"
    " 80 % of the rows. A band that does not lie around zero is physics that the model does not"
    " have: steps at zero speed are dry friction, slopes are viscous friction or leakage."
    " `diagnose` looks for its law and its name."
)


def report_html(found: Identification, origin: Mapping[str, Any]) -> str:
    """One self-contained HTML page.

    Parameters
    ----------
    found : Identification
    origin : mapping
        Provenance, as in the result file.

    Returns
    -------
    str
    """
    joints = found.given.joint_names
    held_out, fitted = (_rows(found, side) for side in (found.channels, found.fitted))
    judged = held_out or fitted
    note = model_error_note(found.channels)
    notes = [one for one in found.notes if one != note]
    sections = [
        health_section(found.recordings, found.losses, joints),
        excitation_section(found.recordings, joints, ()),
        _parameters(found, note),
        prediction_section(held_out, fitted, joints, _LABELS),
        law_section(speed_views(judged), _LAWS, joints),
        correlation_section(judged, joints),
        free_run_section(found.free_run, joints),
        control_section(found.recordings),
        provenance_section(origin, _method(found), notes, found.recordings),
    ]
    title = f"Identification of {found.given.name}"
    return page(title, identification_verdict(found, held_out), sections)


def _rows(found: Identification, channels: Sequence[ChannelScore]) -> list[ChannelRows]:
    rejected = rejected_channels(found.given, found.inertial, found.hydraulic)
    rows = [
        channel_rows(
            (one.name, one.unit),
            (one.time_s, one.measured, one.before, one.after),
            (one.speed, *joint_speed(found.given, one.name.split("/")[0])),
            one.summary(),
            0 if one.tally is None else one.tally.count,
        )
        for one in channels
    ]
    return [replace(one, rejected=one.name in rejected) for one in rows]


def _parameters(found: Identification, note: str) -> Section:
    lead = (
        "Every parameter that was fitted. Grey: these recordings do not or hardly determine it or"
        " do not tell it from a bound, or it was held or rejected; the reason stands below its"
        " name. What was not determined, held or rejected stays as given in the model."
    )
    owner, joints = owners(found.given), found.given.joint_names
    rows = [identified_row(p, owner) for p in found.parameters]
    stages = rejections(found.given, found.inertial, found.hydraulic)
    said = [f"{stage} rejected: {why}" for stage, (why, _) in stages.items()]
    given = compared_with(found.given)
    body = bullets([*said, *([note] if note else [])], "no")
    body += signs(rows) + parameter_table(rows, joints, given)
    if not rows:
        body += paragraph("None could be fitted.")
    body += change_figure(rows, joints, given)
    body += comparison_part(found.comparison)
    body += folded("Physically consistent bodies", physical_part(found.physical))
    title = "Flow: the summed form of eq. 14 for comparison"
    body += folded(title, summed_part(found.summed))
    return Section("parameters", "Parameters", lead, body)


def _method(found: Identification) -> list[tuple[str, str]]:
    if found.estimator is None:
        return []
    return [("estimator", f"{found.estimator.name} ({found.estimator.reason})")]
