"""Physically consistent parameters: base parameters kept, bodies that exist, infeasible said."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from hydro_ident.errors import IdentError
from hydro_ident.estimate.bodies.physical import (
    BaseEstimate,
    PhysicalParameters,
    physical_parameters,
    told_distance,
)
from hydro_ident.estimate.bodies.pseudo_inertia import bodies_of
from hydro_ident.identify.consistent_robot import (
    PhysicalResult,
    impossible,
    physical_dict,
    physical_result,
    reference_values,
    with_standard_parameters,
)
from hydro_ident.identify.model_file import write_model
from hydro_ident.identify.urdf_file import write_urdf
from hydro_ident.study.consistency import random_robot, table
from hydro_model.description.urdf import read_chain, standard_parameters
from hydro_model.multibody.base_parameters import base_map, with_base
from hydro_model.multibody.rigid_body import inverse_dynamics
from hydro_model.robot import STANDARD_PARAMETERS, BaseParameter, FloatArray, Robot
from hydro_model.robot_files import datasheet_inertia, load_robot

pytestmark = pytest.mark.needs("clarabel")


def chain(seed: int, dof: int) -> Robot:
    return random_robot(np.random.default_rng([seed, dof]), dof)


def identified(robot: Robot, inertia: FloatArray, std: float | None = None) -> Robot:
    """The robot with the base parameters of some link inertia."""
    found = base_map(robot)
    values = found.combination @ np.append(inertia.ravel(), robot.part_parameters.ravel())
    parameters = tuple(
        BaseParameter(name, found.coefficients(i), float(values[i]))
        for i, name in enumerate(found.names)
    )
    spread = np.zeros(values.size) if std is None else std * np.abs(values).max()
    covariance = np.diag(np.broadcast_to(spread, values.shape) ** 2)
    return replace(robot, base_parameters=parameters, base_covariance=covariance)


def solve(given: Robot, inertia: FloatArray, std: float | None = None) -> PhysicalParameters:
    found = physical_result(identified(given, inertia, std), given).parameters
    assert found is not None
    return found


def links(found: PhysicalParameters) -> FloatArray:
    whole = [b.parameters for b in found.bodies if len(b.parameters) == len(STANDARD_PARAMETERS)]
    return np.array([[one[p] for p in STANDARD_PARAMETERS] for one in whole])


def pseudo_inertia(theta: FloatArray) -> FloatArray:
    """By pinocchio, which orders the inertia xx, xy, yy, xz, yz, zz."""
    order = [0, 1, 2, 3, 4, 5, 7, 6, 8, 9]
    return pin.PseudoInertia.FromDynamicParameters(theta[order]).toMatrix()


def check(robot: Robot, found: PhysicalParameters) -> None:
    """Bodies exist, by pinocchio, and have the base parameters that the result claims."""
    theta = links(found)
    for row in theta:
        assert np.linalg.eigvalsh(pseudo_inertia(row))[0] > 0.0
    base = base_map(robot)
    values = base.combination @ [v for b in found.bodies for v in b.parameters.values()]
    scale = np.abs(found.closest).max()
    assert np.abs(values - found.closest).max() <= 1e-9 * scale
    if found.feasible:
        assert np.array_equal(found.closest, found.identified)


@pytest.mark.parametrize(("seed", "dof"), [(s, d) for d in range(1, 8) for s in range(3)])
def test_random_bodies_give_bodies_with_the_same_base_parameters(seed: int, dof: int) -> None:
    truth = chain(seed, dof)
    other = replace(truth, link_inertia=chain(seed + 50, dof).link_inertia)
    found = solve(other, truth.link_inertia)
    assert found.feasible
    assert found.problems == ()
    check(other, found)
    # Nothing that motion shows has changed.
    q, qd, qdd = np.random.default_rng(seed).normal(size=(3, 20, dof))
    torque = inverse_dynamics(truth, q, qd, qdd)
    again = inverse_dynamics(replace(truth, link_inertia=links(found)), q, qd, qdd)
    assert np.allclose(again, torque, rtol=0.0, atol=1e-9 * np.abs(torque).max())


@pytest.mark.parametrize("dof", [2, 4, 7])
def test_the_given_bodies_come_back_where_the_data_agree_with_them(dof: int) -> None:
    robot = chain(5, dof)
    found = solve(robot, robot.link_inertia)
    assert np.allclose(links(found), robot.link_inertia, rtol=0.0, atol=1e-9)
    assert max(b.divergence for b in found.bodies) < 1e-12


def test_it_is_the_closest_of_all_in_the_stated_metric() -> None:
    truth, other = chain(1, 3), chain(51, 3).link_inertia
    found = solve(replace(truth, link_inertia=other), truth.link_inertia)
    base = base_map(truth)
    null = np.linalg.svd(base.combination)[2][len(base.names) :]

    def divergence(theta: FloatArray) -> float:
        total = 0.0
        for row, given in zip(theta.reshape(-1, 10), other, strict=True):
            ratio = np.linalg.solve(pseudo_inertia(given), pseudo_inertia(row))
            total += float(np.trace(ratio) - np.linalg.slogdet(ratio)[1] - 4.0)
        return total

    best = links(found).ravel()
    assert divergence(best) == pytest.approx(sum(b.divergence for b in found.bodies), rel=1e-9)
    for direction in null:
        slope = (divergence(best + 1e-5 * direction) - divergence(best - 1e-5 * direction)) / 2e-5
        assert abs(slope) < 1e-5
        assert divergence(best + 0.01 * direction) > divergence(best)


def test_without_cad_bodies_are_found_and_the_guess_is_said() -> None:
    truth = chain(2, 4)
    bare = replace(truth, link_inertia=np.zeros((4, 10)))
    result = physical_result(identified(bare, truth.link_inertia), bare)
    assert result.parameters is not None
    assert result.parameters.feasible
    check(bare, result.parameters)
    assert "link0, link1, link2, link3: the given inertia is not that of a body" in result.notes[0]


def test_cad_of_point_masses_is_used_as_far_as_it_goes(robot: Robot) -> None:
    points = robot.link_inertia.copy()
    for row in points:
        row[:] = standard_parameters(row[0], row[1:4] / row[0], np.zeros((3, 3)))
    found = solve(replace(robot, link_inertia=points), robot.link_inertia)
    assert found.feasible
    assert not any(b.given for b in found.bodies[:2])
    check(robot, found)


def test_a_link_of_negative_inertia_is_named(robot: Robot) -> None:
    inertia = robot.link_inertia.copy()
    inertia[1, 7] = -60.0
    result = physical_result(identified(robot, inertia, 0.01), robot)
    found = result.parameters
    assert found is not None
    assert not found.feasible
    assert found.problems[0].bodies == ("tilt_link",)
    assert found.problems[0].base_parameters == ("tilt_link.iyy",)
    # From -60 to 0 in deviations of 1 % of the largest parameter, all else being free.
    sigma = 0.01 * np.abs(found.identified).max()
    assert found.problems[0].standard_deviations == pytest.approx(60.0 / sigma, rel=0.1)
    assert (
        "no physically consistent tilt_link has the identified tilt_link.iyy"
        in (result.problems[0])
    )
    assert "not used" in result.problems[-1]
    check(robot, found)
    assert found.closest[5] > 0.0


@pytest.mark.parametrize(("seed", "dof"), [(1, 3), (2, 5), (0, 7)])
def test_the_last_link_of_a_chain_is_named(seed: int, dof: int) -> None:
    truth = chain(seed, dof)
    inertia = truth.link_inertia.copy()
    inertia[-1, 4:] *= -1.0
    found = solve(truth, inertia, 1e-3)
    assert not found.feasible
    assert f"link{dof - 1}" in {name for p in found.problems for name in p.bodies}
    assert found.distance > 2.0
    check(truth, found)
    # The closest base parameters are feasible themselves.
    again = solve(truth, links(found), 1e-3)
    assert again.distance < 1e-2


def test_links_that_cannot_exist_together_are_named_together(robot: Robot) -> None:
    """iyy of the lift link with 2.56 times the tilt link's mass leaves no room for that mass."""
    values = identified(robot, robot.link_inertia, 0.01)
    parameters = list(values.base_parameters)
    parameters[2] = replace(parameters[2], value=100.0)
    found = physical_result(replace(values, base_parameters=tuple(parameters)), robot).parameters
    assert found is not None
    assert [p.bodies for p in found.problems] == [("lift_link", "tilt_link")]
    check(robot, found)


def test_noise_makes_base_parameters_infeasible_by_no_more_than_its_size() -> None:
    truth = chain(3, 5)
    rng = np.random.default_rng(8)
    seen = set()
    for std in (1e-5, 1e-5, 1e-3, 1e-2, 0.05, 0.2):
        given = identified(truth, truth.link_inertia, std)
        assert given.base_covariance is not None
        sigma = np.sqrt(np.diag(given.base_covariance))
        draw = rng.normal(size=sigma.size)
        noisy = tuple(
            replace(p, value=p.value + s * e)
            for p, s, e in zip(given.base_parameters, sigma, draw, strict=True)
        )
        found = physical_result(replace(given, base_parameters=noisy), truth).parameters
        assert found is not None
        check(truth, found)
        seen.add(found.feasible)
        # The truth is feasible and this far away; the closest cannot be farther.
        assert found.distance <= float(np.linalg.norm(draw)) * (1.0 + 1e-6)
        assert impossible(PhysicalResult(found, (), ())) == ""
    assert seen == {True, False}


def test_the_same_input_gives_the_same_numbers() -> None:
    truth = chain(4, 5)
    inertia = truth.link_inertia.copy()
    inertia[-1, 4:] *= -1.0
    for given in (truth.link_inertia * 1.01, inertia):
        first, second = solve(truth, given, 0.01), solve(truth, given, 0.01)
        assert np.array_equal(links(first), links(second))
    # Where bodies exist, rounding of the input stays rounding of the result.
    first = solve(truth, truth.link_inertia * 1.01)
    moved = solve(truth, truth.link_inertia * (1.01 + 1e-13))
    assert np.allclose(links(first), links(moved), rtol=1e-9, atol=1e-9)


def test_barrels_and_rods_are_bodies_too(robot: Robot) -> None:
    start = identified(robot, robot.link_inertia, 1e-4)
    found = physical_result(start, robot).parameters
    assert found is not None
    assert found.feasible
    assert [b.name for b in found.bodies[2:4]] == ["lift_cylinder_barrel", "lift_cylinder_rod"]
    theta = [v for b in found.bodies for v in b.parameters.values()]
    assert np.allclose(theta, robot.parameter_vector, rtol=1e-9, atol=1e-9)
    rows = tuple(
        replace(row, value=-20.0) if row.name == "tilt_cylinder_barrel.izz" else row
        for row in start.base_parameters
    )
    found = physical_result(replace(start, base_parameters=rows), robot).parameters
    assert found is not None
    assert not found.feasible
    named = {name for problem in found.problems for name in problem.bodies}
    assert named <= {"tilt_cylinder_barrel", "tilt_cylinder_rod", "lift_link", "tilt_link"}
    assert "tilt_cylinder_barrel" in named


def test_cylinders_without_described_parts_have_no_bodies(robot: Robot) -> None:
    bare = replace(
        robot,
        cylinders=tuple(
            replace(c, barrel=None, rod=None if i == 0 else c.rod)
            for i, c in enumerate(robot.cylinders)
        ),
    )
    found = solve(bare, robot.link_inertia, 1e-4)
    assert found.feasible
    names = [b.name for b in found.bodies]
    assert names[:2] == ["lift_link", "tilt_link"]
    assert "lift_cylinder_rod" not in names
    assert "tilt_cylinder_rod" in names


def test_a_body_of_unknown_parameters_is_refused() -> None:
    with pytest.raises(IdentError, match=r"body 'rod'.*found mass, mcx, ixx, iyy"):
        bodies_of(["rod.mass", "rod.mcx", "rod.ixx", "rod.iyy"], np.ones(4), 1.0)
    estimate = BaseEstimate(("a.mass",), np.eye(1), np.ones(1), np.zeros((1, 1)))
    with pytest.raises(IdentError, match="first moments and one inertia"):
        physical_parameters(["a.mass"], np.ones(1), estimate, 1.0)


def test_a_base_parameter_of_an_unknown_link_is_said_not_raised(robot: Robot) -> None:
    start = identified(robot, robot.link_inertia)
    rows = (BaseParameter("hook.mass", {"hook.mass": 1.0}, 3.0), *start.base_parameters[1:])
    result = physical_result(replace(start, base_parameters=rows), robot)
    assert result.parameters is None
    assert result.problems == (
        "physically consistent parameters were not found: no given value for hook.mass",
    )
    data = physical_dict(result)
    assert data is not None
    assert data["feasible"] is None
    assert data["links"] == {}


def test_model_file_and_urdf_carry_them_and_dynamics_do_not_change(
    robot: Robot, tmp_path: Path
) -> None:
    heavier = robot.link_inertia * np.array([[0.9], [1.1]])
    model = identified(robot, heavier, 0.01)
    base = base_map(robot)
    values = np.array([p.value for p in model.base_parameters])
    # Like what is identified: what no torque shows is the description's.
    model = replace(with_base(robot, base, values), base_parameters=model.base_parameters)
    result = physical_result(model, robot)
    assert result.parameters is not None
    model = with_standard_parameters(model, result.parameters)
    write_model(model, tmp_path / "model.yaml")
    assert write_urdf(model, tmp_path / "identified.urdf")
    again = load_robot(tmp_path / "model.yaml")
    assert again.standard_parameters == model.standard_parameters
    assert np.array_equal(again.link_inertia, model.link_inertia)
    # A later identification stays close to these, not to the leading parameters of the model.
    kept = {name: model.standard_parameters[name] for name in robot.standard_names}
    assert reference_values(again) == kept
    assert np.array_equal(datasheet_inertia(again), robot.link_inertia)
    told = read_chain(tmp_path / "identified.urdf", robot.tip_link).link_inertia
    assert np.allclose(told, links(result.parameters), rtol=1e-12, atol=1e-9)
    q, qd, qdd = np.random.default_rng(1).normal(size=(3, 30, 2))
    torque = inverse_dynamics(again, q, qd, qdd)
    bodies = replace(robot, link_inertia=told)
    parts = [again.standard_parameters[name] for name in robot.part_names]
    bodies = replace(bodies, part_inertia=np.reshape(parts, (-1, 3)))
    again_by_bodies = inverse_dynamics(bodies, q, qd, qdd)
    assert np.allclose(again_by_bodies, torque, rtol=0.0, atol=1e-9 * np.abs(torque).max())


def test_infeasible_values_enter_no_file(robot: Robot, tmp_path: Path) -> None:
    inertia = robot.link_inertia.copy()
    inertia[1, 7] = -60.0
    model = identified(robot, inertia, 0.01)
    result = physical_result(model, robot)
    model = with_standard_parameters(model, result.parameters)
    assert not model.standard_parameters
    assert not write_urdf(model, tmp_path / "identified.urdf")
    data = physical_dict(result)
    assert data is not None
    assert data["feasible"] is False
    assert data["infeasible"][0]["links"] == ["tilt_link"]
    assert data["closest"]["base_parameters"]["tilt_link.iyy"] > 0.0
    assert model.base_parameters[5].value < -59.0


@pytest.mark.parametrize("kind", ["fixed", "continuous"])
def test_urdf_lumps_links_beside_the_chain(tmp_path: Path, robot: Robot, kind: str) -> None:
    assert robot.urdf is not None
    tool = f"""<link name="tool"><inertial><origin xyz="0.1 0 0"/><mass value="50"/>
      <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
      <joint name="grip" type="{kind}"><parent link="tip_link"/><child link="tool"/>
      <origin xyz="0.2 0 0" rpy="0 0.3 0"/></joint></robot>"""
    file = tmp_path / "tooled.urdf"
    file.write_text(robot.urdf.read_text().replace("</robot>", tool))
    lumped = read_chain(file, "tip_link").link_inertia
    tooled = replace(robot, urdf=file, link_inertia=lumped)
    model = with_standard_parameters(
        identified(tooled, lumped), physical_result(identified(tooled, lumped), tooled).parameters
    )
    assert write_urdf(model, tmp_path / "identified.urdf")
    told = read_chain(tmp_path / "identified.urdf", "tip_link").link_inertia
    assert np.allclose(told, lumped, rtol=1e-9, atol=1e-7)
    assert not write_urdf(model, file)


def test_the_study_finds_every_exact_machine_consistent() -> None:
    lines = table(1, 3)
    assert len(lines) == 1 + 7 * 4
    exact = [line for line in lines if "  0e+00  " in line]
    assert len(exact) == 7
    assert all("1 /   1" in line for line in exact)


def test_a_distance_that_rounds_to_nothing_is_told_as_small() -> None:
    assert told_distance(0.02) == "less than 0.1 standard deviations"
    assert told_distance(0.06) == "0.1 standard deviations"
    assert told_distance(3.14) == "3.1 standard deviations"
