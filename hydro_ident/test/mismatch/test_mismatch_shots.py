"""Roll-outs over windows of a simulated crane, by the very crane that was recorded."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from hydro_ident.estimate.scoring.scores import HoldOut
from hydro_ident.mismatch.modelling.shots import Shots
from hydro_model.effects.catalogue import resolve
from hydro_model.robot import EffectSpec, Robot

WHOLE = HoldOut(every=0)
SECONDS, WINDOW_S, WINDOWS = 12.0, 2.0, 5
#: What derivatives by a filter leave of a start, and no memory at all is well above.
MISSED_RAD = 1e-4
Lay = Callable[..., Any]


def _missed(make_run: tuple[Callable[..., Robot], Lay], lay_out: Lay, *specs: EffectSpec) -> Lay:
    """Of a machine with some effects: RMS error of the lift joint by a robot with others, rad."""
    true_crane, simulated_run = make_run
    machine = replace(true_crane(), effects=specs)
    predictor = lay_out(simulated_run(machine, SECONDS, noisy=False)).training.predictor
    shots = Shots.of(predictor, WHOLE, WINDOW_S, WINDOWS, True)

    def missed(*others: EffectSpec) -> float:
        robot = replace(machine, effects=others)
        errors = shots.errors(robot, resolve(robot))
        assert len(errors) == WINDOWS
        return float(np.sqrt(np.mean(np.concatenate([e[:, 0] for e in errors]) ** 2)))

    return missed


@pytest.mark.parametrize("target", ["xs031", "lift_cylinder"])
def test_a_late_command_is_late_once(
    make_run: tuple[Callable[..., Robot], Lay], lay_out: Lay, target: str
) -> None:
    """Shifting the record and delaying the robot as well would find half the delay."""

    def late(delay_s: float) -> EffectSpec:
        return EffectSpec("command_delay", target, {"delay": delay_s})

    missed = _missed(make_run, lay_out, late(0.01))
    assert missed(late(0.01)) < 0.3 * min(missed(late(0.005)), missed(late(0.015)))


@pytest.mark.thorough
@pytest.mark.parametrize(
    "spec",
    [
        EffectSpec("command_delay", "xs031", {"delay": 0.06}),
        EffectSpec("valve_spool_lag", "lift_cylinder", {"frequency": 4.0}),
        EffectSpec("valve_hysteresis", "lift_cylinder", {"half_width": 0.02}),
        EffectSpec("supply_droop", "xs031", {"resistance": 2e9, "time_constant": 0.3}),
    ],
    ids=lambda spec: spec.name,
)
def test_a_window_remembers_what_came_before_it(
    make_run: tuple[Callable[..., Robot], Lay], lay_out: Lay, spec: EffectSpec
) -> None:
    """The machine itself follows its recording from amid a motion on."""
    assert _missed(make_run, lay_out, spec)(spec) < MISSED_RAD
