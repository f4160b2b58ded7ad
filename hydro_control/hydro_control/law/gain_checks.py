"""Whether gains can be meant for a machine: what one count of its encoders asks of the valves, and
how long the filters take at its rate.

The shipped gains were chosen on machines of one size at 500 Hz with encoders of 20 bits.
"""

from __future__ import annotations

import numpy as np

from hydro_control.errors import ControlError
from hydro_control.gains import Gains
from hydro_control.law.law import ControlLaw
from hydro_control.motion.required_motion import Reference
from hydro_control.state.filters import time_constant_s
from hydro_model.multibody.joint_ranges import middle
from hydro_model.robot import FloatArray, Robot

#: Share of the rated voltage that one count of an encoder may ask for.
MOST_PER_COUNT = 0.05
#: Of 5.6 ms beside a cycle of delay an oscillation builds up (`gains.md`).
LONGEST_FILTER_S = 5.0e-3
_FILTERED = ("alpha_qd", "alpha_p", "alpha_fd")
#: Samples at rest before the count, and looked at from it on.
_BEFORE, _AFTER = 20, 20


def gain_warnings(robot: Robot, gains: Gains) -> list[str]:
    """What is odd about gains on a robot.

    Parameters
    ----------
    robot : Robot
    gains : Gains

    Returns
    -------
    list of str
        A sentence each; empty where nothing is.
    """
    dt_s = 1.0 / robot.sensors.rate_hz
    slow = {
        name: constant
        for name in _FILTERED
        if (constant := time_constant_s(getattr(gains, name), dt_s)) > LONGEST_FILTER_S
    }
    found = [
        f"{name} is a time constant of {1e3 * constant:.1f} ms at {robot.sensors.rate_hz:g} Hz,"
        f" expected at most {1e3 * LONGEST_FILTER_S:g} ms: raise it"
        for name, constant in slow.items()
    ]
    for joint, share in zip(robot.joint_names, count_shares(robot, gains), strict=True):
        if share > MOST_PER_COUNT:
            found.append(
                f"one count of {joint}'s encoder asks for {share:.0%} of its valve's voltage,"
                f" expected at most {MOST_PER_COUNT:.0%}: lower k_v, k_f_m2_ns and the filter"
                " weights, or correct counts_per_rev of the robot file (sensors, encoder)"
            )
    return found


def count_shares(robot: Robot, gains: Gains) -> FloatArray:
    """Largest share of the rated voltage that one count of each joint's encoder asks for, (n,).

    Of the law itself, before what limits it, in the middle of the joints' ranges and of the
    pressures: what one count changes.

    Parameters
    ----------
    robot : Robot
    gains : Gains
    """
    pose = middle(robot)
    steps = np.diag(robot.encoder_steps)
    return np.array(
        [np.ptp(_signals(robot, gains, pose, step)[:, i]) for i, step in enumerate(steps)]
    )


def _signals(robot: Robot, gains: Gains, pose: FloatArray, step: FloatArray) -> FloatArray:
    """Valve signals from the last sample at rest on, (samples, n)."""
    law = ControlLaw(robot, gains)
    still = np.zeros(robot.dof)
    reference = Reference("joint", pose, still, still)
    rails = robot.supply_pressure_pa, robot.tank_pressure_pa
    half = np.full(len(robot.cylinders), 0.5 * sum(rails))
    rows = []
    for k in range(_BEFORE + _AFTER):
        q = pose + (step if k >= _BEFORE else 0.0)
        output = law.step(k * law.dt_s, q, half, half, *rails, reference)
        if output.fault:
            raise ControlError(f"robot {robot.name} in mid-range: {output.fault}")
        rows.append(output.valve_signal)
    return np.array(rows[_BEFORE - 1 :])
