"""What zeros of transducers do to a model's numbers: `hydro_ident.estimate.forces.zeros`."""

from __future__ import annotations

import math

import numpy as np

from hydro_ident.estimate.forces.force_rows import pressed_joints
from hydro_ident.mismatch.fitting.fitted import Fitted
from hydro_ident.mismatch.rows.prediction import Predictor
from hydro_ident.transducers import zero_pa
from hydro_model.robot import FloatArray


def of_zeros(predictor: Predictor, fitted: Fitted) -> FloatArray:
    """What the usual zeros of all transducers add to a fit's covariance.

    A zero that is off is a constant force in a recording of any length: the fit takes it for
    weight (or for what was found, such as a bias), and no residual shows it.

    Parameters
    ----------
    predictor : Predictor
    fitted : Fitted

    Returns
    -------
    (p, p) array
        By `Fitted.names`; zero of what is held.
    """
    material, rows = predictor.material, fitted.bench.layout.channel
    robot, zero = material.robot, zero_pa(material.robot)
    areas = {
        robot.joint_index(c.joint): math.hypot(c.area_a_m2, c.area_b_m2) for c in robot.cylinders
    }
    total = np.zeros((len(fitted.names), len(fitted.names)))
    for joint in pressed_joints(material.forces):
        channel = material.forces.channels[joint]
        if channel in material.channels:
            push = np.where(rows == material.channels.index(channel), areas[joint] * zero, 0.0)
            moved = fitted.bench.refit(push)
            total += np.outer(moved, moved)
    return total
