"""What a robot file's targets mean for effects of each kind, and effects of instruments."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from hydro_model.effects import CATALOGUE, Readings, Stage, read_with, resolve, targets
from hydro_model.effects.readings import delayed
from hydro_model.errors import RobotError
from hydro_model.robot import EffectSpec, Robot
from hydro_model.robot_files import load_robot

CRANE, AXIS = load_robot("xs031"), load_robot("emps")
CHAMBERS = ("lift_cylinder/a", "lift_cylinder/b", "tilt_cylinder/a", "tilt_cylinder/b")


def listed(*specs: tuple[str, str, dict[str, float]], robot: Robot = CRANE) -> Robot:
    return replace(robot, effects=tuple(EffectSpec(*spec) for spec in specs))


def machine(name: str) -> Robot:
    """A robot that may have an effect: the crane, or an axis without cylinder."""
    return AXIS if CATALOGUE[name].drive_only else CRANE


def typical(name: str) -> dict[str, float]:
    return {p.name: p.typical for p in CATALOGUE[name].parameters}


@pytest.mark.parametrize("name", CATALOGUE)
def test_every_effect_resolves_at_each_of_its_targets_and_at_the_robot(name) -> None:
    robot = machine(name)
    every = targets(robot, CATALOGUE[name])
    assert every
    for target in every:
        (one,) = resolve(listed((name, target, typical(name)), robot=robot))
        assert one.target == target
    found = resolve(listed((name, robot.name, typical(name)), robot=robot))
    assert tuple(one.target for one in found) == every


def test_targets_by_kind() -> None:
    kinds = {
        "coulomb_friction": ("lift_cylinder", "tilt_cylinder"),
        "encoder_offset": ("lift", "tilt"),
        "pressure_sensor_bias": CHAMBERS,
        "base_tilt": ("xs031",),
    }
    for name, expected in kinds.items():
        assert targets(CRANE, CATALOGUE[name]) == expected
    assert targets(AXIS, CATALOGUE["coulomb_friction"]) == ("carriage",)
    assert targets(AXIS, CATALOGUE["pin_friction"]) == ()
    assert targets(AXIS, CATALOGUE["joint_coupling"]) == ()


@pytest.mark.parametrize("target", ["tilt_cylinder", "tilt_valve", "tilt"])
def test_a_cylinder_stands_for_its_joint_and_for_its_chambers(target) -> None:
    (offset,) = resolve(listed(("encoder_offset", target, {"offset": 0.01})))
    assert (offset.target, offset.joint, offset.index) == ("tilt", 1, 1)
    both = resolve(listed(("pressure_sensor_bias", target, {"bias": 1e5})))
    assert [(one.target, one.index) for one in both] == [(CHAMBERS[2], 2), (CHAMBERS[3], 3)]


def test_one_chamber_has_the_laws_of_that_chamber_alone() -> None:
    (one,) = resolve(listed(("end_cushion", "lift_cylinder/b", {"strength": 0.9, "length": 0.02})))
    assert [term.stage for term in one.terms] == [Stage.FLOW_B]
    assert (one.cylinder, one.side, one.target) == (0, "b", "lift_cylinder/b")
    with pytest.raises(RobotError, match="unknown target 'lift_cylinder/b'"):
        resolve(listed(("coulomb_friction", "lift_cylinder/b", {"force": 1.0})))


def test_rails_have_sensors_too() -> None:
    found = resolve(listed(("pressure_sensor_gain", "tank", {"error": 0.01})))
    assert [(one.target, one.index) for one in found] == [("tank", 5)]


@pytest.mark.parametrize(
    ("spec", "message"),
    [
        (("joint_coupling", "carriage", {"viscous": 1.0}), "looks at another joint"),
        (("internal_leakage", "carriage", {"coefficient": 0.0}), "unknown target 'carriage'"),
        (("base_tilt", "carriage", {"pitch": 0.0}), "expected target 'emps', found 'carriage'"),
    ],
)
def test_what_a_robot_does_not_have_is_said(spec, message) -> None:
    with pytest.raises(RobotError, match=message):
        resolve(listed(spec, robot=AXIS))


@pytest.mark.parametrize("name", CATALOGUE)
def test_values_outside_their_bounds_are_rejected(name) -> None:
    effect, robot = CATALOGUE[name], machine(name)
    target = targets(robot, effect)[0]
    for parameter in effect.parameters:
        for value in (parameter.lower, parameter.upper):
            given = {**typical(name), parameter.name: value}
            resolve(listed((name, target, given), robot=robot))
        span = parameter.upper - parameter.lower
        for value in (parameter.lower - 0.01 * span, parameter.upper + 0.01 * span, np.nan):
            changed = listed((name, target, {**typical(name), parameter.name: value}), robot=robot)
            with pytest.raises(RobotError, match=f"{name}.{parameter.name} should be"):
                resolve(changed)


def test_payload_may_change_more_than_once_but_not_twice_at_once() -> None:
    first = ("payload_change", "xs031", {"mass": 50.0, "start_s": 2.0})
    then = ("payload_change", "xs031", {"mass": -50.0, "start_s": 1.0})
    assert [one.parameters[0] for one in resolve(listed(first, then))] == [-50.0, 50.0]
    with pytest.raises(RobotError, match="listed twice for 'xs031'"):
        resolve(listed(first, first))


@pytest.mark.parametrize("first", ["lift_cylinder", "lift_cylinder/a", "lift", "xs031"])
@pytest.mark.parametrize("then", ["lift_cylinder", "lift_cylinder/a", "lift", "xs031"])
def test_a_chamber_within_its_cylinder_is_listed_twice_in_either_order(
    first: str, then: str
) -> None:
    volume = {"volume_a": 1e-3, "volume_b": 1e-3}
    with pytest.raises(RobotError, match="'dead_volume' is listed twice for 'lift_cylinder"):
        resolve(listed(("dead_volume", first, volume), ("dead_volume", then, volume)))


def test_chambers_listed_one_by_one_are_two() -> None:
    volume, bias = {"volume_a": 1e-3, "volume_b": 1e-3}, {"bias": 1e5}
    for name, values in (("dead_volume", volume), ("pressure_sensor_bias", bias)):
        specs = [(name, f"lift_cylinder/{side}", values) for side in "ba"]
        found = resolve(listed(*specs, (name, "tilt_cylinder/a", values)))
        assert {one.target for one in found} == set(CHAMBERS[:3])


def test_a_chamber_of_which_nothing_is_said_does_not_leak() -> None:
    (one,) = resolve(listed(("external_leakage", "lift_cylinder", {"coefficient_b": 2e-13})))
    assert one.parameters.tolist() == [0.0, 2e-13]


def readings(count: int = 50) -> Readings:
    rng = np.random.default_rng(1)
    return Readings(
        step_s=0.002,
        q=rng.normal(size=(count, 2)),
        p_a=rng.uniform(0.0, 2e7, (count, 2)),
        p_b=rng.uniform(0.0, 2e7, (count, 2)),
        supply=np.full(count, 19e6),
        tank=np.full(count, 1e6),
        valve_signal=rng.uniform(-1.0, 1.0, (count, 2)),
        torque=np.full((count, 2), np.nan),
    )


def changed(name: str, target: str, parameters: dict[str, float]) -> dict[str, np.ndarray]:
    """Differences of what the sensors show to what is, where there are any."""
    true = readings()
    shown = read_with(listed((name, target, parameters)), true)
    fields = ("q", "p_a", "p_b", "supply", "tank", "valve_signal")
    gaps = {f: getattr(shown, f) - getattr(true, f) for f in fields}
    return {f: gap for f, gap in gaps.items() if gap.any()}


def test_offset_moves_one_angle() -> None:
    (gap,) = changed("encoder_offset", "tilt", {"offset": 0.02}).values()
    np.testing.assert_allclose(gap, np.tile([0.0, 0.02], (50, 1)))


def test_bias_and_gain_change_one_pressure() -> None:
    gaps = changed("pressure_sensor_bias", "tilt_cylinder/a", {"bias": 3e4})
    np.testing.assert_allclose(gaps.pop("p_a"), np.tile([0.0, 3e4], (50, 1)), atol=1e-6)
    assert not gaps
    gaps = changed("pressure_sensor_gain", "lift_cylinder/b", {"error": 0.01})
    expected = readings().p_b * [0.01, 0.0]
    np.testing.assert_allclose(gaps.pop("p_b"), expected, atol=1e-6)
    assert not gaps
    (gap,) = changed("pressure_sensor_gain", "supply", {"error": 0.01}).values()
    np.testing.assert_allclose(gap, 19e4)


@pytest.mark.parametrize(
    ("name", "target", "parameters"),
    [
        ("encoder_offset", "tilt", {"offset": 0.3}),
        ("pressure_sensor_bias", "tilt_cylinder/a", {"bias": -3e5}),
        ("pressure_sensor_gain", "lift_cylinder/b", {"error": 0.19}),
        ("pressure_sensor_gain", "supply", {"error": -0.19}),
    ],
)
def test_what_a_sensor_reads_wrongly_is_undone(
    name: str, target: str, parameters: dict[str, float]
) -> None:
    true, robot = readings(), listed((name, target, parameters))
    (one,) = resolve(robot)
    back = one.effect.undone(read_with(robot, true), one.index, one.parameters)
    for field in ("q", "p_a", "p_b", "supply", "tank"):
        np.testing.assert_allclose(getattr(back, field), getattr(true, field), rtol=1e-12)


def test_delays_shift_samples() -> None:
    true = readings()
    shown = read_with(listed(("pressure_delay", "lift", {"delay": 0.004})), true)
    np.testing.assert_array_equal(shown.p_a[2:, 0], true.p_a[:-2, 0])
    np.testing.assert_array_equal(shown.p_a[:, 1], true.p_a[:, 1])
    shown = read_with(listed(("command_delay", "xs031", {"delay": 0.006})), true)
    np.testing.assert_array_equal(shown.valve_signal[:-3], true.valve_signal[3:])


def test_delay_by_part_of_a_sample_interpolates_and_keeps_gaps_to_themselves() -> None:
    ramp = np.arange(10.0)
    np.testing.assert_allclose(delayed(ramp, 0.003, 0.002)[2:], ramp[2:] - 1.5)
    ramp[4] = np.nan
    assert np.flatnonzero(np.isnan(delayed(ramp, 0.002, 0.002))).tolist() == [5]
    assert np.flatnonzero(np.isnan(delayed(ramp, 0.001, 0.002))).tolist() == [4, 5]
    assert delayed(ramp[:0], 0.002, 0.002).shape == (0,)
    np.testing.assert_allclose(delayed(ramp[:1], 0.002, 0.002), [0.0])


@pytest.mark.parametrize("target", ["tilt_cylinder", "tilt_valve", "tilt"])
def test_target_may_be_cylinder_valve_or_joint(target) -> None:
    (one,) = resolve(listed(("valve_null_bias", target, {"bias": 0.01})))
    assert one.cylinder == 1
    assert one.parameters == pytest.approx([0.01])


def test_robot_as_target_means_every_cylinder_or_the_robot() -> None:
    robot = listed(
        ("supply_droop", "xs031", {"resistance": 4e8, "time_constant": 0.1}),
        ("coulomb_friction", "xs031", {"force": 3e3}),
    )
    found = [(one.effect.name, one.cylinder) for one in resolve(robot)]
    assert found == [("coulomb_friction", 0), ("coulomb_friction", 1), ("supply_droop", None)]


def test_optional_parameters_get_typical_values() -> None:
    (one,) = resolve(listed(("coulomb_friction", "lift", {"force": 3e3})))
    assert one.parameters == pytest.approx([3e3, 0.005])


@pytest.mark.parametrize(
    ("spec", "message"),
    [
        (("magic", "lift", {}), "no effect 'magic' in the catalogue .*coulomb_friction"),
        (("coulomb_friction", "boom", {"force": 1.0}), "unknown target 'boom' .*lift_cylinder"),
        (("coulomb_friction", "lift", {"mu": 1.0}), "no parameter 'mu' .known: force, velocity"),
        (("coulomb_friction", "lift", {}), "needs parameter 'force' in N"),
        (("coulomb_friction", "lift", {"force": -1.0}), "force should be 0 to 100000 N, found -1"),
        (("supply_droop", "lift", {"resistance": 1.0, "time_constant": 1.0}), "target 'xs031'"),
    ],
)
def test_bad_lists_are_said(spec, message) -> None:
    with pytest.raises(RobotError, match=message) as caught:
        resolve(listed(spec))
    assert "hydraulics.yaml" in str(caught.value)


def test_the_same_effect_twice_is_said() -> None:
    one = ("coulomb_friction", "lift", {"force": 1.0})
    two = ("coulomb_friction", "lift_cylinder", {"force": 2.0})
    with pytest.raises(RobotError, match="listed twice for 'lift_cylinder'"):
        resolve(listed(one, two))
