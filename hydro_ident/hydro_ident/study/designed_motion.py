"""A designed motion whose rows are computed once, for recordings that differ by their noise."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from hydro_ident.design.experiment import design_excitation, start_pose
from hydro_ident.estimate.forces.inertial import ForceModel, Motion, force_columns, force_model
from hydro_ident.estimate.signals.derivatives import FilterSettings, parallel_filter
from hydro_ident.estimate.signals.traces import traces_of
from hydro_ident.estimate.statistics.rows import Rows
from hydro_ident.study.synthetic import STEP_S, synthetic_recording
from hydro_model.motion.paths import JointPath
from hydro_model.motion.paths_joints import joint_motion
from hydro_model.robot import FloatArray, Robot

LAG_S = 0.05  # of the motion behind the reference that serves as the instrument


@dataclass(frozen=True, slots=True)
class DesignedMotion:
    """A designed motion, sampled.

    Attributes
    ----------
    model : ForceModel
    duration_s : float
        As asked for.
    path : JointPath
    times : (N,) array
        Sampling instants, s.
    """

    model: ForceModel
    duration_s: float
    path: JointPath
    times: FloatArray

    @classmethod
    def of(cls, robot: Robot, duration_s: float) -> DesignedMotion:
        """Design one of this length, from the robot's usual start."""
        with tempfile.TemporaryDirectory() as folder:
            path = design_excitation(robot, start_pose(robot), duration_s, Path(folder)).path
        times = np.arange(0.0, path.duration_s, STEP_S)
        return cls(force_model(robot), duration_s, path, times)

    def rows(self, settings: FilterSettings, instruments: bool) -> Rows:
        """Rows of the motion, whose y is yet to come; instruments are `LAG_S` ahead."""
        robot = self.model.robot
        trace = traces_of([replace(synthetic_recording(robot, 1.0), q_ref=None)])[0]

        def columns(at: FloatArray) -> FloatArray:
            moved = Motion(*joint_motion(robot, self.path, at))
            return parallel_filter(force_columns(self.model, trace, moved), STEP_S, settings)

        x = columns(self.times)
        ahead = np.minimum(self.times + LAG_S, self.path.duration_s)
        z = columns(ahead) if instruments else None
        step_s = settings.decimation(STEP_S) * STEP_S
        return Rows(x[..., 0], x, step_s * np.arange(float(len(x))), z=z, step_s=step_s)
