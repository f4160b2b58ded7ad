"""A suggested mapping as a YAML file with its reasons, and as lines for a person."""

from __future__ import annotations

import json
from collections.abc import Iterator

import yaml

from hydro_ident.logs.guess import Guess
from hydro_ident.logs.map import SCHEMA, SECTIONS
from hydro_ident.logs.suggest import Suggestion
from hydro_model.errors import printable

_LEVELS = {"sure": "sure", "likely": "likely", "guess": "a guess", "open": "FILL IN"}
#: Columns of the longest name that the table shows whole.
_WIDEST = 44

_SAID = {"clocks": "      # late_s: how much later than the zero of `time` its zero is"}


def mapping_text(suggestion: Suggestion) -> str:
    """The mapping as YAML.

    Parameters
    ----------
    suggestion : Suggestion

    Returns
    -------
    str
    """
    lines = (*_head(suggestion), *_body(suggestion), *_tail(suggestion))
    # Names of a Parquet file's columns may hold line breaks, and a comment ends at one.
    return "\n".join(map(printable, lines)) + "\n"


def _head(s: Suggestion) -> Iterator[str]:
    yield f"# Suggested for {s.log.path.name}: look at every line before trusting it."
    if s.to_fill_in:
        yield f"# {len(s.to_fill_in)} to fill in: convert refuses FILL_IN."
    yield f"schema: {SCHEMA}"
    if s.robot:
        yield f"robot: {_scalar(s.robot)}"
    else:
        yield "# robot: NAME      # without one the names below are free, and nothing checks them"
    if s.start:
        yield f'start: "{s.start}"      # {s.start_why}'


def _body(s: Suggestion) -> Iterator[str]:
    for guess in s.guesses:
        if guess.section == "time":
            yield f"# {_LEVELS[guess.level]}: {'; '.join(guess.why)}"
            yield f"time: {_flow(guess)}"
    for section in ("clocks", *SECTIONS):
        members = [g for g in s.guesses if g.section == section]
        if members:
            yield f"{section}:{_SAID.get(section, '')}"
        for guess in members:
            yield f"  # {_LEVELS[guess.level]}: {'; '.join(guess.why)}"
            yield f"  {_scalar(guess.name)}: {_flow(guess)}"
    for guess in s.guesses:
        if guess.section == "oil_temperature":
            yield f"# {_LEVELS[guess.level]}: {'; '.join(guess.why)}"
            yield f"oil_temperature: {_flow(guess)}"


def _tail(s: Suggestion) -> Iterator[str]:
    left = [g for g in s.guesses if not g.section]
    if left:
        yield "# Left out:"
    yield from (f"#   {g.column}: {'; '.join(g.why)}" for g in left)
    if s.missing:
        yield f"# The robot has these too, and no column looks like them: {'; '.join(s.missing)}"


def _flow(guess: Guess) -> str:
    pairs = [f"{k}: {_scalar(value)}" for k, value in guess.entry.items()]
    return "{" + ", ".join(pairs) + "}"


def _scalar(value: object) -> str:
    """A value on one line, quoted where YAML would read it otherwise."""
    if not isinstance(value, str):
        return json.dumps(value)
    style = None if value.isprintable() else '"'  # in which line breaks are escaped
    plain = yaml.safe_dump(
        [value], default_flow_style=True, default_style=style, width=10_000, allow_unicode=True
    )
    return plain.strip()[1:-1]


def lines_of(suggestion: Suggestion) -> list[str]:
    """The suggestion as a table.

    Parameters
    ----------
    suggestion : Suggestion

    Returns
    -------
    list of str
    """
    rows = [("column", "becomes", "", "because")]
    for g in suggestion.guesses:
        units = [str(g.entry[key]) for key in ("unit", "reference") if key in g.entry]
        into = f"{g.section}{', ' if g.name else ''}{g.name} {' '.join(units)}".strip() or "-"
        # Names that are long differ at their end: `rec.signals.LABEL`.
        name = printable(g.column)
        name = name if len(name) <= _WIDEST else f"…{name[1 - _WIDEST :]}"
        rows.append((name, into, _LEVELS[g.level] if g.section else "", "; ".join(g.why)))
    widths = [max(len(row[k]) for row in rows) for k in range(3)]
    lines = [
        printable(" ".join(f"{cell:{w}s}" for cell, w in zip(row, [*widths, 0], strict=True)))
        for row in rows
    ]
    lines += [printable(f"to fill in: {text}") for text in suggestion.to_fill_in]
    lines += [f"no column for: {text}" for text in suggestion.missing]
    return lines
