"""What the heads of other laboratories' tables say becomes what they mean, or is left open."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import pytest

from hydro_ident.bag.log_file import read_log
from hydro_ident.bag.log_guess import Guess
from hydro_ident.bag.log_suggest import suggest
from hydro_model.robot import Robot
from hydro_model.robot_files import load_robot

CRANE = load_robot("xs031")
#: Lowest and highest number of a column, by its head.
Table = Mapping[str, tuple[float, float]]
Suggest = Callable[..., dict[str, Guess]]


@pytest.fixture
def guesses_of(tmp_path: Path) -> Suggest:
    """Guesses of the columns of a CSV file, by their heads."""

    def of(table: Table, robot: Robot | None = CRANE, units: str = "") -> dict[str, Guess]:
        t = 0.002 * np.arange(100)
        swings = 0.5 + 0.5 * np.sin(40.0 * t)
        rows = np.column_stack([low + (high - low) * swings for low, high in table.values()])
        lines = [";".join(("t", *table)), *([units] if units else [])]
        lines += [
            ";".join(repr(float(v)) for v in (at, *row)) for at, row in zip(t, rows, strict=True)
        ]
        file = tmp_path / "log.csv"
        file.write_text("\n".join(lines) + "\n", encoding="utf-8")
        return {g.column: g for g in suggest(read_log(file), robot).guesses}

    return of


def test_a_chambers_letter_in_brackets_is_no_ampere(guesses_of: Suggest) -> None:
    """It had made a transducer's loop current of chamber A alone, 4 to 20 mA for 0 to 250 bar."""
    names = [f"Lift pressure ({chamber})" for chamber in "AB"]
    found = guesses_of(dict.fromkeys(names, (10.0, 50.0)))
    assert [found[name].name for name in names] == ["lift_cylinder/a", "lift_cylinder/b"]
    assert all("raw" not in found[name].entry for name in names)
    assert {found[name].entry["unit"] for name in names} == {"bar"}


@pytest.mark.parametrize("name", ["Pressure sensor current (A)", "Druck_lift [mA]"])
def test_a_current_of_a_pressure_transducer_is_one(name: str, guesses_of: Suggest) -> None:
    guess = guesses_of({name: (0.005, 0.018)})[name]
    assert guess.section == "pressures"
    assert len(guess.entry["raw"]) == 2


def test_a_pressure_in_volts_is_its_transducers(guesses_of: Suggest) -> None:
    """It had become the lift's valve and left no name for the valve's own signal."""
    name, supply, valve = "lift_pressure_A [V]", "Pumpendruck [V]", "lift_valve_cmd [V]"
    table = {name: (1.0, 6.0), supply: (3.0, 4.0), valve: (-5.0, 5.0)}
    found = guesses_of(table)
    assert (found[name].section, found[name].name) == ("pressures", "lift_cylinder/a")
    assert found[name].entry["raw"] == "FILL_IN"
    assert found[name].entry["span"] == [0, 250.0]
    assert (found[supply].section, found[supply].name) == ("pressures", "supply")
    assert (found[valve].section, found[valve].name) == ("valve_commands", "lift_valve")
    without = guesses_of(table, None)[name].entry
    assert without["raw"] == without["span"] == "FILL_IN"


@pytest.mark.parametrize(
    ("name", "section"),
    [
        ("pilot_pressure [V]", ""),
        ("supply_voltage [V]", ""),
        ("p_valve_cmd [V]", "valve_commands"),
    ],
)
def test_other_voltages_are_what_they_were(name: str, section: str, guesses_of: Suggest) -> None:
    assert guesses_of({name: (1.0, 6.0)})[name].section == section
