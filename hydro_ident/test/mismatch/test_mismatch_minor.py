"""What is within every machine's tolerances is told in a note, and no finding."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hydro_ident.mismatch.answer import minor
from hydro_ident.mismatch.answer.minor import is_minor, minor_notes, parted, parted_unknown
from hydro_ident.mismatch.answer.outcome import ChannelResult, Finding
from hydro_ident.mismatch.fitting.weighed import Weighed
from hydro_ident.mismatch.locating.dependence import Dependence
from hydro_ident.mismatch.naming.named import named_of
from hydro_ident.mismatch.trials.contender import Contender
from hydro_ident.mismatch.unnamed.unknown import Unexplained
from hydro_model.effects.catalogue import resolve
from hydro_model.effects.targets import ActiveEffect
from hydro_model.robot import EffectSpec, Robot
from hydro_model.robot_files import load_robot

#: A fit of nothing: no number of it has a deviation.
UNFITTED = Weighed(None, (), np.zeros((0, 0)), np.zeros(0))  # type: ignore[arg-type]
LIFT = "lift_cylinder"
#: Of the lift cylinder's piston; transducers' zeros of 4 and 20 kPa push with it.
AREA_M2 = load_robot("xs031").cylinders[0].area_a_m2


def _term(robot: Robot, name: str, target: str, parameters: dict[str, float]) -> ActiveEffect:
    (term,) = resolve(replace(robot, effects=(EffectSpec(name, target, parameters),)))
    return term


def _push(robot: Robot) -> float:
    return robot.cylinders[0].area_a_m2 * robot.supply_pressure_pa


@pytest.mark.parametrize(
    ("name", "target", "small", "large"),
    [
        ("pressure_sensor_gain", f"{LIFT}/a", {"error": -5e-4}, {"error": -2e-3}),
        ("pressure_sensor_bias", f"{LIFT}/b", {"bias": 4e3}, {"bias": -2e4}),
        ("encoder_offset", "lift", {"offset": -3e-4}, {"offset": 1e-3}),
        ("constant_force_offset", LIFT, {"force": -4e3 * AREA_M2}, {"force": 2e4 * AREA_M2}),
        (
            "dead_volume",
            LIFT,
            {"volume_a": 8e-6, "volume_b": 9e-6},
            {"volume_a": 8e-6, "volume_b": 2e-4},
        ),
        ("valve_null_bias", "lift_valve", {"bias": -2e-4}, {"bias": 5e-4}),
        ("valve_hysteresis", "lift_valve", {"half_width": 2e-4}, {"half_width": 1e-3}),
        ("valve_deadband", "lift_valve", {"width": 9e-4}, {"width": 1.2e-3}),
        ("valve_underlap", "lift_valve", {"width": 9e-4}, {"width": 1.2e-3}),
        (
            "pressure_compensation",
            "lift_valve",
            {"share": 0.01, "margin": 7e5, "outflow": 0.008},
            {"share": 0.01, "margin": 7e5, "outflow": 0.03},
        ),
        (
            "valve_gain_nonlinearity",
            "lift_valve",
            {"progression": -0.07, "knee": 0.008},
            {"progression": -0.07, "knee": 0.02},
        ),
        # As far beyond the knee as an underlap of 0.17 %: the slope there is what edges are.
        (
            "valve_gain_nonlinearity",
            "lift_valve",
            {"progression": -0.825, "knee": 2.0e-4},
            {"progression": -0.825, "knee": 3.6e-4},
        ),
    ],
)
def test_sizes_within_data_sheets_are_minor(
    robot: Robot, name: str, target: str, small: dict[str, float], large: dict[str, float]
) -> None:
    assert is_minor(robot, _term(robot, name, target, small))
    assert not is_minor(robot, _term(robot, name, target, large))


def test_a_gain_that_changes_evenly_is_none_of_edges(robot: Robot) -> None:
    even = {"progression": 0.005, "knee": 0.0}
    assert not is_minor(robot, _term(robot, "valve_gain_nonlinearity", "lift_valve", even))


def test_small_machines_are_held_to_less(robot: Robot) -> None:
    """A third of a small cylinder's oil is no fitting's; nor is 5 kPa little of 5 bar."""
    volumes = {"volume_a": 9e-6, "volume_b": 9e-6}
    cylinder = replace(robot.cylinders[0], bore_m=0.02, rod_m=0.01, stroke_m=0.1)
    small = replace(robot, cylinders=(cylinder, robot.cylinders[1]), supply_pressure_pa=5e5)
    for name, target, sizes in (
        ("dead_volume", LIFT, volumes),
        ("pressure_sensor_bias", f"{LIFT}/a", {"bias": 4e3}),
    ):
        assert is_minor(robot, _term(robot, name, target, sizes))
        assert not is_minor(small, _term(small, name, target, sizes))
        tiny = {key: 0.05 * value for key, value in sizes.items()}
        assert is_minor(small, _term(small, name, target, tiny))


def test_zeros_of_transducers_are_minor_by_their_range(robot: Robot) -> None:
    """Ones of 400 bar are 8 kPa off as ones of 100 bar are 2 kPa off."""

    def ranged(range_pa: float) -> Robot:
        return replace(robot, sensors=replace(robot.sensors, pressure_range_pa=range_pa))

    wide, narrow = ranged(4e7), ranged(1e7)
    for bias, expected in ((8e3, (True, False)), (2e3, (True, True)), (1.2e4, (False, False))):
        one = {"bias": -bias}
        force = {"force": bias * AREA_M2}
        for own, small in zip((wide, narrow), expected, strict=True):
            assert is_minor(own, _term(own, "pressure_sensor_bias", f"{LIFT}/a", one)) is small
            assert is_minor(own, _term(own, "constant_force_offset", LIFT, force)) is small


def test_a_size_has_to_be_surely_beyond_the_tolerance(robot: Robot) -> None:
    """Two deviations beyond it, which are no more than a third of the size."""
    term = _term(robot, "dead_volume", LIFT, {"volume_a": 1.2e-5, "volume_b": 8e-6})
    vague = _term(robot, "dead_volume", LIFT, {"volume_a": 1.6e-5, "volume_b": 8e-6})
    known, name = {f"{LIFT}.dead_volume.volume_b": 1e-7}, f"{LIFT}.dead_volume.volume_a"
    assert not is_minor(robot, term, known | {name: 0.9e-6})
    assert is_minor(robot, term, known | {name: 1.1e-6})
    assert not is_minor(robot, vague, known | {name: 1e-4})


def test_friction_is_minor_by_what_the_cylinder_can_push(robot: Robot) -> None:
    for share, expected in ((1e-4, True), (1e-3, False)):
        force = {"force": share * _push(robot)}
        assert is_minor(robot, _term(robot, "coulomb_friction", LIFT, force)) is expected


def test_friction_of_two_parts_counts_at_50_mm_s(robot: Robot) -> None:
    for viscous, expected in ((1e-3, True), (3e-3, False)):
        values = {"force": -1e-4 * _push(robot), "viscous": viscous * _push(robot)}
        term = _term(robot, "asymmetric_friction", LIFT, values)
        assert is_minor(robot, term) is expected


def test_what_has_no_name_and_is_tiny_is_noted() -> None:
    wave = 1e4 * np.sin(np.arange(1000.0))
    channel = ChannelResult("lift/force", "N", np.arange(1000.0), wave, wave, wave, 1.0)
    curve = np.zeros(3)
    some = Dependence(
        0, "lift/force", "time", "", 9.0, 2, 9.0, 0.001, 0.09, 5.0, curve, curve, curve, 0.3
    )
    text = "9% of what is left in lift/force follows time (5 N rms, repeats every 0.3 s)"
    tiny = Unexplained("lift/force", ("time",), 0.09, 0.001, text, some, size=5.0)
    real = replace(tiny, size=12.0)
    at_large = replace(tiny, depends_on=("everywhere",), size=math.inf)
    kept, (note,) = parted_unknown([tiny, real, at_large], [channel])
    assert kept == (real, at_large)
    assert note.startswith(text)
    assert "0.071 % of lift/force itself" in note


def test_a_hundredth_of_what_noise_leaves_is_no_unknown() -> None:
    at, curve = np.arange(1000.0), np.zeros(3)
    wave, left = 100.0 * np.sin(at), np.where(at % 2.0, 1.0, -1.0)
    some = Dependence(
        0, "lift/force", "time", "", 9.0, 2, 9.0, 0.001, 0.01, 0.1, curve, curve, curve, 0.3
    )
    own = Unexplained("lift/force", ("time",), 0.01, 0.001, "1% of what is left", some, size=0.2)
    for share, noise, expected in ((0.01, 0.9, False), (0.01, 0.5, True), (0.04, 0.9, True)):
        channel = ChannelResult("lift/force", "N", at, wave, wave, wave - left, noise)
        kept, notes = parted_unknown([replace(own, share=share)], [channel])
        assert bool(kept) is expected
        assert [n.startswith("1% of what is left: 1 % of") for n in notes] == [True] * (not kept)


def test_an_effect_without_tolerance_is_never_minor(robot: Robot) -> None:
    tiny = _term(robot, "valve_spool_lag", "lift_valve", {"frequency": 500.0, "damping": 0.7})
    assert not is_minor(robot, tiny)


def test_minor_ones_leave_the_findings_and_are_noted(robot: Robot) -> None:
    terms = [
        _term(robot, "pressure_sensor_gain", f"{LIFT}/a", {"error": 5e-4}),
        _term(robot, "coulomb_friction", LIFT, {"force": 0.01 * _push(robot)}),
    ]
    found = []
    for term in terms:
        one = Contender(term, UNFITTED, 400.0, 380.0, 3.0)
        found.append(Finding(named_of([one], 0.001, 1.0), None, ("lift/force",)))  # type: ignore[arg-type]
    findings, small = parted(robot, found, {})
    assert [f.named.names for f in findings] == [("coulomb_friction",)]
    assert [f.named.names for f in small] == [("pressure_sensor_gain",)]
    (note,) = minor_notes(robot, small, {})
    assert f"pressure_sensor_gain of {LIFT}/a" in note
    assert "(error 0.0005)" in note


def test_what_may_be_no_more_than_every_machine_has_is_no_finding(robot: Robot) -> None:
    """A spring that nothing tells from 0.06 % of a transducer's gain."""
    spring = _term(robot, "counterbalance_spring", LIFT, {"force": 50.0, "stiffness": 900.0})

    def found(error: float) -> Finding:
        gain = _term(robot, "pressure_sensor_gain", f"{LIFT}/a", {"error": error})
        both = [Contender(term, UNFITTED, 400.0, 380.0, 3.0) for term in (spring, gain)]
        return Finding(named_of(both, 0.001, 1.0), None, ("lift/force",))  # type: ignore[arg-type]

    small, large = found(6e-4), found(4e-3)
    assert len(small.named.names) == 2
    findings, minor_ones = parted(robot, [small, large], {})
    assert (findings, minor_ones) == ([large], [small])
    (note,) = minor_notes(robot, minor_ones, {})
    assert note.startswith(f"counterbalance_spring of {LIFT} is there, but it may as well be")
    assert f"pressure_sensor_gain of {LIFT}/a, not surely larger" in note
    assert "(error 0.0006)" in note


def test_the_page_says_these_sizes() -> None:
    page = (Path(__file__).parents[3] / "hydro_msgs_docs/diagnosis.md").read_text(encoding="utf-8")
    paragraph = page.partition("* **Minor.**")[2].partition("* **Limits.**")[0]
    gain, bias, offset, volume, null, *others = (most for _, most in minor._TOLERATED.values())
    *edges, share = others
    assert edges == [null, minor._EDGE, minor._EDGE]
    for told in (
        f"gains of transducers below {1e2 * gain:g} %",
        f"biases below {1e2 * bias:g} % of the transducers' range",
        f"{1e2 * minor._SUPPLY_SHARE:g} % of the supply",
        f"{1e3 * offset:g} mrad",
        f"{1e6 * volume:g} ml",
        f"12-bit converter ({1e2 * null:.2g} % of the signal), overlaps, underlaps",
        f"come to less than {1e2 * minor._EDGE:g} % of the signal",
        f"shares of a flow below {1e2 * share:g} % that do not follow the pressure",
        f"{1e2 * minor._FRICTION_SHARE:g} % of what the cylinder can push",
        f"no name is below {1e2 * minor.UNKNOWN_SHARE:g} %",
    ):
        assert told in paragraph, told
