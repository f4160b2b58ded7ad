"""Ranges of joints with finite ends, for whoever draws, samples or takes the middle of them."""

from __future__ import annotations

import numpy as np

from hydro_model.robot import FloatArray, Robot

#: A joint without limits is looked at over a turn, or this many metres either way.
_ENDLESS_M = 1.0


def limits(robot: Robot) -> FloatArray:
    """Lower and upper limit of every joint, finite, (n, 2)."""
    rows = []
    for joint in robot.joints:
        reach = _ENDLESS_M if joint.prismatic else np.pi
        low = joint.lower if np.isfinite(joint.lower) else -reach
        rows.append((low, joint.upper if np.isfinite(joint.upper) else reach))
    return np.array(rows, dtype=np.float64)


def middle(robot: Robot) -> FloatArray:
    """The middle of every joint's range, (n,); of one without an end, of what it is looked at in.

    Parameters
    ----------
    robot : Robot
    """
    return np.asarray(limits(robot).mean(axis=1))
