"""Where joints rest at the ends of their travel: what a stop bears is in no measured force."""

from __future__ import annotations

from collections.abc import Container

import numpy as np

from hydro_ident.estimate.signals.derivatives import FilterSettings, motion
from hydro_ident.estimate.signals.traces import Trace
from hydro_model.arrays import BoolArray
from hydro_model.hydraulics.cylinder import lever
from hydro_model.robot import FloatArray, Robot

#: A piston so near to an end of its stroke may lie there, m; so may a joint at a limit, m or rad.
_NEAR = 4.0e-3
#: What is slower rests, m/s or rad/s.
_RESTS = 1.0e-3
#: Samples of which velocities are differences.
_LEAST = 5


def at_end_stops(
    robot: Robot, trace: Trace, settings: FilterSettings, still: Container[int] = ()
) -> BoolArray:
    """Samples in which a joint's filtered force may have a part of what its stop bears, (N, n).

    Under pressure a piston pushes its stop with up to the supply's whole force, which the equation
    of its own joint does not know; those of the others hold.

    Parameters
    ----------
    robot : Robot
    trace : Trace
        Every joint's angle is known.
    settings : FilterSettings
        Its filters, as quick as the trace bears them, carry what happens at a stop so far.
    still : container of int
        Joints that never move: without their rows nothing would be left of the others.
    """
    result = np.zeros(trace.q.shape, dtype=np.bool_)
    moving = [j for j in range(robot.dof) if j not in still]
    near = {j: _near_an_end(robot, trace, j) for j in moving}
    if trace.samples < _LEAST or not any(where.any() for where in near.values()):
        return result
    settings = settings.borne_at(trace.step_s)
    _, speed, _ = motion(trace.q, trace.step_s, settings)
    for cylinder in robot.cylinders:
        at = robot.joint_index(cylinder.joint)
        speed[:, at] *= lever(cylinder, trace.q[:, at])
    for joint, where in near.items():
        own = where & (np.abs(speed[:, joint]) < _RESTS)
        result[:, joint] = _reached(own, settings.edge_samples(trace.step_s))
    return result


def _near_an_end(robot: Robot, trace: Trace, joint: int) -> BoolArray:
    place, q = robot.joints[joint], trace.q[:, joint]
    near = _beside(q, place.lower, place.upper)
    for i, cylinder in enumerate(robot.cylinders):
        if robot.joint_index(cylinder.joint) == joint:
            near |= _beside(trace.stroke[:, i], 0.0, cylinder.stroke_m)
    return near


def _beside(values: FloatArray, low: float, high: float) -> BoolArray:
    # What goes on beyond a limit of the file has not met its stop there.
    return np.asarray((np.abs(values - low) < _NEAR) | (np.abs(values - high) < _NEAR))


def _reached(mask: BoolArray, samples: int) -> BoolArray:
    """A mask widened by so many samples either way."""
    if not mask.any():
        return mask
    before = np.concatenate([[0], np.cumsum(mask)])
    at = np.arange(mask.size)
    last = np.minimum(at + samples + 1, mask.size)
    return np.asarray(before[last] > before[np.maximum(at - samples, 0)])
