"""Strokes, lever arms and loads at rest of a robot's cylinders over its joints' ranges."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from hydro_model.hydraulics.cylinder import inside_stroke, lever, stroke
from hydro_model.multibody.joint_ranges import limits
from hydro_model.multibody.rigid_body import inverse_dynamics, mass_matrix
from hydro_model.robot import Cylinder, FloatArray, Robot

#: Positions along a joint's range, poses of the other joints at each.
POSITIONS, OTHERS = 201, 33
#: Poses drawn for the mass matrix.
POSES = 256
#: Force is not divided by a lever shorter than this part of the longest one.
_NO_LEVER = 1e-3


def drawn_poses(robot: Robot, count: int = POSES) -> FloatArray:
    """Poses within the limits, always the same: the ranges' middle and corners, then at random.

    Parameters
    ----------
    robot : Robot
    count : int
        Of the random ones.

    Returns
    -------
    (N, n) array
    """
    low, high = limits(robot).T
    n = min(robot.dof, 8)
    corners = np.array(np.meshgrid(*[[0.0, 1.0]] * n, indexing="ij")).reshape(n, -1).T
    corners = np.hstack([corners, np.full((len(corners), robot.dof - n), 0.5)])
    draws = np.random.default_rng(0).uniform(size=(count, robot.dof))
    shares = np.vstack([np.full((1, robot.dof), 0.5), corners, draws])
    return np.asarray(low + shares * (high - low))


def least_inertia(robot: Robot) -> tuple[float, FloatArray]:
    """The smallest eigenvalue of the mass matrix over the drawn poses, and its pose.

    Masses that make no machine often show at an end of the ranges alone.

    Parameters
    ----------
    robot : Robot

    Returns
    -------
    float, (n,) array
        Above 0 where the matrix is positive definite in all of them.
    """
    poses = drawn_poses(robot)
    smallest = np.linalg.eigvalsh(mass_matrix(robot, poses))[:, 0]
    worst = int(smallest.argmin())
    return float(smallest[worst]), poses[worst]


@dataclass(frozen=True, slots=True)
class CylinderRange:
    """One cylinder over its joint's range.

    Attributes
    ----------
    cylinder : Cylinder
    unit : str
        Of the joint: `rad` or `m`.
    q, stroke_m, lever_m : (N,) array
        Joint positions; piston displacement; dx/dq.
    load_low_n, load_high_n : (N,) array
        Smallest and largest piston force at rest, over poses of the other joints; NaN at a dead
        centre.
    pull_n, push_n : float
        Forces of the full supply pressure on either side, tank pressure on the other.
    """

    cylinder: Cylinder
    unit: str
    q: FloatArray
    stroke_m: FloatArray
    lever_m: FloatArray
    load_low_n: FloatArray
    load_high_n: FloatArray
    pull_n: float
    push_n: float

    @property
    def dead_centres(self) -> tuple[float, ...]:
        """Joint positions inside the limits where the lever arm is zero."""
        if self.cylinder.l1_m == 0.0:
            return ()
        first, last = ((self.q[k] + self.cylinder.q0_rad) / np.pi for k in (0, -1))
        turns = range(int(np.ceil(first)), int(np.floor(last)) + 1)
        return tuple(float(k * np.pi - self.cylinder.q0_rad) for k in turns)

    @property
    def inside(self) -> tuple[float, float] | None:
        """The longest stretch of joint positions whose strokes the cylinder has."""
        return inside_stroke(self.cylinder, self.q)

    @property
    def worst_force_n(self) -> float:
        """The load at rest that is largest beside what the supply gives; NaN where none is."""
        loads = np.concatenate([self.load_low_n, self.load_high_n])
        if not np.isfinite(loads).any() or not (self.pull_n < 0.0 < self.push_n):
            return float("nan")
        return float(loads[np.nanargmax(self._shares(loads))])

    @property
    def load_share(self) -> float:
        """That load as a share of what the supply gives in its direction."""
        return float(self._shares(np.array(self.worst_force_n)))

    def _shares(self, loads: FloatArray) -> FloatArray:
        return np.asarray(np.where(loads >= 0.0, loads / self.push_n, loads / self.pull_n))

    def as_dict(self) -> dict[str, Any]:
        """For a JSON file."""
        share = self.load_share
        return {
            "name": self.cylinder.name,
            "joint": self.cylinder.joint,
            "joint_range": [float(self.q[0]), float(self.q[-1])],
            "stroke_range_m": [float(self.stroke_m.min()), float(self.stroke_m.max())],
            "stroke_m": self.cylinder.stroke_m,
            "lever_range_m": [float(self.lever_m.min()), float(self.lever_m.max())],
            "dead_centres": list(self.dead_centres),
            "load_share": share if np.isfinite(share) else None,
        }


def cylinder_ranges(robot: Robot) -> tuple[CylinderRange, ...]:
    """Every cylinder of a robot over its joint's range.

    Parameters
    ----------
    robot : Robot

    Returns
    -------
    tuple of CylinderRange
    """
    return tuple(_range(robot, cylinder) for cylinder in robot.cylinders)


def _range(robot: Robot, cylinder: Cylinder) -> CylinderRange:
    at = robot.joint_index(cylinder.joint)
    low, high = limits(robot)[at]
    q = np.linspace(low, high, POSITIONS)
    arm = lever(cylinder, q)
    others = drawn_poses(robot, OTHERS)
    poses = np.repeat(others[None], len(q), axis=0)
    poses[:, :, at] = q[:, None]
    still = np.zeros((poses.size // robot.dof, robot.dof))
    torque = inverse_dynamics(robot, poses.reshape(still.shape), still, still)[:, at]
    held = np.abs(arm) > _NO_LEVER * np.abs(arm).max()
    force = torque.reshape(len(q), -1) / np.where(held, arm, np.nan)[:, None]
    p_s, p_t = robot.supply_pressure_pa, robot.tank_pressure_pa
    a, b = cylinder.area_a_m2, cylinder.area_b_m2
    return CylinderRange(
        cylinder=cylinder,
        unit="m" if robot.joints[at].prismatic else "rad",
        q=q,
        stroke_m=stroke(cylinder, q),
        lever_m=arm,
        load_low_n=force.min(axis=1),
        load_high_n=force.max(axis=1),
        pull_n=a * p_t - b * p_s,
        push_n=a * p_s - b * p_t,
    )
