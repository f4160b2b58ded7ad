"""Postures of chains whose joints are more than the place of their tip fixes."""

from __future__ import annotations

import numpy as np

from hydro_control.motion.required_motion import RANK_RATIO, damped_inverse
from hydro_model.multibody.kinematics import tip_jacobian, tip_state
from hydro_model.robot import FloatArray, Robot

#: The tip is at its place within this, m: what arithmetic leaves.
_AT_PLACE_M = 1e-10
#: From tracking errors of centimetres to arithmetic; no step turns or shifts a joint by more than
#: the longest, rad or m, so that far from the place the posture stays near the one measured.
_STEPS, _LONGEST_STEP = 6, 0.1


def is_redundant(robot: Robot, q: FloatArray) -> bool:
    """Whether joints can move while the tip stays where it is.

    Parameters
    ----------
    robot : Robot
    q : (n,) array
        Joint positions, rad or m.

    Returns
    -------
    bool
        Of a non-redundant chain True in an exactly singular pose alone.
    """
    values = np.linalg.svd(tip_jacobian(robot, q), compute_uv=False)
    rank = int(np.count_nonzero(values > RANK_RATIO * values[0]))
    return robot.dof > rank


def posture_at_tip(robot: Robot, tip_m: FloatArray, q: FloatArray) -> FloatArray:
    """Joint positions near others with the tip at a place: what the law steers to from there.

    A few steps of Newton's method by the law's own damped inverse, the first of which is the
    law's desired position. It always answers: where the place is too far away or the pose too
    near a singular one, by a posture on the way.

    Parameters
    ----------
    robot : Robot
    tip_m : (3,) array
        In the base frame.
    q : (n,) array
        Measured joint positions, rad or m.

    Returns
    -------
    (n,) array
    """
    found, still = np.array(q, dtype=float), np.zeros(len(q))
    for _ in range(_STEPS):
        position, jacobian, _rate = tip_state(robot, found, still)
        error = tip_m - position
        if np.linalg.norm(error) <= _AT_PLACE_M:
            break
        step = damped_inverse(jacobian)[0] @ error
        longest = float(np.max(np.abs(step)))
        found = found + step * min(1.0, _LONGEST_STEP / max(longest, _LONGEST_STEP))
    return found
