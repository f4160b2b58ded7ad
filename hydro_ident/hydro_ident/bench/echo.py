"""What a user would write with rclpy: the same messages and frames, nothing done in between.

    python -m hydro_ident.bench.echo {frames,commands} BUS

`frames` publishes joint states and chamber pressures of made-up values for every cycle on the bus
and sends a frame of 0 V for every valve command that it hears; `commands` publishes a valve
command for every message of pressures. Both wait as the product does (`hydro_msgs_docs.hot_loop`).
Stamps are sample counters. Both end on SIGTERM.
"""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable
from typing import Any

from hydro_hw_bridge.bus.bus_open import open_bus
from hydro_hw_bridge.protocol.codec import Codec
from hydro_model.robot_files import load_robot
from hydro_msgs_docs import topics
from hydro_msgs_docs.hot_loop import HotSubscription, HotWait
from hydro_msgs_docs.messages import joint_state, set_stamp, stamp_ns
from hydro_msgs_docs.middleware import start_ros

ROBOT, _IDLE_S = "xs031", 0.5


def frames(node: Any, bus_name: str) -> None:
    """The bridge's place: cycles to messages, commands to frames.

    Parameters
    ----------
    node : Node
    bus_name : str
    """
    from sensor_msgs.msg import JointState

    robot = load_robot(ROBOT)
    codec = Codec.load(None, None, robot)
    bus = open_bus(bus_name, codec.device_ids)
    hot = HotSubscription(node, JointState, topics.VALVE_COMMAND, topics.reliable())
    publish = _cycle_publisher(node, robot)

    def receive() -> None:
        counter, last = 0, codec.device_ids[-1]
        while True:
            message = bus.receive(_IDLE_S)
            frame = None if message is None else codec.receive(message)
            if frame is None or message is None:
                continue
            if frame.role == "sync":
                counter = codec.sample_counter(frame)
            if message.arbitration_id == last:
                publish(counter)

    threading.Thread(target=receive, daemon=True).start()
    zero, wait = (0.0,) * len(robot.valves), HotWait(node, hot)
    while True:
        if wait.wait(_IDLE_S) and (message := hot.take()) is not None:
            bus.send(codec.encode_command(stamp_ns(message), zero, enable=True))


def _cycle_publisher(node: Any, robot: Any) -> Callable[[int], None]:
    from sensor_msgs.msg import JointState

    rest = [0.5] * robot.dof
    joints = joint_state(0, robot.joint_names, position=rest, velocity=rest)
    pressures = joint_state(0, robot.pressure_names, effort=[5e6] * len(robot.pressure_names))
    pairs = [
        (node.create_publisher(JointState, topic, topics.reliable()), message)
        for topic, message in (
            (topics.JOINT_STATES, joints),
            (topics.CHAMBER_PRESSURES, pressures),
        )
    ]

    def publish(counter: int) -> None:
        for publisher, message in pairs:
            set_stamp(message, counter)
            publisher.publish(message)

    return publish


def commands(node: Any, _bus_name: str) -> None:
    """The controller's place: messages to commands.

    `node` subscribes and publishes; `_bus_name` is not for it.
    """
    from sensor_msgs.msg import JointState

    robot, qos = load_robot(ROBOT), topics.reliable()
    joints = HotSubscription(node, JointState, topics.JOINT_STATES, qos)
    pressures = HotSubscription(node, JointState, topics.CHAMBER_PRESSURES, qos)
    publisher = node.create_publisher(JointState, topics.VALVE_COMMAND, qos)
    command = joint_state(0, robot.valve_names, effort=[0.0] * len(robot.valves))
    wait = HotWait(node, pressures)
    while True:
        if wait.wait(_IDLE_S) and (message := pressures.take()) is not None:
            joints.take()
            set_stamp(command, stamp_ns(message))
            publisher.publish(command)


PARTS: dict[str, Callable[[Any, str], None]] = {"frames": frames, "commands": commands}

if __name__ == "__main__":
    import rclpy
    from rclpy.signals import SignalHandlerOptions

    # As the controller: the threads' turns shall not be what is compared.
    sys.setswitchinterval(0.0005)
    start_ros("echo", handlers=SignalHandlerOptions.NO)
    PARTS[sys.argv[1]](rclpy.create_node(f"echo_{sys.argv[1]}"), sys.argv[2])
