"""Base parameters against the numerical rank of the regressor and the paper's Table I."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from hydro_model.multibody.base_parameters import BaseMap, base_map, with_base
from hydro_model.multibody.rigid_body import inverse_dynamics, regressor
from hydro_model.robot import FloatArray, Joint, Robot
from hydro_model.robot_files import load_robot

MakeChain = Callable[..., Robot]
CASES = [(seed, dof) for dof in range(1, 8) for seed in (0, 1, 2)]


def turned(robot: Robot, rotations: list[FloatArray], seed: int) -> Robot:
    """The chain with other joint rotations, all axes and links along coordinate axes."""
    rng = np.random.default_rng([seed, robot.dof])
    joints: list[Joint] = [
        replace(
            joint,
            rotation=rotation,
            axis=np.eye(3)[rng.integers(3)],
            translation_m=np.eye(3)[rng.integers(3)] * rng.choice([0.0, 0.4, 1.0]),
        )
        for joint, rotation in zip(robot.joints, rotations, strict=True)
    ]
    return replace(robot, joints=tuple(joints), gravity_m_s2=np.array([0.0, 0.0, -9.81]))


def right_angled(robot: Robot, seed: int) -> Robot:
    angles = np.random.default_rng([seed, robot.dof]).integers(0, 4, size=(robot.dof, 3))
    rotations = Rotation.from_euler("xyz", angles * np.pi / 2).as_matrix()
    return turned(robot, list(rotations), seed)


def nearly_parallel(robot: Robot, seed: int) -> Robot:
    """All axes within 1e-5 to 0.1 rad of one another, or parallel."""
    rng = np.random.default_rng([seed, robot.dof])
    joints = []
    for joint in robot.joints:
        tilt = rng.choice([0.0, 1.0]) * 10.0 ** rng.uniform(-5.0, -1.0)
        rotation = Rotation.from_rotvec(tilt * rng.normal(size=3)).as_matrix()
        joints.append(replace(joint, rotation=rotation, axis=np.array([0.0, 0.0, 1.0])))
    return replace(robot, joints=tuple(joints))


def random_motion(robot: Robot) -> tuple[FloatArray, FloatArray, FloatArray]:
    q, qd, qdd = np.random.default_rng(robot.dof).uniform(-3.0, 3.0, size=(3, 120, robot.dof))
    return q, qd, qdd


def check(robot: Robot) -> BaseMap:
    found = base_map(robot)
    columns = regressor(robot, *random_motion(robot))
    stacked = columns.reshape(-1, columns.shape[-1])
    sizes = np.linalg.svd(stacked, compute_uv=False)
    assert len(found.names) == np.sum(sizes > 1e-12 * sizes[0])
    assert np.linalg.matrix_rank(stacked[:, found.leading], tol=1e-12 * sizes[0]) == len(
        found.names
    )
    theta = robot.parameter_vector
    torque = columns @ theta
    base = columns[..., found.leading] @ (found.combination @ theta)
    assert np.abs(base - torque).max() < 1e-11 * np.abs(torque).max()
    return found


@pytest.mark.parametrize(("seed", "dof"), CASES)
def test_generic_chains(make_chain: MakeChain, seed: int, dof: int) -> None:
    assert np.abs(check(make_chain(seed, dof)).combination).max() < 100.0


@pytest.mark.parametrize(("seed", "dof"), CASES)
def test_right_angled_chains(make_chain: MakeChain, seed: int, dof: int) -> None:
    assert np.abs(check(right_angled(make_chain(seed, dof), seed)).combination).max() < 100.0


@pytest.mark.parametrize(("seed", "dof"), CASES)
def test_nearly_parallel_chains(make_chain: MakeChain, seed: int, dof: int) -> None:
    found = check(nearly_parallel(make_chain(seed, dof), seed))
    assert np.abs(found.combination).max() < 1e3


def nearly_aligned(robot: Robot, seed: int) -> Robot:
    """Axes tilted by 1e-6 to 0.1 rad against one another, or parallel."""
    rng = np.random.default_rng([7, seed])
    joints = []
    for joint in robot.joints:
        tilt = rng.choice([0.0, 1.0]) * 10.0 ** rng.uniform(-6.0, -1.0)
        rotation = Rotation.from_rotvec(tilt * rng.normal(size=3)).as_matrix()
        joints.append(replace(joint, rotation=rotation, axis=np.array([0.0, 0.0, 1.0])))
    return replace(robot, joints=tuple(joints))


@pytest.mark.parametrize("count", [70, pytest.param(200, marks=pytest.mark.thorough)])
def test_random_robots(make_chain: MakeChain, count: int) -> None:
    """Count and span against the numerical rank; tilts of 1e-6 show by 1e-12, as rounding does."""
    sharp = 0
    for k in range(count):
        robot = make_chain(1000 + k, 1 + k % 7)
        robot = nearly_aligned(robot, k) if k % 2 else robot
        found = base_map(robot)
        assert np.abs(found.combination).max() < 1e3, k
        motion = np.random.default_rng(k).uniform(-3.0, 3.0, size=(3, 60, robot.dof))
        columns = regressor(robot, *motion).reshape(-1, 10 * robot.dof)
        sizes = np.linalg.svd(columns, compute_uv=False) / np.linalg.norm(columns)
        least, most = int(np.sum(sizes > 1e-11)), int(np.sum(sizes > 1e-14))
        assert least <= len(found.names) <= most, k
        sharp += least == most
        torque = columns @ robot.link_inertia.ravel()
        base = columns[:, found.leading] @ (found.combination @ robot.link_inertia.ravel())
        assert np.abs(base - torque).max() < 1e-11 * np.abs(torque).max(), k
    assert sharp > 0.9 * count


@pytest.mark.parametrize(("seed", "dof"), CASES)
def test_a_payload_regroups_with_the_last_link(make_chain: MakeChain, seed: int, dof: int) -> None:
    """The base parameters that it changes are those of a last link that is so much heavier."""
    robot = make_chain(seed, dof)
    body = make_chain(seed + 50, 1).link_inertia[0]
    mass, at_tip = body[0], robot.tip_offset_m
    inertia = np.array([body[[4, 5, 6]], body[[5, 7, 8]], body[[6, 8, 9]]])
    # Steiner from the tip to the joint, by the first moment.
    moment, shift = body[1:4] + mass * at_tip, np.outer(at_tip, body[1:4])
    inertia = inertia + 2.0 * np.trace(shift) * np.eye(3) - shift - shift.T
    inertia += mass * (at_tip @ at_tip * np.eye(3) - np.outer(at_tip, at_tip))
    links = robot.link_inertia.copy()
    links[-1] += [mass, *moment, *inertia[np.triu_indices(3)]]
    loaded = replace(robot, link_inertia=links)
    lumped = base_map(robot, payload=True)
    wanted = base_map(loaded).combination @ links.ravel()
    found = lumped.combination @ np.concatenate([robot.link_inertia.ravel(), body])
    assert np.allclose(found, wanted, rtol=0, atol=1e-10 * np.abs(wanted).max())


def test_a_payload_of_the_crane_shows_four_parameters() -> None:
    found = base_map(load_robot("xs031"), payload=True)
    effect = found.combination[:, -10:]
    shown = [found.standard_names[-10:][k] for k in np.flatnonzero(np.abs(effect).max(axis=0))]
    assert shown == ["payload.mass", "payload.mcx", "payload.mcz", "payload.iyy"]
    assert np.linalg.matrix_rank(effect, tol=1e-9) == 4
    [mass] = [n for n in found.coefficients(0) if "load" in n]
    assert mass == "payload.mass"


@pytest.mark.parametrize(("seed", "dof"), [(0, 2), (1, 4), (2, 7)])
def test_changes_in_the_nullspace_show_on_no_joint(
    make_chain: MakeChain, seed: int, dof: int
) -> None:
    robot = make_chain(seed, dof)
    found = base_map(robot)
    change = np.random.default_rng(seed).normal(size=10 * dof)
    change -= np.linalg.pinv(found.combination) @ (found.combination @ change)
    assert np.linalg.norm(change) > 1.0
    motion = random_motion(robot)
    other = replace(robot, link_inertia=robot.link_inertia + change.reshape(dof, 10))
    torque = inverse_dynamics(robot, *motion)
    assert np.allclose(
        inverse_dynamics(other, *motion), torque, rtol=0, atol=1e-11 * np.abs(torque).max()
    )


def test_what_no_torque_shows_stays_as_it_was(make_chain: MakeChain) -> None:
    """Other base parameters are taken up by the leading ones; a turn of gravity shows the rest."""
    robot = make_chain(1, 2)
    rng = np.random.default_rng(3)
    base = base_map(robot)
    values = base.combination @ robot.parameter_vector + rng.normal(size=len(base.names))
    other = with_base(robot, base, values)
    np.testing.assert_allclose(base.combination @ other.parameter_vector, values, atol=1e-9)
    kept = np.setdiff1d(np.arange(10 * robot.dof), base.leading)
    np.testing.assert_array_equal(other.parameter_vector[kept], robot.parameter_vector[kept])
    # An axis along gravity hides first moments, until the base is tilted.
    upright = replace(
        robot,
        joints=(replace(robot.joints[0], rotation=np.eye(3), axis=np.array([0.0, 0.0, 1.0])),),
        link_inertia=robot.link_inertia[:1],
        gravity_m_s2=np.array([0.0, 0.0, -9.81]),
    )
    shown = base_map(upright)
    again = with_base(upright, shown, 2.0 * (shown.combination @ upright.parameter_vector))
    tilted = replace(again, gravity_m_s2=9.81 * np.array([0.0, np.sin(0.1), -np.cos(0.1)]))
    still = np.zeros((1, 1))
    torque = inverse_dynamics(tilted, still, still, still)[0, 0]
    # About z gravity turns the link by m_x g_y - m_y g_x, held by the opposite torque.
    assert torque == pytest.approx(-robot.link_inertia[0, 1] * 9.81 * np.sin(0.1))


def test_table_one_of_the_paper() -> None:
    robot = replace(load_robot("xs031"), cylinders=())
    found = base_map(robot)
    assert [found.readable(i) for i in range(len(found.names))] == [
        "lift_link.mcx + 1.6 tilt_link.mass",
        "lift_link.mcz",
        "lift_link.iyy + 2.56 tilt_link.mass",
        "tilt_link.mcx",
        "tilt_link.mcz",
        "tilt_link.iyy",
    ]
    assert found.names[0] == "lift_link.mcx"
    assert found.coefficients(0) == pytest.approx({"lift_link.mcx": 1.0, "tilt_link.mass": 1.6})
    table = [1121.4, 4.7, 1738.0, 1095.7, 92.0, 2074.7]
    assert np.allclose(found.combination @ robot.link_inertia.ravel(), table, atol=0.1)


def test_gravity_along_the_first_axis_hides_first_moments() -> None:
    """The crane on its side: nothing pulls on joint 1, so only its inertia shows there."""
    robot = replace(load_robot("xs031"), gravity_m_s2=np.array([0.0, -9.81, 0.0]))
    assert [name for name in base_map(robot).names if name.startswith("lift_l")] == [
        "lift_link.iyy"
    ]
    check(robot)


def test_weightless_prismatic_joint_shows_its_mass_alone(make_chain: MakeChain) -> None:
    robot = replace(make_chain(0, 1, 1.0), gravity_m_s2=np.zeros(3))
    found = check(robot)
    assert found.names == ("link0.mass",)
    assert found.readable(0) == "link0.mass"


def test_a_right_angle_rounded_in_the_urdf_may_count_as_exact() -> None:
    exact = load_robot("xs031")
    slip = Rotation.from_euler("x", 1.5708 - np.pi / 2).as_matrix()
    rounded = replace(
        exact, joints=tuple(replace(j, rotation=j.rotation @ slip) for j in exact.joints)
    )
    names = base_map(exact).names
    assert len(base_map(rounded).names) > len(names)
    assert base_map(rounded, tolerance=1e-4).names == names


@pytest.mark.parametrize("length", [1e-3, 1.0, 30.0])
def test_the_unit_of_length_does_not_matter(make_chain: MakeChain, length: float) -> None:
    robot = make_chain(2, 4)
    joints = tuple(replace(j, translation_m=length * j.translation_m) for j in robot.joints)
    scaled = replace(robot, joints=joints, tip_offset_m=length * robot.tip_offset_m)
    assert len(base_map(scaled).names) == len(base_map(robot).names)
    assert np.abs(base_map(scaled).combination).max() < 1e3
