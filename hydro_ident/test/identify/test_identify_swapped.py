"""Signals that were swapped are told from physics that is left out, and named."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from hydro_ident.bag.recording import Recording
from hydro_ident.identify.identification import Identification, identify
from hydro_model.robot import EffectSpec
from hydro_model.robot_files import load_robot

pytestmark = pytest.mark.needs("clarabel")


def problem_of(found: Identification, what: str) -> str:
    [text] = [text for text in found.problems if text.startswith(what)]
    return text


def with_columns(recording: Recording, **sources: list[tuple[str, int]]) -> Recording:
    """A recording whose columns are those of other fields, by field and column."""
    made = {
        name: np.column_stack([getattr(recording, field)[:, k] for field, k in columns])
        for name, columns in sources.items()
    }
    return replace(recording, **made)


def test_swapped_chambers_are_rejected_and_named(clean: Any) -> None:
    swapped = with_columns(
        clean.recording(), p_a=[("p_b", 0), ("p_a", 1)], p_b=[("p_a", 0), ("p_b", 1)]
    )
    found = identify(load_robot("xs031"), [swapped])
    assert found.verdict == "partly_identified"
    text = problem_of(found, "hydraulics of lift_cylinder rejected")
    assert "lift/flow_a goes by lift_cylinder/b in the place of lift_cylinder/a (resid" in text
    assert "lift/flow_b goes by lift_cylinder/a in the place of lift_cylinder/b (resid" in text
    assert text.endswith("likely swapped, in the mapping or the wiring")
    assert "these pressures are likely swapped" in problem_of(found, "forces rejected")
    assert not any("tilt_cylinder rejected" in text for text in found.problems)
    assert found.robot is not None
    given, kept = found.given.valves, found.robot.valves
    assert kept[0] == given[0]
    assert kept[1] != given[1]


def test_one_pressure_of_each_of_two_cylinders_swapped_is_named(clean: Any) -> None:
    swapped = with_columns(clean.recording(), p_a=[("p_a", 1), ("p_a", 0)])
    found = identify(load_robot("xs031"), [swapped])
    text = problem_of(found, "forces rejected")
    assert "tilt_cylinder/a in the place of lift_cylinder/a" in text
    assert "lift_cylinder/a in the place of tilt_cylinder/a" in text
    assert "_cylinder/b" not in text
    assert not any(p.identifiable for p in found.parameters if p.name.startswith("lift_valve"))


def test_swapped_valves_are_named_and_forces_stay(clean: Any) -> None:
    swapped = with_columns(clean.recording(), valve_v=[("valve_v", 1), ("valve_v", 0)])
    found = identify(load_robot("xs031"), [swapped])
    text = problem_of(found, "hydraulics of tilt_cylinder rejected")
    assert "the signal of lift_valve in the place of tilt_valve's" in text
    assert "to tell them" not in text
    assert not any(text.startswith("forces rejected") for text in found.problems)


def test_physics_that_is_left_out_is_no_exchange(driven: Callable[..., Any]) -> None:
    """A valve that is off its null by 8 %: its flows are predicted by half."""
    run = driven(18.0, (EffectSpec("valve_null_bias", "xs031", {"bias": 0.08}),))
    found = identify(load_robot("xs031"), [run.recording()])
    fits = [c.summary()["fit_after_pct"] for c in found.channels if "flow" in c.name]
    assert min(map(float, fits)) < 80.0
    assert not any("likely swapped" in text for text in found.problems)
