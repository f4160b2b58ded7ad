"""Roll-outs over windows of a simulated crane, by the very crane that was recorded."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from hydro_ident.estimate.scores import HoldOut
from hydro_ident.mismatch.shots import Shots
from hydro_model.effects.catalogue import resolve
from hydro_model.robot import EffectSpec, Robot

WHOLE = HoldOut(every=0)
SECONDS, WINDOW_S, WINDOWS = 12.0, 2.0, 5
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
