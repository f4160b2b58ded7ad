"""What zeros of pressure transducers, off by a constant, do to the parameters of the forces.

A zero that is off by 1 Pa is a constant force of the piston's area. Least squares takes it for
weight, in a recording of any length, and no residual shows it. A constant passes the filters as
it is.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from hydro_ident.estimate.forces.force_rows import ForceModel, pressed_joints
from hydro_ident.estimate.forces.inertial import InertialFit
from hydro_ident.estimate.forces.outside_noise import widened
from hydro_ident.estimate.statistics.moments import Moments
from hydro_ident.estimate.statistics.rows import Rows


def constant_rows(model: ForceModel, rows: Rows) -> Rows:
    """Rows with a column behind the others per joint with pressures: a force of 1 N there.

    Parameters
    ----------
    model : ForceModel
    rows : Rows
        Of its channels.
    """
    joints = pressed_joints(model)
    columns = np.zeros((*rows.y.shape, len(joints)))
    columns[:, joints, np.arange(len(joints))] = 1.0
    return replace(rows, x=np.concatenate([rows.x, columns], axis=2), z=None)


def with_zeros(fit: InertialFit, gathered: Sequence[Moments], zero_pa: float) -> InertialFit:
    """A fit whose covariance has the zeros of the transducers.

    Parameters
    ----------
    fit : InertialFit
    gathered : sequence of Moments
        Of `constant_rows`, by recording: those that were fitted, without robust weights.
    zero_pa : float
        Standard deviation of a transducer's zero.

    Returns
    -------
    InertialFit
        As of `hydro_ident.estimate.forces.outside_noise.widened`.
    """
    robot, joints = fit.model.robot, pressed_joints(fit.model)
    if not joints or not gathered:
        return fit
    push = {
        robot.joint_index(c.joint): zero_pa * math.hypot(c.area_a_m2, c.area_b_m2)
        for c in robot.cylinders
    }
    behind = gathered[0].width - 1
    columns = range(behind - len(joints), behind)
    return widened(fit, gathered, columns, [push[j] for j in joints])
