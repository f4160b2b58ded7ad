"""`send_path FILE`: ask a running controller to play a tip or joint path, or to stop."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from typing import Any

from hydro_control.errors import ControlError
from hydro_control.node.lifecycle_command import seconds
from hydro_control.node.node import NAME as CONTROLLER
from hydro_model.command_line.command import Parser, run_command
from hydro_model.command_line.output import add_json, report
from hydro_msgs_docs.middleware import start_ros

NAME = "send_path"
#: Of what `--json` writes.
SCHEMA = "hydro_control/sent_path/1"


class SendError(ControlError):
    """Nobody took the trajectory."""

    exit_code = 1


def main() -> int:
    """The command `send_path`."""
    return run_command(NAME, run)


def run(arguments: Sequence[str]) -> int:
    """Publish a path once as a trajectory message; to stop, one without points.

    Parameters
    ----------
    arguments : sequence of str

    Returns
    -------
    int
        0 where a controller has taken the message; whether it accepts it is in its log and in
        `/diagnostics`.

    Raises
    ------
    ControlError
        Both a path and `--stop` are given, or neither.
    RobotError
        The path file cannot be used.
    SendError
        No controller listens within the timeout.
    """
    args = _parser().parse_args(arguments)
    if args.stop == (args.path is not None):
        found = "both" if args.stop else "neither"
        raise ControlError(f"expected a path file or --stop, found {found}")
    from hydro_model.motion.paths import TipPath, load_path
    from hydro_msgs_docs import topics

    if args.stop:
        _send(topics.JOINT_TRAJECTORY, _stop_message(), args.timeout)
        data = {"schema": SCHEMA, "kind": "stop", "topic": topics.JOINT_TRAJECTORY, "points": 0}
        report(args.json, data, f"{topics.JOINT_TRAJECTORY}: stop")
        return 0
    path = load_path(args.path)
    tip = isinstance(path, TipPath)
    topic = topics.TIP_TRAJECTORY if tip else topics.JOINT_TRAJECTORY
    message = tip_message(path) if tip else joint_message(path)
    _send(topic, message, args.timeout)
    text = f"{topic}: {len(message.points)} points, {path.duration_s:.2f} s"
    report(args.json, sent_dict(args.path, path, topic, len(message.points)), text)
    return 0


def _stop_message() -> Any:
    """No points: whatever is played, of joints or of the tip, comes to rest on its way."""
    from trajectory_msgs.msg import JointTrajectory

    return JointTrajectory()


def _send(topic: str, message: Any, timeout_s: float) -> None:
    import rclpy
    from rclpy.signals import SignalHandlerOptions

    from hydro_msgs_docs import topics

    start_ros("send_path", handlers=SignalHandlerOptions.NO)
    node = rclpy.create_node("send_path", start_parameter_services=False)
    try:
        publisher = node.create_publisher(type(message), topic, topics.reliable())
        _deliver(node, publisher, message, timeout_s)
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


def sent_dict(name: str, path: Any, topic: str, points: int) -> dict[str, Any]:
    """What was sent, for a program.

    Parameters
    ----------
    name : str
        Of the path, as given.
    path : hydro_model.motion.paths.TipPath or hydro_model.motion.paths.JointPath
    topic : str
    points : int
        Of the message.

    Returns
    -------
    dict
        `start` and `end` are positions: of the tip in `frame`, m, or of the `joints`, rad or m.
    """
    from hydro_control.motion.trajectory import waypoints_of
    from hydro_model.motion.paths import TipPath

    waypoints = waypoints_of(path)
    of = (
        {"kind": "tip", "frame": path.frame, "tip_link": path.tip_link}
        if isinstance(path, TipPath)
        else {"kind": "joint", "joints": list(path.joints)}
    )
    return {
        "schema": SCHEMA,
        "path": name,
        "topic": topic,
        **of,
        "points": points,
        "duration_s": path.duration_s,
        "start": waypoints[0].position.tolist(),
        "end": waypoints[-1].position.tolist(),
    }


def _parser() -> argparse.ArgumentParser:
    parser = Parser(
        prog=NAME, description="Ask a running controller to play a tip or joint path, or to stop."
    )
    parser.add_argument("path", metavar="FILE", nargs="?", help="path file, or a shipped path")
    parser.add_argument(
        "--stop",
        action="store_true",
        help="in the place of a path: come to rest within 0.5 s on the way of what is played",
    )
    parser.add_argument(
        "--timeout", type=seconds, default=5.0, metavar="S", help="seconds to wait (default 5)"
    )
    add_json(parser, "what was sent")
    return parser


def _deliver(node: Any, publisher: Any, message: Any, timeout_s: float) -> None:
    from rclpy.duration import Duration

    end, heard = time.monotonic() + timeout_s, False
    while not heard:
        heard = _is_heard(node, publisher)
        # Also of a process that had been stopped: what it was to send is out of date by now.
        if time.monotonic() > end:
            domain = node.context.get_domain_id()
            raise SendError(
                f"no controller listens on {publisher.topic_name} within {timeout_s:g} s in ROS"
                f" domain {domain}"
            )
        if not heard:
            time.sleep(0.02)
    publisher.publish(message)
    if not publisher.wait_for_all_acked(Duration(seconds=timeout_s)):
        raise SendError(f"the controller did not take the message on {publisher.topic_name}")


def _is_heard(node: Any, publisher: Any) -> bool:
    """A controller listens, and it is among those that a message now goes to.

    Others may listen beside it, such as a recorder. Which of them the publisher has met is not to
    be known, only how many: so all that can be met have to be.
    """
    from rclpy.qos import QoSCompatibility, qos_check_compatible

    met = publisher.get_subscription_count()
    listeners = [
        one.node_name
        for one in node.get_subscriptions_info_by_topic(publisher.topic_name)
        if qos_check_compatible(publisher.qos_profile, one.qos_profile)[0]
        is not QoSCompatibility.ERROR
    ]
    return CONTROLLER in listeners and met >= len(listeners)


def joint_message(path: Any) -> Any:
    """A joint path as `trajectory_msgs/msg/JointTrajectory`.

    Parameters
    ----------
    path : hydro_model.motion.paths.JointPath

    Returns
    -------
    trajectory_msgs.msg.JointTrajectory
        With positions, velocities and accelerations, so that quintics give the path back.
    """
    from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

    from hydro_control.motion.trajectory import waypoints_of

    message = JointTrajectory(joint_names=list(path.joints))
    for point in waypoints_of(path):
        message.points.append(
            JointTrajectoryPoint(
                positions=point.position.tolist(),
                velocities=point.velocity.tolist(),
                accelerations=point.acceleration.tolist(),
                time_from_start=_duration(point.time_s),
            )
        )
    return message


def tip_message(path: Any) -> Any:
    """A tip path as `trajectory_msgs/msg/MultiDOFJointTrajectory`.

    Parameters
    ----------
    path : hydro_model.motion.paths.TipPath

    Returns
    -------
    trajectory_msgs.msg.MultiDOFJointTrajectory
        One transform per point whose translation is the tip's position; its rotation is unused.
    """
    from geometry_msgs.msg import Transform, Twist, Vector3
    from trajectory_msgs.msg import MultiDOFJointTrajectory, MultiDOFJointTrajectoryPoint

    from hydro_control.motion.trajectory import waypoints_of

    def vector(values: Any) -> Any:
        x, y, z = values.tolist()
        return Vector3(x=x, y=y, z=z)

    message = MultiDOFJointTrajectory(joint_names=[path.tip_link])
    message.header.frame_id = path.frame
    for point in waypoints_of(path):
        message.points.append(
            MultiDOFJointTrajectoryPoint(
                transforms=[Transform(translation=vector(point.position))],
                velocities=[Twist(linear=vector(point.velocity))],
                accelerations=[Twist(linear=vector(point.acceleration))],
                time_from_start=_duration(point.time_s),
            )
        )
    return message


def _duration(seconds: float) -> Any:
    from builtin_interfaces.msg import Duration

    whole, part = divmod(round(seconds * 1e9), 1_000_000_000)
    return Duration(sec=whole, nanosec=part)


if __name__ == "__main__":
    sys.exit(main())
