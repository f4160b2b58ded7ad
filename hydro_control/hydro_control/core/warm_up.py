"""Everything that the control law calls, compiled and loaded before the first sample."""

from __future__ import annotations

import numpy as np

from hydro_control.errors import ControlError
from hydro_control.law.law import ControlLaw
from hydro_control.motion.required_motion import Reference
from hydro_model.multibody.joint_ranges import middle
from hydro_model.multibody.kinematics import TipPlace, tip_position


def warm_up(law: ControlLaw) -> None:
    """Run a law once in mid-range, at rest, by joints and by the tip.

    Parameters
    ----------
    law : ControlLaw
        As new afterwards.

    Raises
    ------
    ControlError
        It cannot answer there.
    """
    robot = law.robot
    pose = middle(robot)
    half = 0.5 * (robot.supply_pressure_pa + robot.tank_pressure_pa)
    pressures = np.full(len(robot.cylinders), half)
    supply = robot.supply_pressure_pa, robot.tank_pressure_pa
    tip = tip_position(robot, pose)
    # The watch of measured motion calls the kernel itself.
    TipPlace(robot).at(pose)
    for reference in (
        Reference("joint", pose, np.zeros(robot.dof), np.zeros(robot.dof)),
        Reference("tip", tip, np.zeros(3), np.zeros(3)),
    ):
        ahead = reference if law.lead_s else None
        output = law.step(0.0, pose, pressures, pressures, *supply, reference, ahead)
        law.reset()
        if output.fault:
            raise ControlError(f"robot {robot.name} in mid-range: {output.fault}")
