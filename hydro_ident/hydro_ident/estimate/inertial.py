"""Base inertial parameters with viscous friction (paper III-A with its errata).

One row per joint and kept sample, in newtons at the piston (or in N m where a joint torque is
measured): eq. 18's torque rows divided by the lever, so that channels are piston forces and the
friction column is the piston's velocity (eq. 18 prints ``(dx/dq)^2`` without the joint velocity;
power 2 is right in torque rows). Regressor and regressand pass the same filter.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from hydro_ident.estimate.derivatives import (
    FilterSettings,
    kept_samples,
    low_pass,
    motion,
    parallel_filter,
)
from hydro_ident.estimate.least_squares import Fit, Rows, weighted_least_squares
from hydro_ident.estimate.traces import Trace
from hydro_model.base_parameters import BaseMap, base_map
from hydro_model.cylinder import lever, piston_force
from hydro_model.rigid_body import regressor
from hydro_model.robot import FloatArray, Robot

#: A parameter whose column resembles the others this much is not told apart from them.
MAX_COLLINEARITY = 1.0e3
#: A joint that never leaves a band of this many encoder counts stands still; so does one that
#: moves less than `STILL_RANGE`, where friction hides everything else.
STILL_COUNTS = 200.0
STILL_RANGE = 0.01


@dataclass(frozen=True, slots=True)
class Motion:
    """Filtered motion of one trace; edges not yet trimmed.

    Attributes
    ----------
    q, qd, qdd : (N, n) array
    """

    q: FloatArray
    qd: FloatArray
    qdd: FloatArray


#: Piston forces (N, m, e) of the listed effects at unit linear parameters.
ForceColumns = Callable[[Trace, Motion], FloatArray]


@dataclass(frozen=True, slots=True)
class ForceModel:
    """The linear model of the force channels.

    Attributes
    ----------
    robot : Robot
    base : BaseMap
    channels : tuple of str
        `<joint>/force`, or `<joint>/torque` for a joint without cylinder.
    names : tuple of str
        Base parameters, `<cylinder>.viscous_friction`, then the listed effects'.
    torque : bool
        Joint torques were measured, not chamber pressures.
    effect_names : tuple of str
    effect_columns : callable or None
        Gives the (N, m, e) piston forces of unit parameters, opposing motion.
    """

    robot: Robot
    base: BaseMap
    channels: tuple[str, ...]
    names: tuple[str, ...]
    torque: bool = False
    effect_names: tuple[str, ...] = ()
    effect_columns: ForceColumns | None = None

    @property
    def units(self) -> tuple[str, ...]:
        """Unit of each channel."""
        return tuple("N" if c.endswith("/force") else "N m" for c in self.channels)


def force_model(
    robot: Robot,
    torque: bool = False,
    effect_names: Sequence[str] = (),
    effect_columns: ForceColumns | None = None,
) -> ForceModel:
    """The linear force model of a robot.

    Parameters
    ----------
    robot : Robot
    torque : bool
        Use measured joint torques on every joint instead of chamber pressures.
    effect_names : sequence of str
        Linear parameters of listed effects.
    effect_columns : callable, optional
        Their columns.

    Returns
    -------
    ForceModel
    """
    driven = set() if torque else {cylinder.joint for cylinder in robot.cylinders}
    channels = tuple(f"{j}/{'force' if j in driven else 'torque'}" for j in robot.joint_names)
    base = base_map(robot)
    friction = tuple(f"{c.name}.viscous_friction" for c in robot.cylinders)
    names = (*base.names, *friction, *effect_names)
    return ForceModel(robot, base, channels, names, torque, tuple(effect_names), effect_columns)


def measured_force(model: ForceModel, trace: Trace) -> FloatArray:
    """Piston force (eq. 9) or measured torque of every joint, shape (N, n); NaN where unknown."""
    robot = model.robot
    result = trace.joint_torque.copy()
    for i, cylinder in enumerate(() if model.torque else robot.cylinders):
        at = robot.joint_index(cylinder.joint)
        result[:, at] = piston_force(cylinder, trace.p_a[:, i], trace.p_b[:, i])
    return result


def force_columns(model: ForceModel, trace: Trace, moved: Motion) -> FloatArray:
    """Regressor of every channel before the parallel filter, shape (N, n, p)."""
    robot = model.robot
    inertial = regressor(robot, moved.q, moved.qd, moved.qdd)[..., list(model.base.leading)]
    friction = np.zeros((*moved.q.shape, len(robot.cylinders)))
    effects = np.zeros((*moved.q.shape, len(model.effect_names)))
    forces = model.effect_columns(trace, moved) if model.effect_columns is not None else None
    for i, cylinder in enumerate(robot.cylinders):
        at = robot.joint_index(cylinder.joint)
        arm = lever(cylinder, moved.q[:, at])
        friction[:, at, i] = arm * moved.qd[:, at]
        if forces is not None:
            effects[:, at] = forces[:, i]
        if model.torque:
            friction[:, at] *= arm[:, None]
            effects[:, at] *= arm[:, None]
        else:
            inertial[:, at] /= arm[:, None]
    return np.concatenate([inertial, friction, effects], axis=2)


def force_rows(
    model: ForceModel,
    trace: Trace,
    settings: FilterSettings,
    still: Sequence[int] = (),
) -> Rows | None:
    """Filtered and decimated rows of one trace.

    Parameters
    ----------
    model : ForceModel
    trace : Trace
    settings : FilterSettings
    still : sequence of int
        Joints that stand still throughout: held at their mean, so that encoder noise cannot
        pass for motion.

    Returns
    -------
    Rows or None
        One channel per joint. None where the trace is shorter than the filter's edges, or a
        joint angle or every force is missing: each force needs all the angles.
    """
    keep = kept_samples(trace.samples, trace.step_s, settings)
    force = measured_force(model, trace)
    known = np.isfinite(force).all(axis=0)
    if keep.size < 2 or not known.any() or not np.isfinite(trace.q).all():
        return None
    q = trace.q.copy()
    q[:, list(still)] = q[:, list(still)].mean(axis=0)
    moved = Motion(*motion(q, trace.step_s, settings))
    x = parallel_filter(force_columns(model, trace, moved), trace.step_s, settings)
    # The forces pass the encoders' filter too: both sides of the equation are treated alike.
    force[:, known] = low_pass(
        force[:, known], trace.step_s, settings.differentiation_hz, settings.order
    )
    y = np.full((keep.size, force.shape[1]), np.nan)
    y[:, known] = parallel_filter(force[:, known], trace.step_s, settings)
    return Rows(y, x, trace.time_s[keep], trace.label)


def still_joints(robot: Robot, traces: Sequence[Trace]) -> tuple[int, ...]:
    """Joints that do not move in any of the traces.

    Parameters
    ----------
    robot : Robot
    traces : sequence of Trace

    Returns
    -------
    tuple of int
    """
    count = 2.0 * np.pi / robot.sensors.encoder_counts_per_rev
    least = max(STILL_RANGE, STILL_COUNTS * count)
    low = np.min([trace.q.min(axis=0) for trace in traces], axis=0)
    high = np.max([trace.q.max(axis=0) for trace in traces], axis=0)
    return tuple(int(i) for i in np.flatnonzero(~(high - low >= least)))


@dataclass(frozen=True, slots=True)
class InertialFit:
    """Base parameters and viscous friction of a robot.

    Attributes
    ----------
    model : ForceModel
    fit : Fit
    identifiable : tuple of bool
        Per name of the model, see `identifiable_parameters`.
    still : tuple of int
        Joints that did not move.
    settings : FilterSettings
    """

    model: ForceModel
    fit: Fit
    identifiable: tuple[bool, ...]
    still: tuple[int, ...]
    settings: FilterSettings

    @property
    def missing(self) -> tuple[str, ...]:
        """Names that the data do not determine."""
        pairs = zip(self.model.names, self.identifiable, strict=True)
        return tuple(name for name, known in pairs if not known)


def fit_inertial(
    model: ForceModel,
    traces: Sequence[Trace],
    settings: FilterSettings | None = None,
    select: Callable[[Rows], Rows] | None = None,
) -> InertialFit | None:
    """Weighted least squares of the force channels over all traces.

    Parameters
    ----------
    model : ForceModel
    traces : sequence of Trace
    settings : FilterSettings, optional
    select : callable, optional
        Picks the rows that take part in the fit.

    Returns
    -------
    InertialFit or None
        None where no trace carries a force with all joint angles.
    """
    settings = settings or FilterSettings()
    usable = [t for t in traces if np.isfinite(t.q).all()]
    if not usable:
        return None
    still = still_joints(model.robot, usable)
    pieces = [force_rows(model, trace, settings, still) for trace in usable]
    chosen = [p if select is None else select(p) for p in pieces if p is not None]
    chosen = [p for p in chosen if p.time_s.size]
    if sum(int(np.isfinite(p.y).sum()) for p in chosen) <= 10 * len(model.names):
        return None
    fit = weighted_least_squares(chosen)
    return InertialFit(model, fit, identifiable_parameters(model, fit), still, settings)


def identifiable_parameters(model: ForceModel, fit: Fit) -> tuple[bool, ...]:
    """Which parameters the recorded motion determines.

    Two conditions of the regressor, none of the value found: its column is not a combination of
    the others (`Fit.collinearity` below `MAX_COLLINEARITY`; joints that stand still have been
    held exactly, so that their columns degenerate exactly), and its standard deviation stays
    below what the parameter could be at most on a machine of this size (`parameter_scales`).
    """
    scales = parameter_scales(model)
    return tuple(
        bool(c < MAX_COLLINEARITY and s < scale)
        for c, s, scale in zip(fit.collinearity, fit.std, scales, strict=True)
    )


def parameter_scales(model: ForceModel) -> FloatArray:
    """Largest plausible size of every parameter: total mass times powers of the reach.

    For friction, the force limit of the joint's cylinder over its rated speed; for effects,
    infinity (their bounds are the catalogue's).
    """
    robot = model.robot
    mass = max(float(robot.link_inertia[:, 0].sum()), 1.0)
    reach = sum(float(np.linalg.norm(j.translation_m)) for j in robot.joints)
    reach = max(reach + float(np.linalg.norm(robot.tip_offset_m)), 0.1)
    scales = []
    for name in model.base.names:
        kind = name.rsplit(".", 1)[-1]
        power = 0 if kind == "mass" else 1 if kind.startswith("mc") else 2
        scales.append(mass * reach**power)
    for cylinder in robot.cylinders:
        joint = robot.joints[robot.joint_index(cylinder.joint)]
        arm = np.abs(lever(cylinder, np.linspace(joint.lower, joint.upper, 21))).max()
        scales.append(joint.effort_limit / arm / (joint.velocity_limit * arm))
    return np.array([*scales, *[np.inf] * len(model.effect_names)])
