"""Command delays beyond a cycle, where the robot file states them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from hydro_ident.identify.identification import Settings, identify
from hydro_model.robot import Robot
from hydro_model.robot_files import load_robot

pytestmark = pytest.mark.needs("clarabel")

STATED_S = 0.008
EDGES = ("c_pa", "c_at", "c_pb", "c_bt")


def _stating(delay_s: float = STATED_S) -> Robot:
    return replace(load_robot("xs031"), command_delay_s=delay_s)


@pytest.fixture(scope="module")
def late(make_run: tuple[Callable[..., Robot], Callable[..., Any]]) -> Any:
    """A crane whose commands take four cycles."""
    true_crane, simulated_run = make_run
    return simulated_run(replace(true_crane(), command_delay_s=STATED_S), 12.0)


@pytest.mark.parametrize("stated_s", [STATED_S, pytest.param(0.0074, marks=pytest.mark.thorough)])
def test_a_stated_delay_of_more_than_a_cycle_is_fitted(late: Any, stated_s: float) -> None:
    """The file may be a part of a cycle off, and its own delay is no bound."""
    found = identify(_stating(stated_s), [late.recording()])
    rows = {p.name: p for p in found.parameters}
    assert rows["command_delay"].value == pytest.approx(STATED_S, abs=1e-4)
    assert not rows["command_delay"].reason
    assert found.robot is not None
    assert found.robot.command_delay_s == rows["command_delay"].value
    for valve, cylinder in zip(late.robot.valves, late.robot.cylinders, strict=True):
        for edge in EDGES:
            true = getattr(valve, edge)
            assert rows[f"{valve.name}.{edge}"].value == pytest.approx(true, rel=0.01)
        bulk = rows[f"{cylinder.name}.bulk_modulus"].value
        assert bulk == pytest.approx(cylinder.bulk_modulus_pa, rel=0.02)


def _sampled(run: Any, every: int, name: str) -> Any:
    """A recording of one sample in so many; commands are held for ten of them."""
    thin = {k: getattr(run, k)[::every] for k in ("q", "p_a", "p_b", "voltage")}
    whole = run.recording()
    changes = {"period_s": every * whole.period_s, "stamp_ns": whole.stamp_ns[::every]}
    return replace(run, **thin).recording(name, **changes)


@pytest.mark.thorough
def test_lost_valve_messages_are_left_out_at_either_delay(late: Any) -> None:
    """Scores compare two delays on the same windows: those that neither moves a hole into."""
    voltage, rng = late.voltage.copy(), np.random.default_rng(2)
    voltage[rng.choice(np.arange(50, len(voltage)), 20, replace=False)] = np.nan
    fine = _sampled(replace(late, voltage=voltage), 1, "fine")
    found = identify(_stating(), [_sampled(late, 2, "coarse")], [fine])
    assert found.verdict == "identified"
    flows = [c for c in found.channels if "/flow_" in c.name]
    assert len(flows) == 4
    for channel in flows:
        assert channel.summary()["fit_after_pct"] > 90.0  # type: ignore[operator]


@pytest.mark.thorough
@pytest.mark.parametrize("estimator", ["wls", "robust"])
def test_recordings_of_different_rates_have_one_delay(late: Any, estimator: Any) -> None:
    both = [_sampled(late, every, f"every {every}") for every in (2, 1)]
    found = identify(_stating(), both, settings=Settings(estimator=estimator))
    rows = {p.name: p for p in found.parameters}
    assert rows["command_delay"].value == pytest.approx(STATED_S, abs=1e-4)
    for valve in late.robot.valves:
        for edge in EDGES:
            true = getattr(valve, edge)
            assert rows[f"{valve.name}.{edge}"].value == pytest.approx(true, rel=0.01)


def test_milliseconds_in_place_of_seconds_are_said(late: Any) -> None:
    found = identify(_stating(8.0), [late.recording()])
    [note] = [n for n in found.notes if "command_delay_s" in n]
    assert "of 8 s: more than is tried, which is 0.002 s" in note
