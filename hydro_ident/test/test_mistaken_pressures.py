"""Pressures in another unit than Pa are told; those of a machine whose pump is off are not."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import count
from typing import Any

import numpy as np
import pytest

from hydro_ident.bag.reader import read_bag
from hydro_ident.bag.recording import recording_of
from hydro_ident.commands.inspect import main
from hydro_ident.identify.survey import recorded_notes, survey_source
from hydro_ident.identify.verdict import judge, spoils_all
from hydro_ident.inspecting.health import find_irregularities
from hydro_ident.inspecting.mistaken_pressures import mistaken_notes
from hydro_ident.recordings.sources import sources_of
from hydro_ident.report.verdict_words import health_line
from hydro_model.robot import Robot
from hydro_model.robot_files import load_robot

ATMOSPHERE = 101325.0
COUNT = 400
PRESSURES = "/chamber_pressures"
Changed = Callable[[np.ndarray], np.ndarray]


@pytest.fixture
def found_in(write_bag, run_columns, robot):
    """What is said of units in a run whose pressures were changed, and of how much it moved."""

    def found(change: Changed, columns: slice = slice(None), moves: bool = True):
        topics = run_columns(1500)
        names, fields = topics[PRESSURES]
        absolute = fields["effort"]
        absolute[:, names.index("supply")] += robot.supply_pressure_pa - 5e6
        absolute[:, columns] = change(absolute[:, columns])
        if not moves:
            topics["/joint_states"][1]["position"][:] = (0.8, -1.2)
        recording = recording_of(read_bag(write_bag(topics)), robot)
        return [f for f in find_irregularities(recording) if f.kind == "unit"]

    return found


@pytest.mark.parametrize(
    ("change", "unit"),
    [
        (lambda pa: (pa - ATMOSPHERE) / 1e5, "bar"),
        (lambda pa: pa / 1e5, "bar"),
        (lambda pa: pa / 1e3, "kPa"),
        (lambda pa: pa / 1e6, "MPa"),
        (lambda pa: pa / 6894.757, "psi"),
        (lambda pa: ATMOSPHERE + (pa - ATMOSPHERE) / 1e5, "bar"),
        (lambda pa: ATMOSPHERE + (pa - ATMOSPHERE) / 1e3, "kPa"),
    ],
)
def test_another_unit_is_told_as_what_it_looks_like(found_in, change, unit) -> None:
    [found] = found_in(change)
    assert found.signal == "pressures"
    assert found.text.startswith(f"look like {unit}")
    assert "expected up to about 1.91e+07 Pa, the supply of xs031" in found.text
    assert "the contract has Pa absolute" in found.text
    assert not found.harmless


def test_where_all_are_in_bar_at_rest_no_vacuum_is_believed(found_in) -> None:
    [found] = found_in(lambda pa: pa / 1e5, moves=False)
    assert "nearly vacuum" in found.text


@pytest.mark.parametrize(("columns", "signal"), [(slice(4), "chambers"), (slice(4, 5), "supply")])
def test_what_alone_is_in_another_unit_is_told(found_in, columns, signal) -> None:
    [found] = found_in(lambda pa: pa / 1e5, columns)
    assert found.signal == signal


@pytest.mark.parametrize(
    ("change", "columns", "moves"),
    [
        (lambda pa: pa, slice(None), True),
        # The pump is off: about the atmosphere, with zeros that are off by some of it.
        (lambda pa: ATMOSPHERE + 1e-3 * (pa - 5e6), slice(None), False),
        (lambda pa: ATMOSPHERE + 2e4 + 0.0 * pa, slice(None), False),
        # It is off, recorded as gauge.
        (lambda pa: 2e3 + 1e-2 * (pa - 5e6), slice(None), False),
        # It is off and the arm sinks on what its chambers hold.
        (lambda pa: ATMOSPHERE + 0.0 * pa, slice(4, None), True),
        # The supply is not connected.
        (lambda pa: 0.0 * pa, slice(4, 5), True),
    ],
)
def test_a_machine_whose_pump_is_off_is_not_accused(found_in, change, columns, moves) -> None:
    assert found_in(change, columns, moves) == []


@pytest.fixture
def told_of(write_bag, run_columns, robot):
    """What is said of units where pressures, Pa absolute by name, are all that was recorded."""

    names = (f"bag{i}" for i in count())

    def told(pressures: dict[str, np.ndarray], still: tuple[int, ...] = (), of: Robot = robot):
        topics = run_columns(COUNT)
        effort = np.column_stack(list(pressures.values()))
        topics[PRESSURES] = (tuple(pressures), {"effort": effort})
        for joint in still:
            topics["/joint_states"][1]["position"][:, joint] = (0.8, -1.2)[joint]
        recording = recording_of(read_bag(write_bag(topics, name=next(names))), of)
        return [f for f in find_irregularities(recording) if f.kind == "unit"]

    return told


def swing(low: float, high: float, noise: float = 0.0, phase: float = 0.0) -> np.ndarray:
    rng = np.random.default_rng(int(1e3 * phase))
    share = 0.5 - 0.5 * np.cos(np.arange(COUNT) * 0.02 + phase)
    return low + (high - low) * share + noise * rng.normal(size=COUNT)


def chambers(low: float, high: float, sides: str = "ab", noise: float = 0.0):
    names = [f"{axis}_cylinder/{side}" for axis in ("lift", "tilt") for side in sides]
    return {name: swing(low, high, noise, 0.7 * i) for i, name in enumerate(names)}


@pytest.mark.parametrize(
    ("level", "noise"),
    [(300.0, 10.0), (300.0, 300.0), (2.5e3, 30.0), (5e3, 50.0), (2e4, 300.0), (2e4, 5e3)],
)
@pytest.mark.parametrize("still", [(), (0, 1)])
def test_a_supply_that_reads_nothing_is_no_unit(told_of, level, noise, still) -> None:
    supply = {"supply": swing(level, level, noise)}
    assert told_of({**chambers(1e6, 5e6), **supply}, still) == []


@pytest.mark.parametrize(
    ("level", "noise"), [(300.0, 10.0), (2e4, 300.0), (1e5, 50.0), (1e5, 2e3)]
)
def test_a_supply_alone_does_not_stand_for_all_pressures(told_of, level, noise) -> None:
    assert told_of({"supply": swing(level, level, noise)}) == []


def test_a_supply_that_stands_still_or_that_chambers_contradict_is_no_unit(told_of) -> None:
    assert told_of({**chambers(1e6, 5e6), "supply": np.full(COUNT, 190.0)}) == []
    # It wanders, as an open input's noise does.
    assert told_of({**chambers(1e6, 5e6), "supply": swing(60.0, 195.0)}) == []
    # Chambers hold nothing: the pump is off.
    idle = chambers(ATMOSPHERE, ATMOSPHERE + 2e4)
    assert told_of({**idle, "supply": swing(180.0, 195.0)}, still=(0, 1)) == []
    # They hold far more than the pump would make.
    assert told_of({**chambers(1e6, 4e7), "supply": swing(180.0, 195.0)}) == []
    [found] = told_of({**chambers(1e6, 5e6), "supply": swing(180.0, 195.0)})
    assert found.signal == "supply"


def test_chambers_to_the_tank_are_not_accused(told_of) -> None:
    tank = ATMOSPHERE + 4e4
    pump = {"supply": swing(0.95e7, 1.05e7)}
    # Of each cylinder one side was read, with the supply and without.
    assert told_of({**chambers(ATMOSPHERE, tank, "b"), **pump}) == []
    assert told_of(chambers(ATMOSPHERE + 2e3, ATMOSPHERE + 1e4, "b")) == []
    # Both were, but the supply's reading shows the unit.
    assert told_of({**chambers(ATMOSPHERE, ATMOSPHERE + 1e4), **pump}) == []


def test_zeros_that_are_off_are_no_unit_where_something_shows_it(told_of) -> None:
    """Recorded as gauge: a supply of 2.7 kPa at rest, chambers of 3 to 10 kPa beside a pump."""
    idle = {**chambers(500.0, 2e3), "supply": swing(2.7e3, 2.8e3)}
    assert told_of(idle, still=(0, 1)) == []
    pump = {"supply": swing(0.95e7, 1.05e7)}
    assert told_of({**chambers(3e3, 1e4), **pump}) == []


def test_a_dead_chamber_is_not_a_side_that_was_read(crane_run: Any) -> None:
    run = crane_run.recording("run")
    kpa = replace(run, p_a=run.p_a / 1e3, p_b=run.p_b / 1e3, supply=None)
    assert len(mistaken_notes([kpa])) == 1
    dead = {"lift_cylinder/a": 0.0, "tilt_cylinder/b": 0.0}
    assert mistaken_notes([replace(kpa, dead=dead)]) == []


def test_a_cylinder_with_both_sides_has_to_have_moved(told_of) -> None:
    one = {f"lift_cylinder/{s}": swing(ATMOSPHERE + 2e3, ATMOSPHERE + 1e4) for s in "ab"}
    assert told_of(one, still=(0,)) == []
    [found] = told_of(one)
    assert found.signal == "pressures"
    assert "although lift moved" in found.text


def test_noise_about_the_atmosphere_is_no_unit(told_of) -> None:
    """Of a cylinder that something else moved: a number in kPa would be far below vacuum."""
    assert told_of(chambers(ATMOSPHERE, ATMOSPHERE, noise=1e3)) == []


def test_a_thick_rod_makes_no_light_load_another_unit(told_of, robot) -> None:
    thick = tuple(replace(c, rod_m=0.95 * c.bore_m) for c in robot.cylinders)
    light = chambers(ATMOSPHERE + 5e4, ATMOSPHERE + 2e5)
    assert told_of(light, of=replace(robot, cylinders=thick)) == []


def test_inspect_asks_to_look_at_it(write_bag: Any, run_columns: Any, capsys: Any) -> None:
    columns = run_columns(400)
    columns[PRESSURES][1]["effort"][:] = 190.0
    assert main([str(write_bag(columns, metadata={"robot": "xs031"}))]) == 0
    said = capsys.readouterr().out
    assert ": 1 to look at" in said
    assert "CHECK   pressures: look like bar: at most 190 Pa absolute" in said


def test_identify_and_diagnose_say_it_before_all_else(crane_run: Any) -> None:
    robot, run = load_robot("xs031"), crane_run.recording("run")
    wrong = {
        name: None if (pa := getattr(run, name)) is None else pa / 1e5 - ATMOSPHERE
        for name in ("p_a", "p_b", "supply", "tank")
    }
    bar = replace(run, **wrong)
    assert mistaken_notes([run]) == []
    [told] = mistaken_notes([run, bar])
    assert told.startswith("run: pressures: look like bar: ")
    assert judge(robot, [bar], None, None).problems[0] == told
    notes = recorded_notes([survey_source(source, robot) for source in sources_of([bar])])
    assert notes[0] == told
    assert spoils_all(told)


def test_a_strip_names_it(found_in: Any) -> None:
    from types import SimpleNamespace

    summary = SimpleNamespace(findings=tuple(found_in(lambda pa: pa / 1e5)))
    assert health_line([summary]) == [  # type: ignore[list-item]
        "The recordings are not clean (pressures unit): see data health first."
    ]
