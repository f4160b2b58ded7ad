"""The robot to look at stands where the model says: links, pins, barrels, rods, in every pose."""

from __future__ import annotations

import json
import math
import time
from pathlib import Path

import numpy as np
import pytest
import yaml

from hydro_model.description.visual_joints import (
    barrel_joint,
    rod_joint,
    visual_joint_names,
    visual_joint_positions,
)
from hydro_model.hydraulics.cylinder import stroke
from hydro_model.multibody.closed_chain import part_places
from hydro_model.multibody.joint_ranges import limits
from hydro_model.multibody.kinematics import link_frames, tip_position
from hydro_model.robot import Robot
from hydro_model.robot_files import load_robot, shipped_robots
from hydro_msgs_docs.rviz_files import rviz_view, state_publisher_parameters
from hydro_msgs_docs.visual_command import main
from hydro_msgs_docs.visual_node import VISUAL_JOINT_STATES, positions_of
from hydro_msgs_docs.visual_urdf import base_link, rpy_of, visual_urdf

ROOT = Path(__file__).resolve().parents[1]
LAYOUTS = ROOT / "hydro_msgs_docs/layouts"


@pytest.fixture(params=shipped_robots())
def robot(request: pytest.FixtureRequest) -> Robot:
    return load_robot(request.param)


def poses(robot: Robot, count: int = 40) -> np.ndarray:
    low, high = limits(robot).T
    return low + (high - low) * np.random.default_rng(7).random((count, robot.dof))


class Drawn:
    """A URDF placed by pinocchio, an oracle that knows nothing of cylinders."""

    def __init__(self, urdf: str) -> None:
        pinocchio = pytest.importorskip("pinocchio", reason="pinocchio is not installed")
        self.tool = pinocchio
        self.model = pinocchio.buildModelFromXML(urdf)
        self.data = self.model.createData()

    def frames(self, names: tuple[str, ...], values: np.ndarray) -> None:
        q = np.zeros(self.model.nq)
        for name, value in zip(names, values, strict=True):
            q[self.model.joints[self.model.getJointId(name)].idx_q] = value
        self.tool.framesForwardKinematics(self.model, self.data, q)

    def at(self, frame: str) -> tuple[np.ndarray, np.ndarray]:
        assert self.model.existFrame(frame), frame
        place = self.data.oMf[self.model.getFrameId(frame)]
        return place.translation, place.rotation


def test_links_pins_and_rods_are_where_the_model_has_them(robot: Robot) -> None:
    drawn = Drawn(visual_urdf(robot))
    names = visual_joint_names(robot)
    assert drawn.model.nq == len(names)
    places = part_places(robot)
    for q in poses(robot):
        drawn.frames(names, visual_joint_positions(robot, q))
        origins, rotations = link_frames(robot, q)
        for joint, origin, rotation in zip(robot.joints, origins, rotations, strict=True):
            at, turn = drawn.at(joint.child_link)
            np.testing.assert_allclose(at, origin, atol=1e-9)
            np.testing.assert_allclose(turn, rotation, atol=1e-9)
        np.testing.assert_allclose(drawn.at(robot.tip_link)[0], tip_position(robot, q), atol=1e-9)
        for k, cylinder in enumerate(robot.closed_chains):
            pins = [
                p.pin_m if p.host < 0 else origins[p.host] + rotations[p.host] @ p.pin_m
                for p in places[2 * k : 2 * k + 2]
            ]
            barrel, turn = drawn.at(f"{barrel_joint(cylinder.name)}_link")
            rod, _ = drawn.at(f"{rod_joint(cylinder.name)}_link")
            np.testing.assert_allclose(barrel, pins[0], atol=1e-9)
            np.testing.assert_allclose(rod, pins[1], atol=1e-9)
            length = np.linalg.norm(pins[1] - pins[0])
            np.testing.assert_allclose(turn[:, 0], (pins[1] - pins[0]) / length, atol=1e-9)


def test_rods_slide_by_the_stroke_and_arrays_are_rows_of_single_poses(robot: Robot) -> None:
    many = poses(robot, 5)
    rows = visual_joint_positions(robot, many)
    names = visual_joint_names(robot)
    for cylinder in robot.closed_chains:
        own = many[:, robot.joint_index(cylinder.joint)]
        column = rows[:, names.index(rod_joint(cylinder.name))]
        np.testing.assert_allclose(column, stroke(cylinder, own), atol=1e-12)
    for row, q in zip(rows, many, strict=True):
        np.testing.assert_array_equal(row, visual_joint_positions(robot, q))


def test_bodies_reach_from_joint_to_joint_and_rods_into_their_barrels(robot: Robot) -> None:
    from urdf_parser_py.urdf import URDF

    model = URDF.from_xml_string(visual_urdf(robot).encode())
    for cylinder in robot.closed_chains:
        barrel = model.link_map[f"{barrel_joint(cylinder.name)}_link"].visual
        rod = model.link_map[f"{rod_joint(cylinder.name)}_link"].visual
        assert barrel.geometry.radius > 0.5 * cylinder.bore_m > rod.geometry.radius
        mouth = barrel.origin.xyz[0] + 0.5 * barrel.geometry.length
        tail = cylinder.x0_m + rod.origin.xyz[0] - 0.5 * rod.geometry.length
        bottom = barrel.origin.xyz[0] - 0.5 * barrel.geometry.length
        assert bottom <= tail + 1e-9
        assert tail + cylinder.stroke_m < mouth < cylinder.x0_m
    if robot.dof > 1:
        bar = model.link_map[robot.joints[0].child_link].visual
        assert bar.geometry.size[0] == pytest.approx(
            float(np.linalg.norm(robot.joints[1].translation_m))
        )


@pytest.mark.parametrize("seed", range(20))
def test_roll_pitch_and_yaw_turn_back_into_the_rotation(seed: int) -> None:
    from scipy.spatial.transform import Rotation

    turn = Rotation.random(random_state=seed).as_matrix()
    if seed < 4:  # x upright: the angles are not unique, the rotation is
        sign = 1.0 if seed % 2 else -1.0
        turn = Rotation.from_euler("xyz", [0.3 * seed, sign * math.pi / 2, 0.2]).as_matrix()
    back = Rotation.from_euler("xyz", rpy_of(turn)).as_matrix()
    np.testing.assert_allclose(back, turn, atol=1e-9)


def test_files_hold_the_urdf_and_the_frame(robot: Robot, tmp_path: Path) -> None:
    told = tmp_path / "told.json"
    assert main(["--robot", robot.name, "--out", str(tmp_path), "--json", str(told)]) == 0
    files = {str(file) for file in tmp_path.iterdir() if file != told}
    assert set(json.loads(told.read_text("utf-8"))["files"]) == files
    urdf = (tmp_path / f"{robot.name}.urdf").read_text(encoding="utf-8")
    parameters = yaml.safe_load((tmp_path / "robot_state_publisher.yaml").read_text("utf-8"))
    inner = parameters["robot_state_publisher"]["ros__parameters"]
    assert inner["robot_description"] == urdf
    view = yaml.safe_load((tmp_path / f"{robot.name}.rviz").read_text(encoding="utf-8"))
    manager = view["Visualization Manager"]
    assert manager["Global Options"]["Fixed Frame"] == base_link(robot)
    shown = {d["Class"] for d in manager["Displays"]}
    assert "rviz_default_plugins/RobotModel" in shown


def test_shipped_files_are_up_to_date() -> None:
    crane = load_robot("xs031")
    urdf = visual_urdf(crane)
    folder = LAYOUTS / "rviz"
    assert (folder / "xs031.urdf").read_text(encoding="utf-8") == urdf
    assert (folder / "xs031.rviz").read_text(encoding="utf-8") == rviz_view(crane)
    written = (folder / "robot_state_publisher.yaml").read_text(encoding="utf-8")
    assert written == state_publisher_parameters(urdf)


def test_positions_come_from_joints_or_stroke_sensors_or_not_at_all() -> None:
    crane = load_robot("xs031")
    tilt = crane.cylinder("tilt_cylinder")
    given = {"lift": 0.7, "tilt_cylinder": float(stroke(tilt, -1.1)), "other": 3.0}
    found = positions_of(crane, given)
    assert found is not None
    np.testing.assert_allclose(found, [0.7, -1.1], atol=1e-9)
    assert positions_of(crane, {"lift": 0.7}) is None


def test_the_monitor_knows_every_node_that_reports() -> None:
    text = (LAYOUTS / "rqt/diagnostics.yaml").read_text(encoding="utf-8")
    analyzers = yaml.safe_load(text)["analyzers"]["ros__parameters"]
    known = {name for a in analyzers.values() if isinstance(a, dict) for name in a["startswith"]}
    page = (ROOT / "hydro_msgs_docs/topics/diagnostics.md").read_text(encoding="utf-8")
    row = next(line for line in page.splitlines() if line.startswith("| Published by"))
    assert known == {word.strip("` ") for word in row.split("|")[2].split(",")}


@pytest.mark.ros
def test_the_node_answers_joint_states_with_all_joints() -> None:
    import rclpy
    from rclpy.executors import SingleThreadedExecutor
    from sensor_msgs.msg import JointState

    from hydro_msgs_docs.topics import JOINT_STATES, reliable
    from hydro_msgs_docs.visual_node import publish_visual_joints

    context = rclpy.Context()
    rclpy.init(args=["--ros-args", "-p", "robot:=xs031"], context=context, domain_id=77)
    try:
        node = rclpy.create_node("visual_joints", context=context)
        other = rclpy.create_node("other", context=context)
        publish_visual_joints(node)
        got: list[JointState] = []
        other.create_subscription(JointState, VISUAL_JOINT_STATES, got.append, reliable())
        source = other.create_publisher(JointState, JOINT_STATES, reliable())
        executor = SingleThreadedExecutor(context=context)
        executor.add_node(node)
        executor.add_node(other)
        until = time.monotonic() + 20.0
        k = 0
        while len(got) < 3 and time.monotonic() < until:
            message = JointState(name=["tilt", "lift"], position=[-1.0, 0.5])
            message.header.stamp.sec, k = 10 + k, k + 1
            source.publish(message)
            executor.spin_once(timeout_sec=0.1)
        assert len(got) == 3
        crane = load_robot("xs031")
        assert tuple(got[0].name) == visual_joint_names(crane)
        wanted = visual_joint_positions(crane, [0.5, -1.0])
        np.testing.assert_allclose(got[0].position, wanted, atol=1e-12)
        assert got[0].header.stamp.sec >= 10
        node.destroy_node()
        other.destroy_node()
    finally:
        rclpy.shutdown(context=context)
