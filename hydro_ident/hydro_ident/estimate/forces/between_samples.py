"""What forces do between two samples, and how far off the readings of it may be.

A command is held from one cycle to the next. Where the log has the same rate the flows are nearly
constant in between, and oil that a piston accelerating with a takes up bends the force of its
chambers: with the spring of both oil columns,

    K = beta (A1 / x + A2 / (S - x)),    F'' = -K a,

it runs through a parabola from corner to corner. Positions tell the mean force over a sample, and
the readings are of wherever in it they fall: at the corners they are K T^2 / 12 a less than the
mean, halfway between them K T^2 / 24 a more. A log that always reads at the same place sees a mass
that is off by that, and no residual shows it. Where the corners lie nobody knows: the delay of the
command and the lag of the spool decide it. So this is no correction but one deviation, of
K T^2 / 12 a, common to all cylinders: they have their commands at the same time.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from hydro_ident.estimate.forces.force_rows import ForceModel, pressed_joints
from hydro_ident.estimate.forces.inertial import InertialFit
from hydro_ident.estimate.forces.outside_noise import widened
from hydro_ident.estimate.forces.standstill import Rest, held_still
from hydro_ident.estimate.signals.derivatives import (
    FilterSettings,
    kept_samples,
    motion,
    parallel_filter,
)
from hydro_ident.estimate.signals.traces import Trace
from hydro_ident.estimate.statistics.moments import Moments
from hydro_ident.estimate.statistics.rows import Rows
from hydro_model.hydraulics.cylinder import lever, lever_rate, stroke
from hydro_model.robot import Cylinder, FloatArray

#: Oil in lines and ports, as a share of the stroke's: a chamber is never without any.
_LEAST_SHARE = 0.02


def oil_spring(cylinder: Cylinder, x_m: FloatArray, bulk_pa: float) -> FloatArray:
    """Stiffness in N/m of both oil columns at piston positions, valves shut.

    Parameters
    ----------
    cylinder : Cylinder
    x_m : array
        Any shape.
    bulk_pa : float

    Returns
    -------
    array
        Same shape as `x_m`.
    """
    full = cylinder.stroke_m
    x = np.clip(x_m, _LEAST_SHARE * full, (1.0 - _LEAST_SHARE) * full)
    return np.asarray(bulk_pa * (cylinder.area_a_m2 / x + cylinder.area_b_m2 / (full - x)))


def curved_rows(
    model: ForceModel,
    trace: Trace,
    rows: Rows,
    settings: FilterSettings,
    bulk_pa: Mapping[str, float],
    still: Mapping[int, Rest] | None = None,
) -> Rows:
    """Rows with a column behind the others for readings that fall on the corners.

    Parameters
    ----------
    model : ForceModel
    trace : Trace
    rows : Rows
        Of its force channels, with whatever columns.
    settings : FilterSettings
    bulk_pa : mapping of str to float
        Bulk modulus by cylinder.
    still : mapping of int to Rest, optional
        As of `force_rows`.
    """
    step_s = max(trace.step_s, trace.read_s)
    if model.corrected is not None:
        trace = model.corrected(trace)
    settings = settings.borne_at(trace.step_s)
    keep = kept_samples(trace.samples, trace.step_s, settings, trace.cycle, trace.core)
    q, qd, qdd = motion(held_still(trace.q, still or {}), trace.step_s, settings)
    force, wet = np.zeros(q.shape), pressed_joints(model)
    for cylinder in model.robot.cylinders:
        at = model.robot.joint_index(cylinder.joint)
        if at in wet:
            angle, speed = q[:, at], qd[:, at]
            curved = lever(cylinder, angle) * qdd[:, at] + lever_rate(cylinder, angle) * speed**2
            spring = oil_spring(cylinder, stroke(cylinder, angle), bulk_pa[cylinder.name])
            force[:, at] = spring * step_s**2 / 12.0 * curved
    column = parallel_filter(force, trace.step_s, settings, keep)[..., None]
    return replace(rows, x=np.concatenate([rows.x, column], axis=2), z=None)


def with_curvature(fit: InertialFit, gathered: Sequence[Moments], behind: int = 0) -> InertialFit:
    """A fit whose covariance has what the place of the readings in a cycle moves it by.

    Parameters
    ----------
    fit : InertialFit
    gathered : sequence of Moments
        Of `curved_rows`, by recording: those that were fitted, without robust weights.
    behind : int
        Columns that stand behind theirs.

    Returns
    -------
    InertialFit
        As of `hydro_ident.estimate.forces.outside_noise.widened`.
    """
    if not pressed_joints(fit.model) or not gathered:
        return fit
    return widened(fit, gathered, [gathered[0].width - 2 - behind], [1.0])
