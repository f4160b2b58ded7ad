"""Forces of a stretch as its rows have them: measured, of late readings, of torques."""

from __future__ import annotations

import numpy as np

from hydro_ident.estimate.forces.force_rows import measured_force
from hydro_ident.estimate.signals.derivatives import low_pass, smooth_rates
from hydro_ident.mismatch.rows.material import Material, Stretch
from hydro_model.hydraulics.cylinder import lever
from hydro_model.robot import FloatArray, Robot


def measured(material: Material, stretch: Stretch) -> FloatArray:
    """Measured forces of a stretch on its rows, (T, n)."""
    force = measured_force(material.forces, stretch.trace)
    settings = material.filters
    finite = np.where(np.isfinite(force), force, 0.0)
    smooth = low_pass(finite, stretch.trace.step_s, settings.differentiation_hz, settings.order)
    return material.filtered(stretch, smooth)


def skewed(material: Material, stretch: Stretch) -> FloatArray:
    """What measured forces are off by per second that a reading is late, (T, 2 c + n).

    Chambers a and b of each cylinder in turn, then the joints' torques.
    """
    trace, settings = stretch.trace, material.filters
    areas = [area for c in material.robot.cylinders for area in (-c.area_a_m2, c.area_b_m2)]
    pressures = np.stack([trace.p_a, trace.p_b], axis=2).reshape(trace.samples, -1)
    slopes = np.array(areas) * smooth_rates(pressures, trace.step_s, settings)
    late = -smooth_rates(trace.joint_torque, trace.step_s, settings)
    return material.filtered(stretch, np.concatenate([slopes, late], axis=1))


def forces_of(
    material: Material, robot: Robot, stretch: Stretch, torques: FloatArray
) -> FloatArray:
    """Torques (N, n) of all joints as the force channels have them, on a stretch's rows, (T, n).

    Parameters
    ----------
    material : Material
    robot : Robot
    stretch : Stretch
        With its motion.
    torques : (N, n) array
    """
    if stretch.moved is None or material.forces.torque:
        return material.filtered(stretch, torques)
    forces = torques.copy()
    for cylinder in robot.cylinders:
        joint = robot.joint_index(cylinder.joint)
        forces[:, joint] /= lever(cylinder, stretch.moved.q[:, joint])
    return material.filtered(stretch, forces)
