"""Sections of the identification's report: what was lost, the free run, what changed."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from pathlib import PurePath

import numpy as np

from hydro_ident.compare import Change, Comparison
from hydro_ident.free_run import FreeRun, JointRollout
from hydro_ident.report.html import bullets, table
from hydro_ident.report.svg import Line, line_plot
from hydro_ident.validation_results import comparison_text, joint_text
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
        errors = ("RMSE given", "RMSE identified")
        head = ("joint", "unit", *errors, *(f"whole run {e}" for e in errors))
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
    head = ("parameter", "before", "now", "change", "unit", "z", "p adjusted", "outcome")
    base = ""
    if found.base is not None:
        base = f"<p>All base parameters together: {escape(joint_text(found.base))}.</p>"
    # The report may be passed on: a model's folder and name say which, a whole path too much.
    old = "/".join(PurePath(found.old).parts[-2:])
    text = (
        f"Against {old}: {comparison_text(found)}. z is the change over its standard deviation,"
        " that of noise and of what physics left out of the model may make together."
    )
    return "\n".join(
        [
            "<h2>Changes since the earlier model</h2>",
            f"<p>{escape(text)}</p>",
            table(head, [_row(c) for c in found.changes]),
            base,
            bullets([note.replace(found.old, old) for note in found.notes]),
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
        "-" if c.test is None else f"{c.test.p_adjusted:.2g}",
        "unknown" if c.test is None else c.test.outcome,
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
