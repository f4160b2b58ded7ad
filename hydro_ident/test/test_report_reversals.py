"""Close-ups of reversals: of turns with a stop, of training rows where need be, or why none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from hydro_ident.report.channel_rows import ChannelRows, channel_rows
from hydro_ident.report.prediction_section import prediction_section

SUMMARY = dict.fromkeys(
    ("rmse_before", "rmse_after", "noise_floor", "fit_before_pct", "fit_after_pct"), 1.0
)


def channel(stop_s: float, *, turns: bool = True, known: bool = True) -> ChannelRows:
    """A joint that goes one way for 4 s, stands, and goes on or back for 4 s."""
    t = np.arange(0.0, 8.0 + stop_s, 0.02)
    speed = np.where(t < 4.0, 0.3, np.where(t < 4.0 + stop_s, 0.0, -0.3 if turns else 0.3))
    return channel_rows(
        ("lift/force", "N"),
        (t, speed, speed, speed),
        (speed if known else None, "joint velocity", "rad/s"),
        SUMMARY,
    )


def shown(held_out: list[ChannelRows], fitted: list[ChannelRows]) -> str:
    return prediction_section(held_out, fitted, ("lift",), ("before", "after")).body


@pytest.mark.parametrize("stop_s", [0.1, 0.9, 1.5, 2.9])
def test_a_turn_with_a_stop_is_a_reversal_and_motion_is_seen_on_both_sides(stop_s: float) -> None:
    rows = channel(stop_s)
    (turn,) = rows.reversals()
    speed = rows.speed[turn]
    assert speed[0] == 0.3
    assert speed[-1] == -0.3
    assert (speed != 0.0).sum() * 0.02 == pytest.approx(1.5, abs=0.05)


def test_a_long_rest_between_two_motions_is_no_reversal() -> None:
    assert channel(20.0).reversals() == []


def test_training_rows_are_shown_where_held_out_rows_never_turn() -> None:
    body = shown([channel(1.0, turns=False)], [channel(1.0)])
    assert "reversal at 4.5 s, training rows</figcaption>" in body
    assert "No close-up" not in body


def test_held_out_rows_come_first() -> None:
    body = shown([channel(1.0)], [channel(1.0)])
    assert body.count("reversal at") == 2 * 1  # its title and its label
    assert "reversal at 4.5 s, training rows" not in body


def test_training_rows_alone_have_close_ups() -> None:
    assert "reversal at 4.5 s, training rows" in shown([], [channel(1.0)])


def test_a_channel_without_rows_at_a_turn_does_not_deny_the_turn_of_its_neighbour() -> None:
    turning = replace(channel(1.0), name="lift/flow_a")
    body = shown([channel(1.0, turns=False), turning], [])
    assert "lift: flow into chamber A, reversal at 4.5 s" in body
    assert "lift/force has no held-out rows on both sides of a turn" in body
    assert "nowhere" not in body


def test_why_there_is_no_close_up_is_said() -> None:
    straight = channel(1.0, turns=False)
    told = "No close-up of a reversal: lift/force has no {} on both sides of a turn"
    assert told.format("held-out rows or training rows") in shown([straight], [straight])
    assert told.format("training rows") in shown([], [straight])
    unknown = channel(1.0, known=False)
    assert "the motion of the held-out rows is not known" in shown([unknown], [])
