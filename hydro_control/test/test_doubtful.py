"""Effects that were fitted too unsurely are left alone, one target at a time."""

from __future__ import annotations

from dataclasses import replace

import pytest

from hydro_control.compensation_plan import plan
from hydro_control.doubtful import doubt
from hydro_model.effects import CATALOGUE
from hydro_model.robot import EffectSpec, Robot
from hydro_model.robot_files import load_robot

ROBOT = load_robot("xs031")
FORCE = "{}_cylinder.coulomb_friction.force"


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


def test_a_size_that_ran_to_its_bound_is_left_alone() -> None:
    force = next(p for p in CATALOGUE["coulomb_friction"].parameters if p.name == "force")
    planned = plan(rubbing(3000.0, force.upper, lift=40.0, tilt=80.0))
    assert [one.target for one in planned.active] == ["lift_cylinder"]
    assert "bound" in planned.left_out["coulomb_friction:tilt_cylinder"]


@pytest.mark.parametrize(("std", "sure"), [(0.0005, True), (0.004, False)])
def test_an_effect_without_linear_parameter_goes_by_what_can_be_zero(
    std: float, sure: bool
) -> None:
    bias = EffectSpec("valve_null_bias", "lift_cylinder", {"bias": -0.005})
    stated = {"lift_cylinder.valve_null_bias.bias": std}
    robot = replace(ROBOT, effects=(bias,), standard_deviations=stated)
    assert (doubt(robot, bias) == "") is sure


@pytest.mark.parametrize(("frequency_hz", "sure"), [(5.0, False), (60.0, True), (500.0, True)])
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
