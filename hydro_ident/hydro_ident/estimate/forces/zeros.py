"""What zeros of pressure transducers, off by a constant, do to the parameters of the forces.

A zero that is off by 1 Pa is a constant force of the piston's area. Least squares takes it for
weight, in a recording of any length, and no residual shows it: intervals by noise alone are many
times too narrow. The estimates stay; the covariance has for each chamber

    V + s s',    s = A sum_g w_g X_g' 1 times the area times the usual deviation of a zero

added up, as zeros know nothing of each other (A and w as in
`hydro_ident.estimate.statistics.solution`). A constant passes the filters as it is.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from hydro_ident.estimate.forces.force_rows import ForceModel, pressed_joints
from hydro_ident.estimate.forces.inertial import InertialFit
from hydro_ident.estimate.statistics.blocks import Blocks, blocks_of
from hydro_ident.estimate.statistics.moments import Moments
from hydro_ident.estimate.statistics.regression import plain_parameters
from hydro_ident.estimate.statistics.rows import Rows
from hydro_ident.estimate.statistics.solution import MOST_DOF, levels
from hydro_model.arrays import IndexArray
from hydro_model.robot import FloatArray


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
        The same estimates. What was held is left as it is. The zeros' deviation counts as
        known, so that degrees of freedom are more.
    """
    robot, joints = fit.model.robot, pressed_joints(fit.model)
    if not joints or not gathered:
        return fit
    own = fit.fit
    free = np.setdiff1d(np.arange(own.theta.size), [part.index for part in fit.held])
    moved = _moved(blocks_of(gathered), own.theta, free, len(joints))
    push = {
        robot.joint_index(c.joint): zero_pa * math.hypot(c.area_a_m2, c.area_b_m2)
        for c in robot.cylinders
    }
    moved *= np.array([push[j] for j in joints])
    covariance, before = own.covariance.copy(), np.diag(own.covariance)
    covariance[np.ix_(free, free)] += moved @ moved.T
    grown = np.where(before > 0.0, np.diag(covariance) / np.where(before > 0.0, before, 1.0), 1.0)
    # Satterthwaite's, with a part of the variance that is known; a fit may not say its own.
    dof = np.minimum(own.dof * grown[: own.dof.size] ** 2, MOST_DOF)
    return replace(fit, fit=replace(own, covariance=covariance, dof=dof))


def _moved(blocks: Blocks, theta: FloatArray, free: IndexArray, count: int) -> FloatArray:
    """What 1 N at each of the last columns' joints moves the free parameters by, (f, count)."""
    shift = np.zeros(blocks.x.shape[3])
    shift[: theta.size] = theta
    shift[free] = 0.0
    part = blocks.held(free, shift)
    weight = 1.0 / levels(part, theta[free]) ** 2
    forces = range(blocks.x.shape[3] - count, blocks.x.shape[3])
    return np.stack(
        [plain_parameters(replace(part, y=blocks.x[..., k]), weight) for k in forces], axis=1
    )
