"""Residual auto- and cross-correlation with their bands."""

from __future__ import annotations

from collections.abc import Sequence

from hydro_ident.report.channel_rows import ChannelRows
from hydro_ident.report.correlation import (
    Correlogram,
    autocorrelation,
    cross_correlation,
    why_none,
)
from hydro_ident.report.figure import Figure, band, line
from hydro_ident.report.page import Row, Section, paragraph, percent, table
from hydro_ident.report.palette import BEFORE, joint_colour

_LEAD = (
    "What is left should look like noise. Inside the grey band a correlation may be chance (95 %);"
    " one lag in twenty lies outside by chance. A residual that goes with the motion, or with"
    " itself beyond the first tenth of a second (so far the filters tie neighbours together),"
    " still holds physics."
)


def correlation_section(channels: Sequence[ChannelRows], joints: Sequence[str]) -> Section:
    """The section, of the residuals after on the rows given."""
    title = "Residual correlation"
    rows, figures = [], []
    for one in channels:
        colour = joint_colour(joints, one.joint)
        before, after = one.residuals
        own = [autocorrelation(one.time_s, r) for r in (before, after)]
        cross = [cross_correlation(one.time_s, r, one.speed) for r in (before, after)]
        name = one.speed_name
        pair = [
            _figure(f"{one.title}: with itself", "lag in s", own, colour),
            _figure(f"{one.title}: with {name}", f"lag behind the {name} in s", cross, colour),
        ]
        figures.append('<div class="pair">' + "".join(pair) + "</div>")
        shares = [_share(c) for c in (*own, *cross)]
        why = why_none(after, "the residual") or why_none(one.speed, f"the {name}")
        below = "; ".join(filter(None, (one.remark, why)))
        rows.append(Row((one.name, *shares), below=below, dot=colour, off=one.rejected))
    if not rows:
        return Section("correlation", title, _LEAD, paragraph("No residual to correlate."))
    head = ("channel", "with itself: before", "after", "with the motion: before", "after")
    body = paragraph("Share of the lags outside the band:", "") + table(head, rows)
    return Section("correlation", title, _LEAD, body + "".join(figures))


def _share(found: Correlogram | None) -> str:
    return "–" if found is None else percent(found.outside)


def _figure(title: str, x: str, found: Sequence[Correlogram | None], colour: str) -> str:
    before, after = found
    if before is None or after is None:
        return ""
    around = band("95 % band, after", after.lag_s, -after.band, after.band)
    traces = [
        around,
        line("before", (before.lag_s, before.value), BEFORE, dash="dot"),
        line("after", (after.lag_s, after.value), colour, width=2.0),
    ]
    return Figure(title, x, ("correlation (no unit)",), traces).html()
