"""The page around a report: its head, sections, tables and scripts."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path

from hydro_ident.everyday_units import beside

_ASSETS = Path(__file__).parent / "assets"
#: Numbers below ten to this power are written without one.
_PLAIN = 6
#: Nothing but what stands in the file itself may run or be shown, whatever the library offers.
_POLICY = (
    "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline';"
    " img-src data: blob:"
)


#: What a plot does, by mouse and by finger: a finger that drags moves the page (`report.js`).
_HINT = (
    '<p class="none hint"><span class="by-mouse">Plots: drag to look closer, double-click to go'
    " back, click a name in a legend to hide its line.</span>"
    '<span class="by-touch">Plots: tap a line to read its values, tap a name in a legend to hide'
    " its line; two fingers enlarge the page.</span> A joint has the same colour everywhere.</p>"
)


@dataclass(frozen=True, slots=True)
class Section:
    """A section of a report.

    Attributes
    ----------
    key, title : str
        Anchor and heading.
    lead : str
        Plain text: what it is, in a sentence.
    body : str
        HTML.
    """

    key: str
    title: str
    lead: str
    body: str

    def html(self) -> str:
        """The section element."""
        return (
            f'<section id="{self.key}"><h2>{escape(self.title)}</h2>'
            f'<p class="lead">{_marked(self.lead)}</p>{self.body}</section>'
        )


@dataclass(frozen=True, slots=True)
class Verdict:
    """What a report says first, in plain words.

    Attributes
    ----------
    tone : str
        `good`, `warn` or `bad`.
    headline : str
    word : str
        The verdict as the result file has it.
    cards : tuple of (str, tuple of str)
        Headings and lines of plain text.
    """

    tone: str
    headline: str
    word: str
    cards: tuple[tuple[str, tuple[str, ...]], ...]

    def html(self) -> str:
        """The strip at the top."""
        cards = "".join(
            f'<div class="card"><h2>{escape(head)}</h2>{bullets(lines)}</div>'
            for head, lines in self.cards
        )
        return (
            f'<section id="verdict" class="verdict {self.tone}">'
            f'<p class="headline">{escape(self.headline)}</p>'
            f'<p class="word">Verdict: {escape(self.word.replace("_", " "))}</p>'
            f'<div class="cards">{cards}</div></section>'
        )


def page(title: str, verdict: Verdict, sections: Sequence[Section]) -> str:
    """A whole report.

    Parameters
    ----------
    title : str
    verdict : Verdict
    sections : sequence of Section

    Returns
    -------
    str
    """
    from plotly.offline import get_plotlyjs

    links = "".join(f'<li><a href="#{s.key}">{escape(s.title)}</a></li>' for s in sections)
    return "\n".join(
        [
            "<!DOCTYPE html>",
            f'<html lang="en"><head><meta charset="utf-8"><title>{escape(title)}</title>',
            f'<meta http-equiv="Content-Security-Policy" content="{_POLICY}">',
            '<meta name="viewport" content="width=device-width,initial-scale=1">',
            f"<style>{_asset('report.css')}</style></head><body>",
            f"<h1>{escape(title)}</h1>",
            verdict.html(),
            f"<nav><ol>{links}</ol></nav>",
            _HINT,
            "<noscript><p>The plots need JavaScript; everything else is here.</p></noscript>",
            *(section.html() for section in sections),
            f"<script>{get_plotlyjs()}</script>",
            f"<script>{_asset('report.js')}</script>",
            "</body></html>\n",
        ]
    )


def _asset(name: str) -> str:
    return (_ASSETS / name).read_text(encoding="utf-8")


def number(value: float | None, digits: int = 4) -> str:
    """A number for reading: few digits, a short exponent; a dash for none."""
    if value is None or not math.isfinite(value):
        return "–"
    mantissa, _, exponent = f"{value:.{digits}g}".partition("e")
    if exponent and 0 < int(exponent) < _PLAIN:
        return f"{float(f'{value:.{digits}g}'):.0f}"
    return mantissa + (f"e{int(exponent)}" if exponent else "")


def bullets(lines: Sequence[str], style: str = "") -> str:
    """A list, empty where there are no lines.

    `style` is a class of the style sheet.
    """
    if not lines:
        return ""
    kind = f' class="{style}"' if style else ""
    return f"<ul{kind}>" + "".join(f"<li>{_marked(line)}</li>" for line in lines) + "</ul>"


def paragraph(text: str, style: str = "none") -> str:
    """A paragraph of plain text.

    `style` is a class of the style sheet.
    """
    return f'<p class="{style}">{_marked(text)}</p>'


def counted(count: int, what: str) -> str:
    """How many of what there are, `what` being one of them."""
    return f"{count} {what}" if count == 1 else f"{count} {what}s"


def percent(share: float, digits: int = 0, sign: str = "") -> str:
    """A share in per cent, with `digits` behind the point; `sign` "+" writes that, too.

    What rounds to nothing and is not nothing is under the last digit.
    """
    text = f"{100.0 * share:{sign}.{digits}f}"
    if float(text) == 0.0:
        text = f"under {10.0**-digits:.{digits}f}" if share else f"{0.0:.{digits}f}"
    return f"{text} %"


#: How the packages' own texts write units and exponents, and how a report does.
_AS_TYPED = (
    (re.compile(r"(?<=\d)e\+?(-?)0*(?=\d)"), r"e\1"),
    (re.compile(r"\^2\b"), "²"),
    (re.compile(r"\^3\b"), "³"),
    (re.compile(r"\bsqrt\(Pa\)"), "√Pa"),
    (re.compile(r"(?<=\d) deg\b(?! C)"), "°"),
    (re.compile(r"(?<= )\+-(?= )"), "±"),
)


#: What `number` writes without an exponent, as `1.5e+02`.
_SHORT = re.compile(rf"(?<![\w.])\d(?:\.\d+)?e\+?0*[1-{_PLAIN - 1}]\b")


def written(text: str) -> str:
    """A text of the packages with units and exponents as the rest of the page has them."""
    text = _SHORT.sub(lambda found: f"{float(found[0]):.10g}", text)
    for typed, read in _AS_TYPED:
        text = typed.sub(read, text)
    return text


def also(values: Sequence[float | None], unit: str, between: str = " … ") -> str:
    """Numbers in the unit that people use beside SI; empty where that is SI, or of none.

    `values` are in the SI unit `unit`, and `between` stands between two of them.
    """
    known = [value for value in values if value is not None]
    return written(beside(known, unit, between)) if known else ""


def _marked(text: str) -> str:
    """Plain text with what stands between backticks as code, and as it is."""
    parts = text.split("`")
    if len(parts) % 2 == 0:
        return escape(written(text))
    kept = (
        f"<code>{escape(part)}</code>" if k % 2 else escape(written(part))
        for k, part in enumerate(parts)
    )
    return "".join(kept)


def folded(title: str, body: str) -> str:
    """What is there for those who ask; empty where there is nothing.

    `body` is HTML.
    """
    return f"<details><summary>{escape(title)}</summary>{body}</details>" if body else ""


@dataclass(frozen=True, slots=True)
class Row:
    """A row of a table that is more than plain cells.

    Attributes
    ----------
    cells : tuple of str
        Plain text.
    below : str
        Small print below the first cell.
    dot : str
        Colour of the joint it belongs to; empty for none.
    off : bool
        Greyed.
    """

    cells: tuple[str, ...]
    below: str = ""
    dot: str = ""
    off: bool = False


def table(
    head: Sequence[str],
    rows: Sequence[Sequence[str] | Row],
    text: Sequence[int] = (),
    *,
    stacked: bool = False,
) -> str:
    """A table.

    Parameters
    ----------
    head : sequence of str
    rows : sequence of Row or of sequences of str
        Plain text.
    text : sequence of int
        Columns of words: flush left, and they wrap.
    stacked : bool
        On a narrow screen a row is a block of its cells with their headings; else it scrolls.

    Returns
    -------
    str
    """
    kinds = [' class="text"' if k in text else "" for k in range(len(head))]
    top = "".join(f"<th{kind}>{escape(h)}</th>" for kind, h in zip(kinds, head, strict=True))
    if stacked:
        kinds = [f'{kind} data-label="{escape(h)}"' for kind, h in zip(kinds, head, strict=True)]
    body = "".join(_row(r if isinstance(r, Row) else Row(tuple(r)), kinds) for r in rows)
    inner = f"<thead><tr>{top}</tr></thead><tbody>{body}</tbody>"
    return f'<div class="scroll{" stack" if stacked else ""}"><table>{inner}</table></div>'


#: Where a long name may go on in the next line of a narrow screen.
_JOINT = re.compile(r"(?<=[a-z][._/])(?=[a-z])")
#: Numbers in which a browser would break the line: behind the exponent's minus.
_BREAKABLE = re.compile(r"-?[\d.]+e-\d+")


def _row(row: Row, kinds: Sequence[str]) -> str:
    dot = f'<span class="dot" style="background:{row.dot}"></span>' if row.dot else ""
    below = f"<small>{escape(written(row.below))}</small>" if row.below else ""
    first, *others = (escape(cell) for cell in row.cells)
    cells = [f"{dot}{_JOINT.sub('<wbr>', first)}{below}"]
    cells += [_BREAKABLE.sub(r'<span class="n">\g<0></span>', cell) for cell in others]
    inner = "".join(f"<td{kind}>{cell}</td>" for kind, cell in zip(kinds, cells, strict=True))
    return f"<tr{' class=' + chr(34) + 'off' + chr(34) if row.off else ''}>{inner}</tr>"
