"""A suggested mapping is right where it says sure, and leaves open what the log does not tell."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from hydro_ident.commands.convert import main, run
from hydro_ident.logs.file import Log, read_log
from hydro_ident.logs.guess import words_of
from hydro_ident.logs.suggest import Suggestion, suggest
from hydro_ident.logs.units import spelt, unit_in
from hydro_model.robot_files import load_robot

EXAMPLES = Path(__file__).resolve().parents[2] / "hydro_msgs_docs" / "log_examples"
T = np.arange(200) * 0.002


def log_of(units: dict[str, str] | None = None, **columns: np.ndarray) -> Log:
    return Log(Path("log.csv"), columns, units=units or {})


def made(suggestion: Suggestion) -> dict[str, tuple[str, str, str]]:
    return {g.column: (g.section, g.name, g.level) for g in suggestion.guesses}


@pytest.mark.parametrize(
    ("text", "quantity", "unit", "reference"),
    [
        ("[bar]", "pressure", "bar", ""),
        ("bar(g)", "pressure", "bar", "gauge"),
        ("psia", "pressure", "psi", "absolute"),
        ("MPa abs", "pressure", "MPa", "absolute"),
        ("°", "angle", "deg", ""),
        ("V", "voltage", "V", ""),
        ("Nm", "effort", "N m", ""),
        ("kg/cm²(g)", "pressure", "kgf/cm2", "gauge"),
        ("ata", "pressure", "kgf/cm2", "absolute"),
        ("N/mm²", "pressure", "MPa", ""),
        ("°F", "temperature", "degF", ""),
        ("gon", "angle", "gon", ""),
        ("deg/s", "velocity", "deg/s", ""),
    ],
)
def test_units_are_told_however_they_are_spelt(text, quantity, unit, reference) -> None:
    found = spelt(text)
    assert found is not None
    assert (found.quantity, found.unit, found.reference) == (quantity, unit, reference)


@pytest.mark.parametrize(
    ("name", "unit", "words"),
    [
        ("p1 [bar]", "bar", ("p", "1")),
        ("Druck A lift (bar)", "bar", ("druck", "a", "lift")),
        ("angle / deg", "deg", ("angle",)),
        ("Model Root/crane/pA_lift", "", ("crane", "p", "a", "lift")),
        ("U1_V", "V", ("u", "1")),
        ("p_a", "", ("p", "a")),
        ("p_atm", "", ("p", "atm")),
        ("p1 [N/cm2]", "", ("p", "1")),
        ("LiftCylPressureB", "", ("lift", "cyl", "pressure", "b")),
        ("Systemdruck [bar]", "bar", ("system", "druck")),
        ("SYSTEMDRUCK", "", ("system", "druck")),
        ("Versorgungsdruck", "", ("versorgung", "druck")),
        ("Pumpendruck", "", ("pumpe", "druck")),
        ("Rücklaufleitungsdruck", "", ("rücklauf", "druck")),
        ("supplypressure", "", ("supply", "pressure")),
        ("Hub_Kolbenstangenseitendruck_2", "", ("hub", "stange", "druck", "2")),
        ("p_Ringraum_1", "", ("p", "ring", "1")),
        ("Sollwinkel2", "", ("soll", "winkel", "2")),
    ],
)
def test_names_hold_words_numbers_and_units(name, unit, words) -> None:
    assert unit_in(name) == unit
    assert words_of(name) == words


@pytest.mark.parametrize(
    "name",
    [
        "Differenzdruck",
        "Lastdruck",
        "Steuerdruck",
        "Speicherdruck",
        "Solldruck",
        "Umgebungsdruck",
        "Ringleitungsdruck",
        "Systemrücklaufdruck",
        "Systemkolbendruck",
        "Kolbenringdruck",
        "Tankraum",
        "Ventilweg",
        "Pumpenwinkel",
        "Gelenkmoment",
        "Druckluft",
    ],
)
def test_compounds_that_say_something_else_stay_whole(name: str) -> None:
    """Of `Ringleitung`, a supply, `Ring` alone would make a rod's side."""
    assert words_of(name) == (name.lower(),)


def test_german_compounds_are_the_lines_and_chambers_that_they_name() -> None:
    names = ["Systemdruck", "Tankdruck", "Kolbendruck_1", "Stangendruck_1", "Ringraumdruck_2"]
    p = {name: 50.0 + k + T for k, name in enumerate(names)}
    log = log_of(dict.fromkeys(names, "bar"), t=T, Gelenkwinkel_1=0.5 + T, Sollwinkel_1=T, **p)
    found = made(suggest(log, load_robot("xs031")))
    assert found["Systemdruck"] == ("pressures", "supply", "open")  # gauge or absolute
    assert found["Tankdruck"][:2] == ("pressures", "tank")
    assert found["Kolbendruck_1"][:2] == ("pressures", "lift_cylinder/a")
    assert found["Stangendruck_1"][:2] == ("pressures", "lift_cylinder/b")
    assert found["Ringraumdruck_2"][:2] == ("pressures", "tilt_cylinder/b")
    assert found["Gelenkwinkel_1"][:2] == ("joints", "lift")
    assert found["Sollwinkel_1"][:2] == ("references", "lift")
    without = made(suggest(log))
    assert without["Systemdruck"][:2] == ("pressures", "supply")
    assert without["Tankdruck"][:2] == ("pressures", "tank")
    assert without["Kolbendruck_1"][:2] == ("pressures", "cylinder1/a")


@pytest.mark.parametrize("name", ["Versorgungsdruck", "Pumpendruck", "Systemdruck"])
def test_a_supply_of_any_german_name_is_the_supply(name: str) -> None:
    log = log_of({name: "barg"}, t=T, **{name: 180.0 + T})
    found = {g.column: g for g in suggest(log, load_robot("xs031")).guesses}
    assert (found[name].name, found[name].level) == ("supply", "sure")


def test_what_the_names_do_not_tell_is_told_by_numbers_and_the_robot() -> None:
    log = log_of(
        t=np.arange(200.0) * 2.0,
        q1=0.7 + 0.1 * np.sin(T),
        q2=-60.0 + 9.0 * np.sin(T),
        p1=120.0 + 0.0 * T,
        ps=18.7 + np.sin(T),
        u1=np.sin(30.0 * T),
    )
    found = suggest(log, load_robot("xs031"), "xs031")
    entries = {g.column: g.entry for g in found.guesses}
    assert entries["t"]["unit"] == "ms"  # steps of 2: 500 Hz as ms, nothing as s
    assert entries["q1"]["unit"] == "rad"
    assert entries["q2"]["unit"] == "deg"
    assert entries["p1"]["unit"] == "bar"  # 120 MPa is no pressure of this machine
    assert entries["ps"]["unit"] == "MPa"
    assert made(found)["u1"][:2] == ("valve_commands", "lift_valve")
    assert "pressures, lift_cylinder/a: reference" in found.to_fill_in
    assert "pressures, tank" in found.missing


def pressures_beside(**tank: np.ndarray) -> Log:
    return log_of(t=T, p1=120.0 + T, p2=60.0 + T, ps=180.0 + T, **tank)


def test_a_tank_line_has_the_unit_of_the_logs_other_pressures() -> None:
    found = {
        g.column: g for g in suggest(pressures_beside(p_tank=5.0 + T), load_robot("xs031")).guesses
    }
    assert found["p_tank"].entry["unit"] == "bar"
    assert found["p_tank"].why[-1] == "bar: as the log's other pressures, largest 5.398 bar"
    assert found["p_tank"].level == "open"  # gauge or absolute
    assert "bar: largest 120.4 bar, supply 190 bar" in found["p1"].why


@pytest.mark.parametrize("bar", [3e5, 45.0, -2.0, 0.0])
def test_a_tank_line_that_does_not_fit_their_unit_is_left_open(bar: float) -> None:
    found = suggest(pressures_beside(p_tank=bar + 0.0 * T), load_robot("xs031"))
    assert "pressures, tank: unit" in found.to_fill_in


def test_units_of_other_pressures_that_differ_tell_nothing() -> None:
    log = log_of({"p1": "barg", "ps": "MPa"}, t=T, p1=120.0 + T, ps=18.0 + T, p_tank=5.0 + T)
    assert "pressures, tank: unit" in suggest(log, load_robot("xs031")).to_fill_in
    one = log_of({"ps": "barg"}, t=T, ps=180.0 + T, p_tank=5.0 + T)
    assert "pressures, tank: unit" in suggest(one, load_robot("xs031")).to_fill_in


def test_pressures_below_zero_are_gauge_and_the_file_may_say() -> None:
    p = 5e5 + 6e5 * np.sin(30.0 * T)
    log = log_of({"p1": "Pa", "p2": "Pa", "p3": "bara"}, p1=p, p2=p + 2e6, p3=p * 1e-5 + 9.0)
    references = {g.column: (g.entry["reference"], g.level) for g in suggest(log).guesses[1:]}
    assert references["p1"][0] == references["p2"][0] == "gauge"
    assert references["p3"][0] == "absolute"


def test_a_sign_that_does_not_fit_the_joint_is_turned_and_said() -> None:
    log = log_of({"tilt_angle": "deg"}, t=T, tilt_angle=60.0 + 9.0 * np.sin(T))
    guess = suggest(log, load_robot("xs031")).guesses[1]
    assert guess.entry["sign"] == -1
    assert guess.level == "guess"
    assert any("only with its sign changed" in text for text in guess.why)


def test_a_reference_is_held_against_its_joints_range_as_the_joint_is() -> None:
    turned = 60.0 + 9.0 * np.sin(T)
    log = log_of({"tilt_deg": "deg", "tilt_soll": "deg"}, t=T, tilt_deg=turned, tilt_soll=turned)
    guesses = suggest(log, load_robot("xs031")).guesses[1:]
    assert [(g.section, g.entry.get("sign"), g.level) for g in guesses] == [
        ("joints", -1, "guess"),
        ("references", -1, "guess"),
    ]


def test_a_joint_without_ends_is_outside_of_none() -> None:
    robot = load_robot("xs031")
    endless = replace(robot.joints[0], lower=-np.inf, upper=np.inf)
    robot = replace(robot, joints=(endless, *robot.joints[1:]))
    guess = suggest(log_of({"lift": "rad"}, t=T, lift=9.0 * T), robot).guesses[1]
    assert (guess.name, guess.level) == ("lift", "sure")


def test_raw_transducers_take_the_robots_range_or_are_left_open() -> None:
    log = log_of({"p1": "mA", "p2": "mA"}, t=T, p1=8.0 + T, p2=9.0 + T)
    known = suggest(log, load_robot("xs031")).guesses[1]
    assert (known.entry["raw"], known.entry["span"]) == ([4, 20], [0, 250.0])
    assert "pressures, cylinder1/a: span" in suggest(log).to_fill_in


def test_velocities_and_the_unknown_are_left_out_with_a_reason() -> None:
    log = log_of({"dq1": "rad/s"}, t=T, dq1=np.sin(T), counter=np.ones(200))
    found = {g.column: g for g in suggest(log).guesses}
    assert found["dq1"].section == found["counter"].section == ""
    assert "the analysis differentiates" in found["dq1"].why[-1]


def test_a_log_of_one_line_says_why_it_has_no_time() -> None:
    guess = suggest(log_of(t=np.zeros(1), q=np.ones(1))).guesses[0]
    assert "'t' does not increase: it has one value" in guess.why


def test_two_columns_never_get_one_name() -> None:
    log = log_of(t=T, q1=0.5 + T, q1_raw=0.5 + T, q_1_filtered=0.5 + T)
    found = suggest(log, load_robot("xs031"))
    names = [(g.section, g.name) for g in found.guesses if g.section]
    assert len(names) == len(set(names))


def arguments(log: Path, folder: Path, *more: str) -> list[str]:
    return [str(log), "--suggest", str(folder / "map.yaml"), *more]


def test_a_mapping_without_gaps_converts_as_it_is(tmp_path: Path, capsys) -> None:
    log = EXAMPLES / "control_desk.csv"
    assert run([*arguments(log, tmp_path, "--robot", "xs031"), "--json", str(tmp_path / "j")]) == 0
    mapping = yaml.safe_load((tmp_path / "map.yaml").read_text(encoding="utf-8"))
    assert mapping["joints"]["tilt"]["wrap"] == 360
    assert mapping["pressures"]["lift_cylinder/a"]["reference"] == "gauge"
    report = json.loads((tmp_path / "j").read_text())
    sure = {g["column"] for g in report["guesses"] if g["sure"] == "sure"}
    assert {"q_lift", "p_A_lift", "u_tilt"} <= sure
    assert "enc_tilt" not in sure
    out = ["--map", str(tmp_path / "map.yaml"), "--out", str(tmp_path / "bag")]
    assert run([str(log), *out]) == 0
    assert "56 cycles at 100 Hz" in capsys.readouterr().out


def test_a_mapping_with_gaps_is_refused_with_their_names(
    tmp_path: Path, monkeypatch, capsys
) -> None:
    log = EXAMPLES / "labview.lvm"
    assert run(arguments(log, tmp_path, "--robot", "xs031")) == 0
    assert "to fill in: pressures, lift_cylinder/a: reference" in capsys.readouterr().out
    out = ["--map", str(tmp_path / "map.yaml"), "--out", str(tmp_path / "bag")]
    monkeypatch.setattr("sys.argv", ["convert", str(log), *out])
    assert main() == 2
    assert "'reference' is still to be filled in: gauge or absolute" in capsys.readouterr().err
    text = (tmp_path / "map.yaml").read_text(encoding="utf-8")
    (tmp_path / "map.yaml").write_text(text.replace("FILL_IN", "gauge"), encoding="utf-8")
    assert main() == 0


def test_without_a_robot_names_are_made_up_and_the_rest_is_the_same(tmp_path: Path) -> None:
    found = suggest(read_log(EXAMPLES / "control_desk.csv"))
    assert made(found)["p_A_lift"][:2] == ("pressures", "lift/a")
    assert made(found)["q_lift"][:2] == ("joints", "lift")
    assert {g.level for g in found.guesses if g.section == "joints"} == {"guess"}


def test_a_mapping_is_never_overwritten(tmp_path: Path, monkeypatch, capsys) -> None:
    (tmp_path / "map.yaml").write_text("mine")
    monkeypatch.setattr("sys.argv", ["convert", *arguments(EXAMPLES / "labview.lvm", tmp_path)])
    assert main() == 2
    assert "exists already" in capsys.readouterr().err
    assert (tmp_path / "map.yaml").read_text() == "mine"
