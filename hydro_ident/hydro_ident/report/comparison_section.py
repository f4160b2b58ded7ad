"""What changed since an earlier model."""

from __future__ import annotations

from html import escape
from pathlib import PurePath

from hydro_ident.identify.compare import Change, Comparison
from hydro_ident.identify.validation_results import comparison_text, joint_text
from hydro_ident.report.figure import unit_text
from hydro_ident.report.page import bullets, number, table


def comparison_part(found: Comparison | None) -> str:
    """The comparison; empty where none was asked for."""
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
    return "".join(
        [
            "<h3>Changes since the earlier model</h3>",
            f"<p>{escape(text)}</p>",
            table(head, [_row(c) for c in found.changes]),
            base,
            bullets([note.replace(found.old, old) for note in found.notes]),
        ]
    )


def _row(c: Change) -> tuple[str, ...]:
    return (
        c.name,
        number(c.old, 5),
        number(c.new, 5),
        f"{c.new - c.old:+.3g}",
        unit_text(c.unit),
        "–" if c.z is None else f"{c.z:+.2f}",
        "–" if c.test is None else f"{c.test.p_adjusted:.2g}",
        "unknown" if c.test is None else c.test.outcome,
    )
