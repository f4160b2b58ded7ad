"""Units of effects' parameters at joints without cylinder."""

from __future__ import annotations

from dataclasses import replace

import pytest

from hydro_model.effects import CATALOGUE, ActiveEffect, resolve
from hydro_model.effects.units import effect_units, unit_at_joint
from hydro_model.robot import EffectSpec, Robot
from hydro_model.robot_files import load_robot


def _axis(prismatic: bool) -> Robot:
    robot = load_robot("emps")
    return replace(robot, joints=(replace(robot.joints[0], prismatic=prismatic),))


def _active(robot: Robot, name: str, target: str) -> ActiveEffect:
    form = CATALOGUE[name].forms[-1 if robot.dry_joints else 0]
    values = {p.name: p.typical for p in form.parameters}
    (one,) = resolve(replace(robot, effects=(EffectSpec(name, target, values),)))
    return one


@pytest.mark.parametrize(
    ("of_piston", "of_joint"),
    [
        ("m", "rad"),
        ("m/s", "rad/s"),
        ("m/s^2", "rad/s^2"),
        ("N", "N m"),
        ("N s/m", "N m s/rad"),
        ("N s^2/m^2", "N m s^2/rad^2"),
        ("N/m", "N m/rad"),
        ("rad/s", "rad/s"),
        ("N m", "N m"),
        ("kg m^2", "kg m^2"),
        ("m^3/s", "m^3/s"),
        ("Pa", "Pa"),
        ("1", "1"),
    ],
)
def test_a_turning_joint_has_torques_and_angles(of_piston: str, of_joint: str) -> None:
    assert unit_at_joint(of_piston, False) == of_joint
    assert unit_at_joint(of_joint, False) == of_joint


def test_every_unit_of_a_turning_joint_is_that_of_a_piston_on_a_sliding_one() -> None:
    for unit in ("m", "m/s", "N", "N s/m", "N s^2/m^2", "N/m"):
        assert unit_at_joint(unit_at_joint(unit, False), True) == unit
    assert unit_at_joint("kg m^2", True) == "kg"


@pytest.mark.parametrize(
    ("name", "sliding", "turning"),
    [
        ("coulomb_friction", ("N", "m/s"), ("N m", "rad/s")),
        ("quadratic_friction", ("N s^2/m^2",), ("N m s^2/rad^2",)),
        ("counterbalance_spring", ("N", "N/m", "1"), ("N m", "N m/rad", "1")),
        ("rotor_inertia", ("kg",), ("kg m^2",)),
        ("load_dependent_friction", ("1", "m/s"), ("1", "rad/s")),
        ("backlash", ("m", "N"), ("rad", "N m")),
    ],
)
def test_an_effect_has_the_units_of_its_joint(
    name: str, sliding: tuple[str, ...], turning: tuple[str, ...]
) -> None:
    for prismatic, units in ((True, sliding), (False, turning)):
        robot = _axis(prismatic)
        assert _active(robot, name, robot.joint_names[0]).units == units


def test_cylinders_the_tip_and_another_joint_keep_their_units() -> None:
    crane = load_robot("xs031")
    for name in ("coulomb_friction", "counterbalance_spring"):
        one = _active(crane, name, crane.cylinders[0].name)
        assert one.units == tuple(p.unit for p in one.effect.parameters)
    assert effect_units(CATALOGUE["external_contact"], False)[:3] == ("N/m", "m", "1")
    assert effect_units(CATALOGUE["joint_coupling"], False)[0] == "N m s/rad"
