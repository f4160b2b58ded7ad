"""From measured pins to a robot file: the pins come out where they were measured."""

from __future__ import annotations

import resource
from pathlib import Path

import numpy as np
import pytest

from hydro_model.hydraulics.cylinder import stroke
from hydro_model.new_robot import main
from hydro_model.robot_files import load_robot

URDF = """<robot name="crane">
  <link name="base"/>
  <joint name="lift" type="revolute">
    <parent link="base"/><child link="boom"/><axis xyz="0 -1 0"/>
    <limit lower="-0.2" upper="1.0" effort="40000" velocity="0.8"/>
  </joint>
  <link name="boom"><inertial><mass value="180"/><origin xyz="1.2 0 0"/>
    <inertia ixx="3" iyy="95" izz="95" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="end" type="fixed"><parent link="boom"/><child link="tip"/>
    <origin xyz="2 0 0"/></joint>
  <link name="tip"/>
</robot>
"""
PARENT, CHILD, CLOSED = (0.30, -0.95), (0.80, -0.08), 0.83
REST = ["--tip", "tip", "--valve", "60", "35", "--supply", "180"]
CYLINDER = ["lift", *map(str, (*PARENT, *CHILD, 0.08, 0.045, 0.8, CLOSED))]


@pytest.fixture
def urdf(tmp_path: Path) -> Path:
    path = tmp_path / "crane.urdf"
    path.write_text(URDF, encoding="utf-8")
    return path


def run(urdf: Path, *cylinder: str) -> int:
    return main([str(urdf), *REST, "--cylinder", *cylinder])


def test_the_stroke_is_the_distance_of_the_measured_pins(urdf: Path) -> None:
    assert run(urdf, *CYLINDER) == 0
    robot = load_robot(urdf.with_suffix(".hydraulics.yaml"))
    for q in (-0.2, 0.0, 0.7):
        turn = np.array([[np.cos(q), -np.sin(q)], [np.sin(q), np.cos(q)]])
        apart = np.linalg.norm(turn @ np.array(CHILD) - np.array(PARENT))
        assert stroke(robot.cylinders[0], q) == pytest.approx(apart - CLOSED, abs=2e-5)
    assert robot.valves[0].c_pa == pytest.approx(60e-3 / 60 / np.sqrt(35e5), rel=1e-3)
    assert robot.supply_pressure_pa == 18e6


def test_what_was_not_given_is_not_stated(urdf: Path) -> None:
    """What the file leaves out is what `check_robot` asks for."""
    assert run(urdf, *CYLINDER) == 0
    text = urdf.with_suffix(".hydraulics.yaml").read_text(encoding="utf-8")
    assert "rated_voltage_v" not in text
    assert "rate_hz" not in text


def test_what_was_given_is_stated(urdf: Path) -> None:
    given = ["--rated-voltage", "5", "--rate", "1000", "--cylinder", *CYLINDER]
    assert main([str(urdf), *REST, *given]) == 0
    robot = load_robot(urdf.with_suffix(".hydraulics.yaml"))
    assert robot.valves[0].rated_voltage_v == 5.0
    assert robot.sensors.rate_hz == 1000.0


@pytest.mark.parametrize("option", ["--rated-voltage", "--rate", "--pressure-range"])
@pytest.mark.parametrize("value", ["0", "-5", "nan", "inf"])
def test_options_are_numbers_above_0(
    urdf: Path, option: str, value: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([str(urdf), *REST, option, value, "--cylinder", *CYLINDER]) == 2
    assert f"{option}: expected a number above 0, found {value}" in capsys.readouterr().err
    assert not urdf.with_suffix(".hydraulics.yaml").exists()


def test_a_supply_beyond_the_usual_sensors_needs_their_range(
    urdf: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """250 bar are the default range: a sensor at its end would read what it cannot."""
    high = [*REST[:-1], "320", "--cylinder", *CYLINDER]
    assert main([str(urdf), *high]) == 2
    said = capsys.readouterr().err
    assert "--supply: 320 bar" in said
    assert "250 bar" in said
    assert "--pressure-range" in said
    assert main([str(urdf), *high, "--pressure-range", "400"]) == 0
    assert load_robot(urdf.with_suffix(".hydraulics.yaml")).sensors.pressure_range_pa == 40e6


@pytest.mark.parametrize(
    ("cylinder", "said"),
    [
        (["slew", *CYLINDER[1:]], "slew"),
        (["lift", "wide", *CYLINDER[2:]], "'wide'"),
    ],
)
def test_what_does_not_fit_leaves_no_file(
    urdf: Path, cylinder: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(urdf, *cylinder) == 2
    assert said in capsys.readouterr().err
    assert not urdf.with_suffix(".hydraulics.yaml").exists()


def test_nothing_is_overwritten(urdf: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(urdf, *CYLINDER) == 0
    assert run(urdf, *CYLINDER) == 2
    assert "already" in capsys.readouterr().err
    before = urdf.with_suffix(".hydraulics.yaml").read_text(encoding="utf-8")
    assert main([str(urdf), *REST, "--force", "--cylinder", "slew", *CYLINDER[1:]]) == 2
    assert urdf.with_suffix(".hydraulics.yaml").read_text(encoding="utf-8") == before
    assert sorted(p.name for p in urdf.parent.iterdir()) == ["crane.hydraulics.yaml", "crane.urdf"]


def test_force_replaces_the_file(urdf: Path) -> None:
    assert run(urdf, *CYLINDER[:5], "0.08", "0.04", *CYLINDER[7:]) == 0
    assert main([str(urdf), *REST, "--force", "--cylinder", *CYLINDER]) == 0
    assert load_robot(urdf.with_suffix(".hydraulics.yaml")).cylinders[0].rod_m == 0.045


TWO = URDF.replace(
    '<joint name="end" type="fixed"><parent link="boom"/>',
    """<joint name="tilt" type="revolute">
    <parent link="boom"/><child link="arm"/><origin xyz="2 0 0"/><axis xyz="0 -1 0"/>
    <limit lower="-0.2" upper="1.0" effort="40000" velocity="0.8"/>
  </joint>
  <link name="arm"><inertial><mass value="80"/><origin xyz="0.6 0 0"/>
    <inertia ixx="1" iyy="20" izz="20" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="end" type="fixed"><parent link="arm"/>""",
)
BOTH = ["--cylinder", *CYLINDER, "--cylinder", "tilt", *CYLINDER[1:]]


@pytest.mark.parametrize(
    ("valves", "flows_l_min"),
    [([("60", "35")], (60, 60)), ([("60", "35"), ("40", "35")], (60, 40))],
)
def test_valves_are_one_for_all_or_one_for_each(
    urdf: Path, valves: list[tuple[str, str]], flows_l_min: tuple[float, float]
) -> None:
    urdf.write_text(TWO, encoding="utf-8")
    given = [word for valve in valves for word in ("--valve", *valve)]
    assert main([str(urdf), "--tip", "tip", "--supply", "180", *given, *BOTH]) == 0
    robot = load_robot(urdf.with_suffix(".hydraulics.yaml"))
    assert [v.name for v in robot.valves] == ["lift_valve", "tilt_valve"]
    for valve, flow in zip(robot.valves, flows_l_min, strict=True):
        assert valve.c_bt == pytest.approx(flow * 1e-3 / 60 / np.sqrt(35e5), rel=1e-3)


@pytest.mark.parametrize(
    ("valves", "said"),
    [
        (["60 35"] * 3, "expected one for all or one for each of the 2 cylinders, found 3"),
        (["60 35", "40 0"], "expected numbers above 0, found 40 0"),
    ],
)
def test_valves_that_do_not_fit_leave_no_file(
    urdf: Path, valves: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    urdf.write_text(TWO, encoding="utf-8")
    given = [word for valve in valves for word in ("--valve", *valve.split())]
    assert main([str(urdf), "--tip", "tip", "--supply", "180", *given, *BOTH]) == 2
    assert said in capsys.readouterr().err
    assert not urdf.with_suffix(".hydraulics.yaml").exists()


def test_a_folder_that_cannot_be_written_is_one_line(
    urdf: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Of a description as it was installed: no user may write beside it."""
    urdf.write_text(TWO, encoding="utf-8")
    given = ["--valve", "60", "35"]
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (0, hard))
    try:
        assert main([str(urdf), "--tip", "tip", "--supply", "180", *given, *BOTH]) == 2
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    said = capsys.readouterr().err
    assert "cannot be written" in said
    assert said.count("\n") == 1
    assert [file.name for file in urdf.parent.iterdir()] == [urdf.name]


TELESCOPE = URDF.replace(
    '<joint name="end" type="fixed"><parent link="boom"/>',
    """<joint name="slide" type="prismatic">
    <parent link="boom"/><child link="tube"/><origin xyz="1 0 0"/><axis xyz="1 0 0"/>
    <limit lower="0.05" upper="0.85" effort="40000" velocity="0.8"/>
  </joint>
  <link name="tube"><inertial><mass value="80"/><origin xyz="0.6 0 0"/>
    <inertia ixx="1" iyy="20" izz="20" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="end" type="fixed"><parent link="tube"/>""",
)


def test_a_cylinder_along_a_joint_that_slides_has_no_triangle(urdf: Path) -> None:
    """Pins 1.2 m apart at q = 0 and 1.15 m with the rod fully in: in at q = -0.05 m."""
    urdf.write_text(TELESCOPE, encoding="utf-8")
    along = ["slide", "-0.9", "0.1", "0.3", "0.11", "0.06", "0.035", "0.95", "1.15"]
    assert main([str(urdf), *REST, "--cylinder", *CYLINDER, "--cylinder", *along]) == 0
    _, ram = load_robot(urdf.with_suffix(".hydraulics.yaml")).cylinders
    assert (ram.l1_m, ram.x0_m) == (0.0, pytest.approx(-0.05))
    assert stroke(ram, 0.3) == pytest.approx(0.35)


@pytest.mark.parametrize("pins", [("0.3", "0.1", "-0.9", "0.1"), ("-0.9", "0.1", "0.3", "0.2")])
def test_a_cylinder_askew_to_a_joint_that_slides_leaves_no_file(
    urdf: Path, pins: tuple[str, ...], capsys: pytest.CaptureFixture[str]
) -> None:
    urdf.write_text(TELESCOPE, encoding="utf-8")
    askew = ["slide", *pins, "0.06", "0.035", "0.95", "1.15"]
    assert run(urdf, *askew) == 2
    assert "expected the cylinder along it, CX above PX and CY as PY" in capsys.readouterr().err
    assert not urdf.with_suffix(".hydraulics.yaml").exists()
