"""Listed effects of whole robots and rails, and of plays, in what `identify` fits."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from hydro_ident.estimate.effects.listed_effects import ListedEffects
from hydro_ident.estimate.effects.listed_steps import stepped
from hydro_ident.estimate.flows.chambers import chambers_of
from hydro_ident.estimate.flows.hydraulics import fit_hydraulics
from hydro_ident.estimate.forces.inertial import fit_inertial
from hydro_ident.estimate.signals.traces import Trace, traces_of
from hydro_ident.identify.identified_robot import identified_robot
from hydro_ident.identify.job import planned_force_model
from hydro_model.effects.rows import signal_rows
from hydro_model.effects.signals import TIP_HEIGHT
from hydro_model.robot import EffectSpec, Robot

MakeRun = tuple[Callable[..., Robot], Callable[..., Any]]
EDGES = ("c_pa", "c_at", "c_pb", "c_bt")
DROOP = EffectSpec("supply_droop", "xs031", {"resistance": 6e9, "time_constant": 0.05})
BACK = EffectSpec("tank_back_pressure", "xs031", {"resistance": 3e12})


# Plays ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("drag", [0.0, 3e4])
def test_a_listed_play_is_swept_whenever_the_force_turns(robot: Robot, drag: float) -> None:
    """What a chamber swallows by a play of a metre is its area, one way and back."""
    time = np.arange(2000) * 0.002
    swing = 2e6 * np.sin(2.0 * np.pi * 0.5 * time)[:, None] * [1.0, 1.0]
    q = np.array([0.5, -1.2]) + 0.1 * np.sin(2.0 * np.pi * 0.5 * time)[:, None]
    still = np.zeros((time.size, 2))
    trace = Trace(
        "bag#0", 0.002, time, q, 0.3 + still, 3e6 + swing, 5e6 - swing, 1.8e7 + still[:, 0],
        1e5 + still[:, 0], still, still,
    )  # fmt: skip
    play = EffectSpec("backlash", "lift_cylinder", {"width": 1e-3, "drag": drag})
    effects = ListedEffects.of(replace(robot, effects=(play,)))
    chamber = chambers_of(robot)[0]
    names, columns = effects.chamber_columns(chamber, trace)
    assert names == ("backlash.width",)
    area = chamber.cylinder.area_a_m2
    swept = np.cumsum(columns[:, 0])
    assert np.ptp(swept) == pytest.approx(area, rel=0.05)
    assert "backlash" not in (*effects.held, *effects.ignored)


def test_a_play_needs_no_speed_where_nothing_drags(robot: Robot) -> None:
    """As where the angle of a joint was not recorded: its pressures say when the pin crosses."""
    play = EffectSpec("backlash", "lift_cylinder", {"width": 1e-3})
    (one,) = ListedEffects.of(replace(robot, effects=(play,))).active
    time = np.arange(1000) * 0.002
    q, still = np.full((time.size, 2), 0.3), np.zeros((time.size, 2))
    swing = 2e6 * np.sin(2.0 * np.pi * time)
    pressures = np.stack([3e6 + swing, 5e6 - swing, 1.8e7 + 0.0 * time, 1e5 + 0.0 * time], axis=1)
    rows = [
        signal_rows(robot, 0, 0, time, q, qd, qd, pressures, 0.0 * time) for qd in (None, still)
    ]
    stage = one.effect.terms[0].stage
    unknown, known = (one.effect.columns(s, one.parameters, stage, 0.002) for s in rows)
    assert np.abs(known).max() > 0.0
    assert np.array_equal(unknown, known)


# Grounds --------------------------------------------------------------------------------------


def test_a_listed_ground_is_one(make_run: MakeRun) -> None:
    """It pushes every joint by one stiffness; a fit of one per joint made two grounds of it."""
    true_crane, simulated_run = make_run
    crane = true_crane()
    free = simulated_run(crane, 6.0, noisy=False)
    time = 0.002 * np.arange(len(free.q))
    low = float(np.quantile(signal_rows(crane, None, 0, time, free.q)[:, TIP_HEIGHT], 0.3))
    ground = EffectSpec("external_contact", crane.name, {"stiffness": 4e4, "height": low})
    truth = replace(crane, effects=(ground,))
    recording = simulated_run(truth, 18.0, noisy=False).recording()
    guess = replace(ground, parameters={"stiffness": 1e4, "height": low})
    given = replace(recording.robot, effects=(guess,))
    effects = ListedEffects.of(given)
    name = f"{crane.name}.external_contact.stiffness"
    assert effects.force_names == (name,)
    fit = fit_inertial(planned_force_model(given, effects, ()), traces_of([recording]))
    assert fit is not None
    at = fit.model.names.index(name)
    assert fit.fit.theta[at] == pytest.approx(4e4, rel=0.02)
    (found,) = identified_robot(given, fit, None).effects
    assert (found.target, found.parameters["height"]) == (crane.name, low)
    assert found.parameters["stiffness"] == pytest.approx(4e4, rel=0.02)


# Rails ----------------------------------------------------------------------------------------


def _edges(robot: Robot, given: Robot, traces: tuple[Trace, ...]) -> np.ndarray:
    """How far fitted edges are from a robot's, by iteration from another one's."""
    effects = ListedEffects.of(given)
    for _ in range(8):
        seen = [effects.with_signal_laws(trace) for trace in traces]
        fit = fit_hydraulics(given, seen, None, effects.chamber_columns)
        assert fit is not None
        if not effects.iterated:
            break
        effects, step = stepped(effects, fit)
    assert not effects.iterated or step < 1e-6
    return np.array([
        one.value(edge)[0] / float(getattr(robot.valve_of(one.cylinder), edge)) - 1.0
        for one in fit.cylinders
        for edge in EDGES
        if edge in one.names
    ])  # fmt: skip


@pytest.mark.thorough
def test_edges_are_not_what_listed_rails_take(make_run: MakeRun) -> None:
    """Nobody recorded the rails: edges that took the droop up would have it twice in a model."""
    true_crane, simulated_run = make_run
    truth = replace(true_crane(), effects=(DROOP, BACK))
    recording = simulated_run(truth, 12.0, scale=0.7, noisy=False).recording(
        supply=None, tank=None
    )
    valves = tuple(
        replace(v, **{e: 0.8 * float(getattr(v, e)) for e in EDGES}) for v in truth.valves
    )
    given = replace(truth, valves=valves)
    traces = traces_of([replace(recording, robot=given)])
    plain = np.abs(_edges(truth, replace(given, effects=()), traces))
    listed = np.abs(_edges(truth, given, traces))
    assert plain.max() > 0.03
    assert listed.max() < 0.1 * plain.max()


def test_a_recorded_rail_has_given_way_already(make_run: MakeRun) -> None:
    true_crane, simulated_run = make_run
    truth = replace(true_crane(), effects=(DROOP, BACK))
    recording = simulated_run(truth, 2.0, noisy=False).recording(tank=None)
    (trace,) = traces_of([recording])
    seen = ListedEffects.of(truth).with_signal_laws(trace)
    assert trace.rails_read == (True, False)
    assert np.array_equal(seen.supply, trace.supply)
    assert seen.tank.max() > trace.tank.max() + 1e4
