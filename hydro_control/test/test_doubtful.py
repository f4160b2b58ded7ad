"""Effects that were fitted too unsurely are left alone, one target at a time."""

from __future__ import annotations

from dataclasses import replace

import pytest

from hydro_control.compensation.compensation_plan import plan
from hydro_control.compensation.doubtful import doubt
from hydro_model.effects import CATALOGUE
from hydro_model.robot import EffectSpec, Robot
from hydro_model.robot_files import load_robot

ROBOT = load_robot("xs031")
FORCE = "{}_cylinder.coulomb_friction.force"
MOST_N = next(p.upper for p in CATALOGUE["coulomb_friction"].parameters if p.name == "force")


def rubbing(lift_n: float, tilt_n: float, **deviations: float) -> Robot:
    """Coulomb friction on both cylinders, with deviations by joint."""
    effects = tuple(
        EffectSpec("coulomb_friction", f"{joint}_cylinder", {"force": force})
        for joint, force in (("lift", lift_n), ("tilt", tilt_n))
    )
    stated = {FORCE.format(joint): std for joint, std in deviations.items()}
    return replace(ROBOT, effects=effects, standard_deviations=stated)


def test_what_a_person_lists_is_taken_at_its_word() -> None:
    robot = rubbing(3000.0, 1.0)
    assert plan(robot).names == ("coulomb_friction",)
    assert not plan(robot).left_out


def test_a_size_whose_interval_reaches_zero_is_left_alone_at_its_target() -> None:
    planned = plan(rubbing(3000.0, 150.0, lift=40.0, tilt=80.0))
    assert [one.target for one in planned.active] == ["lift_cylinder"]
    assert planned.names == ("coulomb_friction",)
    assert planned.left_out.keys() == {"coulomb_friction:tilt_cylinder"}
    assert "zero" in planned.left_out["coulomb_friction:tilt_cylinder"]


@pytest.mark.parametrize("share", [1.0, 1.0 - 5e-7])
def test_a_size_that_ran_to_its_bound_is_left_alone(share: float) -> None:
    planned = plan(rubbing(3000.0, share * MOST_N, lift=40.0, tilt=80.0))
    assert [one.target for one in planned.active] == ["lift_cylinder"]
    assert "bound" in planned.left_out["coulomb_friction:tilt_cylinder"]


def test_near_a_bound_is_not_at_it() -> None:
    assert not plan(rubbing(3000.0, (1.0 - 1e-5) * MOST_N, lift=40.0, tilt=80.0)).left_out


def test_at_a_bound_that_a_person_wrote_down_it_is_taken_at_their_word() -> None:
    """The fit of the other cylinder says nothing of it."""
    assert not plan(rubbing(3000.0, MOST_N, lift=40.0)).left_out


def test_no_friction_at_all_is_no_bound_that_a_fit_ran_to() -> None:
    planned = plan(rubbing(3000.0, 0.0, lift=40.0, tilt=80.0))
    assert "may as well be zero" in planned.left_out["coulomb_friction:tilt_cylinder"]


#: Two deviations are half of a 95 % interval; at its very end zero is still in it.
@pytest.mark.parametrize(
    ("std", "sure"),
    [(0.0005, True), (0.0024, True), (0.0025, False), (0.0026, False), (0.004, False)],
)
def test_an_effect_without_linear_parameter_goes_by_what_can_be_zero(
    std: float, sure: bool
) -> None:
    bias = EffectSpec("valve_null_bias", "lift_cylinder", {"bias": -0.005})
    stated = {"lift_cylinder.valve_null_bias.bias": std}
    robot = replace(ROBOT, effects=(bias,), standard_deviations=stated)
    assert (doubt(robot, bias) == "") is sure


@pytest.mark.parametrize(("std", "sure"), [(0.001, True), (0.006, False)])
def test_a_size_that_cannot_be_below_zero_goes_by_its_interval_too(std: float, sure: bool) -> None:
    deadband = EffectSpec("valve_deadband", "lift_cylinder", {"width": 0.01})
    stated = {"lift_cylinder.valve_deadband.width": std}
    robot = replace(ROBOT, effects=(deadband,), standard_deviations=stated)
    assert (doubt(robot, deadband) == "") is sure


@pytest.mark.parametrize(
    ("frequency_hz", "sure"),
    [(1.0, False), (2.5, False), (5.0, False), (5.5, True), (60.0, True), (500.0, True)],
)
def test_a_lag_is_left_alone_at_its_slowest_only(frequency_hz: float, sure: bool) -> None:
    values = {"frequency": frequency_hz, "damping": 0.7}
    lag = EffectSpec("valve_spool_lag", "lift_cylinder", values)
    # Frequency and damping of a quick spool hide behind each other; their lag is sure.
    stated = {"lift_cylinder.valve_spool_lag.frequency": 4000.0}
    robot = replace(ROBOT, effects=(lag,), standard_deviations=stated)
    assert (doubt(robot, lag) == "") is sure


def test_an_unsure_payload_stays_out_of_the_bodies() -> None:
    load = EffectSpec("payload_change", "xs031", {"mass": 20.0})
    name = "xs031.payload_change.mass"
    sure = plan(replace(ROBOT, effects=(load,), standard_deviations={name: 2.0}))
    unsure = plan(replace(ROBOT, effects=(load,), standard_deviations={name: 30.0}))
    assert (sure.robot.link_inertia != ROBOT.link_inertia).any()
    assert (unsure.robot.link_inertia == ROBOT.link_inertia).all()
    assert not unsure.names


def test_a_payload_that_was_set_down_is_not_said_to_be_compensated() -> None:
    held = EffectSpec("payload_change", "xs031", {"mass": 50.0})
    gone = EffectSpec("payload_change", "xs031", {"mass": 50.0, "end_s": 12.0})
    assert plan(replace(ROBOT, effects=(held,))).names == ("payload_change",)
    assert plan(replace(ROBOT, effects=(gone,))).names == ()
