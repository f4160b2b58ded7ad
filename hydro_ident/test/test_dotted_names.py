"""Names with dots in them, as those of several arms have: results are of the same machine."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from hydro_ident.commands import diagnose, identify
from hydro_ident.parameters.parameter_names import parts_of
from hydro_ident.parameters.parameters import effect_unit, viscous_unit
from hydro_model.robot import EffectSpec, Robot
from hydro_model.robot_files import load_robot, shipped_robots

_PLAIN = re.compile(r"\b(lift|tilt)(?=_link|_cylinder|_valve|\b)")
#: Listed, so that its parameters are among those of the result.
LISTED = (
    "effects:\n"
    "  - {name: coulomb_friction, target: lift_cylinder, parameters: {force: 1000.0}}\n"
    "  - {name: valve_null_bias, target: tilt_valve, parameters: {bias: 0.001}}\n"
)


def dotted(text: str) -> str:
    return _PLAIN.sub(r"front.\1", text)


def written(folder: Path, change: Callable[[str], str], more: str) -> Path:
    source = shipped_robots()["xs031"]
    folder.mkdir()
    (folder / "xs031.urdf").write_text(change(source.with_name("xs031.urdf").read_text()))
    robot = folder / "crane.hydraulics.yaml"
    robot.write_text(change(source.read_text() + more))
    return robot


@pytest.fixture(scope="module")
def run(make_run: tuple[Callable[..., Robot], Callable[..., Any]]) -> Any:
    true_crane, simulated_run = make_run
    effects = (
        EffectSpec("coulomb_friction", "lift_cylinder", {"force": 2500.0}),
        EffectSpec("valve_null_bias", "tilt_valve", {"bias": 0.006}),
    )
    return simulated_run(replace(true_crane(), effects=effects), 9.0)


def results(
    command: Any, run: Any, write_bag: Callable[..., Path], folder: Path
) -> tuple[tuple[Any, Path], tuple[Any, Path]]:
    """Result and folder of a command on the same run, by plain and by dotted names."""
    found = []
    for name, change in (("plain", str), ("dotted", dotted)):
        columns = {
            topic: (tuple(map(change, names)), fields)
            for topic, (names, fields) in run.columns().items()
        }
        # What is listed is fitted; what is not is found.
        robot = written(folder / name, change, LISTED if command is identify else "")
        out = folder / f"{name}_out"
        bag = write_bag(columns, name=f"{name}_bag/run")
        arguments = [str(bag), "--robot", str(robot), "--out", str(out)]
        assert command.run(arguments) == 0
        if command is identify:
            # Once more, against what it has just written.
            earlier = ["--compare", str((out / "model.yaml").rename(folder / "earlier.yaml"))]
            (out / "xs031.urdf").rename(folder / "xs031.urdf")
            assert command.run([*arguments, *earlier]) == 0
        found.append((json.loads((out / "result.json").read_text()), out))
    return found[0], found[1]


def same(plain: Any, other: Any) -> bool:
    """Whether two results differ in the names alone, and in where files lie and what they hold."""
    kept = [{k: v for k, v in one.items() if k != "provenance"} for one in (plain, other)]
    return bool(json.loads(dotted(json.dumps(kept[0]))) == kept[1])


def coloured(out: Path) -> int:
    """Rows that a report marks with a joint's colour."""
    return (out / "report.html").read_text().count('<span class="dot"')


@pytest.mark.thorough
@pytest.mark.needs("clarabel", "plotly")
def test_an_identification_is_that_of_the_same_machine(
    run: Any, write_bag: Any, tmp_path: Path
) -> None:
    (plain, plain_out), (other, out) = results(identify, run, write_bag, tmp_path)
    assert same(plain, other)
    rows = {p["name"]: p for p in other["parameters"]}
    assert rows["front.lift_cylinder.coulomb_friction.force"]["datasheet"] == 1000.0
    assert "front.tilt_cylinder.valve_null_bias.bias" in rows
    assert {"front.lift_link.mcx", "front.tilt_valve.c_pa"} <= rows.keys()
    compared = {one["name"] for one in other["compare"]["parameters"]}
    assert rows.keys() <= compared | {n for n, p in rows.items() if not p["identifiable"]}
    assert coloured(out) == coloured(plain_out) > 20
    assert load_robot(out / "model.yaml").joint_names == ("front.lift", "front.tilt")


@pytest.mark.thorough
@pytest.mark.needs("plotly")
def test_a_diagnosis_is_that_of_the_same_machine(run: Any, write_bag: Any, tmp_path: Path) -> None:
    (plain, plain_out), (other, out) = results(diagnose, run, write_bag, tmp_path)
    assert same(plain, other)
    assert set(other["channels"]) >= {"front.lift/force", "front.tilt/flow_b"}
    assert coloured(out) == coloured(plain_out) > 20
    found = {(one["target"], one["names"][0]) for one in other["findings"]}
    assert ("front.lift_cylinder", "coulomb_friction") in found
    assert len(load_robot(out / "model.yaml").effects) >= len(found) >= 2


def test_a_joint_without_cylinder_keeps_its_unit() -> None:
    robot = load_robot("emps")
    (joint,) = robot.joints
    for name in ("axis", "axis.x"):
        turns = replace(robot, joints=(replace(joint, name=name, prismatic=False),))
        assert viscous_unit(turns, f"{name}.viscous_friction") == "N m s/rad"
        assert effect_unit(turns, f"{name}.coulomb_friction.force") == "N m"


@pytest.mark.parametrize(
    ("name", "parts"),
    [
        ("command_delay", ("", "", "command_delay")),
        ("a.b.c.viscous_friction", ("a.b.c", "", "viscous_friction")),
        ("a.coulomb_friction.force", ("a", "coulomb_friction", "force")),
        ("coulomb_friction.force", ("", "coulomb_friction", "force")),
        ("a.coulomb_friction.mcx", ("a.coulomb_friction", "", "mcx")),
    ],
)
def test_parameters_are_taken_apart_from_behind(name: str, parts: tuple[str, str, str]) -> None:
    assert parts_of(name) == parts
