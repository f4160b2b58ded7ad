"""On how many rows a channel's figures rest stands beside them, and in the strip where few do."""

from __future__ import annotations

import re

import numpy as np
import pytest

from hydro_ident.estimate.scoring.scores import Tally
from hydro_ident.mismatch.answer.outcome import EXPLAINED, UNKNOWN, Diagnosis
from hydro_ident.report.channel_rows import ChannelRows, channel_rows
from hydro_ident.report.correlation import FEWEST_ROWS
from hydro_ident.report.diagnosis_verdict import diagnosis_verdict
from hydro_ident.report.identification_report import _rows
from hydro_ident.report.prediction_section import prediction_section
from hydro_ident.report.verdict_words import error_line, few_rows, noise_line
from hydro_model.robot_files import load_robot

ROBOT = load_robot("xs031")


def channel(name: str, count: int, after: float = 139.0, counted: int = 0) -> ChannelRows:
    """Rows at 25 Hz of a channel that was off by 3380 N."""
    t = 0.04 * np.arange(count)
    summary = {
        "rmse_before": 3380.0, "rmse_after": after, "noise_floor": 54.0, "fit_before_pct": -331.0,
        "fit_after_pct": 82.0,
    }  # fmt: skip
    return channel_rows(
        (name, "N"), (t, t, t, t), (t, "joint velocity", "rad/s"), summary, counted
    )


def cells(body: str) -> list[str]:
    """Of the first row of the first table."""
    row = re.findall(r"<tr.*?</tr>", body.partition("</table>")[0], re.DOTALL)[1]
    return [re.sub("<.*?>", "", one) for one in re.findall(r"<td.*?</td>", row, re.DOTALL)]


def test_the_table_has_rows_and_seconds_of_both_sides() -> None:
    one = prediction_section(
        [channel("lift/force", 5)], [channel("lift/force", 250)], ("lift",), ("a", "b")
    )
    assert "5 rows (0.2 s), training 250 rows (10 s)" in cells(one.body)[0]
    assert f"Of lift/force they are of fewer than {FEWEST_ROWS} held-out rows" in one.lead
    enough = prediction_section([channel("lift/force", FEWEST_ROWS)], [], ("lift",), ("a", "b"))
    assert "fewer than" not in enough.lead


def test_the_strip_says_where_the_largest_figures_are_of_few_rows() -> None:
    rows = [channel("tilt/force", 5), channel("lift/force", 400, after=3000.0)]
    [line] = error_line(rows)
    assert "from 3380 to 139 N" in line
    assert "(sensor noise alone: 54), of 5 rows (0.2 s) alone; least in lift/force, to" in line
    [left] = noise_line([channel("tilt/force", 39, after=5400.0)])
    assert left.endswith("100 times sensor noise, most in tilt/force, of 39 rows (1.6 s) alone.")
    cards = dict(diagnosis_verdict(Diagnosis(UNKNOWN, ROBOT, None), rows).cards)
    assert (
        "tilt/force is off by 3380 N, 63 times sensor noise alone, of 5 rows (0.2 s) alone."
        in (cards["What differs"])
    )
    headline = diagnosis_verdict(Diagnosis(EXPLAINED, ROBOT, None), rows[:1]).headline
    assert "(tilt/force" not in headline
    headline = diagnosis_verdict(
        Diagnosis(EXPLAINED, ROBOT, None), [channel("tilt/force", 1, after=5400.0)]
    ).headline
    assert "(tilt/force, of 1 row (0 s) alone)" in headline


@pytest.mark.parametrize(("count", "counted"), [(0, 0), (FEWEST_ROWS, 0), (5, 5000)])
def test_nothing_is_said_where_there_are_enough_or_none(count: int, counted: int) -> None:
    assert few_rows(channel("lift/force", count, counted=counted)) == ""


def test_rows_that_are_not_drawn_count() -> None:
    tally, t = Tally(every=10), 0.04 * np.arange(3000)
    tally.add(t, t, t, t)
    score = tally.score("lift/force", "N", 1.0, ("run",))
    found = type("Found", (), {"given": ROBOT, "inertial": None, "hydraulic": None})()
    [one] = _rows(found, [score])  # type: ignore[arg-type]
    assert one.time_s.size == 300
    assert one.count == 3000
    assert one.seconds == pytest.approx(120.0)
