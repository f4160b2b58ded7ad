"""Rows of the force channels: piston forces (or joint torques) and their regressor.

One row per joint and kept sample, in newtons at the piston (or in N m where a joint torque is
measured): eq. 18's torque rows divided by the lever, so that channels are piston forces and the
friction column is the piston's velocity (eq. 18 prints ``(dx/dq)^2`` without the joint velocity;
power 2 is right in torque rows). Regressor and regressand pass the same filter.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hydro_ident.estimate.forces.end_stops import at_end_stops
from hydro_ident.estimate.forces.standstill import Rest, giving_way, held_still
from hydro_ident.estimate.signals.derivatives import (
    FilterSettings,
    kept_samples,
    low_pass,
    motion,
    parallel_filter,
)
from hydro_ident.estimate.signals.traces import Trace
from hydro_ident.estimate.statistics.rows import Rows
from hydro_model.hydraulics.cylinder import lever, piston_force
from hydro_model.multibody.base_parameters import BaseMap, base_map
from hydro_model.multibody.rigid_body import regressor
from hydro_model.multibody.square_axes import squared
from hydro_model.robot import FloatArray, Robot


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


@dataclass(frozen=True, slots=True)
class LateForce:
    """Forces that are as though read late, and a friction that it moves.

    Attributes
    ----------
    channels : tuple of str
        Of the force model, all with the same time.
    late_s, std_s : float
        Negative: read before the positions.
    friction : str
        Name of the parameter.
    value : float
        That it has with the time fitted beside it.
    """

    channels: tuple[str, ...]
    late_s: float
    std_s: float
    friction: str
    value: float


#: Piston forces (joint forces where there is no cylinder) of the listed effects at unit linear
#: parameters, (N, n, e) by joint.
ForceColumns = Callable[[Trace, Motion], FloatArray]
#: Joint torques (N, n) of what is taken as listed.
HeldTorque = Callable[[Trace, Motion], FloatArray]


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
        Base parameters, `<cylinder>.viscous_friction`, `<joint>.viscous_friction` of joints
        without cylinder, then the listed effects'.
    torque : bool
        Joint torques were measured, not chamber pressures.
    effect_names : tuple of str
    effect_columns : callable or None
        Gives the (N, n, e) piston forces of unit parameters, opposing motion.
    effect_values : tuple of float
        As the robot file lists them; empty where nothing is to stay as listed.
    held : callable or None
        Gives the (N, n) joint torques of listed effects that are not fitted.
    corrected : callable or None
        Gives the trace without the errors of sensors that the robot file lists.
    """

    robot: Robot
    base: BaseMap
    channels: tuple[str, ...]
    names: tuple[str, ...]
    torque: bool = False
    effect_names: tuple[str, ...] = ()
    effect_columns: ForceColumns | None = None
    effect_values: tuple[float, ...] = ()
    held: HeldTorque | None = None
    corrected: Callable[[Trace], Trace] | None = None

    @property
    def units(self) -> tuple[str, ...]:
        """Unit of each channel."""
        linear = [c.endswith("/force") for c in self.channels]
        slides = [joint.prismatic for joint in self.robot.joints]
        return tuple("N" if a or b else "N m" for a, b in zip(linear, slides, strict=True))


def force_model(
    robot: Robot,
    torque: bool = False,
    effect_names: Sequence[str] = (),
    effect_columns: ForceColumns | None = None,
    parts: bool = True,
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
    parts : bool
        With the parameters of barrels and rods that do not regroup with the links'.

    Returns
    -------
    ForceModel
        Base parameters are those of the robot with axes that are as good as parallel or square
        taken for that (`hydro_model.multibody.square_axes`): what shows by the rounding of an
        angle alone is none.
    """
    driven = set() if torque else {cylinder.joint for cylinder in robot.cylinders}
    channels = tuple(f"{j}/{'force' if j in driven else 'torque'}" for j in robot.joint_names)
    base = base_map(squared(robot)[0])
    base = base if parts else base.of_links
    movers = [c.name for c in robot.cylinders] + [robot.joint_names[j] for j in robot.dry_joints]
    friction = tuple(f"{name}.viscous_friction" for name in movers)
    names = (*base.names, *friction, *effect_names)
    return ForceModel(robot, base, channels, names, torque, tuple(effect_names), effect_columns)


def pressed_joints(model: ForceModel) -> list[int]:
    """Joints whose forces are those of chamber pressures."""
    return [j for j, name in enumerate(model.channels) if name.endswith("/force")]


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
    wet = len(robot.cylinders)
    friction = np.zeros((*moved.q.shape, wet + len(robot.dry_joints)))
    effects = np.zeros((*moved.q.shape, len(model.effect_names)))
    if model.effect_columns is not None:
        effects = model.effect_columns(trace, moved)
    for i, at in enumerate(robot.dry_joints):
        friction[:, at, wet + i] = moved.qd[:, at]
    for i, cylinder in enumerate(robot.cylinders):
        at = robot.joint_index(cylinder.joint)
        arm = lever(cylinder, moved.q[:, at])
        friction[:, at, i] = arm * moved.qd[:, at]
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
    still: Mapping[int, Rest] | None = None,
    instruments: bool = False,
) -> Rows | None:
    """Filtered and decimated rows of the samples that a trace owns.

    Parameters
    ----------
    model : ForceModel
    trace : Trace
    settings : FilterSettings
        As quick as the trace bears them: the equation holds under any filter of both its sides.
    still : mapping of int to Rest, optional
        Joints that stand still throughout.
    instruments : bool
        Add the regressor of the recorded reference: what the motion was to be knows nothing of
        the encoders' noise. Rows without it are NaN.

    Returns
    -------
    Rows or None
        One channel per joint, unknown at its end stops and of a joint that stands still but gives
        way. None where the trace is shorter than the filter's edges, or a joint angle or every
        force is missing: each force needs all the angles.
    """
    if model.corrected is not None:
        trace = model.corrected(trace)
    settings = settings.borne_at(trace.step_s)
    keep = kept_samples(trace.samples, trace.step_s, settings, trace.cycle, trace.core)
    force = measured_force(model, trace)
    known = np.isfinite(force).all(axis=0)
    if not keep.size or not known.any() or not np.isfinite(trace.q).all():
        return None
    still = still or {}
    stopped = at_end_stops(model.robot, trace, settings, still)[keep]
    q = held_still(trace.q, still)
    x = _filtered_columns(model, trace, q, settings, keep)
    z = None
    if instruments:
        z = np.full(x.shape, np.nan)
        if trace.q_ref is not None:
            wanted = held_still(trace.q_ref, still)
            # Of what gives way the reference knows nothing.
            giving = giving_way(still)
            wanted[:, giving] = q[:, giving]
            z = _filtered_columns(model, trace, wanted, settings, keep)
    # The forces pass the encoders' filter too: both sides of the equation are treated alike.
    force[:, known] = low_pass(
        force[:, known], trace.step_s, settings.differentiation_hz, settings.order
    )
    y = np.full((keep.size, force.shape[1]), np.nan)
    y[:, known] = parallel_filter(force[:, known], trace.step_s, settings, keep)
    if model.held is not None:
        y -= _held(model, trace, q, settings, keep)
    y[stopped] = np.nan
    y[:, giving_way(still)] = np.nan
    step_s = settings.decimation(trace.step_s) * trace.step_s
    time_s = trace.time_s[keep]
    return Rows(y, x, time_s, trace.label, z, step_s, settings.stride(trace.step_s))


def _held(
    model: ForceModel,
    trace: Trace,
    q: FloatArray,
    settings: FilterSettings,
    keep: NDArray[np.intp],
) -> FloatArray:
    """What the channels owe to effects that are taken as listed, filtered, (kept, n)."""
    moved = Motion(*motion(q, trace.step_s, settings))
    torque = np.zeros_like(q) if model.held is None else model.held(trace, moved)
    for cylinder in () if model.torque else model.robot.cylinders:
        at = model.robot.joint_index(cylinder.joint)
        torque[:, at] /= lever(cylinder, moved.q[:, at])
    return parallel_filter(torque, trace.step_s, settings, keep)


def _filtered_columns(
    model: ForceModel,
    trace: Trace,
    q: FloatArray,
    settings: FilterSettings,
    keep: NDArray[np.intp],
) -> FloatArray:
    moved = Motion(*motion(q, trace.step_s, settings))
    return parallel_filter(force_columns(model, trace, moved), trace.step_s, settings, keep)
