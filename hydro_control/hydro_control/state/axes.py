"""What moves each joint: its cylinder and its valve."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hydro_control.errors import ControlError
from hydro_model.hydraulics.cylinder import lever
from hydro_model.robot import Cylinder, Joint, Robot, Valve

#: A lever arm shorter than this cannot hold its link.
SHORTEST_LEVER_M = 0.005


@dataclass(frozen=True, slots=True)
class Axis:
    """A joint with its cylinder and valve, and where these stand in the robot's lists.

    Attributes
    ----------
    joint : Joint
    cylinder : Cylinder
    valve : Valve
    cylinder_index, valve_index : int
    """

    joint: Joint
    cylinder: Cylinder
    valve: Valve
    cylinder_index: int
    valve_index: int


def axes_of(robot: Robot) -> tuple[Axis, ...]:
    """The axes of a robot in the order of its joints.

    Parameters
    ----------
    robot : Robot

    Returns
    -------
    tuple of Axis

    Raises
    ------
    ControlError
        A lever arm vanishes within the joint limits, or a velocity limit is not above 0.
    RobotError
        A joint has no cylinder or a cylinder no valve.
    """
    if robot.dof == 0:
        raise ControlError(f"robot {robot.name} has no joints, nothing to control")
    axes = []
    for joint in robot.joints:
        cylinder = robot.cylinder_of(joint.name)
        valve = robot.valve_of(cylinder.name)
        arm = lever(cylinder, np.linspace(joint.lower, joint.upper, 201))
        if np.min(np.abs(arm)) < SHORTEST_LEVER_M or np.min(arm) * np.max(arm) < 0.0:
            raise ControlError(
                f"cylinder '{cylinder.name}': expected a lever arm of at least"
                f" {SHORTEST_LEVER_M} m either way over the limits of joint '{joint.name}',"
                f" found {np.min(arm):.4f} to {np.max(arm):.4f} m"
            )
        if not 0.0 < joint.velocity_limit < np.inf:
            # A URDF's 0 stands for none: nothing would brake the joint before its ends.
            raise ControlError(
                f"joint '{joint.name}': expected a velocity limit above 0 in the URDF's <limit>,"
                f" found {'none' if joint.velocity_limit > 0.0 else joint.velocity_limit}"
            )
        places = robot.cylinders.index(cylinder), robot.valves.index(valve)
        axes.append(Axis(joint, cylinder, valve, *places))
    return tuple(axes)
