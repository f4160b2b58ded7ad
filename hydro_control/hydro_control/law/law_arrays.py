"""A robot, its limits and its gains as the arrays that the compiled control law works on."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hydro_control.gains import Gains
from hydro_control.motion.motion_limits import MotionLimits
from hydro_control.state.axes import Axis
from hydro_model.multibody.chain_arrays import chain_arrays
from hydro_model.multibody.chain_kernels import SCRATCH
from hydro_model.robot import FloatArray, Robot

# Columns of `LawArrays.cylinder` and `.edges`.
L1, L2, Q0, X0, AREA_A, AREA_B, STROKE, VISCOUS, BULK = range(9)
C_PA, C_AT, C_PB, C_BT = range(4)
# Columns of `LawArrays.at`.
CYLINDER, VALVE = range(2)
# Rows of `LawArrays.limits`, entries of `LawArrays.gains`.
SPEED, LOWER, UPPER, OPEN_LOWER, OPEN_UPPER = range(5)
K_P, K_V, K_F, K_X, TIP_SPEED, PRESSURE, SLEW = range(7)


class LawArrays(NamedTuple):
    """What the law knows of one robot, by joint; n joints, m cylinders and valves."""

    rotation: FloatArray  # (n, 3, 3)
    translation: FloatArray  # (n, 3)
    axis: FloatArray  # (n, 3)
    prismatic: NDArray[np.bool_]  # (n,)
    gravity: FloatArray  # (3,)
    theta: FloatArray  # (n, 11)
    parts: FloatArray  # (2 m, PART_COLUMNS) barrels and rods
    tip: FloatArray  # (3,) in the last joint's frame
    cylinder: FloatArray  # (n, 9)
    edges: FloatArray  # (n, 4)
    rated_v: FloatArray  # (n,)
    at: NDArray[np.int64]  # (n, 2) places in the robot's cylinders and valves
    limits: FloatArray  # (5, n) velocities, ends, and where the joints may be
    braking: FloatArray  # (2, n, POINTS) as of `hydro_control.motion.braking`
    gains: FloatArray  # (7,) the last is the greatest step of a voltage


class LawWork(NamedTuple):
    """Working memory of the kernels; contents carry nothing from sample to sample."""

    chain: FloatArray  # (n + 2 m, SCRATCH)
    point: FloatArray  # (3,) the tip
    jacobian: FloatArray  # (3, n) its Jacobian
    rate: FloatArray  # (3, n) the Jacobian's rate
    inverse: FloatArray  # (n, 3) the Jacobian's damped inverse
    columns: FloatArray  # (n, 3) of the singular value decomposition: vectors of the joints
    turn: FloatArray  # (3, 3) and of the tip


def law_arrays(
    robot: Robot, axes: Sequence[Axis], limits: MotionLimits, gains: Gains, dt_s: float
) -> LawArrays:
    """The arrays of a robot under its limits and gains.

    Parameters
    ----------
    robot : Robot
    axes : sequence of Axis
        Of the robot.
    limits : MotionLimits
    gains : Gains
    dt_s : float
        Sample time.

    Returns
    -------
    LawArrays
    """
    chain = chain_arrays(robot)
    speeds = [axis.joint.velocity_limit for axis in axes]
    opened = limits.open_lower, limits.open_upper
    of_law = (gains.k_p_1_s, gains.k_v, gains.k_f_m2_ns, gains.k_x_m)
    of_limits = (limits.tip_speed_m_s, limits.pressure_pa, gains.slew_limit_v_s * dt_s)
    return LawArrays(
        *chain.frames,
        *chain.bodies,
        tip=chain.tip_offset_m,
        cylinder=np.array([_cylinder(axis) for axis in axes]),
        edges=np.array([(v.c_pa, v.c_at, v.c_pb, v.c_bt) for v in (a.valve for a in axes)]),
        rated_v=np.array([axis.valve.rated_voltage_v for axis in axes]),
        at=np.array([(a.cylinder_index, a.valve_index) for a in axes], dtype=np.int64),
        limits=np.array([speeds, limits.lower, limits.upper, *opened]),
        braking=limits.braking,
        gains=np.array([*of_law, *of_limits]),
    )


def _cylinder(axis: Axis) -> tuple[float, ...]:
    c = axis.cylinder
    triangle = c.l1_m, c.l2_m, c.q0_rad, c.x0_m
    return (*triangle, c.area_a_m2, c.area_b_m2, c.stroke_m, c.viscous_friction, c.bulk_modulus_pa)


def law_work(arrays: LawArrays) -> LawWork:
    """Working memory for the kernels.

    `arrays` are the robot's.
    """
    n = len(arrays.axis)
    return LawWork(
        chain=np.empty((n + len(arrays.parts), SCRATCH)),
        point=np.empty(3),
        jacobian=np.empty((3, n)),
        rate=np.empty((3, n)),
        inverse=np.empty((n, 3)),
        columns=np.empty((n, 3)),
        turn=np.empty((3, 3)),
    )
