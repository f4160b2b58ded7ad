"""Figures and tables of errors in the units that people at a machine use, beside SI."""

from __future__ import annotations

import base64
import json
import re
from typing import Any

import numpy as np
import pytest

from hydro_ident.report.channel_rows import ChannelRows, channel_rows
from hydro_ident.report.figure import Axis
from hydro_ident.report.free_run_section import free_run_section
from hydro_ident.report.law_section import LawView, law_section, speed_views
from hydro_ident.report.prediction_section import prediction_section
from hydro_ident.rollouts.free_run import FreeRun, JointRollout

#: m^3/s: 0.6 to 60 l/min.
FLOW = 1e-5 * np.linspace(1.0, 100.0, 500)
TIME = np.arange(500) * 0.02
SUMMARY = {
    "rmse_before": 5.688e-5, "rmse_after": 2.252e-5, "noise_floor": 5e-7, "fit_before_pct": 78.0,
    "fit_after_pct": 91.0,
}  # fmt: skip


def flow_rows() -> ChannelRows:
    names = ("lift/flow_a", "m^3/s")
    speed = (0.5 * np.cos(TIME), "joint velocity", "rad/s")
    return channel_rows(names, (TIME, FLOW, 0.9 * FLOW, 1.1 * FLOW), speed, SUMMARY)


def drawn(html: str) -> list[dict[str, Any]]:
    return [json.loads(text) for text in re.findall(r'application/json">(.*?)</script>', html)]


def values(trace: dict[str, Any], axis: str = "y") -> np.ndarray:
    return np.frombuffer(base64.b64decode(trace[axis]["bdata"]), "<f4")


def test_flows_are_drawn_in_litres_a_minute_and_what_that_is_in_si_is_said() -> None:
    body = prediction_section([flow_rows()], [flow_rows()], ("lift",), ("a", "b")).body
    figure = drawn(body)[0]
    assert figure["layout"]["yaxis"]["title"]["text"] == "flow A in l/min"
    assert figure["layout"]["yaxis2"]["title"]["text"] == "error in l/min"
    lines = {t["name"]: t for t in figure["data"]}
    assert values(lines["measured"])[[0, -1]] == pytest.approx([0.6, 60.0])
    assert values(lines["after"])[-1] == pytest.approx(66.0)
    assert np.nanmax(np.abs(values(lines["a"]))) == pytest.approx(6.0)
    assert np.abs(values(lines["noise ±2σ"])) == pytest.approx(0.06)
    assert "<small>1 l/min = 1.667e-5 m³/s</small>" in body
    close_up = next(d for d in drawn(body) if "yaxis2" not in d["layout"])
    assert close_up["layout"]["yaxis"]["title"]["text"] == "flow A in l/min"
    assert values(close_up["data"][0]).max() > 1.0


def test_errors_of_flows_stand_in_litres_a_minute_below_their_channel() -> None:
    body = prediction_section([flow_rows()], [flow_rows()], ("lift",), ("a", "b")).body
    table = body.partition("</table>")[0]
    assert "<small>3.41 → 1.35 l/min; training 3.41 → 1.35 l/min; " in table
    assert "m³/s" in table
    assert "5.688e-5" in table


def test_angles_are_drawn_in_degrees_and_stand_beside_errors_in_radians() -> None:
    q = np.linspace(0.0, np.pi, TIME.size)
    joint = JointRollout("lift", "rad", 0.04939, 0.01923, 0.1817, 0.07347, TIME, q, q, 0.5 * q)
    section = free_run_section(FreeRun((joint,), 2, 1, 1.0, (), ""), ("lift",)).body
    (figure,) = drawn(section)
    assert figure["layout"]["yaxis"]["title"]["text"] == "position in °"
    assert values(figure["data"][0])[-1] == pytest.approx(180.0)
    assert values(figure["data"][-1])[-1] == pytest.approx(90.0)
    assert "<small>1° = 0.01745 rad</small>" in section
    assert "<small>2.83 → 1.1°; whole run 10.4 → 4.21°</small>" in section


def test_laws_are_drawn_in_the_units_that_their_axes_name() -> None:
    (view,) = speed_views([flow_rows()])
    over_pressure = LawView(
        "law", "why", "lift", Axis("pressure", "Pa"), Axis("lift/force, error", "N"),
        np.linspace(1e5, 2e7, 500), TIME, TIME, np.zeros(500),
    )  # fmt: skip
    body = law_section([view, over_pressure], "", ("lift",)).body
    speed, pressure = drawn(body)
    assert speed["layout"]["xaxis"]["title"]["text"] == "joint velocity in °/s"
    assert np.abs(values(speed["data"][0], "x")).max() == pytest.approx(np.degrees(0.5), rel=1e-3)
    assert values(speed["data"][0]).min() == pytest.approx(-6.0, rel=1e-3)
    assert pressure["layout"]["xaxis"]["title"]["text"] == "pressure in bar"
    assert values(pressure["data"][0], "x")[[0, -1]] == pytest.approx([1.0, 200.0])
    assert values(pressure["data"][0])[-1] == pytest.approx(TIME[-1])
    assert "1°/s = 0.01745 rad/s; 1 l/min = 1.667e-5 m³/s" in body
    assert "<small>1 bar = 100000 Pa</small>" in body


def test_an_axis_in_si_says_nothing_more() -> None:
    axis = Axis("force", "N")
    assert (axis.title, axis.in_si) == ("force in N", "")
    assert axis.of(TIME) is TIME
    assert Axis("share", "1").title == "share (no unit)"
