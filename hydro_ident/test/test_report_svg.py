"""Inline plots: well-formed, thinned without losing peaks, broken at gaps."""

from __future__ import annotations

from xml.etree import ElementTree

import numpy as np

from hydro_ident.report.svg import HEIGHT, WIDTH, Line, line_plot


def _plot(x: np.ndarray, *ys: np.ndarray) -> ElementTree.Element:
    lines = [Line(f"line {k}", "#123456", y) for k, y in enumerate(ys)]
    return ElementTree.fromstring(line_plot("a < b & c", x, lines, "t in s", "N"))


def _points(root: ElementTree.Element) -> list[np.ndarray]:
    return [
        np.array([[float(v) for v in p.split(",")] for p in line.attrib["points"].split()])
        for line in root.iter("polyline")
    ]


def test_a_plot_is_well_formed_and_inside_its_frame() -> None:
    x = np.linspace(0.0, 10.0, 300)
    for points in _points(_plot(x, np.sin(x), 2.0 * np.cos(x))):
        assert np.all(points >= 0.0)
        assert np.all(points[:, 0] <= WIDTH)
        assert np.all(points[:, 1] <= HEIGHT)


def test_a_peak_of_one_sample_survives_thinning() -> None:
    x = np.linspace(0.0, 10.0, 100_000)
    y = np.zeros_like(x)
    y[61_234] = 1.0
    (points,) = _points(_plot(x, y))
    assert len(points) < 2000
    assert points[:, 1].min() < points[0, 1] - 100.0


def test_lines_break_where_time_jumps() -> None:
    x = np.concatenate([np.arange(100) * 0.1, 50.0 + np.arange(100) * 0.1])
    assert [len(p) for p in _points(_plot(x, np.sin(x)))] == [100, 100]


def test_a_constant_or_single_sample_still_plots() -> None:
    assert len(_points(_plot(np.arange(5.0), np.full(5, 3.0)))) == 1
    assert len(_points(_plot(np.array([1.0]), np.array([2.0])))) == 1
