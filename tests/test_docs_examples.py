"""The examples in the pages are what they say: a motion, a robot, an effect; lists are whole."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from hydro_control.node.parameter_file import check_parameter_file as check_controller_file
from hydro_hw_bridge.node.parameter_file import check_parameter_file
from hydro_hw_bridge.node.parameters import PARAMETERS
from hydro_ident.robots.robot_check import check_robot
from hydro_model.effects import resolve
from hydro_model.effects.signals import PISTON_POSITION, PISTON_VELOCITY, SIGNAL_COUNT
from hydro_model.motion.paths import load_path
from hydro_model.motion.paths_check import check_path
from hydro_model.robot import Robot
from hydro_model.robot_files import load_robot

ROOT = Path(__file__).resolve().parents[1]
SOURCES = [
    ROOT / "ros2_ws/src/hydro_model/hydro_model",
    *(
        ROOT / p / p
        for p in ("hydro_msgs_docs", "hydro_hw_bridge", "hydro_control", "hydro_ident")
    ),
]


def public_functions(path: Path) -> Iterator[tuple[str, list[str], str]]:
    """Name, arguments and docstring of a module's public functions and methods."""
    waiting: list[ast.AST] = [ast.parse(path.read_text(encoding="utf-8"))]
    while waiting:
        for node in ast.iter_child_nodes(waiting.pop()):
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                waiting.append(node)
            elif isinstance(node, ast.FunctionDef) and not node.name.startswith("_"):
                given = [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs]
                names = [a.arg for a in given if a.arg not in ("self", "cls")]
                yield node.name, names, ast.get_docstring(node) or ""


@pytest.mark.parametrize("source", SOURCES, ids=lambda path: path.name)
def test_a_list_of_parameters_leaves_none_out(source: Path) -> None:
    missing = []
    for path in sorted(source.rglob("*.py")):
        for name, arguments, text in public_functions(path):
            if "Parameters\n---" not in text:
                continue
            listed = text.split("Parameters\n---", 1)[1]
            listed = re.split(r"\n[A-Z]\w+\n---", listed)[0]
            missing += [
                f"{path.relative_to(ROOT)}, {name}: {argument}"
                for argument in arguments
                if not re.search(rf"^[\w, *]*\b{argument}\b", listed, re.M)
            ]
    assert not missing, "\n".join(missing)


def fenced(page: str, language: str) -> list[str]:
    """Fenced blocks of a language, those in lists without their indentation."""
    text = (ROOT / "hydro_msgs_docs" / page).read_text(encoding="utf-8")
    found = re.findall(rf"^( *)```{language}\n(.*?)^\1```", text, re.M | re.S)
    return [re.sub(rf"^{indent}", "", body, flags=re.M) for indent, body in found]


def test_first_motion_of_the_lab_guide_can_be_played(tmp_path: Path) -> None:
    _, _, motion = fenced("lab_guide.md", "yaml")
    file = tmp_path / "small.yaml"
    file.write_text(motion, encoding="utf-8")
    checked = check_path(load_robot("xs031"), load_path(file), margin=0.05)
    assert checked.peak_velocity.max() < 0.1


def test_limits_of_the_lab_guides_machine_are_taken_by_the_bridge(tmp_path: Path) -> None:
    limits, _, _ = fenced("lab_guide.md", "yaml")
    file = tmp_path / "bridge.yaml"
    file.write_text(limits, encoding="utf-8")
    check_parameter_file(file, ("robot", "can", "clock", "mapping", "dbc", "calibration"))
    given = yaml.safe_load(limits)["can_bridge"]["ros__parameters"]
    rules = {rule.name: rule for rule in PARAMETERS}
    for name, value in given.items():
        assert type(value) is type(rules[name].default)
        assert rules[name].lower <= value <= rules[name].upper


def test_the_lab_guides_controller_asks_for_no_more_than_its_gate_lets_through(
    tmp_path: Path,
) -> None:
    limits, own, _ = fenced("lab_guide.md", "yaml")
    file = tmp_path / "controller.yaml"
    file.write_text(own, encoding="utf-8")
    check_controller_file(file, ("robot", "path"))
    gate = yaml.safe_load(limits)["can_bridge"]["ros__parameters"]
    asked = yaml.safe_load(own)["controller"]["ros__parameters"]
    assert 0.0 < asked["slew_limit_v_s"] <= gate["slew_limit_v_s"]


def example_robot(folder: Path, *further: str) -> Robot:
    """The pages' crane, with further lines in its file."""
    (folder / "mycrane.urdf").write_text(fenced("extending.md", "xml")[0], encoding="utf-8")
    file = folder / "mycrane.hydraulics.yaml"
    file.write_text("".join([fenced("extending.md", "yaml")[0], *further]), encoding="utf-8")
    return load_robot(file)


def test_example_robot_is_a_robot_without_errors(tmp_path: Path) -> None:
    assert not check_robot(example_robot(tmp_path)).remarks


def test_example_effects_are_effects_of_the_example_robot(tmp_path: Path) -> None:
    robot = example_robot(tmp_path, fenced("extending.md", "yaml")[1])
    assert len(resolve(robot)) == len(robot.effects) == 6
    assert not check_robot(robot).remarks


def test_example_pins_are_those_of_the_example_robot(tmp_path: Path) -> None:
    [cylinder] = yaml.safe_load(fenced("extending.md", "yaml")[0])["cylinders"]
    parent, child = np.array([0.30, -0.95]), np.array([0.80, -0.08])
    angles = [np.arctan2(pin[1], pin[0]) for pin in (parent, child)]
    expected = {
        "l1_m": np.linalg.norm(parent),
        "l2_m": np.linalg.norm(child),
        "child_pin_angle_rad": angles[1],
        "q0_rad": angles[1] - angles[0],
    }
    for key, value in expected.items():
        assert cylinder[key] == pytest.approx(value, abs=1e-4)


def test_example_effect_is_one() -> None:
    [code] = fenced("extending.md", "python")
    names: dict[str, Any] = {}
    exec(compile(code, "extending.md", "exec"), names)
    effect = names["WORN_SEAL"]
    rows = np.zeros((3, SIGNAL_COUNT))
    rows[:, PISTON_POSITION], rows[:, PISTON_VELOCITY] = [0.30, 0.35, 0.9], [0.1, -0.1, 0.1]
    force = [term.law(row, effect.typical) for term in effect.terms for row in rows]
    assert force == pytest.approx([1000.0, -1000.0 * np.exp(-1.0), 0.0], abs=1e-3)
