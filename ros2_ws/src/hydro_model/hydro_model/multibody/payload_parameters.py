"""A body fixed to the tip: its parameters in the base parameters, and what of it can be told.

The body's own frame lies at the tip with the axes of the last link. Carried all the time it is a
part of the last link: its parameters regroup with the link's. Between a recording with it and one
without, the base parameters change by ``D payload`` and show the payload as far as D goes.
"""

from __future__ import annotations

import numpy as np

from hydro_model.multibody.spatial import motion_transform, spatial_inertia
from hydro_model.robot import STANDARD_PARAMETERS, FloatArray, Robot

_SIZE = len(STANDARD_PARAMETERS)
PAYLOAD_NAMES = tuple(f"payload.{p}" for p in STANDARD_PARAMETERS)


def inertia_map(transform: FloatArray) -> FloatArray:
    """The (10, 10) map of parameters in a child frame to the same body's in its parent.

    Parameters
    ----------
    transform : (6, 6) array
        X from the parent to the child frame.
    """
    upper = np.triu_indices(3)
    columns = []
    for unit in np.eye(_SIZE):
        moved = transform.T @ spatial_inertia(unit) @ transform
        first = [moved[2, 4], moved[0, 5], moved[1, 3]]
        columns.append([moved[3, 3], *first, *moved[:3, :3][upper]])
    return np.array(columns).T


def payload_effect(robot: Robot, combination: FloatArray) -> FloatArray:
    """D: change of the base parameters per parameter of the payload.

    Parameters
    ----------
    robot : Robot
    combination : (p, c) array
        K, the links' columns first.

    Returns
    -------
    (p, 10) array
    """
    last = _SIZE * (robot.dof - 1)
    at_tip = motion_transform(np.eye(3), np.asarray(robot.tip_offset_m))
    return np.asarray(combination[:, last : last + _SIZE] @ inertia_map(at_tip))
