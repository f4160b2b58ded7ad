"""Logs slower than the commands in them: taken as these were updated, not half a cycle late."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from hydro_ident.bag.recording import Recording
from hydro_ident.bag.streaming import map_columns
from hydro_ident.estimate.signals.traces import traces_of
from hydro_ident.identify.command_updates import UpdatedBetween, update_notes, with_updates
from hydro_ident.identify.identification import Identification, identify
from hydro_ident.identify.job import Settings, prepared
from hydro_ident.identify.survey import looked_at, survey_source
from hydro_ident.recordings.sources import MemorySource
from hydro_ident.recordings.workers import Here
from hydro_model.robot import Robot
from hydro_model.simulation.simulate import simulate

pytestmark = pytest.mark.needs("clarabel")

STIFF = {"lift_cylinder": 8.2e8, "tilt_cylinder": 7.4e8}


@pytest.fixture(scope="module")
def runs(make_run: tuple[Callable[..., Robot], Callable[..., Any]]) -> dict[str, Recording]:
    """The true crane at 500 Hz, its commands held for 20 ms and going straight between them."""
    true_crane, simulated_run = make_run
    crane = true_crane()
    held = simulated_run(crane, 18.0, noisy=False)
    at, knots = np.arange(len(held.q)), np.arange(0, len(held.q), 10)
    # As late as the mean of what is held: the crane goes the same way.
    straight = np.stack([np.interp(at - 5, knots, v) for v in held.voltage[knots].T], axis=1)
    out = simulate(crane, 0.002 * at, straight, held.q[0])
    smooth = replace(held, q=out.q, p_a=out.p_a, p_b=out.p_b, voltage=straight)
    rng = np.random.default_rng(7)
    result = {}
    for name, run in (("held", held), ("smooth", smooth)):
        noise = rng.normal(0.0, 4e3, (2, *run.p_a.shape))
        run = replace(run, p_a=run.p_a + noise[0], p_b=run.p_b + noise[1])
        result[name] = run.recording(name)
    return result


def _slow(recording: Recording, every: int) -> Recording:
    """One cycle in so many."""
    thin = map_columns(recording, lambda values: values[::every])
    return replace(thin, period_s=every * recording.period_s)


def _off(found: Identification) -> dict[str, float]:
    """By how much of themselves the bulk moduli are off."""
    return {
        name: one.value / true - 1.0
        for name, true in STIFF.items()
        for one in found.parameters
        if one.name == f"{name}.bulk_modulus"
    }


@pytest.mark.parametrize(
    ("every", "held"), [(5, 0.04), pytest.param(10, 0.08, marks=pytest.mark.thorough)]
)
def test_bulk_moduli_of_slow_logs_are_those_of_the_machine(
    runs: dict[str, Recording],
    robot: Robot,
    monkeypatch: pytest.MonkeyPatch,
    every: int,
    held: float,
) -> None:
    """Held from sample to sample that of the tilt cylinder comes out too stiff by so much."""
    slow = _slow(runs["smooth"], every)
    found = identify(robot, [slow])
    off = _off(found)
    assert len(off) == 2
    assert max(map(abs, off.values())) < 0.02
    monkeypatch.setattr("hydro_ident.identify.command_updates.SLOW_S", 1.0)
    assert _off(identify(robot, [slow]))["tilt_cylinder"] > held
    assert any(n.startswith("smooth: commands changed between its samples") for n in found.notes)


def test_commands_that_a_slow_controller_holds_are_taken_as_held(
    runs: dict[str, Recording], robot: Robot
) -> None:
    slow = _slow(runs["held"], 5)
    found = identify(robot, [slow])
    assert max(map(abs, _off(found).values())) < 0.01
    assert not any("changed between" in note for note in found.notes)


@pytest.mark.thorough
def test_blocks_that_are_held_out_do_not_tell(runs: dict[str, Recording], robot: Robot) -> None:
    """Scores are of these: voltages of chance there change nothing of what is found."""
    slow = _slow(runs["smooth"], 5)
    split = prepared(
        robot, looked_at(robot, [MemorySource(slow)], ()), Settings(), Here()
    ).plan.split
    held = split.holds("smooth", (slow.stamp_ns - slow.stamp_ns[0]) * 1e-9)
    assert 0.05 < held.mean() < 0.4
    assert slow.valve_v is not None
    volts = slow.valve_v.copy()
    volts[held] = np.random.default_rng(3).uniform(-10.0, 10.0, (int(held.sum()), 2))
    source = MemorySource(replace(slow, valve_v=volts))
    assert prepared(robot, looked_at(robot, [source], ()), Settings(), Here()).sources == (
        UpdatedBetween(source),
    )
    # All blocks together would not have told.
    own, _ = with_updates(robot, [source], [], [survey_source(source, robot)])
    assert own == (source,)


def test_only_slow_recordings_are_looked_at(runs: dict[str, Recording], robot: Robot) -> None:
    """What is verified on is of the same controller; a log that shows every command shows all."""
    quick, slow = runs["smooth"], replace(_slow(runs["smooth"], 5), path=runs["held"].path)
    sources = [MemorySource(r) for r in (quick, slow)]
    surveys = [survey_source(source, robot) for source in sources]
    own, others = with_updates(robot, sources[:1], sources[1:], surveys)
    assert (*own, *others) == tuple(sources)
    own, others = with_updates(robot, sources[1:], sources[:1], [surveys[1], surveys[0]])
    assert own == (UpdatedBetween(sources[1]),)
    assert others == tuple(sources[:1])
    [note] = update_notes((*own, *others))
    assert note.startswith("held: ")


def test_the_mean_of_two_commands_stands_for_the_time_between(crane_run: Any) -> None:
    recording = crane_run.recording()
    [plain] = traces_of([recording])
    [mean] = traces_of([replace(recording, updated_between=True)])
    u = plain.valve_signal
    np.testing.assert_allclose(mean.valve_signal[:-1], 0.5 * (u[:-1] + u[1:]))
    np.testing.assert_array_equal(mean.valve_signal[-1], u[-1])
