"""The report of `diagnose`: verdict, findings, what is left and the channels in one HTML file."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape
from typing import Any

import numpy as np

from hydro_ident.mismatch.describe import each_form, form_text
from hydro_ident.mismatch.diagnosis import ChannelResult, Diagnosis, Finding
from hydro_ident.mismatch.diagnosis_file import channel_dict, finding_dict
from hydro_ident.mismatch.state_space import UNITS
from hydro_ident.mismatch.unknown import Unexplained
from hydro_ident.report.html import bullets, opening, table
from hydro_ident.report.identification_report import provenance_table
from hydro_ident.report.svg import Line, line_plot
from hydro_ident.report.validation_report import free_run_section, losses_section

_MEASURED, _BEFORE, _AFTER = "#222222", "#c0792a", "#2267b5"
_FORMS = ("#2267b5", "#c0792a", "#3a8f4d", "#8a4fa3")
_PLOT_ROWS = 4000


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
    parts = [
        *opening("Diagnosis", found.given.name, found.verdict),
        bullets(found.problems, "no"),
        "<h2>Findings</h2>",
        *([_finding(found, one) for one in found.findings] or ["<p>None.</p>"]),
        "<h2>Unexplained</h2>",
        bullets([one.text for one in found.unexplained]) or "<p>Nothing.</p>",
        *[_unexplained(one) for one in found.unexplained],
        losses_section(found.losses),
        "<h2>Channels on data that took no part</h2>",
        _channels(found),
        *[_plot(channel) for channel in found.channels],
        free_run_section(found.free_run),
        "<h2>What these recordings could not have shown</h2>",
        table(("effect", "why"), [(n.name, n.why) for n in found.not_testable]),
        "<h2>Notes</h2>",
        bullets(found.notes),
        "<h2>Provenance</h2>",
        provenance_table(origin),
        "</body></html>",
    ]
    return "\n".join(parts) + "\n"


def _finding(found: Diagnosis, one: Finding) -> str:
    data = finding_dict(found, one)
    pairs = zip(data["names"], data["probability"], strict=True)
    names = " or ".join(f"{name} ({share:.0%})" for name, share in pairs)
    rows = [("shows", data["where"]["text"]), ("also in", ", ".join(data["also"]) or "-")]
    rows += [("law", data["equation"])]
    for p in data["parameters"]:
        std = "" if p["std"] is None else f" +- {p['std']:.3g}"
        rows.append((p["name"], f"{p['value']:.5g}{std} {p['unit']}"))
    before, after = data["heldout_rmse_before"], data["heldout_rmse_after"]
    rows.append(("held-out RMSE without, with", f"{before:.4g}, {after:.4g}"))
    rows.append(("chance, over all that was tried", f"{data['p_value']:.2g}"))
    rows.append(("to tell it apart", data["separating_experiment"]))
    return f"<h3>{escape(names)}</h3>" + table(("", data["channel"]), rows)


def _channels(found: Diagnosis) -> str:
    head = ("channel", "unit", "RMSE before", "RMSE after", "noise floor", "fit %", "fit %")
    rows = []
    for channel in found.channels:
        s = channel_dict(channel)
        numbers = [f"{s[k]:.4g}" for k in ("rmse_before", "rmse_after", "noise_floor")]
        fits = [f"{s[k]:.1f}" for k in ("fit_before_pct", "fit_after_pct")]
        rows.append((channel.name, channel.unit, *numbers, *fits))
    return table(head, rows)


def _plot(channel: ChannelResult) -> str:
    every = max(1, channel.time_s.size // _PLOT_ROWS)
    lines = (
        Line("residual before", _BEFORE, (channel.measured - channel.before)[::every]),
        Line("residual after", _AFTER, (channel.measured - channel.after)[::every]),
    )
    title = f"{channel.name}: residual"
    return line_plot(title, channel.time_s[::every], lines, "time in s", channel.unit)


def _unexplained(one: Unexplained) -> str:
    """The curve of a dependence, with the short forms that say the same."""
    d, forms = one.dependence, each_form(one.form)
    at, curve = d.knots, d.curve
    drawn = [form for form in forms if form.at.size]
    if drawn:
        at = drawn[0].at
        curve = np.interp(at, d.knots, d.curve)
    lines = [Line("residual", _MEASURED, curve)]
    lines += [
        Line(form.name.replace("_", " "), colour, form.curve)
        for form, colour in zip(drawn, _FORMS, strict=False)
    ]
    times = f" (times {d.times.replace('_', ' ')})" if d.times else ""
    label = f"{d.variable} in {UNITS[d.variable]}"
    plot = line_plot(f"{one.channel} against {d.variable}{times}", at, lines, label, "")
    return plot + bullets([form_text(form) for form in forms])
