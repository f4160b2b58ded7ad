"""One sample of the control law in two compiled calls: to the required forces, and to the valves.

Between the two stands what is estimated online. They are made of the kernels of
`hydro_control.state.state_kernels`, `hydro_control.law.law_kernels` and
`hydro_control.compensation.listed_kernels`, each of which has a readable counterpart; one call of
each would cost more than their work.
"""

from __future__ import annotations

from typing import Any

from hydro_control.compensation.listed_kernels import (
    columns_kernel,
    friction_kernel,
    observe_kernel,
    signals_kernel,
)
from hydro_control.law.law_kernels import (
    ARM,
    FORCE_D,
    LENGTH_A,
    LENGTH_B,
    QD_R,
    QDD_R,
    X,
    flow_kernel,
    required_kernel,
    voltage_kernel,
)
from hydro_control.state.state_kernels import (
    FORCE,
    QD,
    Q,
    difference_kernel,
    measured_kernel,
    predicted_kernel,
)
from hydro_model.numerics.kernel import copy, kernel

Array = Any  # numba types the kernels; mypy follows no numba import

# Rows of what was asked for one sample ago, and of the states of a sample.
ACCELERATION, FORCE_RATE = range(2)
NOW, THEN = range(2)


@kernel
def force_kernel(
    arrays: Any,
    work: Any,
    filters: Any,
    memory: Any,
    listed: Any,
    listed_work: Any,
    dt_s: float,
    time_s: float,
    steps: int,
    q: Array,
    pressures: Array,
    p_s: float,
    p_t: float,
    in_tip: bool,
    reference: Array,
    ahead: bool,
    lead_s: float,
    aim: Array,
    asked: Array,
    states: Array,
    filtered: Array,
    out: Array,
    tip_d: Array,
) -> int:
    """Filtered and predicted state, and required motion and forces with the listed effects.

    Parameters
    ----------
    arrays, work : LawArrays, LawWork
    filters, memory : StateArrays, StateMemory
    listed, listed_work : ListedArrays, ListedWork
    dt_s : float
        Sample time.
    time_s : float
        Of the sample.
    steps : int
        Sample times since the one before.
    q : (n,) array
        Measured joint positions.
    pressures : (2, m) array
        Measured, gauge.
    p_s, p_t : float
        Of supply and tank, gauge.
    in_tip : bool
        References are of the tip, else of the joints.
    reference : (3, 3) or (3, n) array
        Position, velocity and acceleration at the sample.
    ahead : bool
        Required quantities are those of `lead_s` later, for the state predicted for then.
    lead_s : float
    aim : (3, 3) or (3, n) array
        The reference of what is required: that of then, where `ahead`.
    asked : (2, n) array
        Accelerations and rates of force asked for one sample ago, by which the state is predicted;
        the accelerations become those of this sample.
    states : (2, 3, n) array
        Receives positions, velocities and forces now and then, the same where not `ahead`.
    filtered : (2, m) array
        Receives the filtered pressures.
    out : (ROWS, n) array
        Receives the rows of `hydro_control.law.law_kernels.Required`.
    tip_d : (3,) array
        Receives the tip's desired position.

    Returns
    -------
    int
        What limited the motion, as bits of `hydro_control.law.motion_kernels`.
    """
    now, then = states[NOW], states[THEN]
    measured_kernel(filters, memory, q, pressures, steps, dt_s, now, filtered)
    if ahead:
        moving = now[Q], now[QD], now[FORCE]
        predicted_kernel(filters, *moving, lead_s, asked[ACCELERATION], asked[FORCE_RATE], then)
    else:
        for row in range(now.shape[0]):
            copy(now[row], then[row])
    when = then[Q], then[QD], aim, now[Q], reference
    limited = required_kernel(arrays, work, in_tip, *when, out, tip_d)
    copy(out[QDD_R], asked[ACCELERATION])
    motion = then[Q], out[QD_R], out[QDD_R], out[ARM], out[X]
    oil = filtered, p_s, p_t, now[FORCE]
    observe_kernel(listed, listed_work, time_s, *motion, *oil, dt_s)
    columns_kernel(listed, listed_work, out[LENGTH_A], out[LENGTH_B])
    friction_kernel(listed, listed_work, out[FORCE_D])
    return int(limited)


@kernel
def valve_kernel(
    arrays: Any,
    listed: Any,
    listed_work: Any,
    kept: Array,
    past_rate: float,
    past_opening: float,
    span_s: float,
    null_bias: Array,
    p_s: float,
    p_t: float,
    asked: Array,
    states: Array,
    filtered: Array,
    out: Array,
    before_v: Array,
    flow: Array,
    signal: Array,
    voltage_v: Array,
) -> int:
    """Flow terms, signals of the valves and their voltages, for the required forces.

    Parameters
    ----------
    arrays : LawArrays
    listed, listed_work : ListedArrays, ListedWork
    kept : (2, n) array
        What the filter of the forces' rate keeps.
    past_rate, past_opening : float
        What is left of the averages before, of that rate and of the openings.
    span_s : float
        Since the last sample.
    null_bias : (n,) array
        What was estimated of the valves', beside what is listed.
    p_s, p_t : float
        Of supply and tank, gauge.
    asked : (2, n) array
        Its rates of force become those of this sample.
    states, filtered, out : array
        As `force_kernel` filled them; in `out` the forces with what was estimated.
    before_v : (m,) array
        Voltages of the sample before.
    flow, signal : (n,) array
        Receive the flow terms of eq. 23 and the signals of the valves.
    voltage_v : (m,) array
        Receives the voltages.

    Returns
    -------
    int
        What limited the valves, as bits of `hydro_control.law.motion_kernels`.
    """
    rate = asked[FORCE_RATE]
    difference_kernel(kept, out[FORCE_D], past_rate, span_s, rate)
    force, leak = states[THEN, FORCE], listed_work.leak
    limited = flow_kernel(arrays, out, force, rate, leak, filtered, p_s, p_t, flow, signal)
    for i in range(signal.shape[0]):
        signal[i] -= null_bias[i]
    signals_kernel(listed, listed_work, signal, past_opening, signal)
    return int(limited | voltage_kernel(arrays, signal, filtered, before_v, voltage_v))
