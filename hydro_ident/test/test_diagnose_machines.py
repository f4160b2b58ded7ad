"""What machines have that no textbook law of one cylinder shows: the whole diagnosis of each."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.signal import lfilter

from hydro_ident.mismatch.answer.diagnosis import diagnose
from hydro_ident.mismatch.answer.diagnosis_file import channels_told, finding_dict
from hydro_ident.mismatch.answer.outcome import Diagnosis
from hydro_model.robot import EffectSpec
from hydro_model.robot_files import load_robot

pytestmark = pytest.mark.long

Diagnosed = Callable[..., Diagnosis]


@pytest.fixture
def diagnosed(make_run: tuple[Callable[..., Any], Callable[..., Any]]) -> Diagnosed:
    """The reference crane with some effects, diagnosed by two recordings of it."""
    true_crane, simulated_run = make_run

    def run(*effects: EffectSpec, longer: float = 1.0) -> Diagnosis:
        truth = replace(true_crane(), effects=effects)
        train = simulated_run(truth, 14.0 * longer)
        check = simulated_run(truth, 9.0 * longer, seed=3)
        return diagnose(load_robot("xs031"), [train.recording()], [check.recording("check")])

    return run


@pytest.mark.thorough
def test_spools_that_all_lag_are_no_delay_of_the_commands(diagnosed: Diagnosed) -> None:
    """One delay of all commands explains more than the lag of either spool."""
    lag = {"frequency": 15.0, "damping": 0.8}
    found = diagnosed(
        EffectSpec("valve_spool_lag", "lift_valve", lag),
        EffectSpec("valve_spool_lag", "tilt_valve", lag),
    )
    assert [f.named.names[0] for f in found.findings] == ["valve_spool_lag"] * 2
    assert {f.named.term.target for f in found.findings} == {"lift_cylinder", "tilt_cylinder"}
    for one in found.findings:
        frequency, damping = one.named.term.parameters
        # What a lag comes to in motions slower than it: the delay that it looks like.
        assert damping / frequency == pytest.approx(0.8 / 15.0, rel=0.15)


@pytest.mark.thorough
def test_a_mode_is_found_wherever_its_frequency_lies(diagnosed: Diagnosed) -> None:
    """Half an octave beside what is usual nothing of a mode that hardly is damped is seen."""
    mode = {"inertia": 250.0, "frequency": 7.1, "damping": 0.03}
    found = diagnosed(EffectSpec("structural_flexibility", "lift_cylinder", mode))
    assert [f.named.names for f in found.findings] == [("structural_flexibility",)]
    inertia, frequency, *_ = found.findings[0].named.term.parameters
    assert inertia == pytest.approx(250.0, rel=0.15)
    assert frequency == pytest.approx(7.1, rel=0.03)


@pytest.mark.thorough
def test_a_hinge_in_a_link_is_one_mode_that_all_joints_feel(diagnosed: Diagnosed) -> None:
    """It is told how far along the link it is, and nothing is left for the joint behind it."""
    hinge = {"inertia": 2500.0, "frequency": 4.5, "damping": 0.05, "carried": 1.0, "place": 0.4}
    found = diagnosed(EffectSpec("structural_flexibility", "lift_cylinder", hinge))
    assert [f.named.names for f in found.findings] == [("structural_flexibility",)]
    assert found.findings[0].named.term.target == "lift_cylinder"
    inertia, frequency, _, carried, place = found.findings[0].named.term.parameters
    assert inertia * carried == pytest.approx(2500.0, rel=0.1)
    assert frequency == pytest.approx(4.5, rel=0.03)
    assert place == pytest.approx(0.4, abs=0.1)


@pytest.mark.thorough
def test_pins_whose_contacts_bend_are_pins(diagnosed: Diagnosed) -> None:
    """How a law turns around says more than its load does, and is no cause of its own."""
    pins = {"radius": 4e-3, "distance": 8e-5}
    found = diagnosed(EffectSpec("pin_friction", "lift_cylinder", pins))
    assert [f.named.names[0] for f in found.findings] == ["pin_friction"]
    radius, _, distance = found.findings[0].named.term.parameters
    assert radius == pytest.approx(4e-3, rel=0.1)
    assert distance == pytest.approx(8e-5, rel=0.3)
    forces = found.channels[0]
    left = float(np.std(forces.measured - forces.after))
    assert left < 1.5 * forces.noise_floor


@pytest.mark.thorough
def test_a_ground_is_one_finding_at_all_joints(diagnosed: Diagnosed) -> None:
    ground = {"stiffness": 6.0e3, "height": -1.4}
    _told_as_ground(
        diagnosed(EffectSpec("external_contact", "xs031", ground), longer=1.3), 1.0, 0.0
    )


@pytest.mark.thorough
def test_a_ground_that_takes_up_energy_is_no_friction(diagnosed: Diagnosed) -> None:
    """Pressed in as bodies are; the law looks at the tip's rate, to which both joints add."""
    ground = {"stiffness": 6.0e3, "height": -1.4, "exponent": 1.5, "damping": 0.8}
    _told_as_ground(
        diagnosed(EffectSpec("external_contact", "xs031", ground), longer=1.3), 1.5, 0.8
    )


def _told_as_ground(found: Any, exponent: float, damping: float) -> None:
    (finding,) = found.findings
    assert finding.named.names == ("external_contact",)
    assert finding.named.term.target == "xs031"
    assert set(finding.channels) == {"lift/force", "tilt/force"}
    *law, drag = finding.named.term.parameters
    assert law == pytest.approx([6.0e3, -1.4, 0.0, exponent], rel=0.1)
    assert drag == pytest.approx(damping, rel=0.1, abs=0.01)


@pytest.mark.thorough
def test_what_a_joint_runs_against_is_a_contact_at_it(
    diagnosed: Diagnosed, crane_run: Any
) -> None:
    """As it rises; the other joint does not feel it."""
    way = -1.0
    place = way * float(np.quantile(way * crane_run.q[:, 1], 0.3))
    stop = {"stiffness": 2.0e4, "height": way * place, "way": way}
    found = diagnosed(EffectSpec("external_contact", "tilt_cylinder", stop))
    (finding,) = found.findings
    assert finding.named.names == ("external_contact",)
    assert finding.channels[0] == "tilt/force"
    *law, drag = finding.named.term.parameters
    assert law == pytest.approx([2.0e4, way * place, way, 1.0], rel=0.1)
    assert drag == pytest.approx(0.0, abs=0.01)


@pytest.mark.thorough
def test_a_back_pressure_behind_the_transducer_is_told(
    make_run: tuple[Callable[..., Any], Callable[..., Any]],
) -> None:
    """The tank is on record, where no return line is."""
    true_crane, simulated_run = make_run
    rail = EffectSpec("tank_back_pressure", "xs031", {"resistance": 3e11, "time_constant": 0.03})
    truth, runs = replace(true_crane(), effects=(rail,)), []
    for name, seconds, seed in (("run", 14.0, 1), ("check", 9.0, 3)):
        one = simulated_run(truth, seconds, seed=seed).recording(name)
        noise = 2e3 * np.random.default_rng(seed).standard_normal(len(one))
        runs.append(replace(one, tank=truth.tank_pressure_pa + noise))
    (finding,) = diagnose(load_robot("xs031"), runs[:1], runs[1:]).findings
    assert finding.named.names[0] == "tank_back_pressure"
    assert finding.named.term.parameters[0] == pytest.approx(3e11, rel=0.15)


@pytest.mark.thorough
def test_a_back_pressure_is_told_with_the_flow_that_it_leaves(diagnosed: Diagnosed) -> None:
    """Flows at the undisturbed rail are too large, and the resistance comes out too small."""
    rail = {"resistance": 3e11, "time_constant": 0.03}
    found = diagnosed(EffectSpec("tank_back_pressure", "xs031", rail))
    assert [f.named.names[0] for f in found.findings] == ["tank_back_pressure"]
    assert found.findings[0].named.term.parameters[0] == pytest.approx(3e11, rel=0.03)


@pytest.mark.thorough
def test_oil_is_warm_when_the_machine_is_recorded_again(
    make_run: tuple[Callable[..., Any], Callable[..., Any]],
) -> None:
    """Not recorded, its temperature goes with time, but not anew in every recording."""
    true_crane, simulated_run = make_run
    bags = []
    for name, seconds, seed, since_s in (("train", 30.0, 0, 0.0), ("check", 20.0, 3, 18.0)):
        drift = {"viscous": 3.0e4, "rise": 24.0, "time_constant": 12.0, "warm_s": since_s}
        warming = EffectSpec("temperature_drift", "lift_cylinder", drift)
        truth = replace(true_crane(), effects=(warming,))
        bags.append(simulated_run(truth, seconds, seed=seed).recording(name))
    found = diagnose(load_robot("xs031"), bags[:1], bags[1:])
    (one,) = found.findings
    assert (one.named.names, one.channels[0]) == (("temperature_drift",), "lift/force")
    assert not one.verification.silent
    assert any("has been under way for" in note for note in found.notes)
    (lift,) = (c for c in found.channels if c.name == "lift/force")
    left = float(np.sqrt(np.mean((lift.measured - lift.after) ** 2)))
    assert left < 1.5 * lift.noise_floor


@pytest.mark.thorough
def test_oil_that_thins_out_is_told_by_its_temperature(
    make_run: tuple[Callable[..., Any], Callable[..., Any]],
) -> None:
    """Recorded, the temperature says what else only time could."""
    true_crane, simulated_run = make_run
    viscous, rise_k, tau_s, at_first_c = 3.0e4, 24.0, 8.0, 31.0
    warming = {"viscous": viscous, "rise": rise_k, "time_constant": tau_s}
    truth = replace(
        true_crane(), effects=(EffectSpec("temperature_drift", "lift_cylinder", warming),)
    )
    bags = []
    for name, seconds, seed in (("train", 30.0, 0), ("check", 20.0, 3)):
        bag = simulated_run(truth, seconds, seed=seed).recording(name)
        stamps = bag.stamp_ns[::500]
        since_s = (stamps - stamps[0]) * 1e-9
        oil_c = at_first_c + rise_k * (1.0 - np.exp(-since_s / tau_s))
        bags.append(replace(bag, temperature_stamp_ns=stamps, temperature_c=oil_c))
    found = diagnose(load_robot("xs031"), bags[:1], bags[1:])
    (one,) = found.findings
    assert (one.named.names, one.channels[0]) == (("temperature_drift",), "lift/force")
    variable = finding_dict(found, one)["where"]["variable"]
    assert variable == "oil_temperature"
    b, halving, rise, _, reference, _ = one.named.term.parameters
    expected = viscous * 2.0 ** (-(reference - at_first_c) / 17.5)
    assert rise == 0.0
    assert (b, halving) == (pytest.approx(expected, rel=0.05), pytest.approx(17.5, rel=0.05))


@pytest.mark.thorough
def test_transducers_that_wander_slowly_and_read_late_are_no_finding(
    make_run: tuple[Callable[..., Any], Callable[..., Any]],
) -> None:
    """Offsets of 0.02 % of the range that come and go over seconds: no event, no line of time.

    Nor is what their electronics make, delays of 0.4 and 0.1 ms, a spring, friction or a coupling.
    """
    true_crane, simulated_run = make_run
    rng, kept = np.random.default_rng(1), np.exp(-0.002 / 8.0)

    def wander(like: Any) -> Any:
        steps = rng.normal(size=like.shape) * np.sqrt(1.0 - kept**2)
        return 5.0e3 * lfilter([1.0], [1.0, -kept], steps, axis=0)

    def late(p: Any, delay_s: float) -> Any:
        return p - delay_s * np.gradient(p, 0.002, axis=0) + wander(p)

    bags = []
    for name, seconds, motion in (("train", 28.0, 0), ("check", 18.0, 3)):
        run = simulated_run(true_crane(), seconds, seed=motion)
        run = replace(run, p_a=late(run.p_a, 4.0e-4), p_b=late(run.p_b, 1.0e-4))
        bags.append(run.recording(name))
    found = diagnose(load_robot("xs031"), bags[:1], bags[1:])
    assert (found.findings, found.unexplained) == ((), ())


@pytest.mark.thorough
def test_laws_of_edges_in_their_other_forms(diagnosed: Diagnosed) -> None:
    """A valve that holds its drop both ways, and one whose rounded edges overlap at null alone."""
    both = {"share": 0.9, "margin": 1.5e6, "outflow": 0.8}
    rounded = {"width": 0.04, "shift": 0.0}
    found = diagnosed(
        EffectSpec("pressure_compensation", "tilt_valve", both),
        EffectSpec("valve_underlap", "lift_valve", rounded),
        longer=1.3,
    )
    named = {f.named.names[0]: f.named.term for f in found.findings}
    assert set(named) == {"pressure_compensation", "valve_underlap"}
    held, lap = named["pressure_compensation"], named["valve_underlap"]
    assert (held.target, lap.target) == ("tilt_cylinder", "lift_cylinder")
    assert held.parameters == pytest.approx([0.9, 1.5e6, 0.8], rel=0.2)
    width, shift = lap.parameters
    assert width == pytest.approx(0.04, rel=0.1)
    assert shift < 0.2


@pytest.mark.thorough
def test_a_spool_of_a_few_hertz_lags(diagnosed: Diagnosed) -> None:
    slow = {"frequency": 2.5, "damping": 0.8}
    found = diagnosed(EffectSpec("valve_spool_lag", "tilt_valve", slow))
    assert found.findings[0].named.names[0] == "valve_spool_lag"
    assert found.findings[0].named.term.parameters == pytest.approx([2.5, 0.8], rel=0.15)


@pytest.mark.thorough
def test_one_valve_that_is_late_is_a_delay_of_that_valve(diagnosed: Diagnosed) -> None:
    """No lag of its spool, and no delay of all; of so little a lag may be in the set."""
    delay_s = 0.006
    found = diagnosed(EffectSpec("command_delay", "tilt_valve", {"delay": delay_s}))
    (one,) = found.findings
    assert one.named.names[0] == "command_delay"
    assert finding_dict(found, one)["also"][-1] == "timing"
    assert one.named.term.target == "tilt_cylinder"
    assert one.named.term.parameters[0] == pytest.approx(delay_s, abs=2e-4)
    assert found.robot is not None
    (listed,) = found.robot.effects
    assert (listed.name, listed.target) == ("command_delay", "tilt_cylinder")
    assert not [note for note in found.notes if "delays differ" in note]


def test_what_may_be_a_lag_between_signals_is_told_of_timing_too() -> None:
    flows = ("tilt/flow_a", "tilt/flow_b")
    assert channels_told(flows, ("valve_null_bias",)) == flows
    assert channels_told(flows, ("valve_spool_lag", "command_delay")) == (*flows, "timing")
