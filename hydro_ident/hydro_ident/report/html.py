"""Pieces of HTML that the reports share."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape


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
