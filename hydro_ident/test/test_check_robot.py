"""`check_robot`: what cannot be true is said, and drawn all the same."""

from __future__ import annotations

import json
import re
import shutil
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from hydro_ident.commands.check_robot import main
from hydro_ident.report.robot_drawing import POSES
from hydro_ident.robots.robot_check import ERROR, NOTE, WARNING, RobotCheck, check_robot
from hydro_ident.robots.robot_ranges import drawn_poses
from hydro_model.errors import RobotError
from hydro_model.hydraulics.cylinder import lever, stroke
from hydro_model.multibody.rigid_body import potential_energy
from hydro_model.robot_files import load_robot, shipped_robots

LARGEST_BYTES = 8_000_000


class Crane:
    """The reference crane's files in a folder of their own, to be spoilt."""

    def __init__(self, folder: Path) -> None:
        source = shipped_robots()["xs031"]
        self.file = Path(shutil.copy(source, folder / source.name))
        self.urdf = Path(shutil.copy(source.with_name("xs031.urdf"), folder))

    def change(self, *keys: str | int, value: object = None) -> None:
        """Set a value of the hydraulics file, or take it out where it is None."""
        data = yaml.safe_load(self.file.read_text(encoding="utf-8"))
        at = data
        for key in keys[:-1]:
            at = at[key]
        at.pop(keys[-1]) if value is None else at.update({keys[-1]: value})
        self.file.write_text(yaml.safe_dump(data), encoding="utf-8")

    def replace(self, old: str, new: str) -> None:
        """Change the URDF."""
        text = self.urdf.read_text(encoding="utf-8")
        assert old in text
        self.urdf.write_text(text.replace(old, new), encoding="utf-8")

    def check(self) -> RobotCheck:
        return check_robot(load_robot(self.file, check_strokes=False))


@pytest.fixture
def crane(tmp_path: Path) -> Crane:
    return Crane(tmp_path)


def texts(check: RobotCheck, level: str, about: str) -> list[str]:
    return [r.text for r in check.remarks if r.level == level and r.about == about]


@pytest.mark.parametrize("name", sorted(shipped_robots()))
def test_shipped_robots_are_not_wrong(name: str) -> None:
    assert not check_robot(load_robot(name)).wrong


def test_wide_limits_are_an_error_that_names_those_that_fit(crane: Crane) -> None:
    crane.replace('lower="-0.05" upper="1.70"', 'lower="-0.30" upper="1.70"')
    with pytest.raises(RobotError, match="outside its stroke"):
        load_robot(crane.file)
    check = crane.check()
    [text] = texts(check, ERROR, "lift_cylinder")
    low, high = (float(v) for v in re.findall(r"from (\S+) to (\S+) rad$", text)[0])
    cylinder = check.robot.cylinder("lift_cylinder")
    inside = stroke(cylinder, np.linspace(low + 1e-3, high - 1e-3, 50))
    assert inside.min() >= 0.0
    assert inside.max() <= cylinder.stroke_m
    assert stroke(cylinder, low - 0.02) < 0.0
    assert high == pytest.approx(1.70)


def test_limits_that_are_slightly_wide_are_a_warning(crane: Crane) -> None:
    crane.replace('lower="-0.05" upper="1.70"', 'lower="-0.11" upper="1.70"')
    check = crane.check()
    cylinder = check.robot.cylinder("lift_cylinder")
    assert -0.03 * cylinder.stroke_m < stroke(cylinder, -0.11) < 0.0
    assert not texts(check, ERROR, "lift_cylinder")
    [text] = [t for t in texts(check, WARNING, "lift_cylinder") if "joint limits" in t]
    assert "inside it is from" in text


def test_no_position_inside_is_said(crane: Crane) -> None:
    crane.change("cylinders", 0, "x0_m", value=1.5)
    assert "no position in them is inside" in texts(crane.check(), ERROR, "lift_cylinder")[0]


def test_dead_centre_is_found_where_the_pins_and_the_axis_are_in_line(crane: Crane) -> None:
    crane.change("cylinders", 0, "q0_rad", value=1.0056 + 1.2)
    [text] = [t for t in texts(crane.check(), ERROR, "lift_cylinder") if "dead centre" in t]
    assert f"at {np.pi - 2.2056:.3f} rad" in text


def test_missing_masses_make_the_mass_matrix_indefinite(crane: Crane) -> None:
    text = crane.urdf.read_text(encoding="utf-8")
    crane.urdf.write_text(re.sub(r"<inertial>.*?</inertial>", "", text, flags=re.S))
    for k in (0, 1):
        for part in ("barrel", "rod"):
            crane.change("cylinders", k, part)
    check = crane.check()
    assert "mass matrix is not positive definite" in texts(check, ERROR, "xs031")[0]
    assert texts(check, WARNING, "tilt_link") == ["no mass in the URDF"]


@pytest.mark.parametrize(
    ("inertia", "why"),
    [
        ('ixx="20.0" iyy="400.0" izz="185.0"', "exceeds the sum"),
        ('ixx="20.0" iyy="-1.0" izz="185.0"', "one is negative"),
    ],
)
def test_impossible_bodies_are_said(crane: Crane, inertia: str, why: str) -> None:
    crane.replace('ixx="20.0" iyy="189.8" izz="185.0"', inertia)
    assert why in texts(crane.check(), WARNING, "tilt_link")[0]


def test_what_is_left_to_defaults_is_listed(crane: Crane) -> None:
    crane.change("fluid", "bulk_modulus_pa")
    crane.change("cylinders", 1, "rod")
    crane.change("sensors")
    crane.change("valves", 0, "rated_voltage_v")
    check = crane.check()
    assert not check.wrong
    assert "no bulk_modulus_pa" in texts(check, WARNING, "fluid")[0]
    assert any("no rod" in t for t in texts(check, WARNING, "tilt_cylinder"))
    assert any("no rated_voltage_v" in t for t in texts(check, WARNING, "lift_valve"))
    assert len(texts(check, WARNING, "sensors")) == 4


def test_what_of_the_files_is_not_used_is_told(crane: Crane) -> None:
    jaw = """<link name="jaw"><inertial><mass value="55"/>
      <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
      <joint name="grip" type="revolute"><parent link="tip_link"/><child link="jaw"/>
      <limit lower="0" upper="1" effort="1" velocity="1"/></joint></robot>"""
    assert not [r for r in crane.check().remarks if r.about in ("grip", "lift", "tilt")]
    crane.replace("</robot>", jaw)
    text = crane.urdf.read_text(encoding="utf-8")
    at = text.index("</joint>", text.index('name="lift"'))
    dynamics = '<dynamics damping="300" friction="40"/>'
    crane.urdf.write_text(text[:at] + dynamics + text[at:], encoding="utf-8")
    crane.change("joints", value=[{"name": "tilt", "viscous_friction": 70.0}])
    check = crane.check()
    [branch] = texts(check, WARNING, "grip")
    assert "the 55 kg behind it count as fixed to 'tilt_link' at position 0" in branch
    dry, viscous = texts(check, WARNING, "lift")
    assert "the URDF's friction of 40 is not used" in dry
    assert "viscous friction of 300 N m s/rad" in viscous
    assert "viscous_friction of 'lift_cylinder' in N s/m" in viscous
    [listed] = texts(check, WARNING, "tilt")
    assert "viscous friction of 70 N m s/rad" in listed


def test_what_several_lack_is_one_line(crane: Crane) -> None:
    for k in (0, 1):
        for part in ("barrel", "rod", "child_pin_angle_rad"):
            crane.change("cylinders", k, part)
        crane.change("valves", k, "rated_voltage_v")
    check = crane.check()
    assert texts(check, WARNING, "lift_cylinder, tilt_cylinder") == [
        "no barrel and no rod: their masses count as nothing",
        "no child_pin_angle_rad: 0 is taken, which places barrel and rod",
    ]
    said = texts(check, WARNING, "lift_valve, tilt_valve")
    assert said == ["no rated_voltage_v: 10 V is taken"]


def test_cylinders_that_lack_different_parts_are_told_apart(crane: Crane) -> None:
    crane.change("cylinders", 0, "barrel")
    crane.change("cylinders", 1, "rod")
    check = crane.check()
    assert "no barrel: its mass counts as nothing" in texts(check, WARNING, "lift_cylinder")
    assert "no rod: its mass counts as nothing" in texts(check, WARNING, "tilt_cylinder")


def effect(name: str, target: str, **parameters: float) -> dict[str, object]:
    return {"name": name, "target": target, "parameters": parameters}


@pytest.mark.parametrize(
    ("listed", "said"),
    [
        (effect("coulom_friction", "lift_cylinder", force=1.0), "no effect 'coulom_friction' in"),
        (effect("coulomb_friction", "lift_cyl", force=1.0), "has unknown target 'lift_cyl'"),
        (effect("coulomb_friction", "lift_cylinder", fc=1.0), "has no parameter 'fc' (known:"),
        (effect("coulomb_friction", "lift_cylinder"), "needs parameter 'force' in N"),
        (effect("coulomb_friction", "lift_cylinder", force=1e9), "force should be 0 to"),
    ],
)
def test_effects_that_nothing_can_be_made_of_are_errors(
    listed: dict[str, object], said: str, crane: Crane
) -> None:
    sound = effect("backlash", "tilt_cylinder", width=1e-4)
    crane.change("effects", value=[sound, listed])
    [text] = texts(crane.check(), ERROR, "effects")
    assert said in text
    assert crane.file.name not in text
    crane.change("effects", value=[sound])
    assert not crane.check().wrong


def test_every_wrong_effect_is_told_and_one_listed_twice(crane: Crane) -> None:
    friction = effect("coulomb_friction", "lift_cylinder", force=1000.0)
    wrong = [effect("coulomb", "xs031", force=1.0), effect("backlash", "nose", width=1e-4)]
    crane.change("effects", value=[friction, *wrong, wrong[0]])
    assert len(texts(crane.check(), ERROR, "effects")) == 2
    crane.change("effects", value=[friction, friction])
    [text] = texts(crane.check(), ERROR, "effects")
    assert "listed twice for 'lift_cylinder'" in text


def test_the_command_fails_on_an_effect_that_is_none(
    crane: Crane, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    crane.change("effects", value=[effect("coulomb_friction", "lift_cyl", force=1.0)])
    found = tmp_path / "crane.json"
    assert main([str(crane.file), "--json", str(found)]) == 1
    assert "ERROR    effects: effect 'coulomb_friction' has unknown" in capsys.readouterr().out
    remarks = json.loads(found.read_text(encoding="utf-8"))["remarks"]
    assert (remarks[0]["level"], remarks[0]["about"]) == ("error", "effects")


def test_loads_are_the_slope_of_the_energy_over_the_lever() -> None:
    robot = load_robot("xs031")
    [_, tilt] = check_robot(robot).ranges
    step, k = 1e-5, 60
    poses = drawn_poses(robot, 33)
    poses[:, 1] = tilt.q[k]
    nearby = [potential_energy(robot, poses + np.array([0.0, s])) for s in (step, -step)]
    forces = (nearby[0] - nearby[1]) / (2.0 * step) / lever(robot.cylinders[1], tilt.q[k])
    assert tilt.load_high_n[k] == pytest.approx(forces.max(), rel=1e-5)
    assert tilt.load_low_n[k] == pytest.approx(forces.min(), rel=1e-5)


def test_a_load_beyond_the_supply_is_an_error(crane: Crane) -> None:
    crane.change("supply", "pressure_pa", value=9.0e6)
    assert "of what the supply gives" in texts(crane.check(), ERROR, "lift_cylinder")[0]
    crane.change("supply")
    assert "nothing moves" in texts(crane.check(), ERROR, "supply")[0]


def test_a_cylinder_that_lowers_its_joint_and_one_without_valve_are_said(crane: Crane) -> None:
    crane.change("cylinders", 0, "q0_rad", value=-1.0056 - 1.70)
    crane.change("valves", value=[])
    check = crane.check()
    assert any("extending it lowers" in t for t in texts(check, NOTE, "lift_cylinder"))
    assert any("no valve feeds it" in t for t in texts(check, WARNING, "lift_cylinder"))


LIFT, SUPPLY, C_PA = ("cylinders", 0), ("supply", "pressure_pa"), ("valves", 0, "c_pa")
#: Numbers of the reference crane in another unit, what is remarked on, and the unit named.
IN_ANOTHER_UNIT: list[tuple[dict[tuple[str | int, ...], float], str, str]] = [
    ({(*LIFT, "bore_m"): 80.0, (*LIFT, "rod_m"): 45.0}, "lift_cylinder", "80 mm are 0.08 m"),
    ({(*LIFT, "bore_m"): 3.15}, "lift_cylinder", "3.15 inches are 0.08001 m"),
    ({(*LIFT, "stroke_m"): 590.0}, "lift_cylinder", "590 mm are 0.59 m"),
    ({(*LIFT, "l1_m"): 1040.0, (*LIFT, "l2_m"): 160.0}, "lift_cylinder", "mm are 0.1"),
    ({SUPPLY: 18e11}, "supply", "1.8e+07 Pa are 180 bar"),
    ({SUPPLY: 2.6e8}, "supply", "2600 psi are 179.3 bar"),
    ({SUPPLY: 190.0, ("supply", "tank_pressure_pa"): 0.0}, "supply", "190 bar are 190 bar"),
    ({C_PA: 8.91e-7 / 316.2}, "lift_valve", "a drop in Pa taken for bar (100 l/min)"),
    ({C_PA: 16.9}, "lift_valve", "a coefficient in l/(min sqrt(bar))"),
]


@pytest.mark.parametrize(("changes", "about", "said"), IN_ANOTHER_UNIT)
def test_numbers_in_another_unit_are_errors_that_name_it(
    changes: dict, about: str, said: str, crane: Crane
) -> None:
    for keys, value in changes.items():
        crane.change(*keys, value=value)
    check = crane.check()
    assert any(said in text for text in texts(check, ERROR, about))
    valves = [r for r in check.remarks if r.level == ERROR and r.about == "lift_valve"]
    assert bool(valves) == (about == "lift_valve")


@pytest.mark.parametrize(
    ("keys", "value", "said"),
    [
        (("cylinders", 0, "stroke_m"), 8.0, "stroke 8 m: in metres?"),
        (("cylinders", 0, "bore_m"), 0.45, "bore 0.45 m, stroke"),
        (("cylinders", 0, "rod_m"), 0.0045, "rod 0.0045 m in a bore of 0.08 m"),
    ],
)
def test_unlikely_sizes_are_worth_a_look(
    keys: tuple[str | int, ...], value: float, said: str, crane: Crane
) -> None:
    crane.change("cylinders", 0, "stroke_m", value=0.2)
    crane.change(*keys, value=value)
    assert any(said in text for text in texts(crane.check(), WARNING, "lift_cylinder"))


def test_joints_without_limits_are_looked_at_over_a_turn() -> None:
    robot = load_robot("patu655")
    endless = replace(robot.joints[1], lower=-np.inf, upper=np.inf)
    check = check_robot(replace(robot, joints=(robot.joints[0], endless)))
    assert any("-3.14 to 3.14" in t for t in texts(check, NOTE, "tilt"))
    assert np.isfinite(drawn_poses(check.robot)).all()


@pytest.mark.needs("plotly")
def test_the_command_writes_one_file_that_fetches_nothing(
    crane: Crane, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    page, found = tmp_path / "crane.html", tmp_path / "crane.json"
    assert main([str(crane.file), "--out", str(page), "--json", str(found)]) == 0
    said = capsys.readouterr().out
    assert "lift_cylinder" in said
    assert "xs031: 2 joints, 2 cylinders" in said
    html = page.read_text(encoding="utf-8")
    assert len(html.encode()) < LARGEST_BYTES
    assert not re.search(r'(src|href)="(?!#)', html.split("<script>", 1)[0])
    assert html.count('class="canvas"') == len(POSES) + 1 + 2
    # A page that is passed on says nothing of the computer that it was made on.
    assert str(crane.file.parent) not in html
    assert f"<code>{crane.file.name}</code>, <code>{crane.urdf.name}</code>" in html
    data = json.loads(found.read_text(encoding="utf-8"))
    assert data["schema"] == "hydro_ident/robot_check/1"
    assert [c["name"] for c in data["cylinders"]] == ["lift_cylinder", "tilt_cylinder"]


@pytest.mark.thorough
@pytest.mark.needs("plotly")
def test_a_browser_opens_the_drawing_without_errors(
    crane: Crane, tmp_path: Path, browser_check: Callable[..., dict[str, Any]]
) -> None:
    page = tmp_path / "crane.html"
    assert main([str(crane.file), "--out", str(page)]) == 0
    views = browser_check(page, 390, 1400)["views"]
    assert [view["found"] for view in views] == [[]] * len(views)
    assert views[0]["drawn"] == views[0]["figures"] == len(POSES) + 1 + 2


@pytest.mark.needs("plotly")
def test_the_command_fails_on_an_error_and_still_draws(crane: Crane, tmp_path: Path) -> None:
    crane.replace('upper="1.70"', 'upper="2.90"')
    page = tmp_path / "crane.html"
    assert main([str(crane.file), "--out", str(page)]) == 1
    assert "cannot be used as it is" in page.read_text(encoding="utf-8")


def test_without_plotly_the_description_is_checked_and_not_drawn(
    crane: Crane,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(sys.modules, "plotly", None)
    page = tmp_path / "page.html"
    assert main([str(crane.file), "--out", str(page)]) == 0
    said = capsys.readouterr()
    assert "lift_cylinder" in said.out
    assert said.err.startswith("check_robot: plotly is not installed: ")
    assert said.err.count("\n") == 1
    assert not page.exists()


def test_unreadable_robots_are_bad_usage(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([str(tmp_path / "none.yaml")]) == 2
    assert capsys.readouterr().err.startswith("check_robot: no robot file")
