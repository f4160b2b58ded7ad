"""Figures as plotly takes them: plain data, thinned honestly, a title and a unit on every axis.

Shared arguments: `xy` are both coordinates; `panel` is the number of the diagram, from the top;
`colour`, `dash` and `width` (px) are the line's; `legend` says whether it is listed there; `low`
and `high` are the band's edges. `x` is broken where it jumps, `y` goes with it.
"""

from __future__ import annotations

import base64
import json
import math
from dataclasses import dataclass, field
from html import escape
from itertools import pairwise
from typing import Any

import numpy as np

from hydro_ident.everyday_units import everyday
from hydro_ident.report.page import number, written
from hydro_ident.report.palette import BAND
from hydro_model.robot import FloatArray

#: Bins of a line; the extremes of each are kept, so that no peak is lost.
BINS = 400
#: Points of a cloud.
DOTS = 1500
#: Pixels of one panel and of what stands around it.
_PANEL, _FRAME, _LINE = 190, 90, 22
#: A line breaks where a step is so many times the median one.
_JUMP = 10.0
#: How the packages write units, and how people do.
_SIGNS = (("^2", "²"), ("^3", "³"), ("sqrt(Pa)", "√Pa"), ("degC", "°C"), ("deg", "°"))
#: Seconds between recordings that are drawn one after the other.
APART_S = 2.0


@dataclass(frozen=True, slots=True)
class Axis:
    """An axis of a quantity, in the unit that people use.

    What that is in SI stands below the title of the figure: m^3/s would be told in 1e-5.

    Attributes
    ----------
    name : str
    unit : str
        In SI, as the packages write it; empty or 1 for none.
    """

    name: str
    unit: str

    @property
    def title(self) -> str:
        """With its unit."""
        if self.unit in ("", "1"):
            return f"{self.name} (no unit)"
        return f"{self.name} in {unit_text(self._told()[0])}"

    @property
    def in_si(self) -> str:
        """What one of its unit is in SI; empty where that is its unit."""
        unit, scale = self._told()
        if unit == self.unit:
            return ""
        one = f"1{unit_text(unit)}" if unit.startswith("deg") else f"1 {unit_text(unit)}"
        return f"{one} = {number(1.0 / scale)} {unit_text(self.unit)}"

    def of(self, values: FloatArray) -> FloatArray:
        """Values of SI as they are drawn along it."""
        scale = self._told()[1]
        return values if scale == 1.0 else np.asarray(scale * values)

    def _told(self) -> tuple[str, float]:
        return everyday(self.unit) or (self.unit, 1.0)


def unit_text(unit: str) -> str:
    """A unit as people write it."""
    for typed, read in _SIGNS:
        unit = unit.replace(typed, read)
    return "–" if unit in ("", "1", "-") else unit


@dataclass(frozen=True, slots=True)
class Figure:
    """One figure of a report.

    Attributes
    ----------
    title, note : str
        Plain text; the note says how to read it.
    x : Axis or str
        The horizontal axis, or its title with its unit.
    panels : tuple of Axis or str
        The vertical axes, from above; they share the horizontal one.
    traces : list of dict
        As plotly takes them.
    layout : dict
        What the horizontal axis and the figure need beyond that.
    rows : int
        Names on a vertical axis of names; 0 where it is one of numbers.
    tall : float
        Height of a panel over the usual one.
    """

    title: str
    x: Axis | str
    panels: tuple[Axis | str, ...]
    traces: list[dict[str, Any]] = field(default_factory=list)
    layout: dict[str, Any] = field(default_factory=dict)
    note: str = ""
    rows: int = 0
    tall: float = 1.0

    def as_dict(self) -> dict[str, Any]:
        """For plotly."""
        count = len(self.panels)
        across = {"title": {"text": _title(self.x)}}
        layout: dict[str, Any] = {"xaxis": across, **self.layout}
        layout["xaxis"] = {**across, **layout["xaxis"]}
        layout["xaxis"]["anchor"] = _axis("y", count - 1)
        for k, panel in enumerate(self.panels):
            # Without gaps: how much of the height they take, the page knows when it draws.
            top, bottom = 1.0 - k / count, 1.0 - (k + 1) / count
            layout[f"yaxis{k + 1 if k else ''}"] = {
                "title": {"text": _title(panel)},
                "domain": [round(max(bottom, 0.0), 4), round(top, 4)],
                "anchor": "x",
            }
        if self.rows:
            names = {"text": _title(self.panels[0]), "standoff": 12}
            layout["yaxis"] |= {"autorange": "reversed", "dtick": 1, "title": names}
        return {"data": self.traces, "layout": layout}

    def html(self) -> str:
        """The figure element; its data stand beside it as JSON."""
        data = json.dumps(self.as_dict(), separators=(",", ":"), allow_nan=False)
        axes = [one for one in (self.x, *self.panels) if isinstance(one, Axis)]
        in_si = "; ".join(dict.fromkeys(one.in_si for one in axes if one.in_si))
        notes = (written(self.note), in_si)
        note = "".join(f"<small>{escape(text)}</small>" for text in notes if text)
        height = _FRAME + (_LINE * self.rows or round(_PANEL * self.tall) * len(self.panels))
        return (
            f"<figure><figcaption>{escape(self.title)}{note}</figcaption>"
            f'<div class="canvas{" names" if self.rows else ""}" role="img"'
            f' aria-label="{escape(self.title)}" style="--height:{height}px"></div>'
            f'<script type="application/json">{data.replace("<", chr(92) + "u003c")}</script>'
            "</figure>"
        )


def _title(axis: Axis | str) -> str:
    return axis.title if isinstance(axis, Axis) else axis


def _axis(letter: str, panel: int) -> str:
    return letter if panel == 0 else f"{letter}{panel + 1}"


def line(
    name: str,
    xy: tuple[FloatArray, FloatArray],
    colour: str,
    *,
    panel: int = 0,
    dash: str = "solid",
    width: float = 1.5,
    legend: bool = True,
) -> dict[str, Any]:
    """A line, thinned to the extremes of `BINS` bins and broken where `x` jumps."""
    x, y = thinned(*xy)
    style = {"color": colour, "width": width, "dash": dash}
    return _trace(name, x, y, panel, legend) | {"mode": "lines", "line": style}


def path(
    name: str, xy: tuple[FloatArray, FloatArray], colour: str, *, dash: str = "solid"
) -> dict[str, Any]:
    """A way through a plane, in order, thinned to the extremes of both of its coordinates."""
    kept = np.union1d(*(_extremes(values, BINS) for values in xy))
    style = {"color": colour, "width": 1.0, "dash": dash}
    x, y = (values[kept] for values in xy)
    return _trace(name, x, y, 0, True) | {"mode": "lines", "line": style}


def dots(
    name: str, xy: tuple[FloatArray, FloatArray], colour: str, *, panel: int = 0
) -> dict[str, Any]:
    """A cloud of points, of many every so many-th."""
    x, y = xy
    known = np.isfinite(x) & np.isfinite(y)
    every = max(1, math.ceil(int(known.sum()) / DOTS))
    x, y = x[known][::every], y[known][::every]
    style = {"color": colour, "size": 4, "opacity": 0.45}
    return _trace(name, x, y, panel, True) | {"mode": "markers", "marker": style}


def band(
    name: str,
    x: FloatArray,
    low: FloatArray,
    high: FloatArray,
    *,
    panel: int = 0,
    legend: bool = True,
) -> dict[str, Any]:
    """A shaded band between two lines."""
    both = np.concatenate([low, high[::-1]])
    around = _trace(name, np.concatenate([x, x[::-1]]), both, panel, legend)
    look = {"mode": "lines", "fill": "toself", "fillcolor": BAND, "line": {"width": 0}}
    return around | look | {"hoverinfo": "skip"}


def _trace(name: str, x: FloatArray, y: FloatArray, panel: int, legend: bool) -> dict[str, Any]:
    return {
        "type": "scatter",
        "name": name,
        "x": numbers(x),
        "y": numbers(y),
        "xaxis": "x",
        "yaxis": _axis("y", panel),
        "showlegend": legend,
    }


def numbers(values: FloatArray) -> dict[str, str]:
    """Values in single precision, as plotly reads them from little space; NaN is a gap."""
    plain = np.ascontiguousarray(values, dtype="<f4").tobytes()
    return {"dtype": "f4", "bdata": base64.b64encode(plain).decode("ascii")}


def thinned(x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The extremes of every bin of a line, in order; NaN where `x` jumps."""
    xs, ys = list[FloatArray](), list[FloatArray]()
    for piece in pieces(x):
        share = max(2, math.ceil(BINS * (piece.stop - piece.start) / max(x.size, 1)))
        kept = piece.start + _extremes(y[piece], share)
        xs += [x[kept], np.array([np.nan])]
        ys += [y[kept], np.array([np.nan])]
    return np.concatenate([np.zeros(0), *xs[:-1]]), np.concatenate([np.zeros(0), *ys[:-1]])


def _extremes(y: FloatArray, bins: int) -> np.ndarray[Any, np.dtype[np.intp]]:
    """Indices of the smallest and the largest value of every bin, and of the ends."""
    if y.size <= 2 * bins:
        return np.arange(y.size)
    edges = np.linspace(0, y.size, bins + 1).astype(int)
    # Bins as rows of one width; a row's surplus holds its first sample again.
    width = np.arange(np.diff(edges).max())[None]
    at = np.where(width < np.diff(edges)[:, None], edges[:-1, None] + width, edges[:-1, None])
    at = at[np.isfinite(y[at]).any(axis=1)]
    rows = np.arange(at.shape[0])
    kept = [at[rows, np.nanargmin(y[at], axis=1)], at[rows, np.nanargmax(y[at], axis=1)]]
    return np.unique(np.concatenate([[0, y.size - 1], *kept]))


def pieces(x: FloatArray) -> list[slice]:
    """Stretches between jumps, forwards or backwards."""
    if not x.size:
        return []
    steps = np.diff(x)
    usual = float(np.median(steps[steps > 0.0])) if (steps > 0.0).any() else 0.0
    jumps = np.flatnonzero((steps > _JUMP * usual) | (steps < 0.0)) + 1
    return [slice(a, b) for a, b in pairwise([0, *jumps.tolist(), x.size])]


def one_after_another(time_s: FloatArray) -> FloatArray:
    """Times that go on where those of the next recording start again."""
    back = np.flatnonzero(np.diff(time_s) < 0.0) + 1
    result = time_s.copy()
    for at in back.tolist():
        result[at:] += result[at - 1] - result[at] + APART_S
    return result
