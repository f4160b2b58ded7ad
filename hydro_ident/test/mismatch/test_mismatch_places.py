"""What of an effect a robot and its recordings leave to be fitted: tilts, delays, temperature."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from hydro_ident.mismatch.answer.diagnosis import diagnose
from hydro_ident.mismatch.answer.doubts import doubts, hardly_better
from hydro_ident.mismatch.answer.outcome import ChannelResult
from hydro_ident.mismatch.fitting.stepping import is_free, limits_of
from hydro_ident.mismatch.fitting.training import start_model
from hydro_ident.mismatch.naming.name import Searcher
from hydro_ident.mismatch.split.held_out import rms
from hydro_ident.mismatch.split.residuals import Residuals
from hydro_ident.mismatch.trials.candidates import trials
from hydro_ident.mismatch.trials.places import (
    bounded_bend,
    bounded_bodies,
    bounded_tilt,
    stations,
    tilts,
)
from hydro_model.effects.bending import usual_inertia
from hydro_model.effects.catalogue import CATALOGUE, resolve
from hydro_model.effects.targets import ActiveEffect, joint_of
from hydro_model.hydraulics.cylinder import stroke
from hydro_model.multibody.rigid_body import mass_matrix
from hydro_model.robot import EffectSpec, Robot
from hydro_model.robot_files import load_robot

TILT = CATALOGUE["base_tilt"]
MODE = {"inertia": 100.0, "frequency": 5.0}

_LINK = (
    '<link name="{name}"><inertial><origin xyz="{at}"/><mass value="8"/><inertia ixx="0.4"'
    ' iyy="0.4" izz="0.4" ixy="0" ixz="0" iyz="0"/></inertial></link>'
)
_JOINT = (
    '<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
    '<origin xyz="{at}"/><axis xyz="{axis}"/><limit lower="-1" upper="1" effort="9"'
    ' velocity="1"/></joint>'
)


def _arm(folder: Path, axes: tuple[str, str], kind: str = "revolute") -> Robot:
    """Two links whose arms lie across their joints' axes."""
    at = "0 0.5 0" if axes[0] == "1 0 0" else "0.5 0 0"
    urdf = '<robot name="arm"><link name="base"/>' + "".join(
        _JOINT.format(name=f"j{k}", kind=kind, parent=parent, child=f"l{k}", at=place, axis=axis)
        + _LINK.format(name=f"l{k}", at=at)
        for k, parent, place, axis in ((1, "base", "0 0 0", axes[0]), (2, "l1", at, axes[1]))
    )
    tip = '<joint name="end" type="fixed"><parent link="l2"/><child link="tip"/></joint>'
    (folder / "arm.urdf").write_text(f'{urdf}{tip}<link name="tip"/></robot>')
    (folder / "arm.hydraulics.yaml").write_text("robot: arm\nurdf: arm.urdf\ntip_link: tip\n")
    return load_robot(folder / "arm.hydraulics.yaml")


def _tilt(robot: Robot) -> ActiveEffect:
    return bounded_tilt(robot, ActiveEffect(TILT, None, TILT.typical, target=robot.name))


@pytest.mark.parametrize("x0_m", [-0.05, 0.0, 2.0])
def test_bodies_of_a_cylinder_along_its_joint_are_the_links(x0_m: float) -> None:
    """Its `x0_m` is a position of the joint, no length: below 0 bounds would be upside down."""
    robot = load_robot("xs031")
    along = replace(robot.cylinders[1], l1_m=0.0, x0_m=x0_m)
    robot = replace(robot, cylinders=(robot.cylinders[0], along))
    effect = CATALOGUE["cylinder_inertia"]
    for index, free in enumerate((True, False)):
        bounded = bounded_bodies(robot, ActiveEffect(effect, index, effect.typical)).effect
        assert all(spec.lower == 0.0 for spec in bounded.parameters)
        assert all((spec.upper > 0.0) == free for spec in bounded.parameters)
        assert all(spec.upper >= 0.0 for spec in bounded.parameters)


@pytest.mark.parametrize(
    ("axes", "kind", "free"),
    [
        (("0 1 0", "0 -1 0"), "revolute", (False, True)),
        (("1 0 0", "1 0 0"), "revolute", (True, False)),
        (("0 0 1", "0 0 1"), "revolute", (True, True)),
        (("0 0 1", "0 1 0"), "revolute", (True, True)),
        (("1 0 0", "1 0 0"), "prismatic", (False, True)),
        (("0 1 0", "0 1 0"), "prismatic", (True, False)),
    ],
)
def test_a_tilt_is_free_where_it_turns_gravity_onto_a_drive(
    tmp_path: Path, axes: tuple[str, str], kind: str, free: tuple[bool, bool]
) -> None:
    one = _tilt(_arm(tmp_path, axes, kind))
    assert tuple(is_free(one, k) for k in range(2)) == free
    assert one.effect.sizes == ((1,) if free[1] else (0,))
    for shape in tilts(one):
        assert all(shows or value == 0.0 for shows, value in zip(free, shape, strict=True))


def test_a_crane_in_a_plane_tilts_in_that_plane() -> None:
    assert tilts(_tilt(load_robot("xs031"))) == [(0.0, TILT.parameters[1].typical)]


def test_a_delay_goes_to_the_end_of_its_range_and_no_further(laid_crane: Residuals) -> None:
    work = laid_crane
    model, columns = work.base.model, work.training.predictor.delay_columns
    limits, cycle = limits_of(work.training, model), work.training.cycle_s
    for index, at in columns.items():
        assert limits.lower[at] == pytest.approx(-model.delays_s[index])
        assert limits.upper[at] == pytest.approx(1.25 * cycle - model.delays_s[index])


@pytest.mark.thorough
def test_a_temperature_that_only_some_recordings_have_is_left_aside(
    crane_run: Any, make_run: tuple[Callable[..., Any], Callable[..., Any]]
) -> None:
    true_crane, simulated_run = make_run
    bag, other = crane_run.recording(), simulated_run(true_crane(), 10.0, seed=3).recording("b")
    stamps = bag.stamp_ns[::500]
    oil_c = np.linspace(30.0, 40.0, len(stamps))
    warm = replace(bag, temperature_stamp_ns=stamps, temperature_c=oil_c)
    found = diagnose(load_robot("xs031"), [warm], [other])
    assert found.work is not None
    assert all(s.trace.oil_c is None for s in found.work.training.predictor.material.stretches)
    assert found.verdict == "matches"


@pytest.mark.parametrize(
    ("left", "floor", "channels", "hardly"),
    [
        (0.8, 0.01, ("lift/force",), True),
        (0.4, 0.01, ("lift/force",), True),  # as a law of another form leaves
        (0.2, 0.01, ("lift/force",), False),  # more than three quarters are explained
        (0.8, 0.10, ("lift/force",), False),  # not far above the sensors
        (0.8, 0.01, ("tilt/force",), False),  # nothing was found there
        (0.8, 0.0, ("lift/force",), True),  # of exact data
    ],
)
def test_what_leaves_much_far_above_the_sensors_is_not_explained(
    left: float, floor: float, channels: tuple[str, ...], hardly: bool
) -> None:
    time = np.arange(100.0)
    error = np.where(time % 2.0 > 0.0, 1.0, -1.0)
    one = ChannelResult("lift/force", "N", time, np.zeros(100), -error, -left * error, floor)
    said = hardly_better([SimpleNamespace(channels=channels)], [one])  # type: ignore[list-item]
    share = f"lift/force: {left:.0%} of the error is left"
    times = f", {left / floor:.0f} times what the sensors' noise makes" if floor else ""
    assert said == [f"{share}{times}"] * hardly


@pytest.mark.parametrize(
    ("channels", "doubtful"), [(("lift/force",), True), (("tilt/force", "lift/force"), False)]
)
def test_what_other_recordings_know_better_is_not_explained(
    laid_crane: Residuals, channels: tuple[str, ...], doubtful: bool
) -> None:
    """It is the finding's strongest channel that has to be predicted as well as it could be."""
    work = laid_crane
    named = SimpleNamespace(few=1.0, names=("coulomb_friction",), term=SimpleNamespace(target="a"))
    found = [SimpleNamespace(channels=channels, named=named)]
    said = doubts(work, found, [], {"lift/force": 2.5})  # type: ignore[arg-type]
    worse = "lift/force: rows to verify on are predicted 2.5 times worse"
    assert [line.startswith(worse) for line in said] == [True] * doubtful
    assert doubts(work, found, [], {}) == ()  # type: ignore[arg-type]
    assert doubts(work, [], [], {"lift/force": 2.5}) == ()
    named.few = 8.0  # of a joint that swept once
    few = ("few motions of its joint show coulomb_friction of a",)
    assert doubts(work, found, [], {}) == few  # type: ignore[arg-type]


def bend(robot: Robot, target: str) -> dict[str, tuple[float, float]]:
    """Bounds of a mode's parameters at a cylinder, or at a joint without one."""
    bare = replace(robot, effects=(EffectSpec("structural_flexibility", target, MODE),))
    specs = bounded_bend(robot, resolve(bare)[0]).effect.parameters
    return {spec.name: (spec.lower, spec.upper) for spec in specs}


def test_a_mode_is_some_of_what_its_joint_moves() -> None:
    crane = load_robot("xs031")
    usual = usual_inertia(crane, 0)
    lift, tilt = bend(crane, "lift_cylinder"), bend(crane, "tilt_cylinder")
    assert lift["inertia"] == pytest.approx((0.005 * usual, 2.0 * usual))
    assert lift["frequency"] == (0.5, 15.0)
    assert lift["damping"] == (0.0, 0.5)
    assert lift["place"] == (0.0, 0.8)
    # Nothing follows the last joint; a slide has none that turns with it.
    assert tilt["place"] == (0.0, 0.0)


def test_what_a_joint_takes_from_itself_leaves_it_some_inertia(laid_crane: Residuals) -> None:
    """In every recorded pose, the other joint free to follow; a hinge may carry more."""
    work = laid_crane
    predictor, robot = work.training.predictor, work.training.predictor.material.robot
    q = np.concatenate([s.trace.q for s in predictor.material.stretches])
    model = start_model(robot, predictor, ())
    own = list(trials(predictor, model, ["structural_flexibility"]))
    assert {t.active.parameters[3] > 0.0 for t in own} == {True, False}
    for trial in own:
        joint = joint_of(robot, trial.active)
        most = trial.at([1e9]).parameters[0]
        if trial.active.parameters[3] > 0.0:
            assert most == pytest.approx(2.0 * usual_inertia(robot, joint))
            continue
        reduced = mass_matrix(robot, q)
        reduced[:, joint, joint] -= most
        assert np.linalg.eigvalsh(reduced).min() > 0.0
        reduced[:, joint, joint] -= 0.05 * most
        assert np.linalg.eigvalsh(reduced).min() < 0.0


def test_a_joint_that_moves_no_mass_has_no_hinge() -> None:
    crane = load_robot("xs031")
    bare = tuple(replace(c, barrel=None, rod=None) for c in crane.cylinders)
    empty = replace(crane, link_inertia=0.0 * crane.link_inertia, cylinders=bare)
    assert bend(empty, "lift_cylinder")["carried"] == (0.0, 0.0)


def test_five_stations_lie_along_all_that_was_visited_or_half_of_it() -> None:
    expected = [(0.2, 0.6), (0.2, 0.4), (0.3, 0.5), (0.4, 0.6)]
    np.testing.assert_allclose(stations(0.2, 0.6), expected)


@pytest.mark.thorough
def test_a_hump_that_is_narrower_than_stations_lie_apart_is_found_where_it_is(
    make_run: tuple, lay_out: Callable[..., Residuals]
) -> None:
    """Dry friction of 4 kN at one place of the stroke, gone within a tenth of it either way."""
    true_crane, simulated_run = make_run
    run = simulated_run(true_crane(), 40.0)
    piston = run.robot.cylinders[0]
    along = stroke(piston, run.q[:, 0])
    low, high = np.quantile(along, [0.001, 0.999])
    place, half = low + 0.63 * (high - low), 0.1 * (high - low)
    speed = np.gradient(np.convolve(along, np.ones(25) / 25.0, "same"), 0.002)
    hump = 4000.0 * np.clip(1.0 - np.abs(along - place) / half, 0.0, 1.0)
    p_a = run.p_a.copy()
    p_a[:, 0] += hump * np.tanh(speed / 0.01) / piston.area_a_m2
    work = lay_out(replace(run, p_a=p_a))
    search = Searcher(work.scan, work.base, set(), work.bank).run()
    (found,) = search.named
    assert found.names[0] == "position_dependent_friction"
    specs = [spec.name for spec in found.term.effect.parameters]
    values = dict(zip(specs, found.term.parameters, strict=True))
    levels = [values[n] for n in ("retracted", "quarter", "middle", "three_quarters", "extended")]
    assert max(levels) == pytest.approx(4000.0, rel=0.05)
    # With stations that stay where they were tried a fifth of it is left.
    force = work.training.mask & (work.training.predictor.material.channel == 0)
    assert rms(search.fitted.residual[force]) < 0.06 * rms(work.base.residual[force])
    assert values["end"] - values["begin"] < 0.6 * (high - low) / piston.stroke_m
