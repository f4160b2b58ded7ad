"""Rails that nobody read: their constants may be off, and intervals reach as far."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

from hydro_ident.estimate.flows.hydraulics import HydraulicFit, fit_hydraulics
from hydro_ident.estimate.signals.traces import traces_of
from hydro_ident.identify.identification import identify
from hydro_ident.parameters.parameters import cylinder_parameters
from hydro_model.robot import Robot
from hydro_model.robot_files import load_robot

OFF_PA = 6.0e5
UNREAD: dict[str, Any] = {"supply": None, "tank": None}


@pytest.fixture(scope="module")
def run_of(make_run: tuple[Callable[..., Robot], Callable[..., Any]]) -> Callable[..., Any]:
    """`run_of(pascals)`: 15 s of the crane whose supply is that much above the file's."""
    true_crane, simulated_run = make_run

    def run(off_pa: float) -> Any:
        crane = true_crane()
        return simulated_run(
            replace(crane, supply_pressure_pa=crane.supply_pressure_pa + off_pa), 15.0
        )

    return run


@pytest.fixture(scope="module")
def higher(run_of: Callable[..., Any]) -> Any:
    return run_of(OFF_PA)


def _fit(run: Any, **changes: Any) -> HydraulicFit:
    fit = fit_hydraulics(load_robot("xs031"), traces_of([run.recording(**changes)]))
    assert fit is not None
    return fit


def _outside(run: Any, fit: HydraulicFit) -> list[str]:
    """Moduli and edges whose intervals do not hold the truth."""
    found = []
    for cylinder in fit.cylinders:
        assert not cylinder.rejected
        own, valve = run.robot.cylinder(cylinder.cylinder), run.robot.valve_of(cylinder.cylinder)
        for row in cylinder_parameters(run.robot, cylinder, {}):
            rest = row.name.split(".")[1]
            truth = own.bulk_modulus_pa if rest == "bulk_modulus" else getattr(valve, rest)
            assert row.ci95 is not None
            if not row.ci95[0] < truth < row.ci95[1]:
                found.append(row.name)
    return found


def test_edges_beside_a_constant_that_is_off_hold_the_truth(higher: Any) -> None:
    fit = _fit(higher, **UNREAD)
    supply, tank = fit.rails
    assert (supply.rail, tank.rail) == ("supply", "tank")
    assert supply.told
    assert supply.off_pa == pytest.approx(OFF_PA, rel=0.2)
    assert not tank.told
    assert not _outside(higher, fit)


def test_rails_that_were_read_add_nothing(higher: Any) -> None:
    fit = _fit(higher)
    assert fit.rails == ()
    valve = higher.robot.valves[0]
    value, std = fit.cylinders[0].value("c_pa")
    assert value == pytest.approx(valve.c_pa, rel=2e-3)
    assert std < 1e-3 * value


@pytest.mark.needs("clarabel")
def test_what_is_told_of_a_rail_is_said(higher: Any, run_of: Callable[..., Any]) -> None:
    robot = load_robot("xs031")
    found = identify(robot, [higher.recording(**UNREAD)])
    notes = [n for n in found.notes if "was not recorded, and the robot file's" in n]
    assert len(notes) == 2
    told = 1e-5 * (robot.supply_pressure_pa + OFF_PA)
    assert "do not fit what passes the valves" in notes[0]
    assert float(notes[0].split("about ")[1].split()[0]) == pytest.approx(told, abs=1.5)
    right = run_of(0.0)
    fit = _fit(right, **UNREAD)
    assert not any(rail.told for rail in fit.rails)
    assert not _outside(right, fit)
