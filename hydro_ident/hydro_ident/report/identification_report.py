"""The report of `identify`: verdict, parameters, channels and their plots in one HTML file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

from hydro_ident.estimate.scores import ChannelScore
from hydro_ident.identification import Identification
from hydro_ident.model_error import model_error_note
from hydro_ident.parameters import Parameter
from hydro_ident.report.html import bullets as _list
from hydro_ident.report.html import opening
from hydro_ident.report.html import table as _table
from hydro_ident.report.physical_report import physical_section, summed_section
from hydro_ident.report.svg import Line, line_plot
from hydro_ident.report.validation_report import (
    comparison_section,
    free_run_section,
    losses_section,
)

#: Of every report.
_MEASURED, _BEFORE, _AFTER = "#222222", "#c0792a", "#2267b5"


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
    warning = model_error_note(found.channels)
    parts = [
        *opening("Identification", found.given.name, found.verdict),
        _list(found.problems, "no"),
        _estimator(found),
        "<h2>Parameters</h2>",
        _list([warning] if warning else [], "no"),
        _parameters(found.parameters),
        physical_section(found.physical),
        comparison_section(found.comparison),
        losses_section(found.losses),
        "<h2>Predictions on data that took no part in the fit</h2>",
        _channels(found.channels),
        *[_plot(channel) for channel in found.channels],
        free_run_section(found.free_run),
        summed_section(found.summed),
        "<h2>Notes</h2>",
        _list([note for note in found.notes if note != warning], ""),
        "<h2>Provenance</h2>",
        provenance_table(origin),
        "</body></html>",
    ]
    return "\n".join(parts) + "\n"


def _estimator(found: Identification) -> str:
    """Which estimator was used, and why."""
    if found.estimator is None:
        return ""
    text = f"Estimator: {found.estimator.name} ({found.estimator.reason})."
    return f"<p>{escape(text)}</p>"


def _parameters(parameters: Sequence[Parameter]) -> str:
    head = ("parameter", "value", "95 % interval", "unit", "datasheet", "determined")
    rows = []
    for p in parameters:
        interval = "-" if p.ci95 is None else " .. ".join(f"{bound:.5g}" for bound in p.ci95)
        rows.append(
            (
                readable(p),
                f"{p.value:.5g}",
                interval,
                p.unit,
                "-" if p.datasheet is None else f"{p.datasheet:.5g}",
                "yes" if p.identifiable else "held" if p.held else "no",
            )
        )
    return _table(head, rows)


def readable(parameter: Parameter) -> str:
    """A base parameter as the sum it stands for, any other by its name."""
    text = parameter.name
    for name, factor in parameter.combination.items():
        if name != parameter.name:
            size = "" if abs(factor) == 1.0 else f"{abs(factor):.6g} "
            text += f" {'-' if factor < 0.0 else '+'} {size}{name}"
    return text


def _channels(channels: Sequence[ChannelScore]) -> str:
    errors = ("RMSE given", "RMSE identified", "noise floor")
    head = ("channel", "unit", *errors, "fit given %", "fit identified %")
    rows = []
    for channel in channels:
        s = channel.summary()
        numbers = [f"{s[k]:.4g}" for k in ("rmse_before", "rmse_after", "noise_floor")]
        fits = [f"{s[k]:.1f}" for k in ("fit_before_pct", "fit_after_pct")]
        rows.append((channel.name, channel.unit, *numbers, *fits))
    return _table(head, rows)


def _plot(channel: ChannelScore) -> str:
    lines = (
        Line("measured", _MEASURED, channel.measured),
        Line("given robot", _BEFORE, channel.before),
        Line("identified", _AFTER, channel.after),
    )
    title = f"{channel.name} ({', '.join(channel.recordings)})"
    return line_plot(title, channel.time_s, lines, "time in s", channel.unit)


def provenance_table(origin: Mapping[str, Any]) -> str:
    """Command, version, robot and bags of a result."""
    rows = [("command", str(origin["command"])), ("version", str(origin["version"]))]
    rows.append(("robot", str(origin["robot"])))
    for kind in ("bags", "validation"):
        rows += [(kind, f"{b['name']}  sha256 {b['sha256']}") for b in origin[kind]]
    return _table(("what", "value"), rows)
