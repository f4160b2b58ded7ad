"""Robot files: what a good one gives, and one clear line for each bad one."""

from __future__ import annotations

from collections.abc import Callable
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from hydro_model.errors import RobotError
from hydro_model.robot_files import MAX_FILE_BYTES, load_robot, shipped_robots

Change = Callable[[dict[str, Any]], None]


def rewritten(path: Path, change: Change) -> Path:
    data = yaml.safe_load(path.read_text(encoding="utf-8"))
    change(data)
    path.write_text(yaml.safe_dump(data), encoding="utf-8")
    return path


def refused(path: Path) -> str:
    """The message with which a file is refused: one line that names the file's folder."""
    with pytest.raises(RobotError) as caught:
        load_robot(path)
    message = str(caught.value)
    assert "\n" not in message
    assert str(path.parent) in message
    assert len(message) < 1000
    return message


def test_the_shipped_crane_by_name_and_by_path() -> None:
    robot = load_robot("xs031")
    assert robot.joint_names == ("lift", "tilt")
    assert robot.link_names == ("lift_link", "tilt_link")
    assert robot.pressure_names == (
        "lift_cylinder/a",
        "lift_cylinder/b",
        "tilt_cylinder/a",
        "tilt_cylinder/b",
        "supply",
        "tank",
    )
    assert np.allclose(robot.tip_offset_m, [2.106, 0.0, 0.0])
    # Table I's inertia of link 1 about its joint.
    assert robot.link_inertia[0, 7] == pytest.approx(95.97, abs=0.01)
    # The datasheet's 100 l/min at 35 bar per edge.
    edge = 100.0 / 60000.0 / np.sqrt(35.0e5)
    assert robot.valve_of("tilt_cylinder").c_pa == pytest.approx(edge, rel=1e-3)
    bore_less_rod = np.pi * (0.080**2 - 0.045**2) / 4.0
    assert robot.cylinder_of("lift").area_b_m2 == pytest.approx(bore_less_rod)
    by_path = load_robot(shipped_robots()["xs031"])
    assert np.array_equal(by_path.link_inertia, robot.link_inertia)


@pytest.mark.parametrize(
    ("look_up", "name", "known"),
    [
        ("joint_index", "elbow", "lift, tilt"),
        ("cylinder", "x", "lift_cylinder, tilt_cylinder"),
        ("valve_of", "x", "lift_cylinder, tilt_cylinder"),
        ("cylinder_of", "x", "lift, tilt"),
    ],
)
def test_unknown_names_list_the_known(look_up: str, name: str, known: str) -> None:
    with pytest.raises(RobotError, match=f"'{name}'.*{known}"):
        getattr(load_robot("xs031"), look_up)(name)


def test_missing_file_names_the_shipped_robots(tmp_path: Path) -> None:
    assert "xs031" in refused(tmp_path / "absent.yaml")
    assert "expected" in refused(tmp_path / "no" / "such")
    with pytest.raises(RobotError, match="no robot file 'xs999'"):
        load_robot("xs999")


def test_a_folder_is_no_robot(tmp_path: Path) -> None:
    refused(tmp_path)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", "expected a mapping of keys, found nothing"),
        ("- 1\n- 2\n", "found a list"),
        ("just a text", "found a text"),
        ("17", "found a value"),
        ("a: [1, 2", "not valid YAML"),
        ("a: b: c", "not valid YAML"),
        ("robot: !!python/object:os.system x", "not valid YAML"),
        ("[" * 5000, "not valid YAML"),
        ("when: 2024-13-45", "not valid YAML"),
        ("robot: xs031", "key 'tip_link' is missing"),
    ],
)
def test_text_that_is_no_description(tmp_path: Path, text: str, expected: str) -> None:
    path = tmp_path / "robot.yaml"
    path.write_text(text, encoding="utf-8")
    assert expected in refused(path)


def test_bytes_that_are_no_text(tmp_path: Path) -> None:
    path = tmp_path / "robot.yaml"
    path.write_bytes(b"\xff\xfe\x00\x81robot")
    assert "expected a text in UTF-8" in refused(path)


def test_what_lies_beside_a_robot_file_names_it(tmp_path: Path) -> None:
    urdf = tmp_path / "crane.urdf"
    urdf.write_text("<robot/>", encoding="utf-8")
    assert "found a URDF; scripts/new_robot.sh makes one of it" in refused(urdf)
    file = tmp_path / "crane.hydraulics.yaml"
    file.write_text("robot: crane", encoding="utf-8")
    assert f"found a URDF; '{file}' is one" in refused(urdf)
    assert f"no robot file '{tmp_path}'" in refused(tmp_path)
    assert f"; '{file}' is one" in refused(tmp_path)


def test_the_name_of_a_robot_file_without_its_ending_names_it(tmp_path: Path) -> None:
    file = tmp_path / "crane.hydraulics.yaml"
    file.write_text("robot: crane", encoding="utf-8")
    assert f"; did you mean '{file}'?" in refused(tmp_path / "crane")
    assert "did you mean" not in refused(tmp_path / "crain")


def test_a_huge_file_is_not_parsed(tmp_path: Path) -> None:
    path = tmp_path / "robot.yaml"
    path.write_text("#" * (MAX_FILE_BYTES + 1), encoding="utf-8")
    assert "larger than" in refused(path)


def test_a_list_with_nothing_behind_its_key_is_empty(crane: Path) -> None:
    def emptied(data: dict[str, Any]) -> None:
        data |= dict.fromkeys(("cylinders", "valves", "effects", "joints"))

    robot = load_robot(rewritten(crane, emptied))
    assert (robot.cylinders, robot.valves, robot.effects) == ((), (), ())


@pytest.mark.parametrize("key", ["cylinders", "fluid", "tip_link", "gravity_m_s2"])
def test_an_alias_bomb_ends_at_once(crane: Path, key: str) -> None:
    """Aliases within aliases: 10^24 leaves if anything walked or printed them."""
    lines = ["a0: &a0 [x, x, x, x, x, x, x, x, x, x]"]
    lines += [f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 10)}]" for i in range(1, 24)]
    data = yaml.safe_load(crane.read_text(encoding="utf-8"))
    data.pop(key)
    bomb = "\n".join([*lines, yaml.safe_dump(data), f"{key}: *a23", ""])
    crane.write_text(bomb, encoding="utf-8")
    refused(crane)


def test_a_merge_key_bomb_ends_at_once(tmp_path: Path) -> None:
    """Mappings merged ten at a time: 10^12 keys if they were all put together."""
    lines = ["a0: &a0 {x: 1, y: 2}"]
    lines += [f"a{i}: &a{i} {{<<: [{', '.join([f'*a{i - 1}'] * 10)}]}}" for i in range(1, 13)]
    path = tmp_path / "robot.yaml"
    path.write_text("\n".join(lines), encoding="utf-8")
    assert "aliases unfold to more than" in refused(path)


def set_in(*way: str | int, value: object) -> Change:
    def change(data: dict[str, Any]) -> None:
        at: Any = data
        for step in way[:-1]:
            at = at[step]
        at[way[-1]] = value

    return change


BASE_PARAMETER = {"name": "lift_link.mcx", "combination": {"lift_link.mcx": 1.0}, "value": 1.0}


def drop(*way: str | int) -> Change:
    def change(data: dict[str, Any]) -> None:
        at: Any = data
        for step in way[:-1]:
            at = at[step]
        del at[way[-1]]

    return change


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (drop("robot"), "key 'robot' is missing"),
        (drop("urdf"), "key 'urdf' is missing"),
        (drop("cylinders", 0, "bore_m"), "cylinders[lift_cylinder]: key 'bore_m' is missing"),
        (drop("cylinders", 1, "x0_m"), "key 'x0_m' is missing"),
        (drop("valves", 0, "c_bt"), "valves[lift_valve]: key 'c_bt' is missing"),
        (set_in("urdf", value="absent.urdf"), "no URDF at"),
        (set_in("schema", value="hydro_model/model/9"), "expected schema hydro_model/model/1"),
        (set_in("robot", value=7), "'robot' should be a text, found 7"),
        (set_in("tip_link", value="nose"), "no link 'nose' (links: base_link, lift_link"),
        (set_in("gravity_m_s2", value=[0.0, 9.81]), "'gravity_m_s2' should be 3 numbers"),
        (set_in("gravity_m_s2", value=[0.0, 0.0, "down"]), "found 'down'"),
        (set_in("cylinders", value={"a": 1}), "'cylinders' should be a list"),
        (set_in("cylinders", 0, value="lift"), "'cylinders[0]' should be a mapping"),
        (set_in("cylinders", 0, "joint", value="elbow"), "no joint 'elbow' (known: lift, tilt)"),
        (set_in("cylinders", 1, "joint", value="lift"), "'lift' appears more than once"),
        (set_in("cylinders", 1, "name", value="lift_cylinder"), "appears more than once"),
        (set_in("cylinders", 0, "bore_m", value=float("nan")), "should be a finite number"),
        (set_in("cylinders", 0, "bore_m", value=float("inf")), "should be a finite number"),
        (set_in("cylinders", 0, "bore_m", value=True), "should be a number, found True"),
        (set_in("cylinders", 0, "bore_m", value=0.0), "should be a number above 0"),
        (set_in("cylinders", 0, "stroke_m", value=-0.59), "should be a number above 0"),
        (set_in("cylinders", 0, "rod_m", value=0.09), "expected 0 <= rod_m < bore_m"),
        (set_in("cylinders", 0, "stroke_m", value=0.4), "outside its stroke 0 to 0.4"),
        (set_in("cylinders", 0, "x0_m", value=0.95), "outside its stroke"),
        (set_in("cylinders", 0, "barrel", value=[1]), "'barrel' should be a mapping"),
        (set_in("cylinders", 0, "stroke_sensor", value="yes"), "should be true or false"),
        (
            set_in("cylinders", 0, "barrel", "mass_kg", value=-17.4),
            "barrel: 'mass_kg' should be a number of 0 or more, found -17.4",
        ),
        (
            set_in("cylinders", 0, "rod", "inertia_com_kg_m2", value=-0.6),
            "rod: 'inertia_com_kg_m2' should be a number of 0 or more, found -0.6",
        ),
        (
            set_in("command_delay_s", value=-0.004),
            "'command_delay_s' should be a number of 0 or more, found -0.004",
        ),
        (
            set_in("command_delay_s", value=12),
            "expected a command_delay_s of at most 1 s, found 12 s (in ms?)",
        ),
        (
            set_in("sensors", "encoder", "counts_per_rev", value=0.5),
            "encoder: expected counts_per_rev of 1 or more, found 0.5",
        ),
        (
            set_in("supply", "tank_pressure_pa", value=2.0e7),
            "expected a supply pressure_pa of at least the tank's 2e+07 Pa, found 1.9e+07 Pa",
        ),
        (set_in("valves", 0, "cylinder", value="nose"), "no cylinder 'nose'"),
        (set_in("valves", 1, "cylinder", value="lift_cylinder"), "appears more than once"),
        (set_in("valves", 1, "name", value="lift_valve"), "'lift_valve' appears more than once"),
        (set_in("valves", 0, "c_pa", value=-1e-7), "should be a number above 0"),
        (set_in("fluid", value=3), "'fluid' should be a mapping"),
        (set_in("fluid", "bulk_modulus_pa", value="stiff"), "should be a number, found 'stiff'"),
        (set_in("effects", value=[{"name": "coulomb_friction"}]), "key 'target' is missing"),
        (
            set_in("effects", value=[{"name": "coulomb_friction", "target": "lift_cylinder"}]),
            "'parameters' is missing, expected a mapping of names to numbers; 'coulomb_friction'"
            " has force in N, velocity_scale in m/s (optional)",
        ),
        (
            set_in("effects", value=[{"name": "backlash", "target": "lift_cylinder"}]),
            "give in 1/N (optional) or, at another kind of target, gap in rad, contact_torque in",
        ),
        (
            set_in("robot", value=date(2024, 5, 1)),
            "'robot' should be a text, found the date 2024-05-01: YAML makes one of it where it"
            ' stands without quotes, write "2024-05-01"',
        ),
        (
            set_in("fluid", "bulk_modulus_pa", value=date(2024, 5, 1)),
            "should be a number, found the date 2024-05-01: YAML makes one of it where it stands"
            " without quotes",
        ),
        (
            set_in("base_parameters", value=[{"name": "a.b", "combination": {}, "value": 1}]),
            "names 'a.b', expected <link>.<parameter>",
        ),
        (
            set_in("base_parameters", value=[BASE_PARAMETER, BASE_PARAMETER]),
            "base parameter 'lift_link.mcx' appears more than once",
        ),
    ],
)
def test_bad_content(crane: Path, change: Change, expected: str) -> None:
    assert expected in refused(rewritten(crane, change))


def test_an_unknown_effect_without_parameters_is_told_as_one(crane: Path) -> None:
    effect = {"name": "coulom_friction", "target": "lift_cylinder"}
    said = refused(rewritten(crane, set_in("effects", value=[effect])))
    assert "no effect 'coulom_friction' in the catalogue (known: coulomb_friction" in said
    assert "is missing" not in said


def test_direct_cylinder_on_a_revolute_joint(crane: Path) -> None:
    def change(data: dict[str, Any]) -> None:
        del data["cylinders"][0]["l1_m"]

    assert "needs l1_m, l2_m, q0_rad and x0_m" in refused(rewritten(crane, change))


@pytest.fixture
def telescope(crane: Path) -> Path:
    """The crane with a tilt joint that slides; its cylinder is still on a triangle."""
    urdf = crane.with_name("xs031.urdf")
    text = urdf.read_text(encoding="utf-8")
    urdf.write_text(text.replace('"tilt" type="revolute"', '"tilt" type="prismatic"'), "utf-8")
    return crane


def direct(data: dict[str, Any]) -> None:
    for key in ("l1_m", "l2_m", "q0_rad", "barrel", "rod"):
        del data["cylinders"][1][key]
    data["cylinders"][1] |= {"x0_m": -3.0, "stroke_m": 3.0}


def test_a_triangle_on_a_joint_that_slides(telescope: Path) -> None:
    said = refused(telescope)
    assert "cylinder 'tilt_cylinder' on prismatic joint 'tilt' has l1_m" in said
    assert load_robot(rewritten(telescope, direct)).cylinders[1].l1_m == 0.0


@pytest.mark.parametrize("part", ["barrel", "rod"])
def test_barrel_and_rod_of_a_joint_that_slides_belong_to_the_links(
    telescope: Path, part: str
) -> None:
    """Its pins are nowhere in the file: their masses would be lost."""
    pin = {"barrel": "parent", "rod": "child"}[part]
    body = {"mass_kg": 10.0, f"com_from_{pin}_pin_m": 0.3, "inertia_com_kg_m2": 0.5}

    def change(data: dict[str, Any]) -> None:
        direct(data)
        data["cylinders"][1][part] = body

    said = refused(rewritten(telescope, change))
    assert "cylinder 'tilt_cylinder' on prismatic joint 'tilt' has a barrel or rod" in said
    assert "<inertial> of 'lift_link' and the rod's in that of 'tilt_link'" in said


def test_numbers_in_exponent_notation_are_numbers(crane: Path) -> None:
    text = crane.read_text(encoding="utf-8").replace("1.2e9", "1e9")
    crane.write_text(text, encoding="utf-8")
    assert load_robot(crane).cylinders[0].bulk_modulus_pa == 1.0e9
