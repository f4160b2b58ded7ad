"""What the heads of other laboratories' tables say becomes what they mean, or is left open."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hydro_ident.logs.file import read_log
from hydro_ident.logs.guess import Guess
from hydro_ident.logs.suggest import suggest
from hydro_model.robot import Robot
from hydro_model.robot_files import load_robot

CRANE = load_robot("xs031")
_LIFT, _TILT = CRANE.joints
_TELESCOPE = replace(_TILT, name="telescope", prismatic=True, lower=0.0, upper=2.0)
#: With a telescope of up to 2 m in the place of the tilt.
TELESCOPE = replace(
    CRANE,
    joints=(_LIFT, _TELESCOPE),
    cylinders=(
        CRANE.cylinders[0],
        replace(CRANE.cylinders[1], name="telescope_cylinder", joint="telescope"),
    ),
)
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


def test_a_force_is_no_torque_of_a_joint_that_turns(guesses_of: Suggest) -> None:
    """A cylinder's force had become the joint's torque, kN for kN m, and sure."""
    table = {"lift_cylinder_force [kN]": (1.0, 60.0), "lift_torque [kNm]": (1.0, 60.0)}
    found = guesses_of(table)
    force, torque = (found[name] for name in table)
    assert force.section == ""
    assert force.why[-1] == "efforts: a force, and of lift it would be a torque"
    assert (torque.section, torque.name, torque.level) == ("efforts", "lift", "sure")
    slide = guesses_of({"telescope_force [kN]": (1.0, 60.0)}, TELESCOPE)["telescope_force [kN]"]
    assert (slide.section, slide.name, slide.entry["unit"]) == ("efforts", "telescope", "kN")
    assert guesses_of({"Kraft_1": (1.0, 60.0)})["Kraft_1"].section == ""


def test_beside_a_slide_a_cylinders_stroke_is_no_angle(guesses_of: Suggest) -> None:
    """With any slide in the robot a stroke had become an angle: mm for rad, and sure."""
    names = {
        "lift_stroke [mm]": ("strokes", "lift_cylinder", "mm"),
        "lift_angle [deg]": ("joints", "lift", "deg"),
        "telescope_position [cm]": ("joints", "telescope", "cm"),
        "telescope_stroke [mm]": ("strokes", "telescope_cylinder", "mm"),
    }
    found = guesses_of(dict.fromkeys(names, (20.0, 45.0)), TELESCOPE)
    assert {n: (found[n].section, found[n].name, found[n].entry["unit"]) for n in names} == names
    alone = guesses_of({"telescope_position [deg]": (20.0, 45.0)}, TELESCOPE)
    assert alone["telescope_position [deg]"].section == ""


@pytest.mark.parametrize(
    ("low", "high", "unit"),
    [(0.4, 0.8, "FILL_IN"), (150.0, 190.0, "FILL_IN"), (300.0, 1900.0, "mm")],
)
def test_a_slides_length_without_a_unit_is_none_of_degrees(
    low: float, high: float, unit: str, guesses_of: Suggest
) -> None:
    """40 to 80 had become degrees. Of cm and mm only numbers above the other's range tell."""
    guess = guesses_of({"telescope_length": (low, high)}, TELESCOPE)["telescope_length"]
    assert (guess.section, guess.name, guess.entry["unit"]) == ("joints", "telescope", unit)


def test_a_reference_of_a_stroke_is_none_of_an_angle(guesses_of: Suggest) -> None:
    guess = guesses_of({"lift_stroke_ref [mm]": (100.0, 400.0)})["lift_stroke_ref [mm]"]
    assert guess.section == ""
    assert guess.why[-1] == "references: a length, and of lift it would be an angle"


def test_what_is_asked_for_was_not_measured(guesses_of: Suggest) -> None:
    """torque_ref_lift had become the measured torque, sure, and torque_lift nothing."""
    asked = ["torque_ref_lift [Nm]", "torque_set_tilt [Nm]", "lift_pressure_A_soll [bar]"]
    asked += ["pressure_cmd_tilt_b [bar]", "oil_temp_setpoint [degC]"]
    measured = ["torque_lift [Nm]", "torque_meas_tilt [Nm]", "lift_pressure_A [bar]"]
    found = guesses_of(dict.fromkeys((*asked, *measured), (10.0, 50.0)))
    assert {name: found[name].section for name in asked} == dict.fromkeys(asked, "")
    assert found[asked[0]].why[-1].startswith("not taken: 'ref' says what was asked for")
    names = ["lift", "tilt", "lift_cylinder/a"]
    assert [found[name].name for name in measured] == names


def test_of_two_alike_the_one_called_measured_is_taken(guesses_of: Suggest) -> None:
    table = {"torque_lift [Nm]": (1.0, 5.0), "torque_lift_meas [Nm]": (1.0, 5.0)}
    found = guesses_of(table)
    assert [found[name].section for name in table] == ["", "efforts"]


@pytest.mark.parametrize(
    ("name", "section"),
    [
        ("lift_valve_cmd [%]", "valve_commands"),
        ("Ventil lift Soll [%]", "valve_commands"),
        ("lift_valve [%]", "valve_commands"),
        ("lift_cmd [%]", "valve_commands"),
        ("spool_cmd_1 [%]", "valve_commands"),
        ("spool_lift [%]", "spools"),
        ("lift_valve_position [%]", "spools"),
        ("Ventil lift Ist [%]", "spools"),
        ("engine_load [%]", ""),
        ("pump_cmd [%]", ""),
    ],
)
def test_a_share_is_the_valves_signal_or_its_spools(
    name: str, section: str, guesses_of: Suggest
) -> None:
    """A command in percent had become a measured spool; `inspect` then missed the valve."""
    guess = guesses_of({name: (-60.0, 70.0)})[name]
    assert guess.section == section
    if section == "valve_commands":
        assert guess.name == "lift_valve"
        assert guess.entry["raw"] == [-100.0, 100.0]
        assert guess.entry["span"] == [-10.0, 10.0]


def test_what_is_beyond_a_whole_share_is_left_open(guesses_of: Suggest) -> None:
    guess = guesses_of({"lift_valve_cmd [%]": (-600.0, 700.0)})["lift_valve_cmd [%]"]
    assert (guess.section, guess.entry["raw"]) == ("valve_commands", "FILL_IN")


@pytest.mark.parametrize(
    ("name", "section", "key"),
    [
        ("lift_angle [grads]", "joints", "unit"),
        ("lift_valve [inc]", "valve_commands", "raw"),
        ("lift pressure A (counts)", "pressures", "unit"),
        ("lift_stroke [in]", "strokes", "unit"),
        ("oil [°Re]", "oil_temperature", "unit"),
    ],
)
def test_a_unit_that_nobody_here_knows_is_not_guessed_against(
    name: str, section: str, key: str, guesses_of: Suggest
) -> None:
    """[grads] had become degrees, likely, and [in] millimetres."""
    guess = guesses_of({name: (10.0, 45.0)})[name]
    assert (guess.section, guess.entry[key], guess.level) == (section, "FILL_IN", "open")
    assert f"unit '{name.split()[-1].strip('[]()')}' is not known here" in guess.why


def test_a_line_of_units_may_have_an_unknown_one(guesses_of: Suggest) -> None:
    names = ["lift_angle", "tilt_angle", "p_1", "p_2", "p_3"]
    found = guesses_of(dict.fromkeys(names, (10.0, 45.0)), units="s;deg;grads;bar;bar;ksi")
    units = [found[name].entry["unit"] for name in names]
    assert units == ["deg", "FILL_IN", "bar", "bar", "FILL_IN"]


@pytest.mark.parametrize(
    "name",
    ["Druck (Stangenseite)", "p1 (gauge)", "p1 [lift]", "p1 [2]", "p1 (soll)", "p1 [-]",
     "p1 (filtered)"],
)  # fmt: skip
def test_what_else_stands_in_brackets_is_no_unit(name: str, guesses_of: Suggest) -> None:
    assert not any("not known here" in why for why in guesses_of({name: (10.0, 45.0)})[name].why)


def test_a_name_of_the_robot_in_brackets_is_no_unit(guesses_of: Suggest) -> None:
    joints = (replace(_LIFT, name="mast"), _TILT)
    robot = replace(CRANE, joints=joints)
    guess = guesses_of({"angle [mast]": (10.0, 45.0)}, robot)["angle [mast]"]
    assert (guess.name, guess.entry["unit"], guess.level) == ("mast", "deg", "likely")


def test_times_in_an_unknown_unit_are_left_open(tmp_path: Path) -> None:
    """Steps of 2 ticks had become 2 ms, likely."""
    file = tmp_path / "log.csv"
    lines = ["Time [ticks];lift_angle [deg]", *(f"{2 * k};{20 + k % 7}" for k in range(50))]
    file.write_text("\n".join(lines), encoding="utf-8")
    time = suggest(read_log(file), CRANE).guesses[0]
    assert (time.entry["unit"], time.level) == ("FILL_IN", "open")


def test_a_temperature_far_from_oils_is_in_another_unit(guesses_of: Suggest) -> None:
    assert guesses_of({"oil_temp": (300.0, 320.0)})["oil_temp"].entry["unit"] == "FILL_IN"
    assert guesses_of({"oil_temp": (40.0, 45.0)})["oil_temp"].entry == {"signal": "oil_temp"}
    kelvin = guesses_of({"oil_temp [K]": (300.0, 320.0)})["oil_temp [K]"]
    assert (kelvin.entry["unit"], kelvin.level) == ("K", "sure")


@pytest.mark.parametrize(
    ("name", "section", "own", "unit"),
    [
        # A block's port has a number that is no joint's.
        ("Model Root/Sensors/p_pump/Out1 [bar]", "pressures", "supply", "bar"),
        ("Model Root/Sensors/alpha_2/Out1 [deg]", "joints", "tilt", "deg"),
        # `fb` of a function block is no feedback.
        ("PRG.fbTilt.rValveOut_pct", "valve_commands", "tilt_valve", "V"),
        ("PRG.fbTilt.rValveOut_V", "valve_commands", "tilt_valve", "V"),
        ("Ventil 2 in %", "valve_commands", "tilt_valve", "V"),
        ("Winkel 2 in °", "joints", "tilt", "deg"),
        # Of a valve that opens by its whole in Simscape, and by metres.
        ("Kippventil.y [-]", "valve_commands", "tilt_valve", "V"),
        ("crane/tilt valve/S (m)", "spools", "tilt_valve", "1"),
        ("Schieberweg tilt [mm]", "spools", "tilt_valve", "1"),
        # Sensors that read in volts are no valves.
        ("Winkel Kipp (V)", "joints", "tilt", "FILL_IN"),
        ("stroke_2 [V]", "strokes", "tilt_cylinder", "FILL_IN"),
        ("lvdt_spool_2 [V]", "spools", "tilt_valve", "1"),
        ("temp_oil [V]", "oil_temperature", "", "FILL_IN"),
        ("Kolbenkraft 2 (V)", "", "", None),
        ("Ventilspannung Kipp (V)", "valve_commands", "tilt_valve", "V"),
    ],
)
def test_heads_of_other_tools_tables(
    name: str, section: str, own: str, unit: str | None, guesses_of: Suggest
) -> None:
    guess = guesses_of({name: (-0.9, 0.95)})[name]
    assert (guess.section, guess.name, guess.entry.get("unit")) == (section, own, unit)


def test_a_share_without_a_unit_is_of_the_rated_signal(guesses_of: Suggest) -> None:
    """1 of [-] had become 1 V, likely."""
    guess = guesses_of({"Kippventil.y [-]": (-0.9, 0.95)})["Kippventil.y [-]"]
    assert (guess.entry["raw"], guess.entry["span"]) == ([-1.0, 1.0], [-10.0, 10.0])


def test_what_a_robot_does_not_have_gets_no_name_made_up(guesses_of: Suggest) -> None:
    """A motor's volts had become a valve, which `convert` then refused."""
    guess = guesses_of({"vir [V]": (-2.0, 2.0)}, load_robot("emps"))["vir [V]"]
    assert (guess.section, guess.why[-1]) == ("", "valve_commands: emps has none")


def test_a_pumps_angle_is_no_joints(guesses_of: Suggest) -> None:
    guess = guesses_of({"Pump Swash Angle (deg)": (3.0, 12.0)})["Pump Swash Angle (deg)"]
    assert guess.section == ""
