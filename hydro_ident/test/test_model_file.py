"""Model files: what is written reads back as the same robot."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from hydro_ident.commands import nominal
from hydro_ident.errors import IdentError
from hydro_ident.identify.controller_file import controller_text
from hydro_ident.identify.identified_robot import with_edge_coefficient, with_viscous_friction
from hydro_ident.identify.model_file import write_model
from hydro_ident.parameters.model_statistics import Statistics, read_statistics
from hydro_model.errors import RobotError
from hydro_model.multibody.base_parameters import base_map, with_base
from hydro_model.multibody.rigid_body import inverse_dynamics
from hydro_model.robot import BaseParameter, EffectSpec, Robot
from hydro_model.robot_files import load_robot

SLIDER = """<robot name="slider">
<link name="rail"/><link name="cart"><inertial><mass value="95.1"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="slide" type="prismatic"><parent link="rail"/><child link="cart"/>
<axis xyz="1 0 0"/><limit lower="0" upper="0.4" effort="1000" velocity="1"/></joint></robot>
"""


def _plain(robot: Robot) -> dict[str, object]:
    """What can be compared by == and does not depend on where the robot was read from."""
    names = (
        *("name", "tip_link", "cylinders", "valves", "sensors", "effects", "base_parameters"),
        *("supply_pressure_pa", "tank_pressure_pa", "atmospheric_pressure_pa", "command_delay_s"),
    )
    return {name: getattr(robot, name) for name in names}


def _identified(robot: Robot) -> Robot:
    base = base_map(robot)
    values = base.combination @ robot.parameter_vector * 1.0123456789
    return replace(
        with_base(robot, base, values),
        base_parameters=tuple(
            BaseParameter(name, base.coefficients(i), float(values[i]))
            for i, name in enumerate(base.names)
        ),
        base_covariance=np.diag(values**2) * 1e-5 / 3.0,
        command_delay_s=0.00137,
        effects=(EffectSpec("coulomb_friction", "lift_cylinder", {"force": 1e-7 / 3.0}),),
    )


def test_an_identified_robot_reads_back_bit_for_bit(robot: Robot, tmp_path: Path) -> None:
    wanted = _identified(robot)
    write_model(wanted, tmp_path / "model.yaml", {"command": "identify x"})
    read = load_robot(tmp_path / "model.yaml")
    assert _plain(read) == _plain(wanted)
    for name in (
        "link_inertia",
        "part_inertia",
        "base_covariance",
        "gravity_m_s2",
        "tip_offset_m",
    ):
        assert np.array_equal(getattr(read, name), getattr(wanted, name)), name
    q, qd, qdd = np.random.default_rng(0).normal(size=(3, 50, 2))
    assert np.array_equal(inverse_dynamics(read, q, qd, qdd), inverse_dynamics(wanted, q, qd, qdd))
    data = yaml.safe_load((tmp_path / "model.yaml").read_text())
    assert data["schema"] == "hydro_model/model/1"
    assert data["provenance"] == {"command": "identify x"}
    assert (tmp_path / "xs031.urdf").is_file()


def test_a_model_of_a_model_is_the_same_model(robot: Robot, tmp_path: Path) -> None:
    write_model(_identified(robot), tmp_path / "model.yaml")
    once = (tmp_path / "model.yaml").read_text()
    write_model(load_robot(tmp_path / "model.yaml"), tmp_path / "model.yaml")
    assert (tmp_path / "model.yaml").read_text() == once


def test_statistics_for_later_comparisons_read_back(robot: Robot, tmp_path: Path) -> None:
    wanted = _identified(robot)
    size = len(wanted.base_parameters)
    error = np.diag(np.arange(1.0, size + 1.0)) / 3.0
    given = Statistics({"tilt_link.mcx": 7.0 / 3.0}, {"lift_valve.c_pa": 1e-8 / 3.0}, error)
    origin = {"bags": [{"name": "run", "sha256": "00ff"}]}
    write_model(wanted, tmp_path / "model.yaml", origin, given)
    read = read_statistics(tmp_path / "model.yaml")
    assert (read.dof, read.model_error) == (given.dof, given.model_error)
    assert np.array_equal(read.base_model_error, error)
    assert read.bags == {"00ff": "run"}
    assert _plain(load_robot(tmp_path / "model.yaml")) == _plain(wanted)
    datasheet = read_statistics(robot.source)
    assert (datasheet.dof, datasheet.model_error, datasheet.bags) == ({}, {}, {})


def test_coefficients_show_no_rounding_errors(robot: Robot) -> None:
    base = base_map(robot)
    written = [v for i in range(len(base.names)) for v in base.coefficients(i).values()]
    assert 1.6 in written
    assert all(len(repr(abs(v)).replace(".", "").strip("0")) <= 16 for v in written)
    for i, row in enumerate(base.combination):
        exact = {n: row[base.standard_names.index(n)] for n in base.coefficients(i)}
        assert base.coefficients(i) == pytest.approx(exact, rel=1e-11)


def test_a_datasheet_robot_keeps_the_inertia_of_its_urdf(robot: Robot, tmp_path: Path) -> None:
    friction = {"lift_cylinder": 3.9e4, "tilt_cylinder": 7.7e4}
    wanted = with_edge_coefficient(with_viscous_friction(robot, friction), 6.30e-7)
    write_model(wanted, tmp_path / "nominal.yaml")
    read = load_robot(tmp_path / "nominal.yaml")
    assert np.array_equal(read.link_inertia, robot.link_inertia)
    assert [c.viscous_friction for c in read.cylinders] == [3.9e4, 7.7e4]
    assert {v.c_pa for v in read.valves} == {v.c_bt for v in read.valves} == {6.30e-7}
    assert read.base_parameters == ()


def test_the_nominal_command_says_what_it_borrowed(
    robot: Robot, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    friction = {"lift_cylinder": 3.9e4, "tilt_cylinder": 7.7e4}
    write_model(with_viscous_friction(robot, friction), tmp_path / "model.yaml")
    out = tmp_path / "nominal.yaml"
    words = ["--robot", robot.name, "--friction-from", str(tmp_path / "model.yaml")]
    words += ["--edge-coefficient", "6.3e-7", "--out", str(out)]
    assert nominal.run([*words, "--json", "-"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert (told["files"], told["robot"]) == ([str(out)], robot.name)
    assert (told["viscous_friction_ns_m"], told["edge_coefficient"]) == (friction, 6.3e-7)
    assert {c.name: c.viscous_friction for c in load_robot(out).cylinders} == friction
    with pytest.raises(IdentError, match="already there"):
        nominal.run(words)


def test_a_cylinder_directly_on_a_slide_keeps_its_form(tmp_path: Path) -> None:
    (tmp_path / "slider.urdf").write_text(SLIDER)
    (tmp_path / "slider.yaml").write_text(
        "robot: slider\nurdf: slider.urdf\ntip_link: cart\ncylinders:\n"
        "  - {name: ram, joint: slide, bore_m: 0.05, rod_m: 0.03, stroke_m: 0.5, x0_m: -0.05}\n"
    )
    given = load_robot(tmp_path / "slider.yaml")
    (tmp_path / "out").mkdir()
    write_model(given, tmp_path / "out" / "model.yaml")
    assert _plain(load_robot(tmp_path / "out" / "model.yaml")) == _plain(given)


def test_friction_of_an_unknown_cylinder_is_refused(robot: Robot) -> None:
    with pytest.raises(RobotError, match="no cylinder 'boom'"):
        with_viscous_friction(robot, {"boom": 1.0})


def test_a_robot_without_files_cannot_be_written(robot: Robot, tmp_path: Path) -> None:
    with pytest.raises(IdentError, match="has no URDF file"):
        write_model(replace(robot, urdf=None), tmp_path / "model.yaml")
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_is_not_there_is_one_line(robot: Robot, tmp_path: Path) -> None:
    with pytest.raises(IdentError, match="cannot be written"):
        write_model(robot, tmp_path / "absent" / "model.yaml")


def test_the_controller_file_names_the_model_and_the_gains(tmp_path: Path) -> None:
    from hydro_control.node.parameters import PARAMETERS

    text = controller_text(tmp_path / "model.yaml")
    assert "# Gains are the package's defaults" in text
    data = yaml.safe_load(text)
    given = data["controller"]["ros__parameters"]
    assert given["robot"] == str(tmp_path / "model.yaml")
    assert set(given) <= {p.name for p in PARAMETERS}
    assert all(isinstance(v, float) for k, v in given.items() if k != "robot")


@pytest.mark.parametrize("coefficient", ["11.95", "0", "nan"])
def test_an_edge_coefficient_in_another_unit_is_refused(
    coefficient: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture,
) -> None:
    out = tmp_path / "nominal.yaml"
    arguments = ["--robot", "xs031", "--friction-from", "xs031", "--out", str(out)]
    monkeypatch.setattr("sys.argv", ["nominal", *arguments, "--edge-coefficient", coefficient])
    assert nominal.main() == 2
    assert "one in l/(min sqrt(bar))" in capsys.readouterr().err
    assert not out.exists()
    monkeypatch.setattr("sys.argv", ["nominal", *arguments, "--edge-coefficient", "6.3e-7"])
    assert nominal.main() == 0
    assert load_robot(out).valves[0].c_pa == 6.3e-7
