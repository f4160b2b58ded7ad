"""From voltages to parameters: simulated recordings, whole, noisy, cut and lacking."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from hydro_ident import transducers
from hydro_ident.bag.streaming import map_columns
from hydro_ident.errors import IdentError
from hydro_ident.estimate.signals.derivatives import FilterSettings, motion
from hydro_ident.identify.identification import Identification, identify
from hydro_ident.identify.identified_robot import _effects
from hydro_model.hydraulics.cylinder import lever
from hydro_model.multibody.base_parameters import base_map
from hydro_model.robot import EffectSpec, Robot
from hydro_model.robot_files import load_robot

pytestmark = pytest.mark.needs("clarabel")

EFFECTS = (
    EffectSpec("coulomb_friction", "xs031", {"force": 2500.0, "velocity_scale": 0.005}),
    EffectSpec("valve_null_bias", "tilt_valve", {"bias": 0.006}),
    EffectSpec("internal_leakage", "lift_cylinder", {"coefficient": 4e-13}),
    EffectSpec("dead_volume", "tilt_cylinder", {"volume_a": 9e-4, "volume_b": 1.1e-3}),
)


def _truth(robot: Robot) -> dict[str, float]:
    base = base_map(robot)
    values = dict(zip(base.names, base.combination @ robot.parameter_vector, strict=True))
    for c in robot.cylinders:
        values[f"{c.name}.viscous_friction"] = c.viscous_friction
        values[f"{c.name}.bulk_modulus"] = c.bulk_modulus_pa
    for v in robot.valves:
        values |= {f"{v.name}.{e}": getattr(v, e) for e in ("c_pa", "c_at", "c_pb", "c_bt")}
    return values | {"command_delay": robot.command_delay_s}


def test_noise_free_samples_give_every_parameter_to_1e3(found: Identification, clean: Any) -> None:
    truth = _truth(clean.robot)
    assert found.verdict == "identified"
    assert {p.name for p in found.parameters} == set(truth)
    for p in found.parameters:
        # The smallest moment is known to what the largest one is known to.
        slack = 0.02 if p.unit == "kg m" else 0.0
        assert p.value == pytest.approx(truth[p.name], rel=2e-3, abs=slack), p.name
        assert p.identifiable or p.reason.startswith("below detection"), p.name
    for channel in found.channels:
        assert channel.summary()["fit_after_pct"] > 99.9  # type: ignore[operator]


def test_noise_leaves_the_truth_within_the_stated_deviations(clean: Any) -> None:
    rng, count = np.random.default_rng(7), 2 * np.pi / 2**20
    noisy = clean.recording(
        q=count * np.round(clean.q / count + rng.normal(0, 0.5, clean.q.shape)),
        p_a=1e3 * np.round(clean.p_a / 1e3 + rng.normal(0, 4, clean.p_a.shape)),
        p_b=1e3 * np.round(clean.p_b / 1e3 + rng.normal(0, 4, clean.p_b.shape)),
    )
    result = identify(load_robot("xs031"), [noisy])
    truth = _truth(clean.robot)
    for p in result.parameters:
        assert abs(p.value - truth[p.name]) < 5.0 * p.std, p.name
    for channel in result.channels:
        s = channel.summary()
        assert s["rmse_after"] == pytest.approx(s["noise_floor"], rel=0.4)


def test_an_effect_of_the_whole_robot_stays_where_it_was_not_fitted(robot: Robot) -> None:
    listed = EffectSpec("internal_leakage", "xs031", {"coefficient": 1e-12})
    fitted = {"lift_cylinder.internal_leakage.coefficient": SimpleNamespace(value=2e-12)}
    assert _effects(robot, listed, fitted) == [
        EffectSpec("internal_leakage", "lift_cylinder", {"coefficient": 2e-12}),
        EffectSpec("internal_leakage", "tilt_cylinder", {"coefficient": 1e-12}),
    ]
    alone = replace(listed, target="lift_valve")
    assert len(_effects(robot, alone, fitted)) == 1


@pytest.mark.thorough
def test_a_slow_recording_is_looked_at_slowly_and_said(clean: Any) -> None:
    """25 Hz are beyond what 50 samples a second tell; flows need no filter at all."""
    slow = clean.recording()
    every = round(0.02 / slow.period_s)
    slow = map_columns(replace(slow, period_s=0.02), lambda values: values[::every])
    found = identify(load_robot("xs031"), [slow])
    assert found.verdict != "not_enough_data"
    assert found.settings.filters.differentiation_hz == pytest.approx(20.0)
    assert any("motion is looked at below 20 Hz" in note for note in found.notes)
    value = next(p.value for p in found.parameters if p.name == "lift_link.mcx")
    assert value == pytest.approx(_truth(clean.robot)["lift_link.mcx"], rel=0.05)


def test_listed_effects_are_fitted_and_none_is_added(driven: Callable[..., Any]) -> None:
    run = driven(18.0, EFFECTS)
    listed = tuple(
        replace(
            e,
            parameters={
                k: v if k == "velocity_scale" else 0.5 * v for k, v in e.parameters.items()
            },
        )
        for e in EFFECTS
    )
    result = identify(replace(load_robot("xs031"), effects=listed), [run.recording()])
    values = {p.name: p for p in result.parameters}
    for name, value in {
        "lift_cylinder.coulomb_friction.force": 2500.0,
        "tilt_cylinder.coulomb_friction.force": 2500.0,
        "lift_cylinder.internal_leakage.coefficient": 4e-13,
        "tilt_cylinder.dead_volume.volume_a": 9e-4,
        "tilt_cylinder.dead_volume.volume_b": 1.1e-3,
        "tilt_cylinder.valve_null_bias.bias": 0.006,
        "tilt_cylinder.bulk_modulus": 7.4e8,
    }.items():
        assert values[name].value == pytest.approx(value, rel=0.02), name
    assert result.robot is not None
    friction = [e for e in result.robot.effects if e.name == "coulomb_friction"]
    assert {e.target for e in friction} == {"lift_cylinder", "tilt_cylinder"}
    assert friction[0].parameters["velocity_scale"] == 0.005
    assert len(result.robot.effects) == 5


def test_a_stuck_joint_is_not_enough_data_and_named(clean: Any) -> None:
    stuck = clean.q.copy()
    stuck[:, 1] = stuck[0, 1]
    result = identify(load_robot("xs031"), [clean.recording(q=stuck)])
    assert result.verdict == "not_enough_data"
    assert result.robot is None
    assert "tilt_cylinder.viscous_friction" in result.problems[0]
    assert "tilt did not move" in result.problems[0]


def test_no_voltages_identify_the_links_and_say_the_rest(clean: Any) -> None:
    result = identify(load_robot("xs031"), [clean.recording(valve_v=None, command_v=None)])
    assert result.verdict == "partly_identified"
    assert {c.name for c in result.channels} == {"lift/force", "tilt/force"}
    assert len(result.problems) == 2
    assert "no flow channel gave enough windows" in result.problems[0]
    assert result.robot is not None
    assert result.robot.valves == load_robot("xs031").valves


def test_a_rejected_stage_keeps_the_given_numbers_and_says_so(clean: Any) -> None:
    crossed = clean.recording(valve_v=clean.voltage * np.array([1.0, -1.0]))
    result = identify(load_robot("xs031"), [crossed])
    assert result.verdict == "partly_identified"
    assert any("hydraulics of tilt_cylinder rejected" in text for text in result.problems)
    given = load_robot("xs031")
    assert result.robot is not None
    assert result.robot.valves[1] == given.valves[1]
    assert result.robot.cylinders[1].bulk_modulus_pa == given.cylinders[1].bulk_modulus_pa
    assert not any(p.identifiable for p in result.parameters if p.name.startswith("tilt_valve"))


def test_no_pressures_no_effort_is_not_enough_data(clean: Any) -> None:
    result = identify(load_robot("xs031"), [clean.recording(p_a=None, p_b=None)])
    assert result.verdict == "not_enough_data"
    assert "no force channel" in result.problems[0]


def test_a_gap_splits_the_recording_and_spoils_nothing(clean: Any) -> None:
    keep = np.ones(len(clean.q), dtype=bool)
    keep[6000:6200] = False
    recording = clean.recording()
    cut = {
        name: getattr(recording, name)[keep]
        for name in ("stamp_ns", "q", "p_a", "p_b", "supply", "tank", "valve_v", "latched")
    }
    result = identify(load_robot("xs031"), [replace(recording, command_v=None, **cut)])
    truth = _truth(clean.robot)
    for p in result.parameters:
        slack = 0.02 if p.unit == "kg m" else 0.0
        assert p.value == pytest.approx(truth[p.name], rel=2e-3, abs=slack), p.name


def test_validation_bags_give_the_scores(clean: Any) -> None:
    other = clean.recording("other", latched=np.ones(len(clean.q), dtype=bool))
    result = identify(load_robot("xs031"), [clean.recording()], [other])
    assert {c.name for c in result.channels} == {"lift/force", "tilt/force"}
    assert all(c.recordings == ("other",) for c in result.channels)


def test_bags_of_one_name_are_refused(clean: Any) -> None:
    with pytest.raises(IdentError, match="different names, found 'run'"):
        identify(clean.robot, [clean.recording(), clean.recording()])


def test_a_validation_bag_without_a_usable_stretch_scores_nothing(clean: Any) -> None:
    lost = clean.recording("lost", q=np.full_like(clean.q, np.nan))
    found = identify(clean.robot, [clean.recording()], [lost])
    assert found.channels == ()
    assert any("nothing was scored" in note for note in found.notes)


def test_a_robot_file_without_masses_is_identified(crane_run: Any) -> None:
    """Masses are what one identifies for; coarse transducers leave 5 kg m open."""
    rng, shape = np.random.default_rng(2), crane_run.p_a.shape
    p_a, p_b = (p + 3e5 * rng.normal(size=shape) for p in (crane_run.p_a, crane_run.p_b))
    recording = crane_run.recording(p_a=p_a, p_b=p_b)
    given = replace(recording.robot, link_inertia=np.zeros_like(recording.robot.link_inertia))
    found = identify(given, [replace(recording, robot=given)])
    assert found.verdict == "identified", found.problems
    usual = {p.name: p for p in identify(recording.robot, [recording]).parameters}
    for one in found.parameters:
        assert one.identifiable == usual[one.name].identifiable
        assert one.value == pytest.approx(usual[one.name].value, rel=1e-3, abs=one.std), one.name


@pytest.mark.thorough
def test_without_masses_hardly_any_motion_is_not_enough(crane_run: Any) -> None:
    q = crane_run.q[0] + 0.02 * (crane_run.q - crane_run.q[0])
    recording = crane_run.recording(q=q)
    given = replace(recording.robot, link_inertia=np.zeros_like(recording.robot.link_inertia))
    found = identify(given, [replace(recording, robot=given)])
    assert found.verdict == "not_enough_data"
    assert "too little motion" in found.problems[0]


@pytest.mark.thorough
def test_parameters_that_no_bodies_have_are_a_problem(
    crane_run: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The lift's force drops with its acceleration, as no rigid body's does.

    By no more than usual zeros of transducers make of bodies that there are, so that only where
    zeros are exact it is sure.
    """
    cylinder, q = crane_run.robot.cylinders[0], crane_run.q
    qdd = motion(q, 0.002, FilterSettings())[2]
    p_a = crane_run.p_a.copy()
    p_a[:, 0] -= 285.0 * qdd[:, 0] / lever(cylinder, q[:, 0]) / cylinder.area_a_m2
    recorded = crane_run.recording(p_a=p_a)
    assert identify(recorded.robot, [recorded]).verdict == "identified"
    monkeypatch.setattr(transducers, "ZERO", 0.0)
    found = identify(recorded.robot, [recorded])
    assert found.verdict == "partly_identified"
    [text] = found.problems
    assert "no bodies (lift_link, tilt_link) have the identified base parameters" in text
    assert "standard deviations from any that do" in text
    assert "`diagnose`" in text
