"""Position sensors off their centre: found, taken out, and what they hid found behind them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from hydro_ident.mismatch.answer.diagnosis import diagnose
from hydro_ident.mismatch.answer.outcome import Diagnosis
from hydro_ident.mismatch.rows.off_centre import OFF_CENTRE, OffCentre, without_errors
from hydro_ident.recordings.sources import sources_of
from hydro_ident.report.diagnosis_verdict import diagnosis_verdict
from hydro_ident.report.diagnosis_views import diagnosis_rows
from hydro_model.effects.readings import Readings
from hydro_model.hydraulics.cylinder import stroke
from hydro_model.robot import EffectSpec, Robot
from hydro_model.robot_files import load_robot

LEAK = 2.0e-13
MakeRun = tuple[Callable[..., Robot], Callable[..., Any]]
LARGE = OffCentre(0, 1.6e-3, -1.2e-3, 0.14)


def off_by(run: Any, error: OffCentre) -> Any:
    """A run whose sensor reads so."""
    q = run.q.copy()
    q[:, error.joint] = error.read(run.q[:, error.joint])
    return replace(run, q=q)


def diagnosed(
    make_run: MakeRun, error: OffCentre | None, effects: tuple[EffectSpec, ...] = ()
) -> Diagnosis:
    """A machine driven along two motions, 18 s each, the second to verify on."""
    true_crane, simulated_run = make_run
    machine = replace(true_crane(), effects=effects)
    runs = [simulated_run(machine, 18.0, seed=seed) for seed in (0, 3)]
    seen = runs if error is None else [off_by(run, error) for run in runs]
    first, second = seen[0].recording(), seen[1].recording("check")
    return diagnose(load_robot("xs031"), [first], [second])


def test_what_is_read_is_undone_exactly() -> None:
    q = np.linspace(-1.0, 2.0, 5001)
    np.testing.assert_allclose(LARGE.position(LARGE.read(q)), q, atol=1e-15)
    assert np.ptp(LARGE.read(q) - q) == pytest.approx(2.0 * LARGE.amplitude, rel=1e-4)
    assert LARGE.amplitude == pytest.approx(2.0e-3)


def test_as_an_effect_it_reads_one_joint_and_is_undone() -> None:
    q = np.random.default_rng(1).uniform(-1.0, 1.0, (50, 2))
    nothing = np.zeros((50, 2))
    there = Readings(0.002, q, nothing, nothing, q[:, 0], q[:, 0], nothing, nothing)
    numbers = np.array([LARGE.sine, LARGE.cosine, LARGE.period])
    assert OFF_CENTRE.reading is not None
    seen = OFF_CENTRE.reading(there, 1, numbers)
    np.testing.assert_array_equal(seen.q[:, 0], q[:, 0])
    assert np.max(np.abs(seen.q[:, 1] - q[:, 1])) > 1e-3
    np.testing.assert_allclose(OFF_CENTRE.undone(seen, 1, numbers).q, q, atol=1e-15)


def test_recordings_lose_the_error_and_strokes_follow(make_run: MakeRun) -> None:
    from hydro_ident.estimate.signals.traces import traces_of_piece

    true_crane, simulated_run = make_run
    robot, run = load_robot("xs031"), simulated_run(true_crane(), 2.0)
    second = OffCentre(0, 0.0, 3.0e-4, 0.07)
    # Taken out in the opposite order of what the sensor did.
    read = off_by(off_by(run, second), LARGE)
    [source] = sources_of([read.recording()])
    traces = [t for piece in source.pieces(60.0) for t in traces_of_piece(piece)]
    (fixed,) = without_errors(robot, traces, [LARGE, second])
    np.testing.assert_allclose(fixed.q, run.q, atol=1e-15)
    np.testing.assert_allclose(fixed.stroke[:, 0], stroke(robot.cylinders[0], fixed.q[:, 0]))
    assert without_errors(robot, tuple(traces), []) == tuple(traces)


def test_what_it_hides_is_found_behind_it(make_run: MakeRun) -> None:
    """A leak that leaves a fiftieth of what the sensor's error does in its flows."""
    leak = EffectSpec("internal_leakage", "lift_cylinder", {"coefficient": LEAK})
    found = diagnosed(make_run, OffCentre(0, 1.0e-3, 0.0, 0.142), (leak,))
    assert [f.named.names for f in found.findings] == [("internal_leakage",)]
    assert found.findings[0].named.term.parameters[0] == pytest.approx(LEAK, rel=0.03)
    told = {one.channel: one for one in found.unexplained}
    assert set(told) == {"lift/force", "lift/flow_a", "lift/flow_b"}
    for one in told.values():
        assert one.depends_on == ("joint_angle", "piston_velocity")
        assert "the position of lift is read off by 1 +- 0.0" in one.text
        assert one.taken_out is not None
        assert "every 0.142 rad" in one.taken_out.text
        # What it hid was not found yet where both were compared.
        assert one.taken_out.after < 0.2 * one.taken_out.before
    assert found.work is not None
    [error] = found.work.off
    assert error.amplitude == pytest.approx(1.0e-3, abs=3.0 * error.std)
    assert error.std < 5.0e-5
    assert found.verdict == "partly_explained"
    assert any("taken out of the recordings" in note for note in found.notes)
    # As good as a sensor on its centre, which leaves 22 N.
    left = {c.name: float(np.std(c.measured - c.after)) for c in found.channels}
    assert left["lift/force"] < 30.0


@pytest.mark.thorough
def test_of_a_joint_alone_the_flows_tell_it(make_run: MakeRun) -> None:
    """The other joint's angle was not read, so that there are no forces."""
    true_crane, simulated_run = make_run
    seen = []
    for seed, name in ((0, "run"), (3, "check")):
        read = off_by(
            simulated_run(true_crane(), 18.0, seed=seed), OffCentre(0, 1.0e-3, 0.0, 0.142)
        )
        seen.append(read.recording(name, q=read.q * np.array([1.0, np.nan])))
    found = diagnose(load_robot("xs031"), seen[:1], seen[1:])
    assert found.work is not None
    [error] = found.work.off
    assert error.amplitude == pytest.approx(1.0e-3, rel=0.05)
    told = {one.channel: one.taken_out for one in found.unexplained}
    assert set(told) == {"lift/flow_a", "lift/flow_b"}
    assert all(one is not None and one.after < 0.2 * one.before for one in told.values())


@pytest.mark.thorough
def test_where_the_stroke_is_read_instead_it_stays_unknown(make_run: MakeRun) -> None:
    """No angle was read that could be off, and what is left says so."""
    true_crane, simulated_run = make_run
    robot, seen = load_robot("xs031"), []
    for seed, name in ((0, "run"), (3, "check")):
        run = simulated_run(true_crane(), 18.0, seed=seed)
        strokes = np.stack([stroke(c, run.q[:, i]) for i, c in enumerate(robot.cylinders)], axis=1)
        strokes[:, 0] += 8.0e-4 * np.sin(2.0 * np.pi * strokes[:, 0] / 0.03)
        angles = run.q * np.array([np.nan, 1.0])
        seen.append(run.recording(name, q=angles, stroke=strokes))
    found = diagnose(robot, seen[:1], seen[1:])
    assert {one.channel for one in found.unexplained} == {"lift/flow_a", "lift/flow_b"}
    assert found.work is not None
    assert found.work.off == ()


@pytest.mark.thorough
@pytest.mark.parametrize(("name", "factor"), [("l1_m", 0.97), ("l2_m", 1.03)])
def test_a_wrong_length_of_the_machine_is_no_error_of_a_sensor(
    make_run: MakeRun, name: str, factor: float
) -> None:
    """It bends the flows as a slow wave does, which forces contradict."""
    true_crane, simulated_run = make_run
    crane = true_crane()
    lift, tilt = crane.cylinders
    other = replace(lift, **{name: factor * getattr(lift, name)})
    machine = replace(crane, cylinders=(other, tilt))
    runs = [simulated_run(machine, 18.0, seed=seed) for seed in (0, 3)]
    first, second = runs[0].recording(), runs[1].recording("check")
    found = diagnose(load_robot("xs031"), [first], [second])
    assert {"lift/flow_a", "lift/flow_b"} <= {one.channel for one in found.unexplained}
    assert found.work is not None
    assert found.work.off == ()


@pytest.mark.thorough
@pytest.mark.parametrize("period", [0.418, 1.01, 2.84])
def test_it_is_found_where_it_hardly_repeats(make_run: MakeRun, period: float) -> None:
    """Over 0.71 rad: seen as something that follows the time, or the angle as a whole."""
    found = diagnosed(make_run, OffCentre(0, 2.0e-3, 0.0, period))
    assert found.verdict == "unknown"
    assert found.work is not None
    [error] = found.work.off
    assert error.amplitude == pytest.approx(2.0e-3, rel=0.05)
    assert error.period == pytest.approx(period, rel=0.02)
    assert {one.channel for one in found.unexplained} >= {"lift/flow_a", "lift/flow_b"}
    assert all(one.taken_out is not None for one in found.unexplained)
    strip = diagnosis_verdict(found, diagnosis_rows(found)[0])
    assert "A position sensor misreads." in strip.headline
    said = dict(strip.cards)["What was left out"]
    assert any("held-out rows keep less: lift/f" in line for line in said)


@pytest.mark.thorough
def test_a_hum_of_the_valve_is_no_sensor_off_its_centre(make_run: MakeRun) -> None:
    """It is unknown in both flows, too, but no wave along the angle takes it out."""
    true_crane, simulated_run = make_run
    seen = []
    for seed, name in ((0, "run"), (3, "check")):
        run = simulated_run(true_crane(), 18.0, seed=seed)
        hum = 0.05 * np.sin(2.0 * np.pi * np.arange(len(run.q)) * 0.002 / 0.35)
        volts = run.voltage + hum[:, None] * np.array([1.0, 0.0])
        seen.append(run.recording(name, valve_v=volts))
    found = diagnose(load_robot("xs031"), seen[:1], seen[1:])
    assert {"lift/flow_a", "lift/flow_b"} <= {one.channel for one in found.unexplained}
    assert found.work is not None
    assert found.work.off == ()
    assert all(one.taken_out is None for one in found.unexplained)
