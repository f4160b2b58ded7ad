"""Compiles what most tests need: once, where each worker would do it for itself, all at a time.

compile_kernels.py model|rest    in two halves that share next to nothing, side by side
"""

from __future__ import annotations

import sys

import numpy as np

from hydro_control.core.core import ControllerCore
from hydro_control.gains import Gains
from hydro_hw_bridge.rig.core import RigCore
from hydro_hw_bridge.rig.random_truth import plain_truth
from hydro_model.effects import CATALOGUE
from hydro_model.effects.signals import SIGNAL_COUNT
from hydro_model.multibody.kinematics import tip_position
from hydro_model.multibody.rigid_body import inverse_dynamics, mass_matrix, regressor
from hydro_model.robot_files import load_robot
from hydro_model.simulation.simulate import simulate

POSE = (0.5, -1.5)


def model() -> None:
    """Roll a model out for a few cycles."""
    robot = load_robot("xs031")
    simulate(robot, 0.002 * np.arange(3), np.zeros((3, 2)), POSE)


def rest() -> None:
    """Roll the rig's plant out, ask for dynamics, law and effects."""
    robot, motion = load_robot("xs031"), np.tile(POSE, (2, 1))
    RigCore(robot, plain_truth(robot, 1), q=list(POSE)).actuate([0.0, 0.0])
    inverse_dynamics(robot, motion, motion, motion)
    regressor(robot, motion, motion, motion)
    mass_matrix(robot, motion)
    tip_position(robot, motion)
    ControllerCore(robot, Gains())
    for name in ("presliding_friction", "valve_spool_lag", "structural_flexibility"):
        effect = CATALOGUE[name]  # one followed by a closed form, one as linear, one by steps
        effect.evaluate(np.ones((3, SIGNAL_COUNT)), effect.typical, sample_time_s=0.002)


if __name__ == "__main__":
    {"model": model, "rest": rest}[sys.argv[1]]()
