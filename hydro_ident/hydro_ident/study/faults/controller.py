"""The real controller's core as a publisher on the fault bench."""

from __future__ import annotations

import numpy as np

from hydro_control.core.core import ControllerCore, Sample
from hydro_control.gains import Gains
from hydro_hw_bridge.faults.command_faults import Command
from hydro_hw_bridge.protocol import bridge_step
from hydro_model.motion.paths import TipPath
from hydro_model.multibody.kinematics import tip_position
from hydro_model.robot import Robot

#: A path of the tip from the middle of the range, brisk from the first sample on.
LEG_M, LEG_S = (0.25, 0.0, 0.2), 0.6


class CoreCommander:
    """Answers the bridge's samples as the controller node does.

    Parameters
    ----------
    robot : Robot
    """

    def __init__(self, robot: Robot) -> None:
        middle = np.array([0.5 * (joint.lower + joint.upper) for joint in robot.joints])
        start = np.asarray(tip_position(robot, middle))
        path = TipPath.through([start.tolist(), (start + np.array(LEG_M)).tolist()], [LEG_S])
        self._robot = robot
        self._core = ControllerCore(robot, Gains(), path)

    def answer(self, sample: bridge_step.Sample) -> Command | None:
        """The command that follows from a sample; None for an old one."""
        robot, readings = self._robot, sample.readings
        absolute = np.array(readings.pressures_pa) + robot.atmospheric_pressure_pa
        chambers = absolute[: 2 * len(robot.cylinders)].reshape(-1, 2)
        found = self._core.answer(
            Sample(
                sample.stamp_ns,
                np.array(readings.positions),
                chambers[:, 0],
                chambers[:, 1],
                absolute[-2],
                absolute[-1],
            )
        )
        if found is None:
            return None
        voltages = tuple(found.output.voltage_v.tolist())
        return Command(sample.stamp_ns, robot.valve_names, voltages)
