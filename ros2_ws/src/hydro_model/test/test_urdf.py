"""The chain of a URDF: fixed joints lumped, orientations, and what is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio
import pytest
from scipy.spatial.transform import Rotation

from hydro_model.description.urdf import Chain, SideBranch, read_chain
from hydro_model.errors import RobotError
from hydro_model.multibody.rigid_body import inverse_dynamics
from hydro_model.multibody.spatial import from_roll_pitch_yaw
from hydro_model.robot import Robot

INERTIAL = """<inertial><origin xyz="{xyz}" rpy="{rpy}"/><mass value="{mass}"/>
  <inertia ixx="0.5" ixy="0.02" ixz="-0.03" iyy="0.6" iyz="0.04" izz="0.7"/></inertial>"""
LIMIT = '<limit lower="-1" upper="1" effort="10" velocity="2"/>'


def link(
    name: str, mass: float = 3.0, xyz: str = "0.1 -0.2 0.3", rpy: str = "0.4 0.5 -0.6"
) -> str:
    inertial = INERTIAL.format(xyz=xyz, rpy=rpy, mass=mass) if mass else ""
    return f'<link name="{name}">{inertial}</link>'


def joint(
    name: str,
    parent: str,
    child: str,
    kind: str = "revolute",
    xyz: str = "0.3 0.1 -0.2",
    rpy: str = "0.3 -0.7 1.1",
    axis: str = '<axis xyz="0.2 -0.4 0.5"/>',
    limit: str = LIMIT,
) -> str:
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{xyz}" rpy="{rpy}"/>{axis}{limit}</joint>'
    )


def written(folder: Path, *parts: str) -> Path:
    path = folder / "robot.urdf"
    path.write_text(f'<robot name="r">{"".join(parts)}</robot>', encoding="utf-8")
    return path


def fixed(name: str, parent: str, child: str) -> str:
    return joint(name, parent, child, "fixed", axis="", limit="")


def as_robot(chain: Chain) -> Robot:
    return Robot(
        "r", chain.joints, chain.link_inertia, "tip", chain.tip_offset_m,
        np.array([0.0, 0.0, -9.81]), (), (),
    )  # fmt: skip


def test_fixed_joints_lump_as_in_pinocchio(tmp_path: Path) -> None:
    """A fixed pedestal, a fixed attachment on a branch of two, and a fixed tip."""
    path = written(
        tmp_path,
        *(link(name) for name in ("world", "pedestal", "boom", "box", "lid", "arm", "flange")),
        link("tip", 0.0),
        fixed("f0", "world", "pedestal"),
        joint("j1", "pedestal", "boom"),
        fixed("f1", "boom", "box"),
        fixed("f2", "box", "lid"),
        joint("j2", "boom", "arm", "prismatic"),
        fixed("f3", "arm", "flange"),
        fixed("f4", "flange", "tip"),
    )
    robot = as_robot(read_chain(path, "tip"))
    model = pinocchio.buildModelFromUrdf(str(path))
    data = model.createData()
    assert robot.joint_names == ("j1", "j2")
    assert robot.link_names == ("boom", "arm")
    for q, qd, qdd in np.random.default_rng(0).uniform(-1.0, 1.0, size=(10, 3, 2)):
        torque = pinocchio.rnea(model, data, q, qd, qdd)
        assert np.allclose(inverse_dynamics(robot, q, qd, qdd), torque, rtol=0, atol=1e-10)
    pinocchio.framesForwardKinematics(model, data, np.zeros(2))
    at = data.oMf[model.getFrameId("tip")].translation
    along = np.zeros(3)
    for j in reversed(robot.joints):
        start = robot.tip_offset_m if j is robot.joints[-1] else along
        along = j.translation_m + j.rotation @ start
    assert np.allclose(along, at, atol=1e-12)


@pytest.mark.parametrize(
    ("rpy", "x", "y"),
    [
        ("1.5707963267948966 0 0", [1, 0, 0], [0, 0, 1]),
        ("0 1.5707963267948966 0", [0, 0, -1], [0, 1, 0]),
        ("0 0 1.5707963267948966", [0, 1, 0], [-1, 0, 0]),
        # Roll first, then pitch, then yaw about the fixed axes (REP-103 and URDF).
        ("1.5707963267948966 1.5707963267948966 0", [0, 0, -1], [1, 0, 0]),
        ("1.5707963267948966 0 1.5707963267948966", [0, 1, 0], [0, 0, 1]),
    ],
)
def test_orientation_is_fixed_axis_roll_pitch_yaw(
    tmp_path: Path, rpy: str, x: list[float], y: list[float]
) -> None:
    path = written(tmp_path, link("base"), link("arm"), joint("j", "base", "arm", rpy=rpy))
    rotation = read_chain(path, "arm").joints[0].rotation
    assert np.allclose(rotation[:, 0], x, atol=1e-12)
    assert np.allclose(rotation[:, 1], y, atol=1e-12)


def test_axis_is_normalised_and_defaults_to_x(tmp_path: Path) -> None:
    path = written(
        tmp_path,
        *(link(name) for name in ("base", "a", "b")),
        joint("j1", "base", "a", axis='<axis xyz="0 -3 4"/>'),
        joint("j2", "a", "b", "continuous", axis="", limit=""),
    )
    first, second = read_chain(path, "b").joints
    assert np.allclose(first.axis, [0.0, -0.6, 0.8])
    assert np.allclose(second.axis, [1.0, 0.0, 0.0])
    assert (first.lower, first.upper) == (-1.0, 1.0)
    assert (second.lower, second.upper) == (-np.inf, np.inf)


@pytest.mark.parametrize("kind", ["revolute", "continuous", "prismatic"])
def test_what_moves_beside_the_chain_counts_as_fixed_at_position_0(
    tmp_path: Path, kind: str
) -> None:
    """A jaw behind a fixed bracket, with a tooth that moves on it; and links beyond the tip."""

    def chain(kind: str) -> Chain:
        free = {"limit": "", "axis": ""} if kind == "fixed" else {}
        path = written(
            tmp_path,
            *(link(name) for name in ("base", "boom", "bracket", "jaw", "tooth", "arm", "beyond")),
            joint("j1", "base", "boom"),
            fixed("f1", "boom", "bracket"),
            joint("grip", "bracket", "jaw", kind, **free),
            joint("bite", "jaw", "tooth", kind, **free),
            joint("j2", "boom", "arm"),
            joint("j3", "arm", "beyond", kind, **free),
        )
        return read_chain(path, "arm")

    moving, still = chain(kind), chain("fixed")
    assert [j.name for j in moving.joints] == ["j1", "j2"]
    np.testing.assert_array_equal(moving.link_inertia, still.link_inertia)
    assert moving.link_inertia[:, 0].tolist() == [12.0, 6.0]
    assert moving.branches == (SideBranch("grip", "boom", 6.0), SideBranch("j3", "arm", 3.0))
    assert still.branches == ()


def test_branches_without_a_mass_or_of_the_base_are_no_matter(tmp_path: Path) -> None:
    path = written(
        tmp_path,
        *(link(name) for name in ("base", "arm", "door")),
        link("needle", 0.0),
        joint("j1", "base", "arm"),
        joint("hinge", "base", "door"),
        joint("dial", "arm", "needle"),
    )
    chain = read_chain(path, "arm")
    assert chain.branches == ()
    assert chain.link_inertia[0, 0] == 3.0


def test_friction_that_nothing_uses_is_told(tmp_path: Path) -> None:
    rough = LIMIT + '<dynamics damping="2" friction="{}"/>'
    path = written(
        tmp_path,
        *(link(name) for name in ("base", "a", "b")),
        joint("j1", "base", "a", limit=rough.format(30)),
        joint("j2", "a", "b", limit=rough.format(0)),
    )
    chain = read_chain(path, "b")
    assert chain.dry_friction == {"j1": 30.0}
    assert [j.viscous_friction for j in chain.joints] == [2.0, 2.0]


BASE, ARM = link("base"), link("arm")
MIMIC = LIMIT + '<mimic joint="other" multiplier="2"/>'


@pytest.mark.parametrize(
    ("parts", "expected"),
    [
        ((BASE, ARM, joint("j", "base", "arm", "floating")), "joint 'j' is floating, expected"),
        ((BASE, ARM, joint("j", "base", "arm", "planar")), "joint 'j' is planar, expected"),
        ((BASE, ARM, joint("j", "base", "arm", "wobbly")), "not a valid URDF"),
        (
            (BASE, ARM, joint("j", "base", "arm", limit=MIMIC)),
            "joint 'j' mimics 'other', expected",
        ),
        (
            (BASE, ARM, link("k"), joint("j", "base", "arm"), joint("l", "arm", "k", "floating")),
            "joint 'l' is floating, expected",
        ),
        (
            (
                *(BASE, ARM, link("k"), link("m"), joint("j", "base", "arm")),
                *(joint("l", "arm", "k"), joint("n", "k", "m", "planar")),
            ),
            "joint 'n' is planar, expected",
        ),
        (
            (BASE, ARM, joint("j", "base", "arm", limit=f'{LIMIT}<dynamics friction="nan"/>')),
            "expected finite numbers",
        ),
        ((BASE, ARM, joint("j", "base", "arm", axis='<axis xyz="0 0 0"/>')), "has a zero axis"),
        ((BASE, ARM, joint("j", "base", "arm", limit="")), "joint 'j' has no <limit>"),
        (
            (BASE, ARM, joint("j", "base", "arm", limit=LIMIT.replace('"-1"', '"1"'))),
            "expected lower < upper",
        ),
        ((BASE, ARM, fixed("j", "base", "arm")), "no moving joint"),
        ((BASE, link("hand"), joint("j", "base", "hand")), "no link 'arm' (links: base, hand)"),
        ((BASE, ARM, joint("j", "base", "gone")), "not a valid URDF"),
        ((BASE, ARM), "not a valid URDF"),
        ((ARM, joint("j", "arm", "arm")), "robot.urdf"),
        ((BASE, ARM, joint("j", "base", "arm", xyz="0 zero 0")), "not a valid URDF"),
        ((BASE, ARM, joint("j", "base", "arm", xyz="0 nan 0")), "finite"),
        ((BASE, link("arm", xyz="0 inf 0"), joint("j", "base", "arm")), "finite"),
        ((BASE, link("arm", -1.0), joint("j", "base", "arm")), "has mass -1.0"),
        ((BASE, ARM, ARM, joint("j", "base", "arm")), "link 'arm' appears more than once"),
        (
            (BASE, ARM, joint("j", "base", "arm"), joint("j", "base", "arm")),
            "joint 'j' appears more than once",
        ),
        (
            (BASE, ARM, joint("j", "base", "arm"), joint("k", "base", "arm")),
            "child link 'arm' appears more than once",
        ),
    ],
)
def test_bad_chains(tmp_path: Path, parts: tuple[str, ...], expected: str) -> None:
    path = written(tmp_path, *parts)
    with pytest.raises(RobotError) as caught:
        read_chain(path, "arm")
    message = str(caught.value)
    assert expected in message
    assert str(path) in message
    assert "\n" not in message


@pytest.mark.parametrize("text", ["", "<robot", "not xml at all", "<sdf></sdf>"])
def test_text_that_is_no_urdf(tmp_path: Path, text: str) -> None:
    path = tmp_path / "robot.urdf"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(RobotError, match="not a valid URDF"):
        read_chain(path, "tip")


def test_entities_are_not_expanded_without_end(tmp_path: Path) -> None:
    """The XML cousin of the alias bomb."""
    entities = '<!ENTITY a0 "xxxxxxxxxx">' + "".join(
        f'<!ENTITY a{i} "{f"&a{i - 1};" * 10}">' for i in range(1, 24)
    )
    path = tmp_path / "robot.urdf"
    path.write_text(
        f'<?xml version="1.0"?><!DOCTYPE robot [{entities}]><robot name="&a23;"/>',
        encoding="utf-8",
    )
    with pytest.raises(RobotError, match="not a valid URDF"):
        read_chain(path, "tip")


def test_missing_urdf(tmp_path: Path) -> None:
    with pytest.raises(RobotError, match="no URDF at"):
        read_chain(tmp_path / "absent.urdf", "tip")


def test_angles_of_an_origin_turn_as_scipy_turns_them() -> None:
    """To the last digit: robots' numbers stay what they were."""
    random = np.random.default_rng(5)
    usual = np.array([0.0, np.pi / 2, -np.pi / 2, np.pi, 1.5708, 0.3])
    drawn = [*random.uniform(-4.0, 4.0, (200, 3)), *random.choice(usual, (200, 3))]
    for angles in drawn:
        expected = Rotation.from_euler("xyz", angles).as_matrix()
        np.testing.assert_array_equal(from_roll_pitch_yaw(*angles), expected)
