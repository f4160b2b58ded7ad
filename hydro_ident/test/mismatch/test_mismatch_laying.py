"""Rows are laid out where their samples are, whatever their stamps do, and of what was read."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from hydro_ident.bag.recording import Recording
from hydro_ident.errors import NotEnoughDataError
from hydro_ident.estimate.flows.chambers import WindowSettings
from hydro_ident.estimate.signals.derivatives import FilterSettings
from hydro_ident.estimate.signals.traces import traces_of
from hydro_ident.identify.survey import survey_source
from hydro_ident.mismatch.answer.diagnosis import diagnose
from hydro_ident.mismatch.answer.outcome import EXPLAINED, PARTLY
from hydro_ident.mismatch.rows.laying import material_of
from hydro_ident.mismatch.rows.material import Material
from hydro_ident.mismatch.settings import DiagnosisSettings
from hydro_ident.mismatch.split.one_pressure import half_read
from hydro_ident.mismatch.split.residuals import own_forces, residuals
from hydro_ident.recordings.sources import sources_of
from hydro_model.robot import EffectSpec, Robot
from hydro_model.robot_files import load_robot

LEAK = EffectSpec("internal_leakage", "lift_cylinder", {"coefficient": 1e-12})
BIAS = EffectSpec("valve_null_bias", "lift_cylinder", {"bias": 0.02})


def test_balances_start_at_the_same_samples_when_stamps_jitter(crane_run, robot: Robot) -> None:
    [trace] = traces_of([crane_run.recording()])
    late = 0.3 * trace.step_s * np.random.default_rng(1).normal(size=trace.samples)
    starts = []
    for time_s in (trace.time_s, np.sort(trace.time_s + late)):
        forces = own_forces(robot, torque=False)
        stamped = [replace(trace, time_s=time_s)]
        laid = material_of(robot, forces, stamped, FilterSettings(), WindowSettings(), {})
        starts.append(laid.stretches[0].starts)
    assert all(some.size for some in starts[0])
    for regular, jittered in zip(*starts, strict=True):
        np.testing.assert_array_equal(jittered, regular)


@pytest.mark.thorough
@pytest.mark.parametrize("slow_first", [True, False])
def test_recordings_of_other_rates_leave_the_rows_of_one_as_they_are(
    crane_run, robot: Robot, slow_first: bool
) -> None:
    """How far a delay reaches is a time: fewer samples of a slow recording than of a quick one."""
    quick = crane_run.recording("quick")
    slow = crane_run.recording(
        "slow",
        period_s=5 * quick.period_s,
        **{
            name: getattr(quick, name)[::5]
            for name in ("stamp_ns", "q", "p_a", "p_b", "supply", "tank", "valve_v", "latched")
        },
        command_v=None,
    )

    def starts(*recordings: Recording) -> dict[str, tuple[np.ndarray, ...]]:
        sources = sources_of(recordings)
        surveys = [survey_source(source, robot) for source in sources]
        work = residuals(robot, sources, [], surveys, DiagnosisSettings())
        assert work is not None
        laid = work.training.predictor.material
        for place in (p for p in laid.places if laid.is_flow(p.channel)):
            predicted = work.training.predictor.base(work.base.model)[1][place.rows]
            assert predicted.any(axis=1).all()
        return {s.trace.recording: s.starts for s in laid.stretches}

    mixed = starts(*((slow, quick) if slow_first else (quick, slow)))
    for recording in (slow, quick):
        alone = starts(recording)[recording.path.name]
        for one, other in zip(mixed[recording.path.name], alone, strict=True):
            np.testing.assert_array_equal(one, other)


# Pressures that nobody read --------------------------------------------------------------------


def _without(run: Any, side: str, first: int = 0) -> dict[str, np.ndarray]:
    """Pressures of a run with those of one chamber of the lift missing, from a sample on."""
    pressures = getattr(run, f"p_{side}").copy()
    pressures[first:, 0] = np.nan
    return {f"p_{side}": pressures}


def _laid(robot: Robot, *runs: Any) -> Material:
    """Rows of some recordings."""
    usual = FilterSettings(), WindowSettings()
    return material_of(robot, own_forces(robot, torque=False), traces_of(runs), *usual, {})


@pytest.mark.parametrize(("side", "other"), [("a", "b"), ("b", "a")])
def test_a_pressure_that_is_missing_costs_the_force_and_its_own_balance_alone(
    crane_run, robot: Robot, side: str, other: str
) -> None:
    laid = _laid(robot, crane_run.recording(**_without(crane_run, side)))
    assert laid.channels == ("tilt/force", f"lift/flow_{other}", "tilt/flow_a", "tilt/flow_b")
    assert laid.unpaired == (f"lift/flow_{other}",)
    whole = _laid(robot, crane_run.recording())
    assert whole.unpaired == ()
    channel = f"lift/flow_{other}"
    own, all_there = (one.channel == one.channels.index(channel) for one in (laid, whole))
    np.testing.assert_array_equal(laid.time_s[own], whole.time_s[all_there])


def test_a_law_of_both_pressures_needs_both(crane_run, robot: Robot) -> None:
    """One in the robot file is part of the balance of either chamber."""
    leaky = replace(robot, effects=(LEAK,))
    laid = _laid(leaky, crane_run.recording(**_without(crane_run, "b")))
    assert laid.channels == ("tilt/force", "tilt/flow_a", "tilt/flow_b")
    biased = replace(robot, effects=(BIAS,))
    assert "lift/flow_a" in _laid(biased, crane_run.recording(**_without(crane_run, "b"))).channels


def test_a_pressure_that_is_missing_at_times_leaves_no_half_known_rows(
    crane_run, robot: Robot
) -> None:
    """Laws of both pressures are told from where they were read: no row lacks them elsewhere."""
    lost = crane_run.recording(**_without(crane_run, "b", 6000))
    laid = _laid(robot, lost)
    assert laid.unpaired == ()
    own = laid.channel == laid.channels.index("lift/flow_a")
    assert 11.0 < laid.time_s[own].max() < 12.0


@pytest.mark.thorough
def test_rows_to_verify_on_know_what_the_fitted_ones_do(crane_run, lay_out: Any) -> None:
    """A leak that was found with both pressures is no part of a balance that lacks one."""
    for fitted, verified, own in (("", "b", False), ("b", "", True), ("b", "b", True)):
        runs = [
            replace(crane_run, **(_without(crane_run, side) if side else {}))
            for side in (fitted, verified)
        ]
        work = lay_out(runs[0], runs[1:])
        assert "lift/flow_a" in work.training.predictor.material.channels
        assert ("lift/flow_a" in work.check.predictor.material.channels) is own


def test_a_pressure_that_only_the_fitted_recordings_have_is_to_blame(
    crane_run, robot: Robot
) -> None:
    """Not how long the others are: both balances of that cylinder are lost to verify on."""
    lift = crane_run.recording("check", **_without(crane_run, "a"))
    no_a = crane_run.recording("check", p_a=np.full_like(crane_run.p_a, np.nan))
    fitted = sources_of([crane_run.recording("run")])
    first = [survey_source(one, robot) for one in fitted]
    for given, lost in ((lift, ["lift/flow_b"]), (no_a, ["lift/flow_b", "tilt/flow_b"])):
        others = sources_of([given])
        surveys = [*first, *(survey_source(one, robot) for one in others)]
        found = half_read(robot, first, surveys)
        assert [one.channel for one in found] == lost
        assert {one.bag for one in found} == {"check"}
        assert all("no lift_cylinder/a" in one.reason for one in found[:1])
    assert half_read(robot, surveys[1:], surveys[1:]) == ()
    with pytest.raises(NotEnoughDataError, match="found none") as error:
        residuals(robot, fitted, others, surveys, DiagnosisSettings())
    assert "no lift_cylinder/a in" in str(error.value)
    assert "longer" not in str(error.value)


@pytest.mark.thorough
def test_what_one_pressure_tells_is_found(
    make_run: tuple[Callable[..., Robot], Callable[..., Any]],
) -> None:
    """A valve off its middle shows in the one balance; other laws may look like it there."""
    true_crane, simulated_run = make_run
    both, one = list[Any](), list[Any]()
    for name, seconds, seed in (("run", 14.0, 2), ("check", 9.0, 4)):
        run = simulated_run(replace(true_crane(), effects=(BIAS,)), seconds, seed=seed)
        both.append(run.recording(name))
        one.append(run.recording(name, **_without(run, "b")))
    robot = load_robot("xs031")
    for recordings, verdict in ((both, EXPLAINED), (one, PARTLY)):
        found = diagnose(robot, recordings[:1], recordings[1:])
        assert [f.named.names for f in found.findings] == [("valve_null_bias",)]
        assert found.findings[0].named.term.parameters[0] == pytest.approx(0.02, rel=0.1)
        assert found.verdict == verdict
    assert [c.name for c in found.channels][1] == "lift/flow_a"
    assert any(note.startswith("lift/flow_a: the cylinder's other") for note in found.notes)
