"""Rails that nobody read: the robot file's constant may be off, which is no finding."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest

from hydro_ident.bag.recording import Recording
from hydro_ident.mismatch.answer.diagnosis import Diagnosis, diagnose
from hydro_ident.mismatch.answer.rail_constants import parted_rails, rail_notes
from hydro_model.robot_files import load_robot

#: What the machine's rails are beyond the file's constants.
SUPPLY_PA, TANK_PA = -6.0e5, 4.0e5


def _recorded(make_run: tuple[Callable[..., Any], Callable[..., Any]], *, read: bool) -> Diagnosis:
    """A machine whose rails are not as its file has them, with or without their transducers."""
    true_crane, simulated_run = make_run
    plain = true_crane()
    truth = replace(
        plain,
        supply_pressure_pa=plain.supply_pressure_pa + SUPPLY_PA,
        tank_pressure_pa=plain.tank_pressure_pa + TANK_PA,
    )
    robot = load_robot("xs031")

    def recording(seconds: float, seed: int, name: str) -> Recording:
        whole: Recording = simulated_run(truth, seconds, seed=seed).recording(name)
        return (
            replace(whole, robot=robot)
            if read
            else replace(whole, robot=robot, supply=None, tank=None)
        )

    return diagnose(robot, [recording(14.0, 0, "train")], [recording(9.0, 3, "check")])


@pytest.mark.thorough
def test_a_constant_that_is_off_is_told_and_is_no_finding(make_run: tuple[Any, Any]) -> None:
    found = _recorded(make_run, read=False)
    assert (found.verdict, found.findings, found.unexplained) == ("matches", (), ())
    told = [note for note in found.notes if "was not recorded" in note]
    file = load_robot("xs031")
    for rail, gauge in (
        ("supply", file.supply_pressure_pa + SUPPLY_PA),
        ("tank", file.tank_pressure_pa + TANK_PA),
    ):
        (note,) = [n for n in told if n.startswith(f"{rail} was not recorded")]
        said = float(note.split("valves: ")[1].split(" bar")[0])
        assert said == pytest.approx(1e-5 * gauge, abs=0.3)
    assert {e.target for e in found.robot.effects} == {"supply", "tank"}
    for channel in found.channels:
        assert channel.after.std() == pytest.approx(channel.measured.std(), rel=0.05)


@pytest.mark.thorough
def test_rails_that_were_read_need_no_constant(make_run: tuple[Any, Any]) -> None:
    found = _recorded(make_run, read=True)
    assert (found.verdict, found.findings) == ("matches", ())
    assert not any("was not recorded" in note for note in found.notes)


def _finding(name: str, target: str) -> Any:
    effect = SimpleNamespace(name=name)
    return SimpleNamespace(
        named=SimpleNamespace(
            term=SimpleNamespace(effect=effect, target=target, parameters=[2.0e5])
        )
    )


@pytest.mark.parametrize(
    ("read", "parted"),
    [
        ([(False, False)], ["supply", "tank"]),
        ([(True, False)], ["tank"]),
        ([(True, True), (True, False)], ["tank"]),
    ],
)
def test_a_transducer_that_is_off_is_a_finding(
    read: list[tuple[bool, bool]], parted: list[str]
) -> None:
    """Of a rail that a recording lacks it is, or may be, the file's constant."""
    traces = [SimpleNamespace(rails_read=rails) for rails in read]
    material = SimpleNamespace(stretches=[SimpleNamespace(trace=trace) for trace in traces])
    work: Any = SimpleNamespace(
        training=SimpleNamespace(predictor=SimpleNamespace(material=material))
    )
    bias = "pressure_sensor_bias"
    given = [_finding(bias, target) for target in ("supply", "tank", "lift_cylinder/a")]
    given.append(_finding("supply_droop", "xs031"))
    findings, constants = parted_rails(work, given)
    assert [f.named.term.target for f in constants] == parted
    assert findings == [f for f in given if f not in constants]
    notes = rail_notes(load_robot("xs031"), constants)
    assert len(notes) == len(parted)
    assert "10 bar do not fit what passes the valves: 8 bar do" in notes[-1]
