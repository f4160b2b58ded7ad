"""What a diagnosis calls variables, and their units: of a cylinder, of a joint without one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from hydro_ident.mismatch.locating.dependence import Dependence
from hydro_ident.mismatch.rows.channel_words import ChannelWords
from hydro_ident.mismatch.rows.state_space import UNITS
from hydro_ident.mismatch.trials.contender import at_a_bound
from hydro_ident.mismatch.unnamed.describe import variables_of
from hydro_ident.mismatch.unnamed.unknown import Unexplained
from hydro_ident.parameters.parameters import effect_unit, viscous_unit
from hydro_ident.report.unnamed_words import in_words
from hydro_model.effects import resolve
from hydro_model.robot import EffectSpec, Robot
from hydro_model.robot_files import load_robot

CHANNEL = "carriage/torque"


def _axis(prismatic: bool) -> Robot:
    robot = load_robot("emps")
    return replace(robot, joints=(replace(robot.joints[0], prismatic=prismatic),))


TURNING, SLIDING = (ChannelWords(_axis(prismatic), CHANNEL) for prismatic in (False, True))


def test_a_cylinder_keeps_names_and_units() -> None:
    for channel in ("lift/force", "lift/flow_a"):
        words = ChannelWords(load_robot("xs031"), channel)
        for variable, unit in UNITS.items():
            assert (words.name(variable), words.unit(variable)) == (variable, unit)


@pytest.mark.parametrize(
    ("variable", "said", "turning", "sliding"),
    [
        ("piston_velocity", "joint velocity", "rad/s", "m/s"),
        ("piston_position", "joint position", "rad", "m"),
        ("piston_acceleration", "joint acceleration", "rad/s^2", "m/s^2"),
        ("other_joint", "other joint", "rad/s", "rad/s"),
        ("time", "time", "s", "s"),
    ],
)
def test_without_a_cylinder_the_joint_itself_moves(
    variable: str, said: str, turning: str, sliding: str
) -> None:
    for words, unit in ((TURNING, turning), (SLIDING, sliding)):
        assert (words.prose(variable), words.unit(variable)) == (said, unit)


def test_a_joint_that_turns_has_a_torque_and_an_angle_and_one_that_slides_has_neither() -> None:
    for words, force, place in (
        (TURNING, ("joint torque", "N m"), ("joint angle", "rad")),
        (SLIDING, ("joint force", "N"), ("joint position", "m")),
    ):
        assert (words.prose("piston_force"), words.unit("piston_force")) == force
        assert (words.prose("joint_angle"), words.unit("joint_angle")) == place


def test_a_form_is_told_twice_only_where_piston_and_joint_differ() -> None:
    cylinder = ChannelWords(load_robot("xs031"), "lift/force")
    assert variables_of("joint_angle", cylinder) == ("joint_angle", "piston_position")
    for words in (TURNING, SLIDING):
        assert variables_of("joint_angle", words) == ("joint_angle",)
        assert variables_of("piston_position", words) == ("piston_position",)


def test_a_size_at_its_end_is_told_in_the_units_of_its_joint() -> None:
    for words, unit in ((TURNING, "N m"), (SLIDING, "N")):
        spec = EffectSpec("coulomb_friction", "carriage", {"force": 1e5})
        (one,) = resolve(replace(words.robot, effects=(spec,)))
        assert at_a_bound(one).endswith(f"(1e+05 {unit})")


def test_what_gives_way_under_a_hand_is_no_contact() -> None:
    """200 N at the end of three metres turn a joint by that much; under the tip it is a ground."""
    soft = EffectSpec("external_contact", "lift_cylinder", {"stiffness": 500.0, "height": 0.0})
    (at_joint,) = resolve(replace(load_robot("xs031"), effects=(soft,)))
    under_tip = replace(at_joint, cylinder=None, target="xs031")
    assert "below any that bears the name" in at_a_bound(at_joint)
    assert not at_a_bound(under_tip)


def test_the_report_speaks_of_the_joint() -> None:
    none = np.zeros(2)
    curve = Dependence(
        0,
        CHANNEL,
        "piston_position",
        "velocity_squared",
        9.0,
        2,
        9.0,
        1e-3,
        0.2,
        5.0,
        none,
        none,
        none,
        0.5,
    )
    text = f"20% of what is left in {CHANNEL} follows joint_position"
    one = Unexplained(CHANNEL, ("piston_position",), 0.2, 1e-3, text, curve)
    for words, unit, every in ((TURNING, "N m", "0.5 rad (28.6°)"), (SLIDING, "N", "0.5 m")):
        said = in_words(one, unit, words)
        assert f"repeats every {every} of the carriage joint" in said
        assert "the square of the joint's velocity" in said
        assert f"about 5 {unit} rms" in said
        assert "piston" not in said


def test_identified_parameters_have_the_units_of_their_joint() -> None:
    for words, viscous, force in ((TURNING, "N m s/rad", "N m"), (SLIDING, "N s/m", "N")):
        assert viscous_unit(words.robot, "carriage.viscous_friction") == viscous
        assert effect_unit(words.robot, "carriage.coulomb_friction.force") == force
    crane = load_robot("xs031")
    assert viscous_unit(crane, "lift_cylinder.viscous_friction") == "N s/m"
    assert effect_unit(crane, "lift_cylinder.coulomb_friction.force") == "N"
    turning = effect_unit(TURNING.robot, "carriage.joint_coupling.viscous")
    assert turning == "N m s/rad"
