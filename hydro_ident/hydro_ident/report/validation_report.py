"""Sections of the identification's report: what was lost, the free run, what changed."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

import numpy as np

from hydro_ident.compare import LEVEL, Change, Comparison
from hydro_ident.free_run import FreeRun, JointRollout
from hydro_ident.report.html import bullets, table
from hydro_ident.report.svg import Line, line_plot
from hydro_ident.verdict import BagLoss

_MEASURED, _BEFORE, _AFTER = "#222222", "#c0792a", "#2267b5"


def losses_section(losses: Sequence[BagLoss]) -> str:
    """Channels that a bag does not give, with the reason; empty where there are none."""
    if not losses:
        return ""
    rows = [(loss.bag, loss.channel, loss.reason) for loss in losses]
    return "<h2>Channels lost</h2>" + table(("bag", "channel", "reason"), rows)


def free_run_section(run: FreeRun | None) -> str:
    """Roll-outs from recorded voltages against the recording."""
    if run is None:
        return ""
    parts = ["<h2>Free run from the recorded voltages</h2>", bullets(run.rejected, "no")]
    if run.joints:
        head = ("joint", "unit", "RMSE given", "RMSE identified", "whole run", "whole run")
        rows = [
            (
                j.joint,
                j.unit,
                *(_number(v) for v in (j.rmse_before, j.rmse_after)),
                *(_number(v) for v in (j.whole_before, j.whole_after)),
            )
            for j in run.joints
        ]
        text = (
            f"{run.windows} windows of {run.window_s:.2g} s that took no part in the fit, each"
            f" started from the recorded state; {run.whole_runs} whole runs (given, identified)."
        )
        parts += [f"<p>{escape(text)}</p>", table(head, rows)]
        parts += [_plot(j) for j in run.joints]
    return "\n".join(parts)


def comparison_section(found: Comparison | None) -> str:
    """What changed since an earlier model."""
    if found is None:
        return ""
    head = ("parameter", "before", "now", "change", "unit", "z", "p adjusted", "changed")
    base = ""
    if found.base is not None:
        base = (
            f"<p>All base parameters together: chi-squared {found.base.statistic:.1f} on"
            f" {found.base.freedom}, p = {found.base.p_value:.2g}.</p>"
        )
    text = (
        f"Against {found.old}. A parameter is called changed at the {LEVEL:.0%} level, its p-value"
        f" adjusted for {len(found.changes)} tests (Holm)."
    )
    return "\n".join(
        [
            "<h2>Changes since the earlier model</h2>",
            f"<p>{escape(text)}</p>",
            table(head, [_row(c) for c in found.changes]),
            base,
            bullets(found.notes),
        ]
    )


def _row(c: Change) -> tuple[str, ...]:
    return (
        c.name,
        f"{c.old:.5g}",
        f"{c.new:.5g}",
        f"{c.new - c.old:+.3g}",
        c.unit,
        _number(c.z, "+.2f"),
        _number(c.p_adjusted, ".2g"),
        "yes" if c.changed else "no",
    )


def _number(value: float | None, form: str = ".4g") -> str:
    return "-" if value is None else format(value, form)


def _plot(joint: JointRollout) -> str:
    lines = [Line("measured", _MEASURED, joint.measured)]
    for label, colour, values in (
        ("given robot", _BEFORE, joint.before),
        ("identified", _AFTER, joint.after),
    ):
        if np.isfinite(values).all():
            lines.append(Line(label, colour, values))
    title = f"{joint.joint}, free run"
    return line_plot(title, joint.time_s, lines, "time in s", joint.unit)
