"""Sets of findings in a cylinder of whose pressures one was not read."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from hydro_ident.estimate.flows.chambers import WindowSettings
from hydro_ident.estimate.signals.derivatives import FilterSettings
from hydro_ident.estimate.signals.traces import traces_of
from hydro_ident.mismatch.answer.half_read import beside_half_read
from hydro_ident.mismatch.answer.outcome import Finding
from hydro_ident.mismatch.fitting.weighed import Weighed
from hydro_ident.mismatch.naming.named import named_of
from hydro_ident.mismatch.rows.laying import material_of
from hydro_ident.mismatch.rows.material import Material
from hydro_ident.mismatch.split.residuals import own_forces
from hydro_ident.mismatch.trials.contender import Contender
from hydro_model.effects.catalogue import resolve
from hydro_model.robot import EffectSpec, Robot

#: A fit of nothing: no number of it has a deviation.
UNFITTED = Weighed(None, (), np.zeros((0, 0)), np.zeros(0))  # type: ignore[arg-type]
LEAK = EffectSpec(
    "external_leakage", "lift_cylinder", {"coefficient_a": 0.0, "coefficient_b": 1e-13}
)
DEADBAND = EffectSpec("valve_deadband", "lift_valve", {"width": 0.03})


def _material(robot: Robot, run, *, read: bool) -> Material:  # type: ignore[no-untyped-def]
    p_a = run.p_a.copy()
    p_a[:, 0] = p_a[:, 0] if read else np.nan
    settings = FilterSettings(), WindowSettings()
    traces = traces_of([run.recording(p_a=p_a)])
    return material_of(robot, own_forces(robot, torque=False), traces, *settings, {})


def _found(robot: Robot, spec: EffectSpec, *channels: str) -> Finding:
    [term] = resolve(replace(robot, effects=(spec,)))
    named = named_of([Contender(term, UNFITTED, 400.0, 380.0, 3.0)], 0.001, 1.0)
    return Finding(named, None, channels)  # type: ignore[arg-type]


def _told(findings: Sequence[Finding]) -> list[tuple[tuple[str, ...], tuple[float, ...]]]:
    return [(one.named.names, one.named.probability) for one in findings]


def test_a_leak_past_the_piston_stands_beside_one_to_the_outside(crane_run, robot: Robot) -> None:  # type: ignore[no-untyped-def]
    """Only the pressure that was not read could have told them apart."""
    found = [_found(robot, LEAK, "lift/flow_b"), _found(robot, DEADBAND, "lift/flow_b")]
    told = _told(beside_half_read(_material(robot, crane_run, read=False), found))
    # Nothing that acts on another stage is meant: a deadband is none of these.
    both = ("external_leakage", "internal_leakage"), (0.5, 0.5)
    assert told == [both, (("valve_deadband",), (1.0,))]
    assert _told(beside_half_read(_material(robot, crane_run, read=True), found)) == _told(found)


@pytest.mark.parametrize("channels", [("tilt/flow_b",), ("lift/flow_b", "tilt/flow_b")])
def test_what_shows_where_both_were_read_stays(  # type: ignore[no-untyped-def]
    crane_run, robot: Robot, channels: tuple[str, ...]
) -> None:
    found = [_found(robot, LEAK, *channels)]
    assert _told(beside_half_read(_material(robot, crane_run, read=False), found)) == _told(found)
