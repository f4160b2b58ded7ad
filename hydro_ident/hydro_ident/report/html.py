"""Pieces of HTML that the reports share."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

STYLE = """
body{font:15px/1.45 system-ui,sans-serif;max-width:900px;margin:2em auto;padding:0 1em;color:#222}
table{border-collapse:collapse;margin:.6em 0 1.6em;font-variant-numeric:tabular-nums}
th,td{padding:.2em .7em;border-bottom:1px solid #ddd;text-align:right}
th:first-child,td:first-child,td.text{text-align:left}
.no{color:#a33}.verdict{font-size:1.2em;font-weight:600}
svg{width:100%;height:auto;margin:.4em 0}svg text{font-size:11px}svg .title{font-weight:600}
svg polyline{fill:none;stroke-width:1.1}svg .grid{stroke:#eee;fill:none}
svg .end{text-anchor:end}svg .mid{text-anchor:middle}code{font-size:.9em}
"""


def opening(kind: str, robot: str, verdict: str) -> tuple[str, ...]:
    """Head of a page, its title and the verdict.

    Parameters
    ----------
    kind, robot, verdict : str
        Plain texts: "Identification", the robot's name, an identifier.

    Returns
    -------
    tuple of str
    """
    title = f"{escape(kind)} of {escape(robot)}"
    return (
        "<!DOCTYPE html>",
        f'<html lang="en"><head><meta charset="utf-8"><title>{title}</title>',
        f"<style>{STYLE}</style></head><body>",
        f"<h1>{title}</h1>",
        f'<p class="verdict">{escape(verdict.replace("_", " "))}</p>',
    )


def bullets(lines: Sequence[str], style: str = "") -> str:
    """A list, empty where there are no lines.

    Parameters
    ----------
    lines : sequence of str
        Plain text.
    style : str
        Class of the list.

    Returns
    -------
    str
    """
    if not lines:
        return ""
    kind = f' class="{style}"' if style else ""
    return f"<ul{kind}>" + "".join(f"<li>{escape(line)}</li>" for line in lines) + "</ul>"


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table of plain texts.

    Parameters
    ----------
    head : sequence of str
    rows : sequence of sequences of str

    Returns
    -------
    str
    """
    top = "".join(f"<th>{escape(h)}</th>" for h in head)
    body = "".join(
        "<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>" for row in rows
    )
    return f"<table><thead><tr>{top}</tr></thead><tbody>{body}</tbody></table>"
