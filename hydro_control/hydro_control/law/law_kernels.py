"""Compiled equations 19 to 24 at one sample, up to and behind what the listed effects add.

Readable counterparts, which the tests compare with, are in `hydro_control.law.law_reference`.
`arrays` and `work` are as of `hydro_control.law.law_arrays`; pressures are gauge.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from hydro_control.law.law_arrays import (
    AREA_A,
    AREA_B,
    BULK,
    C_AT,
    C_BT,
    C_PA,
    C_PB,
    CYLINDER,
    K_F,
    K_V,
    K_X,
    L1,
    L2,
    PRESSURE,
    Q0,
    SLEW,
    STROKE,
    VALVE,
    VISCOUS,
    X0,
)
from hydro_control.law.motion_kernels import (
    RELIEVED,
    STARVED,
    clipped,
    desired_kernel,
    motion_kernel,
)
from hydro_control.motion.motion_limits import RELIEF_BAND
from hydro_control.state.oil_columns import STROKE_MARGIN
from hydro_model.hydraulics.root_kernels import root
from hydro_model.hydraulics.valve import SMOOTH_PRESSURE_PA
from hydro_model.multibody.rigid_body_kernels import required_torque_kernel
from hydro_model.numerics.kernel import inlined, kernel

Array = Any  # numba types the kernels; mypy follows no numba import


class Required(NamedTuple):
    """The rows that `required_kernel` fills, (n,) each; kernels take an array of these."""

    q_d: Array  # `q_d`: desired positions, without feedback
    qd_d: Array  # `qd_d`: desired velocities
    qd_r: Array  # `qd_r`: required velocities
    qdd_r: Array  # `qdd_r`: and accelerations
    arm: Array  # lever arms
    x: Array  # `x`: piston positions, as they are
    xd: Array  # `xd`: piston velocities
    xd_r: Array  # `xd_r`: and those required
    length_a: Array  # `length_a`: oil column of chamber A
    length_b: Array  # `length_b`: and of chamber B
    force_d: Array  # `force_d`: required piston forces


ROWS = len(Required._fields)
Q_D, QD_D, QD_R, QDD_R, ARM, X, XD, XD_R, LENGTH_A, LENGTH_B, FORCE_D = range(ROWS)


@inlined
def _triangle(cylinder: Array, q: float) -> tuple[float, float]:
    """Stroke and lever arm of a cylinder (eqs. 16 and 17)."""
    if cylinder[L1] == 0.0:
        return q - cylinder[X0], 1.0
    product = cylinder[L1] * cylinder[L2]
    angle = q + cylinder[Q0]
    squares = cylinder[L1] * cylinder[L1] + cylinder[L2] * cylinder[L2]
    pins = math.sqrt(squares - 2.0 * product * math.cos(angle))
    return pins - cylinder[X0], product * math.sin(angle) / pins


@kernel
def required_kernel(
    arrays: Any,
    work: Any,
    in_tip: bool,
    q: Array,
    qd: Array,
    aim: Array,
    measured: Array,
    reference: Array,
    out: Array,
    tip_d: Array,
) -> int:
    """Rows of `out` (ROWS, n): motion, levers, pistons, oil columns, force of eq. 22.

    `aim` has position, velocity and acceleration as rows, of the tip where `in_tip`, else of the
    joints, and `q` and `qd` are the joints' state at its instant. What is desired belongs to the
    sample itself, of which `measured` and `reference` are the positions and the reference: the
    same, or of some milliseconds before. `tip_d` (3,) receives the tip's desired position. Returns
    what limited the motion, as bits of `hydro_control.law.motion_kernels`.
    """
    limited = motion_kernel(arrays, work, in_tip, q, qd, aim, out[QD_R], out[QDD_R])
    desired_kernel(arrays, work, in_tip, measured, reference, out, tip_d)
    _required_torque(arrays, work, q, qd, out)
    for i in range(q.shape[0]):
        cylinder = arrays.cylinder[i]
        x, arm = _triangle(cylinder, q[i])
        full = cylinder[STROKE]
        kept = clipped(x, STROKE_MARGIN * full, (1.0 - STROKE_MARGIN) * full)
        out[ARM, i], out[X, i] = arm, x
        out[XD, i], out[XD_R, i] = arm * qd[i], arm * out[QD_R, i]
        out[LENGTH_A, i], out[LENGTH_B, i] = kept, full - kept
        out[FORCE_D, i] = out[FORCE_D, i] / arm + cylinder[VISCOUS] * out[XD_R, i]
    return int(limited)


@kernel
def _required_torque(arrays: Any, work: Any, q: Array, qd: Array, out: Array) -> None:
    required_torque_kernel(
        q,
        qd,
        out[QD_R],
        out[QDD_R],
        arrays.gains[K_V],
        arrays.rotation,
        arrays.translation,
        arrays.axis,
        arrays.prismatic,
        arrays.gravity,
        arrays.theta,
        arrays.parts,
        work.chain,
        out[FORCE_D],
    )


@inlined
def _open_root(difference_pa: float) -> float:
    """The edge's root, no smaller than where it is smoothed."""
    d = SMOOTH_PRESSURE_PA if difference_pa < SMOOTH_PRESSURE_PA else difference_pa
    return float(root(d))


@inlined
def _fed_root(difference_pa: float) -> float:
    """As `_open_root`, but what runs back into the supply counts as such."""
    return float(root(difference_pa) if difference_pa < 0.0 else _open_root(difference_pa))


@kernel
def flow_kernel(
    arrays: Any,
    out: Array,
    force: Array,
    force_rate: Array,
    leak: Array,
    pressures: Array,
    p_s: float,
    p_t: float,
    flow: Array,
    opening: Array,
) -> int:
    """Flow terms of eq. 23 (corrected) and the edges' openings of eq. 24, (n,) each.

    `out` is what `required_kernel` filled, its columns and its force with what the listed
    effects add; `pressures` (2, m) are the chambers', gauge; `force_rate` is the filtered rate
    of that force, `leak` the flow term of what passes the valve. Returns `STARVED` where a valve
    is kept shut, as the chamber that it should feed would empty into the supply, else 0.
    """
    gains, limited, least = arrays.gains, 0, _open_root(0.0)
    for i in range(force.shape[0]):
        c, edges, at = arrays.cylinder[i], arrays.edges[i], arrays.at[i, CYLINDER]
        length_a, length_b = out[LENGTH_A, i], out[LENGTH_B, i]
        area = c[AREA_A] / length_a + c[AREA_B] / length_b
        forward = -area * out[XD_R, i] - force_rate[i] / c[BULK] + leak[i]
        by_force = gains[K_F] * (out[FORCE_D, i] - force[i])
        flow[i] = forward - (by_force + gains[K_X] * (out[XD_R, i] - out[XD, i]))
        p_a, p_b = pressures[0, at], pressures[1, at]
        if flow[i] < 0.0:
            a, b = edges[C_PA] * _fed_root(p_s - p_a), edges[C_BT] * _open_root(p_b - p_t)
            floor = edges[C_PA] / length_a * least
        else:
            a, b = edges[C_AT] * _open_root(p_a - p_t), edges[C_PB] * _fed_root(p_s - p_b)
            floor = edges[C_PB] / length_b * least
        through = a / length_a + b / length_b
        if through <= floor:
            opening[i], limited = 0.0, STARVED
        else:
            opening[i] = -flow[i] / through
    return limited


@kernel
def voltage_kernel(
    arrays: Any, signal: Array, pressures: Array, before_v: Array, out_v: Array
) -> int:
    """Voltages (m,) in the robot's order: relieved, saturated, and slewed from `before_v`.

    `signal` (n,) is by joint, `pressures` (2, m) are the chambers', gauge.

    Returns `RELIEVED` where a valve is throttled for the pressure of the chamber that it feeds.
    """
    most, limit, limited = arrays.gains[SLEW], arrays.gains[PRESSURE], 0
    for i in range(signal.shape[0]):
        at, rated = arrays.at[i, VALVE], arrays.rated_v[i]
        fed = pressures[0 if signal[i] > 0.0 else 1, arrays.at[i, CYLINDER]]
        share = clipped((limit - fed) / (RELIEF_BAND * limit), 0.0, 1.0)
        if share < 1.0 and signal[i] != 0.0:
            limited = RELIEVED
        wanted = clipped(signal[i] * share * rated, -rated, rated)
        out_v[at] = clipped(wanted, before_v[at] - most, before_v[at] + most)
    return limited
