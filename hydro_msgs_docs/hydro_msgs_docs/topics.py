"""Names of the topics and their QoS: the contract in one place, for every node."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rclpy.qos import QoSProfile

JOINT_STATES = "/joint_states"
CHAMBER_PRESSURES = "/chamber_pressures"
VALVE_COMMAND = "/valve_command"
VALVE_STATE = "/valve_state"
JOINT_REFERENCE = "/joint_reference"
TIP_REFERENCE = "/tip_reference"
JOINT_TRAJECTORY = "/joint_trajectory"
TIP_TRAJECTORY = "/tip_trajectory"
OIL_TEMPERATURE = "/oil_temperature"
BASE_PARAMETERS = "/base_parameters"
DIAGNOSTICS = "/diagnostics"

#: How a node's message in `/diagnostics` begins while it is not active, and while it is but has
#: nothing to work on yet. `inspect` tells by them what belongs to the start and end of a run.
IDLE = ("inactive", "not configured")
WAITING = "waiting for "

#: Topics that carry one message per 500 Hz cycle, all stamped with the cycle's stamp.
CYCLE_TOPICS = (
    JOINT_STATES,
    CHAMBER_PRESSURES,
    VALVE_COMMAND,
    VALVE_STATE,
    JOINT_REFERENCE,
    TIP_REFERENCE,
)

MESSAGE_TYPES = {
    JOINT_STATES: "sensor_msgs/msg/JointState",
    CHAMBER_PRESSURES: "sensor_msgs/msg/JointState",
    VALVE_COMMAND: "sensor_msgs/msg/JointState",
    VALVE_STATE: "sensor_msgs/msg/JointState",
    JOINT_REFERENCE: "sensor_msgs/msg/JointState",
    TIP_REFERENCE: "geometry_msgs/msg/PointStamped",
    JOINT_TRAJECTORY: "trajectory_msgs/msg/JointTrajectory",
    TIP_TRAJECTORY: "trajectory_msgs/msg/MultiDOFJointTrajectory",
    OIL_TEMPERATURE: "sensor_msgs/msg/Temperature",
    BASE_PARAMETERS: "sensor_msgs/msg/JointState",
    DIAGNOSTICS: "diagnostic_msgs/msg/DiagnosticArray",
}

#: Depth of a publisher's and a controller's history, and of the recorder's.
LIVE_DEPTH = 10
RECORDER_DEPTH = 5000


def reliable(depth: int = LIVE_DEPTH) -> QoSProfile:
    """Reliable, keep_last, volatile: every live topic of the contract.

    Parameters
    ----------
    depth : int
        History depth; 5000 for a recorder.

    Returns
    -------
    QoSProfile
    """
    from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=depth,
        reliability=ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.VOLATILE,
    )


def latched(depth: int = 1) -> QoSProfile:
    """Reliable and transient_local: late subscribers get the last messages.

    Parameters
    ----------
    depth : int

    Returns
    -------
    QoSProfile
    """
    from rclpy.qos import DurabilityPolicy

    profile = reliable(depth)
    profile.durability = DurabilityPolicy.TRANSIENT_LOCAL
    return profile
