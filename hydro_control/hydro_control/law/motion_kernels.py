"""Compiled required motion: eq. 19, its rate, and the limits of both.

Readable counterparts, which the tests compare with, are in `hydro_control.motion.required_motion`
and `hydro_control.motion.motion_limits`. Numbers that are not finite pass through every limit, so
that the law finds them at its end.

Arguments shared by all kernels: `arrays` and `work` as of `hydro_control.law.law_arrays`, `q` and
`qd` (n,) the joints' positions and velocities, `reference` position, velocity and acceleration as
three rows, of the tip where `in_tip`, else of the joints, `qd_r` and `qdd_r` (n,) the required
motion, changed in place, `tip_d` (3,) where the tip's desired position goes.
"""

from __future__ import annotations

import math
from typing import Any

from hydro_control.law.law_arrays import (
    K_P,
    LOWER,
    OPEN_LOWER,
    OPEN_UPPER,
    SPEED,
    TIP_SPEED,
    UPPER,
)
from hydro_control.motion.braking import DOWN, POINTS, REACTION_S, RETURN_S, UP
from hydro_control.motion.motion_limits import (
    END_NOTE,
    RELIEVED_NOTE,
    STARVED_NOTE,
    TIP_SPEED_NOTE,
)
from hydro_control.motion.required_motion import (
    ACCELERATION_PER_VELOCITY_1_S,
    DAMPED_NOTE,
    RANK_RATIO,
    SINGULAR_RATIO,
    SPEED_NOTE,
)
from hydro_model.multibody.kinematics import tip_kernel
from hydro_model.numerics.kernel import inlined, kernel

Array = Any  # numba types the kernels; mypy follows no numba import

#: Bits of what a motion was limited by, in the order in which limits are applied.
DAMPED, AT_SPEED, TIP_AT_SPEED, BEFORE_END, STARVED, RELIEVED = 1, 2, 4, 8, 16, 32
_NOTES = (DAMPED_NOTE, SPEED_NOTE, TIP_SPEED_NOTE, END_NOTE, STARVED_NOTE, RELIEVED_NOTE)
#: Columns are orthogonal where their product is below this share of all squares; each sweep of
#: rotations squares what is left.
_ORTHOGONAL, _SWEEPS = 1e-15, 12


def limit_notes(limited: int) -> tuple[str, ...]:
    """What a motion was limited by, in words.

    Parameters
    ----------
    limited : int
        The bits that the kernels return.

    Returns
    -------
    tuple of str
    """
    if not limited:
        return ()
    return tuple(note for i, note in enumerate(_NOTES) if limited >> i & 1)


@inlined
def clipped(value: float, low: float, high: float) -> float:
    """`value` from `low` to `high`; what is no number stays none."""
    if value < low:
        return low
    return high if value > high else value


@kernel
def _rotate(matrix: Array, i: int, j: int, cosine: float, sine: float) -> None:
    for r in range(matrix.shape[0]):
        x, y = matrix[r, i], matrix[r, j]
        matrix[r, i], matrix[r, j] = cosine * x - sine * y, sine * x + cosine * y


@kernel
def _orthogonalise(columns: Array, turn: Array) -> None:
    """One-sided Jacobi rotations: columns (n, 3) become orthogonal, `turn` says how.

    Afterwards ``columns = J^T turn``: their lengths are the singular values of J.
    """
    for _ in range(_SWEEPS):
        rotated = False
        for i in range(2):
            for j in range(i + 1, 3):
                a, b, c = _square(columns, i), _square(columns, j), 0.0
                for r in range(columns.shape[0]):
                    c += columns[r, i] * columns[r, j]
                if not abs(c) > _ORTHOGONAL * (a + b):
                    continue
                rotated = True
                slope = (b - a) / (2.0 * c)
                tangent = math.copysign(1.0, slope) / (abs(slope) + math.hypot(1.0, slope))
                cosine = 1.0 / math.hypot(1.0, tangent)
                _rotate(columns, i, j, cosine, tangent * cosine)
                _rotate(turn, i, j, cosine, tangent * cosine)
        if not rotated:
            return


@inlined
def _square(columns: Array, i: int) -> float:
    total = 0.0
    for r in range(columns.shape[0]):
        total += columns[r, i] * columns[r, i]
    return total


@kernel
def damped_inverse_kernel(jacobian: Array, columns: Array, turn: Array, inverse: Array) -> bool:
    """Damped inverse (n, 3) of a Jacobian (3, n); whether it is damped.

    With ``J^T V = W`` of orthogonal columns of lengths s, the inverse is ``W g V^T`` where g is
    1/s^2, and 1/e^2 for s below e. `columns` and `turn` are working memory.
    """
    n = jacobian.shape[1]
    for i in range(3):
        for r in range(n):
            columns[r, i] = jacobian[i, r]
            inverse[r, i] = 0.0
        for r in range(3):
            turn[r, i] = 1.0 if r == i else 0.0
    _orthogonalise(columns, turn)
    squares = _square(columns, 0), _square(columns, 1), _square(columns, 2)
    largest = max(squares[0], squares[1], squares[2])
    edge = SINGULAR_RATIO * SINGULAR_RATIO * largest
    if edge == 0.0:
        return True
    damped = False
    for i in range(3):
        damped = damped or RANK_RATIO * RANK_RATIO * largest < squares[i] < edge
        gain = 1.0 / max(squares[i], edge)
        for r in range(n):
            for c in range(3):
                inverse[r, c] += columns[r, i] * gain * turn[c, i]
    return damped


@kernel
def _tip(arrays: Any, work: Any, q: Array, qd: Array) -> None:
    """Tip, Jacobian and its rate into the working memory."""
    tip_kernel(
        q,
        qd,
        arrays.rotation,
        arrays.translation,
        arrays.axis,
        arrays.prismatic,
        arrays.tip,
        work.chain,
        work.point,
        work.jacobian,
        work.rate,
    )


@kernel
def desired_kernel(
    arrays: Any, work: Any, in_tip: bool, q: Array, reference: Array, out: Array, tip_d: Array
) -> None:
    """Desired positions and velocities into the first rows of `out`, and the tip's position.

    In tip space by the inverse that the working memory holds: that of the sample's Jacobian, or
    of one a few milliseconds away, over which q_d changes by less than 1 % of the tracking error.
    """
    if in_tip:
        _tip(arrays, work, q, q)
        for i in range(q.shape[0]):
            out[0, i], out[1, i] = q[i], 0.0
            for r in range(3):
                out[0, i] += work.inverse[i, r] * (reference[0, r] - work.point[r])
                out[1, i] += work.inverse[i, r] * reference[1, r]
    else:
        _tip(arrays, work, reference[0], reference[1])
        for i in range(q.shape[0]):
            out[0, i], out[1, i] = reference[0, i], reference[1, i]
    for r in range(3):
        tip_d[r] = reference[0, r] if in_tip else work.point[r]


@kernel
def _from_tip(
    arrays: Any, work: Any, q: Array, qd: Array, reference: Array, qd_r: Array, qdd_r: Array
) -> int:
    """Eq. 19 and its rate, the Jacobian's inverse into the working memory."""
    k_p = arrays.gains[K_P]
    _tip(arrays, work, q, qd)
    damped = damped_inverse_kernel(work.jacobian, work.columns, work.turn, work.inverse)
    n = q.shape[0]
    for i in range(n):
        qd_r[i] = qdd_r[i] = 0.0
        for r in range(3):
            error = reference[0, r] - work.point[r]
            qd_r[i] += work.inverse[i, r] * (reference[1, r] + k_p * error)
    for r in range(3):
        acceleration = reference[2, r] + k_p * reference[1, r]
        for i in range(n):
            acceleration -= k_p * work.jacobian[r, i] * qd[i] + work.rate[r, i] * qd_r[i]
        for i in range(n):
            qdd_r[i] += work.inverse[i, r] * acceleration
    return DAMPED if damped else 0


@kernel
def _from_joints(
    arrays: Any, q: Array, qd: Array, reference: Array, qd_r: Array, qdd_r: Array
) -> None:
    k_p = arrays.gains[K_P]
    for i in range(q.shape[0]):
        qd_r[i] = reference[1, i] + k_p * (reference[0, i] - q[i])
        qdd_r[i] = reference[2, i] + k_p * (reference[1, i] - qd[i])


@kernel
def _within_limits(arrays: Any, qd_r: Array, qdd_r: Array) -> int:
    """The whole velocity within the joints' limits, so that its direction stays; and its rate."""
    excess = 1.0
    for i in range(qd_r.shape[0]):
        share = abs(qd_r[i]) / arrays.limits[SPEED, i]
        if share > excess or math.isnan(share):
            excess = share
    scale = 1.0 / excess
    for i in range(qd_r.shape[0]):
        most = ACCELERATION_PER_VELOCITY_1_S * arrays.limits[SPEED, i]
        qd_r[i] *= scale
        qdd_r[i] = clipped(qdd_r[i] * scale, -most, most)
    return 0 if excess == 1.0 else AT_SPEED


@kernel
def _slower_tip(arrays: Any, work: Any, qd_r: Array, qdd_r: Array) -> int:
    """The whole motion slower where the tip would be too fast; the Jacobian is the sample's."""
    square = 0.0
    for r in range(3):
        along = 0.0
        for i in range(qd_r.shape[0]):
            along += work.jacobian[r, i] * qd_r[i]
        square += along * along
    speed, most = math.sqrt(square), arrays.gains[TIP_SPEED]
    if speed <= most:
        return 0
    for i in range(qd_r.shape[0]):
        qd_r[i] *= most / speed
        qdd_r[i] *= most / speed
    return TIP_AT_SPEED


@inlined
def _speed_before_end(
    energies: Array, lower: float, upper: float, q: float, beyond: float
) -> tuple[float, float]:
    """As `hydro_control.motion.braking.speed_before_end`."""
    step = (upper - lower) / (POINTS - 1)
    at = clipped((q - lower) / step, 0.0, POINTS - 1.0)
    # What is no number must not become an index.
    k = min(int(at), POINTS - 2) if at > 0.0 else 0
    rise = energies[k + 1] - energies[k]
    energy, brake = energies[k] + (at - k) * rise, abs(rise) / step
    early = brake * REACTION_S
    speed = math.sqrt(early * early + 2.0 * energy) - early
    return speed - max(beyond, 0.0) / RETURN_S, brake / (speed + early)


@kernel
def _before_the_ends(arrays: Any, q: Array, qd: Array, qd_r: Array, qdd_r: Array) -> int:
    """No joint faster towards an end than it can brake from."""
    noted = 0
    for i in range(q.shape[0]):
        lower, upper = arrays.limits[LOWER, i], arrays.limits[UPPER, i]
        beyond = q[i] - arrays.limits[OPEN_UPPER, i], arrays.limits[OPEN_LOWER, i] - q[i]
        for side in (UP, DOWN):
            towards = 1.0 if side == UP else -1.0
            energies = arrays.braking[side, i]
            most, fall = _speed_before_end(energies, lower, upper, q[i], beyond[side])
            if not qd_r[i] * towards > most:
                continue
            noted = BEFORE_END
            # The speed that is kept falls as fast as the joint comes nearer.
            slowing = -fall * max(qd[i] * towards, 0.0)
            qd_r[i], qdd_r[i] = towards * most, towards * min(qdd_r[i] * towards, slowing)
    return noted


@kernel
def motion_kernel(
    arrays: Any,
    work: Any,
    in_tip: bool,
    q: Array,
    qd: Array,
    reference: Array,
    qd_r: Array,
    qdd_r: Array,
) -> int:
    """Required velocity and its rate within the limits; what limited it, as bits."""
    limited = 0
    if in_tip:
        limited |= _from_tip(arrays, work, q, qd, reference, qd_r, qdd_r)
    else:
        _tip(arrays, work, q, qd)
        _from_joints(arrays, q, qd, reference, qd_r, qdd_r)
    limited |= _within_limits(arrays, qd_r, qdd_r)
    limited |= _slower_tip(arrays, work, qd_r, qdd_r)
    return int(limited | _before_the_ends(arrays, q, qd, qd_r, qdd_r))
