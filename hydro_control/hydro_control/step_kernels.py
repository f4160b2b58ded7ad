"""One sample of the control law in two compiled calls: to the required forces, and to the valves.

Between the two stands what is estimated online. They are made of the kernels of
`hydro_control.state_kernels`, `hydro_control.law_kernels` and `hydro_control.listed_kernels`, each
of which has a readable counterpart; one call of each would cost more than their work. Arguments
that are described there have the same names here.
"""

from __future__ import annotations

from typing import Any

from hydro_control.law_kernels import (
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
from hydro_control.listed_kernels import (
    columns_kernel,
    friction_kernel,
    observe_kernel,
    signals_kernel,
)
from hydro_control.state_kernels import (
    FORCE,
    QD,
    Q,
    difference_kernel,
    measured_kernel,
    predicted_kernel,
)
from hydro_model.kernel import copy, kernel

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

    Where `ahead`, required quantities are those of the state predicted `lead_s` later, by what was
    `asked` (2, n) one sample ago, and of `aim`, the reference then; else those of the sample.
    `states` (2, 3, n) receive the state now and then. Returns what limited the motion.
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

    The filter of the forces' rate keeps `kept` (2, n), of which `past_rate` is left after the
    `span_s` since the last sample, as `past_opening` is of the averaged openings; `null_bias` (n,)
    is what was estimated of the valves', beside what is listed. The other arguments are those of
    `force_kernel`. Returns what limited the valves.
    """
    rate = asked[FORCE_RATE]
    difference_kernel(kept, out[FORCE_D], past_rate, span_s, rate)
    force, leak = states[THEN, FORCE], listed_work.leak
    limited = flow_kernel(arrays, out, force, rate, leak, filtered, p_s, p_t, flow, signal)
    for i in range(signal.shape[0]):
        signal[i] -= null_bias[i]
    signals_kernel(listed, listed_work, signal, past_opening, signal)
    return int(limited | voltage_kernel(arrays, signal, filtered, before_v, voltage_v))
