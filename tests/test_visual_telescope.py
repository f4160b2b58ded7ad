"""A cylinder along a joint that slides is drawn, too: its barrel stands, its rod goes along."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
import yaml

from hydro_model.description.visual_joints import visual_joint_names, visual_joint_positions
from hydro_model.multibody.kinematics import link_frames
from hydro_model.robot import Robot
from hydro_model.robot_files import load_robot, shipped_robots
from hydro_msgs_docs.visual_urdf import visual_urdf

#: Of the cylinder, and of the joint that it pushes.
STROKE_M, TRAVEL_M = 1.2, 1.1
BOOM = """<joint name="extend" type="prismatic">
    <parent link="tilt_link"/><child link="boom"/>
    <origin xyz="1.4 0.1 0.05" rpy="0.3 -0.2 0.5"/><axis xyz="0.6 0 0.8"/>
    <limit lower="{lower}" upper="{upper}" effort="20000" velocity="0.4"/>
  </joint>
  <link name="boom"><inertial><mass value="80"/><origin xyz="0.3 0 0"/>
    <inertia ixx="1" iyy="9" izz="9" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="tip" type="fixed">
    <parent link="boom"/>"""
OLD = """<joint name="tip" type="fixed">
    <parent link="tilt_link"/>"""


#: Where the joint stands with the rod retracted: at the barrel's foot, a closed length away, or
#: counted from the other end.
@pytest.fixture(params=[0.0, 0.1, 1.5, -1.2], ids="at {:g} m retracted".format)
def telescope(request: pytest.FixtureRequest, tmp_path: Path) -> Robot:
    """The reference crane with a boom that a third cylinder pushes out of its tilt link."""
    x0_m = request.param
    source = shipped_robots()["xs031"]
    shutil.copy(source, tmp_path / "crane.hydraulics.yaml")
    data = yaml.safe_load((tmp_path / "crane.hydraulics.yaml").read_text(encoding="utf-8"))
    push = {"name": "push", "joint": "extend", "bore_m": 0.06, "rod_m": 0.04, "x0_m": x0_m}
    data["cylinders"].insert(1, push | {"stroke_m": STROKE_M})
    edges = dict.fromkeys(("c_pa", "c_at", "c_pb", "c_bt"), 3e-7)
    data["valves"].append({"name": "push_valve", "cylinder": "push"} | edges)
    (tmp_path / "crane.hydraulics.yaml").write_text(yaml.safe_dump(data), encoding="utf-8")
    urdf = source.with_name("xs031.urdf").read_text(encoding="utf-8")
    boom = BOOM.format(lower=x0_m, upper=x0_m + TRAVEL_M)
    (tmp_path / "xs031.urdf").write_text(urdf.replace(OLD, boom), encoding="utf-8")
    return load_robot(tmp_path / "crane.hydraulics.yaml")


def test_its_rod_ends_at_the_boom_and_its_barrel_stays_at_the_link_before(
    telescope: Robot,
) -> None:
    pinocchio = pytest.importorskip("pinocchio", reason="pinocchio is not installed")
    model = pinocchio.buildModelFromXML(visual_urdf(telescope))
    data, names = model.createData(), visual_joint_names(telescope)
    assert model.nq == len(names)
    assert "push_rod" in names
    assert "push_barrel" not in names
    extend = telescope.joint_index("extend")
    joint = telescope.joints[extend]
    low, high = np.array([(j.lower, j.upper) for j in telescope.joints]).T
    for q in low + (high - low) * np.random.default_rng(2).random((20, telescope.dof)):
        values = np.zeros(model.nq)
        for name, value in zip(names, visual_joint_positions(telescope, q), strict=True):
            values[model.joints[model.getJointId(name)].idx_q] = value
        pinocchio.framesForwardKinematics(model, data, values)
        origins, rotations = link_frames(telescope, q)
        before = rotations[extend - 1]
        foot = origins[extend - 1] + before @ joint.translation_m
        barrel, rod = (
            data.oMf[model.getFrameId(name)] for name in ("push_barrel_link", "push_rod_link")
        )
        np.testing.assert_allclose(barrel.translation, foot, atol=1e-9)
        np.testing.assert_allclose(rod.translation, origins[extend], atol=1e-9)
        along = before @ joint.rotation @ joint.axis
        for part in (barrel, rod):
            np.testing.assert_allclose(part.rotation[:, 0], along, atol=1e-9)


def test_its_joints_move_by_the_strokes(telescope: Robot) -> None:
    low, high = np.array([(j.lower, j.upper) for j in telescope.joints]).T
    many = np.linspace(low, high, 7)
    rows = visual_joint_positions(telescope, many)
    names = visual_joint_names(telescope)
    assert rows.shape == (7, len(names))
    np.testing.assert_array_equal(rows[:, :3], many)
    sliding = rows[:, names.index("push_rod")]
    np.testing.assert_allclose(sliding, np.linspace(0.0, TRAVEL_M, 7), atol=1e-12)
    # Behind it in the file the cylinders on triangles keep both of theirs.
    assert names[3:] == (
        *("lift_cylinder_barrel", "lift_cylinder_rod", "push_rod"),
        *("tilt_cylinder_barrel", "tilt_cylinder_rod"),
    )
    np.testing.assert_array_equal(visual_joint_positions(telescope, many[3]), rows[3])


def test_its_rod_never_leaves_its_barrel(telescope: Robot) -> None:
    from urdf_parser_py.urdf import URDF

    model = URDF.from_xml_string(visual_urdf(telescope).encode())
    barrel, rod = (model.link_map[f"push_{part}_link"].visual for part in ("barrel", "rod"))
    x0_m = telescope.cylinder("push").x0_m
    assert barrel.geometry.radius > 0.03 > rod.geometry.radius
    mouth = barrel.origin.xyz[0] + 0.5 * barrel.geometry.length
    bottom = barrel.origin.xyz[0] - 0.5 * barrel.geometry.length
    tail = x0_m + rod.origin.xyz[0] - 0.5 * rod.geometry.length
    assert bottom <= tail + 1e-9
    assert tail + STROKE_M < mouth < x0_m
    assert model.joint_map["push_barrel"].type == "fixed"
