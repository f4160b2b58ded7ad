"""Joints without cylinder: their friction in the robot file, the effects and the roll-out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from hydro_model.effects import CATALOGUE, resolve
from hydro_model.errors import RobotError
from hydro_model.robot import EffectSpec, Robot
from hydro_model.robot_files import load_robot
from hydro_model.simulation.simulate import Model, simulate
from hydro_model.simulation.simulate_reference import reference_rates


@pytest.fixture(scope="module")
def axis() -> Robot:
    return load_robot("emps")


def test_the_shipped_axis_has_its_friction(axis: Robot) -> None:
    assert axis.dry_joints == (0,)
    assert axis.joints[0].viscous_friction == 200.0
    assert [(one.effect.name, one.cylinder, one.joint) for one in resolve(axis)] == [
        ("coulomb_friction", None, 0),
        ("constant_force_offset", None, 0),
    ]
    assert load_robot("xs031").dry_joints == ()


def test_force_on_a_dry_axis_is_mass_viscous_coulomb_and_offset(axis: Robot) -> None:
    """A held force ends at the speed at which friction balances it."""
    offset = EffectSpec("constant_force_offset", "carriage", {"force": -3.0})
    robot = replace(axis, effects=(axis.effects[0], offset))
    time = np.arange(6001) * 1e-3
    force = np.full((time.size, 1), 60.0)
    out = simulate(robot, time, np.zeros((time.size, 0)), [0.0], torque=force)
    final = (60.0 - 20.0 + 3.0) / 200.0
    assert out.qd[-1, 0] == pytest.approx(final, rel=1e-4)
    # tanh is one beyond 0.1 % of the final speed: from there a first-order lag of M / b.
    late = time > 0.01
    lag = final * (1.0 - np.exp(-time * 200.0 / 100.0))
    np.testing.assert_allclose(out.qd[late, 0], lag[late], rtol=2e-3, atol=1e-4)


def test_compiled_and_readable_rates_agree_on_a_mixed_robot(axis: Robot) -> None:
    crane = load_robot("xs031")
    chosen = ("coulomb_friction", "quadratic_friction", "constant_force_offset")
    specs = [
        EffectSpec(name, crane.name, {p.name: p.typical for p in CATALOGUE[name].parameters})
        for name in chosen
    ]
    # The tilt joint loses its cylinder and moves against friction of its own.
    robot = replace(
        crane,
        cylinders=crane.cylinders[:1],
        valves=crane.valves[:1],
        joints=(crane.joints[0], replace(crane.joints[1], viscous_friction=350.0)),
        effects=tuple(specs),
    )
    model = Model(robot)
    assert [(a.cylinder, a.joint) for a in model.active] == [(0, None), (None, 1)] * 3
    state = np.array([0.7, -1.1, 0.2, -0.3, 6e6, 4e6])
    inputs = model.inputs([0.3], 18e6, 1e6, [0.0, 900.0])
    expected = reference_rates(robot, model.active, 0.0, inputs, state)
    np.testing.assert_allclose(model.rates(0.0, state, inputs), expected, rtol=1e-9)
    bare = replace(robot, effects=(), joints=crane.joints)
    still = reference_rates(bare, (), 0.0, inputs, state)
    assert expected[3] != pytest.approx(still[3], rel=1e-3)


@pytest.mark.parametrize("name", ["pressure_dependent_friction", "internal_leakage"])
def test_an_effect_that_needs_a_cylinder_refuses_a_dry_joint(axis: Robot, name: str) -> None:
    typical = {p.name: p.typical for p in CATALOGUE[name].parameters}
    robot = replace(axis, effects=(EffectSpec(name, "carriage", typical),))
    with pytest.raises(RobotError, match="unknown target 'carriage'"):
        resolve(robot)


def test_friction_of_an_unknown_joint_is_refused(axis: Robot, tmp_path) -> None:
    assert axis.source is not None
    assert axis.urdf is not None
    (tmp_path / "emps.urdf").write_text(axis.urdf.read_text())
    file = tmp_path / "bad.hydraulics.yaml"
    text = axis.source.read_text()
    file.write_text(text + "joints: [{name: sledge, viscous_friction: 3.0}]\n")
    with pytest.raises(RobotError, match="no joint 'sledge'"):
        load_robot(file)
    file.write_text(text + "joints: [{name: carriage, viscous_friction: 3.0}]\n")
    assert load_robot(file).joints[0].viscous_friction == 3.0
