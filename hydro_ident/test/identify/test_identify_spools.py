"""Measured spools are the openings where they tell more than the voltages."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from hydro_ident.bag.recording import Recording
from hydro_ident.identify.identification import Identification, identify
from hydro_model.robot import EffectSpec
from hydro_model.robot_files import load_robot
from hydro_model.simulation.simulate import simulate

pytestmark = pytest.mark.needs("clarabel")

LAG = EffectSpec("valve_spool_lag", "xs031", {"frequency": 25.0, "damping": 0.8})


@pytest.fixture(scope="module")
def slow(driven: Callable[..., Any]) -> tuple[Any, np.ndarray]:
    """A run behind spools of 25 Hz, and these as transducers show them."""
    run = driven(18.0, (LAG,))
    time = np.arange(len(run.q)) * 0.002
    spool = simulate(run.robot, time, run.voltage, run.q[0]).valve_signal
    return run, spool + 1e-4 * np.random.default_rng(1).normal(size=spool.shape)


@pytest.fixture(scope="module")
def by_spools(slow: tuple[Any, np.ndarray]) -> Identification:
    run, spool = slow
    return identify(load_robot("xs031"), [replace(run.recording(), spool=spool)])


def bulk_errors(found: Identification, truth: Any) -> list[float]:
    """What bulk moduli are off by, as shares of the truth."""
    values = {p.name: p.value for p in found.parameters}
    return [
        abs(values[f"{c.name}.bulk_modulus"] / c.bulk_modulus_pa - 1.0) for c in truth.cylinders
    ]


def taken(found: Identification) -> str:
    [note] = [note for note in found.notes if "measured spools" in note]
    return note


def test_oil_and_edges_are_exact_behind_slow_spools(
    slow: tuple[Any, np.ndarray], by_spools: Identification
) -> None:
    run, _ = slow
    by_volts = identify(load_robot("xs031"), [run.recording()])
    assert not any("measured spools" in note for note in by_volts.notes)
    assert max(bulk_errors(by_volts, run.robot)) > 0.02
    assert max(bulk_errors(by_spools, run.robot)) < 0.002
    assert taken(by_spools).startswith("the valves' openings are their measured spools")
    truth = {f"{v.name}.{e}": getattr(v, e) for v in run.robot.valves for e in ("c_pa", "c_bt")}
    values = {p.name: p.value for p in by_spools.parameters}
    for name, value in truth.items():
        assert values[name] == pytest.approx(value, rel=1e-3)
    assert not any(c.name.endswith("flow_a") and _physics(c) > 5.0 for c in by_spools.channels)
    # The delay is that of the commands, for whoever drives with them.
    [one, other] = [
        next(p for p in found.parameters if p.name == "command_delay")
        for found in (by_volts, by_spools)
    ]
    assert other.value == pytest.approx(one.value, abs=1e-6)
    assert by_spools.free_run is not None
    assert by_volts.free_run is not None


def _physics(channel: Any) -> float:
    summary = channel.summary()
    return float(summary["rmse_after"]) / max(float(summary["noise_floor"]), 1e-9)


def test_spools_alone_give_flows_and_no_delay(slow: tuple[Any, np.ndarray]) -> None:
    run, spool = slow
    bare = replace(run.recording(), spool=spool, valve_v=None, command_v=None, valve_source="")
    found = identify(load_robot("xs031"), [bare])
    assert max(bulk_errors(found, run.robot)) < 0.002
    [delay] = [p for p in found.parameters if p.name == "command_delay"]
    assert not delay.identifiable
    assert delay.reason.startswith("no voltage tells it")
    assert found.robot is not None
    assert found.robot.command_delay_s == found.given.command_delay_s
    assert not any("flow" in loss.channel for loss in found.losses)


@pytest.mark.parametrize(
    ("made", "why"),
    [
        (lambda volts, _: np.roll(volts / 10.0, 1, axis=0), "is its command over again"),
        (lambda volts, _: np.full_like(volts, 0.02), "reads 0.02 throughout"),
        (lambda _, spool: np.where(np.arange(len(spool))[:, None] % 3, spool, np.nan), "was read"),
        (
            lambda volts, _: volts / 10.0 + 0.02 * np.sin(np.arange(len(volts)))[:, None],
            "they explain the flows no better than the voltages do",
        ),
    ],
)
def test_what_is_no_reading_of_a_spool_is_not_taken(
    made: Callable[..., np.ndarray], why: str, clean: Any
) -> None:
    recording: Recording = clean.recording()
    assert recording.valve_v is not None
    spool = made(recording.valve_v, recording.valve_v / 10.0)
    found = identify(load_robot("xs031"), [replace(recording, spool=spool)])
    assert "were not taken" in taken(found)
    assert why in taken(found)
    plain = identify(load_robot("xs031"), [recording])
    assert [p.value for p in found.parameters] == [p.value for p in plain.parameters]


def test_effects_before_the_spools_stay_as_listed(slow: tuple[Any, np.ndarray]) -> None:
    run, spool = slow
    bias = EffectSpec("valve_null_bias", "xs031", {"bias": 0.004})
    robot = replace(load_robot("xs031"), effects=(LAG, bias), command_delay_s=0.002)
    found = identify(robot, [replace(run.recording(), spool=spool)])
    assert max(bulk_errors(found, run.robot)) < 0.002
    assert not any("null_bias" in p.name for p in found.parameters)
    assert found.robot is not None
    assert found.robot.effects == robot.effects
