"""Residuals against the variable that matters, with the law that was found drawn through them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hydro_ident.report.channel_rows import ChannelRows
from hydro_ident.report.figure import Axis, Figure, band, dots, line
from hydro_ident.report.page import Section, paragraph
from hydro_ident.report.palette import BEFORE, INK, joint_colour
from hydro_model.robot import FloatArray

#: Bins of equal numbers of rows, and the fewest rows in one.
_BINS, _FEWEST = 48, 5
#: Shares of the rows of a bin between the ends of its band.
_LOW, _HIGH = 0.1, 0.9


@dataclass(frozen=True, slots=True)
class LawView:
    """A law against the variable that it is best seen against.

    Attributes
    ----------
    title, note : str
    joint : str
    x_axis, y_axis : Axis
    x, residual : (N,) array
        The variable, and what the model without this law leaves; SI.
    law, left : (N,) array or None
        What the law says of each row, and what is left with it; None where none was looked for.
    legend : str
        What the law is called: only what was named is one.
    """

    title: str
    note: str
    joint: str
    x_axis: Axis
    y_axis: Axis
    x: FloatArray
    residual: FloatArray
    law: FloatArray | None
    left: FloatArray | None
    legend: str = "law"


def law_section(views: Sequence[LawView], lead: str, joints: Sequence[str]) -> Section:
    """The section."""
    title = "Residuals against what matters"
    if not views:
        return Section("laws", title, lead, paragraph("No channel left a residual to look at."))
    body = "".join(_figure(view, joint_colour(joints, view.joint)).html() for view in views)
    return Section("laws", title, lead, f'<div class="pair">{body}</div>')


def speed_views(channels: Sequence[ChannelRows]) -> list[LawView]:
    """Residuals against the motion, where no law was looked for."""
    views = []
    for one in channels:
        if not np.isfinite(one.speed).any():
            continue
        views.append(
            LawView(
                title=one.title,
                note=one.remark,
                joint=one.joint,
                x_axis=Axis(one.speed_name, one.speed_unit),
                y_axis=Axis("error", one.unit),
                x=one.speed,
                residual=one.residuals[1],
                law=None,
                left=None,
            )
        )
    return views


def _figure(view: LawView, colour: str) -> Figure:
    across, up = view.x_axis.of, view.y_axis.of
    x, residual = across(view.x), up(view.residual)
    traces = [dots("residual", (x, residual), BEFORE)]
    if view.law is None or view.left is None:
        at, middle, low, high = binned(x, residual)
        traces.append(band("80 % of rows", at, low, high, legend=False))
        traces.append(line("median", (at, middle), colour, width=3.0))
    else:
        at, middle, low, high = binned(x, up(view.law))
        traces.append(band("80 % of rows", at, low, high, legend=False))
        traces.append(line(view.legend, (at, middle), colour, width=3.0))
        at, middle, _, _ = binned(x, up(view.left))
        traces.append(line("left", (at, middle), INK, dash="dash"))
    return Figure(view.title, view.x_axis, (view.y_axis,), traces, note=view.note)


def binned(x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Medians of ``x`` and ``y`` over bins of equal numbers of rows, and the band of ``y``."""
    known = np.isfinite(x) & np.isfinite(y)
    x, y = x[known], y[known]
    order = np.argsort(x, kind="stable")
    count = max(1, min(_BINS, order.size // _FEWEST))
    columns = [
        (np.median(x[rows]), np.median(y[rows]), *np.quantile(y[rows], (_LOW, _HIGH)))
        for rows in np.array_split(order, count)
        if rows.size
    ]
    at, middle, low, high = np.array(columns).reshape(-1, 4).T
    return at, middle, low, high
