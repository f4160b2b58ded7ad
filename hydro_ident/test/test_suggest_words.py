"""Words of columns' names in five languages, and those that say that it is something else."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hydro_ident.logs.file import Log
from hydro_ident.logs.guess import Guess, reading_of, words_of
from hydro_ident.logs.suggest import suggest
from hydro_ident.logs.suggest_text import lines_of
from hydro_model.arrays import FloatArray
from hydro_model.robot import Robot
from hydro_model.robot_files import load_robot

T: FloatArray = np.linspace(0.0, 0.398, 200)
CRANE = load_robot("xs031")


def guesses(robot: Robot | None, *names: str, unit: str = "") -> dict[str, Guess]:
    """Guesses of columns of one kind beside a time."""
    columns: dict[str, FloatArray] = {"t": T} | {
        name: 50.0 + k + T * T for k, name in enumerate(names)
    }
    units = dict.fromkeys(names, unit) if unit else {}
    log = Log(Path("log.csv"), columns, units=units)
    return {g.column: g for g in suggest(log, robot).guesses}


def called(*names: str) -> Robot:
    """The crane with other names for its joints and cylinders."""
    joints = tuple(replace(j, name=n) for j, n in zip(CRANE.joints, names, strict=True))
    cylinders = tuple(
        replace(c, name=f"{n}_cylinder", joint=n)
        for c, n in zip(CRANE.cylinders, names, strict=True)
    )
    return replace(CRANE, joints=joints, cylinders=cylinders)


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("Auslegerdruck", ("ausleger", "druck")),
        ("Hubzylinder_Druck_Kolbenseite", ("hub", "zylinder", "druck", "kolben")),
        ("LÖFFELZYLINDERDRUCK_2", ("löffel", "zylinder", "druck", "2")),
        ("Stielwinkel", ("stiel", "winkel")),
        ("Presión émbolo", ("presion", "embolo")),
        ("Température de l'huile", ("temperature", "de", "l", "huile")),
        ("Pressio\u0301n", ("pression",)),
        ("Hubraumdruck", ("hubraumdruck",)),
        ("Auslegerlast", ("auslegerlast",)),
    ],
)
def test_compounds_and_accents(name: str, words: tuple[str, ...]) -> None:
    assert words_of(name) == words


def test_german_cylinders_are_the_robots_by_what_they_move() -> None:
    names = [f"{c}zylinder_Druck_{s}seite" for c in ("Kipp", "Hub") for s in ("Kolben", "Stangen")]
    found = guesses(CRANE, *names, unit="barg")
    assert [(found[name].name, found[name].level) for name in names] == [
        ("tilt_cylinder/a", "likely"), ("tilt_cylinder/b", "likely"),
        ("lift_cylinder/a", "likely"), ("lift_cylinder/b", "likely"),
    ]  # fmt: skip
    excavator = called("boom", "stick")
    found = guesses(excavator, "Stielzylinderdruck_A", "Ausleger_Druck_B", unit="barg")
    assert found["Stielzylinderdruck_A"].name == "stick_cylinder/a"
    assert found["Ausleger_Druck_B"].name == "boom_cylinder/b"


def test_german_verbs_are_motions_too() -> None:
    found = guesses(CRANE, "Winkel Kippen", "Winkel Heben", unit="deg")
    assert [found[f"Winkel {verb}"].name for verb in ("Kippen", "Heben")] == ["tilt", "lift"]
    assert "lift: 'heben'" in found["Winkel Heben"].why


def test_an_angle_a_whole_turn_away_is_brought_back_by_its_wrap() -> None:
    """An encoder that counts from 0 to 360 never jumps where the joint stays on one side of 0."""
    columns = {"t": T, "tilt angle": 290.0 + 100.0 * T, "lift angle": 150.0 + 99.0 * T}
    log = Log(Path("log.csv"), columns, units={"tilt angle": "deg", "lift angle": "deg"})
    found = {g.name: g for g in suggest(log, CRANE).guesses}
    tilt, lift = found["tilt"], found["lift"]
    assert (tilt.entry["wrap"], tilt.level) == (360.0, "guess")
    assert "within the joint's range by whole turns" in tilt.why
    # By no whole turn: its zero is somebody's to give.
    assert "wrap" not in lift.entry
    assert any(why.startswith("outside the joint's range") for why in lift.why)


@pytest.mark.parametrize("whole", [True, False])
def test_the_table_shows_names_as_long_as_headers_of_labs_are(whole: bool) -> None:
    name = "Druck Hubzylinder Kolbenseite [bar]" if whole else f"rec.{'s' * 60}.LABEL"
    suggestion = suggest(Log(Path("log.csv"), {"t": T, name: 50.0 + T}), CRANE)
    lines = lines_of(suggestion)
    (line,) = [one for one in lines if name[-5:] in one and "fill" not in one[:4]]
    assert line.startswith(name if whole else "…sss")
    # Reasons begin below one another.
    at = lines[0].index("because")
    assert all(one[at - 1] == " " != one[at] for one in lines[:3])


def test_a_place_is_not_guessed_against_the_columns_own_words() -> None:
    """By its place alone the second would be the lift's rod side."""
    found = guesses(CRANE, "Unbekannter_Druck", "Druck_Kolbenseite", "Druck_tilt", unit="barg")
    assert found["Druck_Kolbenseite"].name.endswith("/a")
    assert found["Druck_tilt"].name.startswith("tilt_cylinder/")
    found = guesses(CRANE, "pompe", "pression pompe", unit="barg")
    assert {g.name for g in found.values() if g.section == "pressures"} == {"supply"}


@pytest.mark.parametrize(
    ("names", "becomes"),
    [
        (("pression vérin 1 fond", "pression vérin 1 tige", "pression pompe", "pression retour"),
         ("lift_cylinder/a", "lift_cylinder/b", "supply", "tank")),
        (("presión_émbolo_2", "presión_vástago_2", "presión_bomba", "presión_tanque"),
         ("tilt_cylinder/a", "tilt_cylinder/b", "supply", "tank")),
        (("pressione_fondello_1", "pressione_stelo_1", "pressione_pompa", "pressione_serbatoio"),
         ("lift_cylinder/a", "lift_cylinder/b", "supply", "tank")),
    ],
)  # fmt: skip
def test_french_spanish_and_italian_pressures(
    names: tuple[str, ...], becomes: tuple[str, ...]
) -> None:
    found = guesses(CRANE, *names)
    assert tuple(found[name].name for name in names) == becomes


@pytest.mark.parametrize(
    ("name", "section"),
    [
        ("angulo_1", "joints"),
        ("ang_lift", "joints"),
        ("carrera_1", "strokes"),
        ("corsa_1", "strokes"),
        ("temperature huile", "oil_temperature"),
        ("temperatura_aceite", "oil_temperature"),
        ("vitesse_1", ""),
        ("portata_1", ""),
        ("tension", ""),  # a voltage in French, a pull in English
        # Where it is measured says no more than that.
        ("oil_pressure_1", "pressures"),
        ("Hub_Druck_A", "pressures"),
        ("Ventil_Druck_1", "pressures"),
        ("Hub_1", "strokes"),
        ("Ventil_1", "valve_commands"),
        # What is asked for was not measured.
        ("angle_cmd_1", "references"),
        ("pressure_ref", ""),
    ],
)
def test_what_is_measured(name: str, section: str) -> None:
    assert guesses(CRANE, name)[name].section == section


@pytest.mark.parametrize(
    ("name", "unit"),
    [
        ("Lastdruck", "bar"),
        ("Differenzdruck", "bar"),
        ("p_LS", "bar"),
        ("pilot_pressure", "bar"),
        ("ambient_temperature", "degC"),
        ("coolant_temp", "degC"),
        ("battery_voltage", "V"),
        ("supply_voltage", "V"),
    ],
)
def test_what_is_something_else_is_left_out_and_says_why(name: str, unit: str) -> None:
    """Each had become the first of its kind: a chamber, the oil, a valve."""
    guess = guesses(CRANE, name, unit=unit)[name]
    assert guess.section == ""
    assert guess.why[-1].startswith("not taken: '")
    assert "something else than" in guess.why[-1]


def test_a_word_that_the_robot_has_itself_is_the_robots() -> None:
    found = guesses(called("load", "tilt"), "load_pressure_A", "load_p", unit="barg")
    assert found["load_pressure_A"].name == "load_cylinder/a"
    assert found["load_p"].name == "load_cylinder/b"


def test_a_valves_current_is_not_taken_for_volts_or_a_stroke() -> None:
    found = guesses(CRANE, "Ventilstrom_Hub", "Motorstrom")
    assert found["Ventilstrom_Hub"].section == "valve_commands"
    assert found["Ventilstrom_Hub"].entry["raw"] == "FILL_IN"
    assert found["Motorstrom"].section == ""


def test_a_piston_rod_is_the_rods_side() -> None:
    found = guesses(CRANE, "lift piston rod side pressure", unit="barg")
    assert found["lift piston rod side pressure"].name == "lift_cylinder/b"


def test_of_temperatures_the_oils_is_the_oils() -> None:
    found = guesses(CRANE, "temp_1", "temp_oil", unit="degC")
    assert (found["temp_1"].section, found["temp_oil"].section) == ("", "oil_temperature")
    assert found["temp_oil"].level == "sure"
    assert guesses(CRANE, "temp_1", unit="degC")["temp_1"].level == "likely"


def test_positions_of_joints_are_read_and_those_of_spools_and_pistons_are_not_theirs() -> None:
    robot = called("j1", "j2")
    swing = {n: 0.4 * np.sin(9.0 * T + k) for k, n in enumerate(("j1_pos", "j2 position"))}
    columns = {"t": T, **swing, "j1 spool position": 0.3 * np.cos(9.0 * T)}
    columns["j2 piston pos"] = 0.2 + 0.1 * np.cos(7.0 * T)
    found = {g.column: g for g in suggest(Log(Path("log.csv"), columns), robot).guesses}
    assert (found["j1_pos"].section, found["j1_pos"].name) == ("joints", "j1")
    assert (found["j2 position"].section, found["j2 position"].name) == ("joints", "j2")
    assert found["j1 spool position"].section != "joints"
    assert reading_of("j2 piston pos", columns["j2 piston pos"], "").quantity == "length"


def test_topics_as_plotting_tools_export_them_are_the_joints() -> None:
    """A message's field says what it is: efforts of joints are torques, of pressures none."""
    torques = 40.0 * np.sin(9.0 * T)
    topics = {f"/joint_states/j1/{field}": torques / 99.0 for field in ("position", "effort")}
    found = {
        name: reading_of(name, values, "").quantity
        for name, values in {**topics, "/chamber_pressures/j1/effort": 1e5 * torques}.items()
    }
    assert list(found.values()) == ["angle", "effort", "pressure"]
