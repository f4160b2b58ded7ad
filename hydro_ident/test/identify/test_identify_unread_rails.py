"""Rails that nobody read: their constants may be off, and intervals reach as far."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

from hydro_ident.estimate.flows.hydraulics import HydraulicFit, fit_hydraulics
from hydro_ident.estimate.signals.traces import traces_of
from hydro_ident.identify.identification import _rail_notes, identify
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
    assert supply.off_pa == pytest.approx(OFF_PA, rel=0.01)
    assert not tank.told
    assert not _outside(higher, fit)


def test_rails_that_were_read_add_nothing(higher: Any) -> None:
    fit = _fit(higher)
    assert fit.rails == ()
    valve = higher.robot.valves[0]
    value, std = fit.cylinders[0].value("c_pa")
    assert value == pytest.approx(valve.c_pa, rel=2e-3)
    assert std < 1e-3 * value


@pytest.mark.thorough
@pytest.mark.parametrize("off_pa", [-2.0e6, 2.0e6])
def test_a_constant_that_is_far_off_is_found_beyond_first_order(
    run_of: Callable[..., Any], off_pa: float
) -> None:
    """Flows follow the root of the drop: one linear step gives -29.6 and 14.75 bar."""
    run = run_of(off_pa)
    supply, tank = _fit(run, **UNREAD).rails
    assert supply.told
    assert supply.off_pa == pytest.approx(off_pa, abs=2.0e4)
    # What is left of a few mbar in the tank is not worth a word.
    assert not tank.told
    assert not _outside(run, _fit(run, **UNREAD))


@pytest.mark.thorough
def test_two_recordings_with_different_constants_tell_none(
    run_of: Callable[..., Any],
) -> None:
    high, low = run_of(1.0e6), run_of(-1.0e6)
    traces = traces_of([high.recording("a", **UNREAD), low.recording("b", **UNREAD)])
    fit = fit_hydraulics(load_robot("xs031"), traces)
    assert fit is not None
    supply = fit.rails[0]
    assert not supply.told
    assert abs(supply.off_pa) + 2.0 * supply.std_pa > 1.0e6


@pytest.mark.thorough
def test_the_note_names_the_recordings_that_lack_a_rail(
    higher: Any, run_of: Callable[..., Any]
) -> None:
    traces = traces_of([run_of(0.0).recording("a"), higher.recording("b", supply=None)])
    fit = fit_hydraulics(load_robot("xs031"), traces)
    [note] = _rail_notes(fit)
    assert note.startswith("supply was not recorded in b, and")


@pytest.mark.thorough
@pytest.mark.needs("clarabel")
def test_what_is_told_of_a_rail_is_said(higher: Any, run_of: Callable[..., Any]) -> None:
    robot = load_robot("xs031")
    found = identify(robot, [higher.recording(**UNREAD)])
    notes = [n for n in found.notes if "was not recorded, and the robot file's" in n]
    assert len(notes) == 2
    told = 1e-5 * (robot.supply_pressure_pa + OFF_PA)
    assert float(notes[0].split("what passes the valves: ")[1].split()[0]) == pytest.approx(
        told, abs=0.1
    )
    assert "Correct the file" not in notes[0]
    right = run_of(0.0)
    fit = _fit(right, **UNREAD)
    assert not any(rail.told for rail in fit.rails)
    assert not _outside(right, fit)
