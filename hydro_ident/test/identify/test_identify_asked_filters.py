"""Filters that leave nothing of a recording are told from a recording that is too short."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from hydro_ident.bag.streaming import map_columns
from hydro_ident.estimate.signals.derivatives import FilterSettings
from hydro_ident.identify.asked_filters import usable_filters
from hydro_ident.identify.identification import Settings, identify
from hydro_ident.identify.verdict import judge
from hydro_model.robot_files import load_robot


@pytest.mark.parametrize(
    ("asked", "step_s", "said"),
    [
        (
            FilterSettings(differentiation_hz=200.0),
            0.01,
            "--differentiation-cutoff 200 is more than 100 samples a second bear, and brings"
            " --parallel-cutoff down to 2 Hz: give 40 or less",
        ),
        (
            FilterSettings(parallel_hz=0.5),
            0.002,
            "--parallel-cutoff 0.5 leaves out 12 s at both ends of a stretch: give 10",
        ),
        (FilterSettings(), 0.02, ""),  # slowed, as is usual for such a recording
        (FilterSettings(differentiation_hz=40.0), 0.01, ""),
        (FilterSettings(parallel_hz=20.0), 0.002, ""),
    ],
)
def test_slow_filters_that_were_asked_for_are_told_with_a_usable_value(
    asked: FilterSettings, step_s: float, said: str
) -> None:
    assert usable_filters(asked, step_s) == said


def test_the_value_that_is_named_is_usable() -> None:
    asked = FilterSettings(differentiation_hz=200.0).borne_at(0.01)
    given = FilterSettings(differentiation_hz=asked.differentiation_hz)
    assert given.borne_at(0.01) == given


def test_a_recording_that_filters_leave_nothing_of_is_not_said_to_be_too_short(
    clean: Any,
) -> None:
    """It was to be recorded anew, for longer, where an option had to be given otherwise."""
    slow = clean.recording()
    every = round(0.01 / slow.period_s)
    slow = map_columns(replace(slow, period_s=0.01), lambda values: values[::every])
    asked = Settings(filters=FilterSettings(differentiation_hz=400.0))
    [problem] = [
        p for p in identify(load_robot("xs031"), [slow], settings=asked).problems if "filters" in p
    ]
    assert "are too short for the filters: " in problem
    assert problem.endswith("--parallel-cutoff down to 1 Hz: give 40 or less")
    # With filters by default the recording alone is to blame.
    [problem] = judge(load_robot("xs031"), [slow], None, None).problems
    assert problem.endswith("play a run of `excite --robot xs031` and record it")
