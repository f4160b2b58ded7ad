"""`visual_joints`: positions of all joints of the drawing, for robot_state_publisher.

`/joint_states` in, `/visual_joint_states` out with each message's own stamp, at most at `rate_hz`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from hydro_model.command_line.command import run_command
from hydro_msgs_docs.middleware import start_ros
from hydro_msgs_docs.node_arguments import check_arguments

if TYPE_CHECKING:
    from hydro_model.robot import FloatArray, Robot

VISUAL_JOINT_STATES = "/visual_joint_states"
RATE_HZ = 50.0
_PARAMETERS = (
    ("robot", "robot file or the name of a shipped robot", None),
    ("rate_hz", "messages a second at most", RATE_HZ),
)


def positions_of(robot: Robot, given: Mapping[str, float]) -> FloatArray | None:
    """Joint positions from what a message holds.

    Parameters
    ----------
    robot : Robot
    given : mapping of str to float
        By name: joints, or cylinders with a stroke sensor.

    Returns
    -------
    (n,) array or None
        None where a joint's position is in neither.
    """
    import numpy as np

    from hydro_model.hydraulics.cylinder import joint_position

    q = np.full(robot.dof, np.nan)
    for i, joint in enumerate(robot.joints):
        q[i] = given.get(joint.name, np.nan)
    for cylinder in robot.cylinders:
        i = robot.joint_index(cylinder.joint)
        x = given.get(cylinder.name, np.nan)
        if not np.isfinite(q[i]) and np.isfinite(x):
            limits = robot.joints[i]
            q[i] = float(joint_position(cylinder, x, 0.5 * (limits.lower + limits.upper)))
    return q if np.isfinite(q).all() else None


def main(arguments: Sequence[str] | None = None) -> int:
    """The `visual_joints` executable."""
    return run_command("visual_joints", _run, arguments)


def _run(arguments: Sequence[str]) -> int:
    check_arguments(
        "visual_joints",
        "Publishes /visual_joint_states: joints, barrels and rods of what visual_urdf writes.",
        _PARAMETERS,
        arguments,
    )
    import rclpy
    from rclpy.executors import ExternalShutdownException

    start_ros("visual_joints", arguments)
    try:
        node = rclpy.create_node("visual_joints")
        try:
            publish_visual_joints(node)
            rclpy.spin(node)
        except (KeyboardInterrupt, ExternalShutdownException):
            return 0
        finally:
            node.destroy_node()
    finally:
        rclpy.try_shutdown()
    return 0


def publish_visual_joints(node: Any) -> None:
    """Make a node publish the drawing's joints.

    Parameters
    ----------
    node : Node
        Its parameters `robot` and `rate_hz` are declared.

    Raises
    ------
    RobotError
        The robot cannot be read.
    """
    from rclpy.qos import qos_profile_sensor_data
    from sensor_msgs.msg import JointState

    from hydro_model.description.visual_joints import visual_joint_names, visual_joint_positions
    from hydro_model.robot_files import load_robot
    from hydro_msgs_docs.topics import JOINT_STATES, reliable

    robot = load_robot(node.declare_parameter("robot", "").value)
    rate_hz = float(node.declare_parameter("rate_hz", RATE_HZ).value)
    names = list(visual_joint_names(robot))
    publisher = node.create_publisher(JointState, VISUAL_JOINT_STATES, reliable())
    due_ns = 0

    def drawn(message: Any) -> None:
        nonlocal due_ns
        stamp_ns = message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec
        # A log that starts again from the beginning is drawn again.
        if due_ns - 2e9 / rate_hz <= stamp_ns < due_ns:
            return
        q = positions_of(robot, dict(zip(message.name, message.position)))  # noqa: B905
        if q is None:
            return
        due_ns = stamp_ns + round(1e9 / rate_hz)
        out = JointState(header=message.header, name=names)
        out.position = visual_joint_positions(robot, q).tolist()
        publisher.publish(out)

    # Best effort: it only draws, and never holds up the machine's publishers.
    node.create_subscription(JointState, JOINT_STATES, drawn, qos_profile_sensor_data)
