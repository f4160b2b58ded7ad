"""Stages that must not be used: values that nothing has, and models that predict badly."""

from __future__ import annotations

import re
from dataclasses import replace
from html import unescape
from pathlib import Path

import numpy as np
import pytest

from hydro_ident.bag.recording import Recording
from hydro_ident.bag.streaming import map_columns
from hydro_ident.commands.identify import summary_text
from hydro_ident.estimate.flows.cylinder_fit import CylinderFit
from hydro_ident.estimate.flows.hydraulics import HydraulicFit
from hydro_ident.estimate.forces.bounds import conditioned
from hydro_ident.identify.compare import compare
from hydro_ident.identify.estimation import Estimates
from hydro_ident.identify.identification import Identification, Settings, identify
from hydro_ident.identify.identification_node import determined
from hydro_ident.identify.rejection import within_bounds
from hydro_ident.identify.results import Provenance, result_dict
from hydro_ident.parameters.parameters import parameter_list
from hydro_ident.report.channel_rows import REJECTED
from hydro_ident.report.identification_report import report_html
from hydro_ident.report.page import written
from hydro_ident.study.synthetic import STEP_S, Noise, synthetic_recording
from hydro_model.effects.catalogue import resolve
from hydro_model.hydraulics.cylinder import lever
from hydro_model.multibody.rigid_body import inverse_dynamics
from hydro_model.robot import EffectSpec, FloatArray
from hydro_model.robot_files import load_robot

FRICTION = 4.0e4
ORIGIN = Provenance("identify bag", "1.0", "xs031", {"bag": "00"}, {})
COULOMB = (EffectSpec("coulomb_friction", "xs031", {"force": 100.0, "velocity_scale": 0.005}),)
PARTS = ("verdict", "parameters", "predictions", "laws")
LEAKAGE = (EffectSpec("internal_leakage", "lift_cylinder", {"coefficient": 1e-13}),)


def speeds(recording: Recording) -> tuple[FloatArray, FloatArray]:
    """Joint and piston speeds, (N, 2) each."""
    qd = np.gradient(recording.q, STEP_S, axis=0)
    arms = [lever(c, recording.q[:, i]) for i, c in enumerate(recording.robot.cylinders)]
    return qd, np.stack(arms, axis=1) * qd


def pushed(recording: Recording, force: FloatArray) -> Recording:
    """With more force (N, 2) on the pistons."""
    assert recording.p_a is not None
    areas = np.array([c.area_a_m2 for c in recording.robot.cylinders])
    return replace(recording, p_a=recording.p_a + force / areas)


@pytest.fixture(scope="module")
def crane() -> Recording:
    """The shipped crane with viscous friction, hardly any noise."""
    run = synthetic_recording(load_robot("xs031"), 18.0, noise=Noise(0.0, 200.0))
    return pushed(run, FRICTION * speeds(run)[1])


def names_of_forces(found: Identification) -> set[str]:
    assert found.inertial is not None
    return set(found.inertial.model.names)


def check_forces_rejected(found: Identification, why: str) -> None:
    assert found.verdict == "partly_identified"
    [problem] = [text for text in found.problems if text.startswith("forces rejected")]
    assert why in problem, problem
    given = found.given
    assert found.robot is not None
    assert np.array_equal(found.robot.link_inertia, given.link_inertia)
    frictions = [c.viscous_friction for c in given.cylinders]
    assert [c.viscous_friction for c in found.robot.cylinders] == frictions
    assert found.robot.effects == given.effects
    resolve(found.robot)
    forces = names_of_forces(found)
    rows = [p for p in found.parameters if p.name in forces]
    assert not any(p.identifiable for p in rows)
    assert all(p.held or p.reason.startswith("forces rejected: ") for p in rows)
    assert not forces & {p.name for p in determined(found)}
    changes = compare(given, found.robot, found.parameters, "old").changes
    assert not forces & {c.name for c in changes}
    assert "lift_valve.c_pa" in {c.name for c in changes}


def test_a_listed_effect_clearly_outside_its_bounds_is_rejected(crane: Recording) -> None:
    """Friction that drives: a sign is wrong somewhere."""
    bad = pushed(crane, -3000.0 * np.tanh(speeds(crane)[1] / 0.005))
    found = identify(replace(load_robot("xs031"), effects=COULOMB), [bad])
    check_forces_rejected(found, "expected lift_cylinder.coulomb_friction.force from 0 to 100000")


@pytest.mark.needs("clarabel")
def test_a_listed_effect_below_zero_by_noise_is_held_there(crane: Recording) -> None:
    robot = replace(load_robot("xs031"), effects=COULOMB)
    rng = np.random.default_rng(5)
    noisy = [
        replace(pushed(crane, 300.0 * rng.normal(size=crane.q.shape)), path=Path(f"{i}"))
        for i in range(3)
    ]
    results = [identify(robot, [one], settings=Settings(estimator="wls")) for one in noisy]
    seen = 0
    for found in results:
        assert found.verdict == "identified"
        assert found.robot is not None
        resolve(found.robot)
        values = {p.name: p for p in found.parameters}
        for owner in ("lift_cylinder", "tilt_cylinder"):
            row = values[f"{owner}.coulomb_friction.force"]
            assert row.value >= 0.0
            assert row.held == (row.value == 0.0)
            if row.held:
                seen += 1
                assert (row.identifiable, row.ci95) == (False, None)
                assert any(n.startswith(f"{row.name}: held at its bound 0 N") for n in found.notes)
                listed = [e for e in found.robot.effects if e.target == owner]
                assert listed[0].parameters["force"] == 0.0
        assert values["lift_cylinder.viscous_friction"].value == pytest.approx(FRICTION, rel=0.02)
    assert seen > 0


def test_negative_viscous_friction_is_rejected(crane: Recording) -> None:
    bad = pushed(crane, -2.0 * FRICTION * speeds(crane)[1])
    found = identify(load_robot("xs031"), [bad])
    check_forces_rejected(found, "expected lift_cylinder.viscous_friction from 0 to inf")
    assert any("signals or their signs are swapped" in text for text in found.problems)


@pytest.mark.needs("clarabel", "plotly")
def test_a_rejected_stage_is_said_once_and_marked_wherever_its_numbers_stand(
    crane: Recording,
) -> None:
    found = identify(load_robot("xs031"), [pushed(crane, -2.0 * FRICTION * speeds(crane)[1])])
    assert found.inertial is not None
    assert found.inertial.rejected
    page = unescape(report_html(found, ORIGIN.as_dict())).replace("<wbr>", "")
    part = {name: page.split(f'id="{name}"')[1].split("</section>")[0] for name in PARTS}
    why = written(found.inertial.rejected).partition("; likely causes")[0]
    assert part["parameters"].count(why) == 1
    forces = [p for p in found.parameters if p.name in names_of_forces(found) and not p.held]
    told = part["parameters"].count("forces rejected, for the reason above the table")
    assert told == len(forces) > 1
    [changes] = re.findall(r"<li>(On rows that took no part.*?)</li>", part["verdict"])
    assert "force" not in changes
    assert "flow" in changes
    assert "Nothing is claimed of lift/force, tilt/force" in part["verdict"]
    said = summary_text(found)
    for channel in found.channels:
        [row] = re.findall(
            rf"<tr[^>]*><td>(?:(?!<tr).)*{channel.name}.*?</tr>", part["predictions"]
        )
        [line] = [text for text in said.splitlines() if text.startswith(f"  {channel.name} ")]
        rejected = channel.name.endswith("/force")
        assert (REJECTED in row) == ('class="off"' in row) == rejected
        assert ("REJECTED" in line) == rejected
    assert part["predictions"].count(f"After: {REJECTED}.") >= 4
    assert part["laws"].count(REJECTED) == 2


@pytest.mark.needs("clarabel")
def test_the_terminal_has_half_of_the_reports_interval(crane: Recording) -> None:
    found = identify(load_robot("xs031"), [crane])
    said = summary_text(found)
    assert "+- half the 95 % interval" in said
    free = [p for p in found.parameters if not p.held and p.bounds[0] == -np.inf]
    assert free
    for p in free:
        assert p.ci95 is not None
        [half] = re.findall(rf"^  {p.name}\b.*\+- +(\S+)", said, re.MULTILINE)
        assert float(half) == pytest.approx((p.ci95[1] - p.ci95[0]) / 2.0, rel=6e-3)


def test_an_impossible_mass_matrix_is_rejected_with_all_parameters_determined(
    crane: Recording,
) -> None:
    robot, (qd, _) = load_robot("xs031"), speeds(crane)
    qdd = np.gradient(qd, STEP_S, axis=0)
    inertia = inverse_dynamics(robot, crane.q, 0 * qd, qdd) - inverse_dynamics(
        robot, crane.q, 0 * qd, 0 * qd
    )
    arms = np.stack([lever(c, crane.q[:, i]) for i, c in enumerate(robot.cylinders)], axis=1)
    found = identify(robot, [pushed(crane, -1.5 * inertia / arms)])
    assert found.inertial is not None
    assert not found.inertial.missing
    check_forces_rejected(found, "make no positive definite mass matrix")


def test_forces_predicted_worse_than_by_the_given_robot_are_rejected(crane: Recording) -> None:
    """A training run with a load that the other one does not have; valves are to be found."""
    robot = load_robot("xs031")
    valves = tuple(replace(v, c_pa=0.7 * v.c_pa, c_at=0.7 * v.c_at) for v in robot.valves)
    qd, _ = speeds(crane)
    moved_as = (crane.q, qd, np.gradient(qd, STEP_S, axis=0))
    arms = np.stack([lever(c, crane.q[:, i]) for i, c in enumerate(robot.cylinders)], axis=1)
    load = 0.1 * inverse_dynamics(robot, *moved_as) / arms
    good = replace(crane, path=Path("check"))
    found = identify(replace(robot, valves=valves), [pushed(crane, load)], [good])
    check_forces_rejected(found, "predicted worse than by the given robot (RMSE")
    assert (
        "training motion was too poor (play a run of `excite --robot xs031`" in found.problems[0]
    )


def test_forces_predicted_worse_than_by_their_mean_are_rejected(crane: Recording) -> None:
    assert crane.p_a is not None
    assert crane.p_b is not None
    good = replace(crane, path=Path("check"), p_a=crane.p_b, p_b=crane.p_a)
    found = identify(load_robot("xs031"), [crane], [good])
    assert any("is predicted worse than by its mean (fit -" in text for text in found.problems)
    assert all(p.reason for p in found.parameters if p.name in names_of_forces(found))


@pytest.mark.needs("clarabel")
@pytest.mark.parametrize("noise_pa", [0.0, 200.0])
def test_a_crane_at_rest_judges_no_forces_by_their_mean(crane: Recording, noise_pa: float) -> None:
    """Whatever is a newton off is worse than the mean of what does not move."""
    robot, at = crane.robot, int(np.abs(speeds(crane)[0]).sum(axis=1).argmin())
    rest = map_columns(crane, lambda values: np.repeat(values[at : at + 1], len(values), axis=0))
    areas = np.array([[c.area_a_m2, c.area_b_m2] for c in robot.cylinders])
    force = inverse_dynamics(robot, rest.q, 0.0 * rest.q, 0.0 * rest.q)
    force /= np.stack([lever(c, rest.q[:, i]) for i, c in enumerate(robot.cylinders)], axis=1)
    noise = noise_pa * np.random.default_rng(0).normal(size=(2, *rest.q.shape))
    p_b = np.full(rest.q.shape, 2e6)
    p_a = (1.001 * force + areas[:, 1] * p_b) / areas[:, 0]
    rest = replace(rest, stamp_ns=crane.stamp_ns, path=Path("rest"))
    rest = replace(rest, p_a=p_a + noise[0], p_b=p_b + noise[1])
    found = identify(load_robot("xs031"), [crane], [rest])
    assert found.inertial is not None
    assert not found.inertial.rejected


@pytest.mark.needs("clarabel")
def test_a_negative_mass_leaves_nothing_of_a_robot_without_valves() -> None:
    robot, time = load_robot("emps"), np.arange(0.0, 20.0, 0.001)
    q = 0.12 + 0.05 * np.sin(2 * np.pi * 0.7 * time) + 0.02 * np.sin(2 * np.pi * 1.9 * time)
    qd = np.gradient(q, time)
    force = 100.0 * np.gradient(qd, time) + 200.0 * qd + 20.0 * np.tanh(qd / 0.001)
    force += 0.5 * np.random.default_rng(1).normal(size=time.size)
    plain = synthetic_recording(load_robot("xs031"), 18.0, noise=Noise(0.0, 200.0))
    rails = np.full(time.size, np.nan)
    recording = replace(
        plain,
        robot=robot,
        stamp_ns=10**18 + np.arange(time.size) * 1_000_000,
        period_s=0.001,
        q=q[:, None],
        effort=-force[:, None],
        p_a=None,
        p_b=None,
        supply=rails,
        tank=rails,
        valve_v=None,
        command_v=None,
        q_ref=None,
        latched=np.zeros(time.size, dtype=bool),
    )
    found = identify(replace(robot, effects=()), [recording])
    assert found.verdict == "not_enough_data"
    assert found.robot is None
    assert "carriage_link.mass from 0 to inf kg, found -" in found.problems[0]
    good = replace(recording, effort=force[:, None])
    assert identify(replace(robot, effects=()), [good]).verdict == "identified"


@pytest.fixture(scope="module")
def leaking(crane: Recording) -> Identification:
    return identify(replace(load_robot("xs031"), effects=LEAKAGE), [crane])


def moved(found: Identification, deviations: float) -> Estimates:
    """The fit with the leakage at so many deviations from 0."""
    assert found.hydraulic is not None
    first, second = found.hydraulic.cylinders
    at = first.names.index("internal_leakage.coefficient")
    # The sum of a bound's slack and of noise.
    covariance = first.covariance.copy()
    scale = np.ones(len(first.names))
    scale[at] = 1e-14 / np.sqrt(covariance[at, at])
    covariance *= np.outer(scale, scale)
    theta = first.theta.copy()
    theta[at] = deviations * 1e-14
    shifted = replace(first, theta=theta, covariance=covariance, rejected="", held=())
    shifted = replace(shifted, identifiable=(True,) * len(first.names))
    fit = replace(found.hydraulic, cylinders=(shifted, second))
    from hydro_ident.estimate.effects.listed_effects import ListedEffects

    assert found.estimator is not None
    return Estimates(None, fit, ListedEffects.of(found.given), found.estimator)


def cylinders(fit: HydraulicFit | None) -> tuple[CylinderFit, ...]:
    assert fit is not None
    return fit.cylinders


@pytest.mark.needs("clarabel")
def test_a_chamber_effect_is_held_within_noise_and_rejected_beyond(
    leaking: Identification,
) -> None:
    robot = leaking.given
    near = within_bounds(robot, moved(leaking, -2.0))
    first, second = cylinders(near.hydraulic)
    assert not first.rejected
    rows = {p.name: p for p in parameter_list(robot, None, near.hydraulic)}
    row = rows["lift_cylinder.internal_leakage.coefficient"]
    assert (row.value, row.held, row.identifiable) == (0.0, True, False)
    assert second is cylinders(leaking.hydraulic)[1]
    far = within_bounds(robot, moved(leaking, -9.0))
    why = cylinders(far.hydraulic)[0].rejected
    assert "expected lift_cylinder.internal_leakage.coefficient from 0" in why
    assert "signals or their signs are swapped" in why
    rows = {p.name: p for p in parameter_list(robot, None, far.hydraulic)}
    assert rows["lift_valve.c_pa"].reason.startswith("hydraulics rejected: expected lift_cyl")
    assert rows["command_delay"].identifiable


def test_conditioning_is_the_fit_without_the_column() -> None:
    rng = np.random.default_rng(2)
    x, y = rng.normal(size=(50, 4)), rng.normal(size=50)
    inverse = np.linalg.inv(x.T @ x)
    theta, covariance = conditioned(inverse @ x.T @ y, inverse, {1: 0.3})
    rest = np.delete(x, 1, axis=1)
    free = np.linalg.solve(rest.T @ rest, rest.T @ (y - 0.3 * x[:, 1]))
    assert theta == pytest.approx(np.insert(free, 1, 0.3))
    kept = np.delete(np.delete(covariance, 1, axis=0), 1, axis=1)
    assert kept == pytest.approx(np.linalg.inv(rest.T @ rest))
    assert not covariance[1].any()


@pytest.mark.needs("clarabel")
@pytest.mark.parametrize(
    ("cycles", "bound", "text"), [(-2, 0.002, "at its longest"), (2, 0.0, "at its bound 0 s")]
)
def test_a_delay_at_its_bound_is_said_and_its_interval_stays_inside(
    crane: Recording, cycles: int, bound: float, text: str
) -> None:
    """The recorded voltage is early (as with a spool that lags) or late."""
    assert crane.valve_v is not None
    shifted = np.roll(crane.valve_v, cycles, axis=0)
    found = identify(load_robot("xs031"), [replace(crane, valve_v=shifted)])
    [delay] = [p for p in found.parameters if p.name == "command_delay"]
    assert delay.value == bound
    assert delay.ci95 is not None
    low, high = delay.ci95
    assert 0.0 <= low <= bound <= high <= 0.002
    assert low < high
    assert any(note.startswith(f"command_delay: {text}") for note in found.notes)
    assert delay.model_error


@pytest.mark.needs("clarabel")
def test_held_parts_are_one_readable_line_per_cylinder(crane: Recording) -> None:
    found = identify(load_robot("xs031"), [crane])
    lines = [note for note in found.notes if "below detection" in note]
    assert [line.split(":")[0] for line in lines] == ["lift_cylinder", "tilt_cylinder"]
    assert "barrel mcx, barrel izz, rod mcx held at the robot file's value" in lines[0]
    assert "kg m^2" in lines[0]
    rows = {p["name"]: p for p in result_dict(found, ORIGIN)["parameters"]}
    part = rows["lift_cylinder_barrel.izz"]
    assert (part["held"], part["std"], part["ci95"]) == (True, None, None)
    assert part["value"] == pytest.approx(part["datasheet"])
