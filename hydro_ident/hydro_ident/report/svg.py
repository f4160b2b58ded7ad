"""Line plots as inline SVG: what a report needs and no more."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from html import escape
from itertools import pairwise

import numpy as np

from hydro_model.robot import FloatArray

WIDTH, HEIGHT = 860, 240
_LEFT, _RIGHT, _TOP, _BOTTOM = 78, 10, 26, 34
#: More points than this cannot be seen; extremes of each bin are kept.
_BINS = 430

#: Coordinates to the text of SVG points.
_Place = Callable[[FloatArray, FloatArray], str]


@dataclass(frozen=True, slots=True)
class Line:
    """One line of a plot.

    Attributes
    ----------
    label, colour : str
    y : (N,) array
    """

    label: str
    colour: str
    y: FloatArray


def line_plot(title: str, x: FloatArray, lines: Sequence[Line], x_label: str, y_label: str) -> str:
    """An SVG element with axes, a legend and one polyline per line.

    Parameters
    ----------
    title, x_label, y_label : str
    x : (N,) array
        Ascending; jumps of more than ten median steps break the lines.
    lines : sequence of Line

    Returns
    -------
    str
    """
    low, high = _range(np.concatenate([line.y for line in lines]))
    start, end = _range(x)

    def place(px: FloatArray, py: FloatArray) -> str:
        across = _LEFT + (px - start) / (end - start) * (WIDTH - _LEFT - _RIGHT)
        down = HEIGHT - _BOTTOM - (py - low) / (high - low) * (HEIGHT - _TOP - _BOTTOM)
        return " ".join(f"{a:.1f},{d:.1f}" for a, d in zip(across, down, strict=True))

    parts = [
        f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" role="img" aria-label="{escape(title)}">',
        f'<text x="{_LEFT}" y="15" class="title">{escape(title)}</text>',
        *_axis(start, end, low, high, place),
    ]
    for line in lines:
        for piece in _pieces(x):
            points = place(*_thinned(x[piece], line.y[piece]))
            parts.append(f'<polyline points="{points}" stroke="{line.colour}"/>')
    parts += _legend(lines)
    middle = (WIDTH + _LEFT) / 2
    parts.append(f'<text x="{middle}" y="{HEIGHT - 4}" class="mid">{escape(x_label)}</text>')
    turn = f'transform="rotate(-90 12 {HEIGHT / 2})"'
    parts.append(f'<text x="12" y="{HEIGHT / 2}" class="mid" {turn}>{escape(y_label)}</text>')
    return "\n".join([*parts, "</svg>"])


def _range(values: FloatArray) -> tuple[float, float]:
    low, high = float(np.min(values)), float(np.max(values))
    if high <= low:
        pad = abs(low) * 0.05 or 1.0
        return low - pad, high + pad
    return low, high


def _axis(start: float, end: float, low: float, high: float, place: _Place) -> list[str]:
    parts = []
    for value in _ticks(low, high):
        across, down = place(np.array([start]), np.array([value])).split(",")
        parts.append(f'<path d="M{across} {down}H{WIDTH - _RIGHT}" class="grid"/>')
        parts.append(
            f'<text x="{_LEFT - 5}" y="{float(down) + 4:.1f}" class="end">{value:.4g}</text>'
        )
    for value in _ticks(start, end):
        across, down = place(np.array([value]), np.array([low])).split(",")
        parts.append(f'<path d="M{across} {down}V{_TOP}" class="grid"/>')
        parts.append(
            f'<text x="{across}" y="{float(down) + 14:.1f}" class="mid">{value:.4g}</text>'
        )
    return parts


def _ticks(low: float, high: float) -> list[float]:
    rough = (high - low) / 5.0
    unit = 10.0 ** math.floor(math.log10(rough))
    step = next(unit * k for k in (1.0, 2.0, 5.0, 10.0) if unit * k >= rough)
    first = math.ceil(low / step)
    return [k * step for k in range(first, math.floor(high / step) + 1)]


def _pieces(x: FloatArray) -> list[slice]:
    steps = np.diff(x)
    if steps.size == 0:
        return [slice(0, x.size)]
    jumps = np.flatnonzero((steps > 10.0 * np.median(steps)) | (steps < 0.0)) + 1
    edges = [0, *jumps.tolist(), x.size]
    return [slice(a, b) for a, b in pairwise(edges)]


def _thinned(x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    if x.size <= 2 * _BINS:
        return x, y
    edges = np.linspace(0, x.size, _BINS + 1).astype(int)
    kept = []
    for a, b in pairwise(edges):
        kept += sorted({a + int(np.argmin(y[a:b])), a + int(np.argmax(y[a:b]))})
    return x[kept], y[kept]


def _legend(lines: Sequence[Line]) -> list[str]:
    parts, across = [], WIDTH - _RIGHT
    for line in reversed(lines):
        across -= 14 + 7 * len(line.label)
        parts.append(f'<text x="{across}" y="15" fill="{line.colour}">{escape(line.label)}</text>')
    return parts
