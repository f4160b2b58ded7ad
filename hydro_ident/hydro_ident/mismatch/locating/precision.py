"""How well a channel is known at all: what is smaller is no finding, however significant."""

from __future__ import annotations

import math

import numpy as np

from hydro_ident.mismatch.fitting.training import Training
from hydro_ident.mismatch.rows.material import Material
from hydro_ident.mismatch.rows.prediction import Model
from hydro_ident.mismatch.settings import PRECISION_UNCONFIRMED
from hydro_ident.transducers import ACCURACY, DRIFT
from hydro_model.robot import FloatArray


def measured_sizes(training: Training, model: Model) -> FloatArray:
    """Root mean square of what each channel measures on the training rows, (K,), in its unit.

    Of a channel without rows, or that measures nothing, 1.
    """
    material = training.predictor.material
    y, _ = training.predictor.base(model)
    sums = np.bincount(
        material.channel[training.mask],
        weights=y[training.mask] ** 2,
        minlength=len(material.channels),
    )
    counts = np.bincount(material.channel[training.mask], minlength=len(material.channels))
    sizes = np.sqrt(sums / np.maximum(counts, 1))
    return np.where(sizes > 0.0, sizes, 1.0)


def measured_size(training: Training, model: Model, channel: int) -> float:
    """That of one channel, as `measured_sizes`."""
    return float(measured_sizes(training, model)[channel])


def least_unconfirmed(training: Training, model: Model, channel: int) -> float:
    """Size below which nothing counts that no other recording can confirm, in a channel's unit.

    Parameters
    ----------
    training : Training
    model : Model
    channel : int
    """
    least = PRECISION_UNCONFIRMED * measured_size(training, model, channel)
    return max(least, drift_of(training.predictor.material, channel))


def drift_of(material: Material, channel: int) -> float:
    """What slowly drifting transducers make of a channel, in its unit; 0 where it has none.

    Parameters
    ----------
    material : Material
    channel : int
    """
    return DRIFT * _of_full_range(material, channel)


def accuracy_of(material: Material, channel: int) -> float:
    """What transducers of the usual class make of a channel, rms, in its unit; 0 as `drift_of`.

    Parameters
    ----------
    material : Material
    channel : int
    """
    return ACCURACY * _of_full_range(material, channel)


def _of_full_range(material: Material, channel: int) -> float:
    """Force of both chambers' pressure ranges, as of errors that know nothing of each other."""
    robot = material.robot
    if material.is_flow(channel) or material.forces.torque:
        return 0.0
    joint = robot.joint_names[material.joint_of(channel)]
    areas = [(c.area_a_m2, c.area_b_m2) for c in robot.cylinders if c.joint == joint]
    return robot.sensors.pressure_range_pa * max((math.hypot(*a) for a in areas), default=0.0)
