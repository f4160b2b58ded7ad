"""Static poses that tell first moments apart, chosen one by one from feasible candidates."""

from __future__ import annotations

import numpy as np

from hydro_ident.design.information import ForceInformation
from hydro_ident.design.limits import Limits, half_range, limit_ratios
from hydro_model.multibody.joint_ranges import middle
from hydro_model.robot import FloatArray

#: Poses that are tried, and the most of a limit that one of them may use.
CANDIDATES, _NEAR = 400, 0.95
#: Share of a joint's range to either side of its middle: room to move about a pose.
_SPREAD = 0.8
#: What is unknown beforehand, as a share of what all the candidates together would tell.
_RIDGE = 1.0e-4


def static_poses(
    information: ForceInformation, limits: Limits, count: int, seed: int
) -> FloatArray:
    """Poses that add the most to what is known, each given those before (greedy D-optimal).

    Parameters
    ----------
    information : ForceInformation
    limits : Limits
    count : int
    seed : int
        Of the candidates.

    Returns
    -------
    (k, n) array
        `count` poses; empty where the robot cannot stand anywhere within the limits.
    """
    robot = information.robot
    rng = np.random.default_rng(seed)
    poses = middle(robot) + _SPREAD * half_range(robot) * rng.uniform(
        -1.0, 1.0, (CANDIDATES, robot.dof)
    )
    still = np.zeros_like(poses)
    poses = poses[limit_ratios(robot, limits, poses, still, still).max(axis=1) <= _NEAR]
    if not len(poses):
        return np.asarray(poses)
    still = np.zeros_like(poses)
    x = information.columns(poses, still, still)
    # At rest no column but those of gravity says anything.
    felt = np.abs(x).max(axis=(0, 1)) > 0.0
    x = x[..., felt]
    if not felt.any():
        return np.asarray(np.tile(poses[:1], (count, 1)))
    each = np.einsum("tkp,tkq->tpq", x, x)
    scale = np.sqrt(np.einsum("tii->i", each))
    each /= np.outer(scale, scale)
    known = _RIDGE * np.eye(len(scale))
    chosen = []
    for _ in range(count):
        gain = np.linalg.slogdet(known + each)[1]
        best = int(np.argmax(gain))
        known = known + each[best]
        chosen.append(best)
    return np.asarray(poses[chosen])


def short_order(start: FloatArray, poses: FloatArray) -> list[int]:
    """Indices of the poses, each the nearest to the one before.

    `start` (n,) is the pose before the first.
    """
    left, at, order = list(range(len(poses))), start, list[int]()
    while left:
        nearest = min(left, key=lambda i: float(np.abs(poses[i] - at).max()))
        left.remove(nearest)
        order.append(nearest)
        at = poses[nearest]
    return order
