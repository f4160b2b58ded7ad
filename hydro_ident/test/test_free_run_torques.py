"""Roll-outs that measured torques drive: a model that has everything follows the recording."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from hydro_ident.estimate.signals.derivatives import FilterSettings
from hydro_ident.estimate.signals.traces import Trace
from hydro_ident.rollouts.rollout_windows import rolled_out, usable_pieces
from hydro_model.robot_files import load_robot

VISCOUS = 215.0


@pytest.mark.parametrize("rate_hz", [50, 100, 500])
def test_a_force_that_was_read_acts_at_its_own_instant(rate_hz: int) -> None:
    """A carriage under position control: held readings would lag by half a cycle.

    They came to three times the way of that, as the lag feeds energy into the model.
    """
    robot = replace(load_robot("emps"), effects=())
    mass = float(robot.link_inertia[0, 0])
    joint = replace(robot.joints[0], viscous_friction=VISCOUS)
    robot = replace(robot, joints=(joint,))
    time = np.arange(round(6.0 * rate_hz)) / rate_hz
    omega, size = 2.0 * np.pi * np.array([0.3, 0.7, 1.9]), np.array([0.06, 0.03, 0.01])
    angle = np.outer(time, omega)
    q, qd = np.sin(angle) @ size, np.cos(angle) @ (size * omega)
    force = -mass * (np.sin(angle) @ (size * omega**2)) + VISCOUS * qd
    none = np.zeros((time.size, 0))
    trace = Trace(
        "run#0", 1.0 / rate_hz, time, q[:, None], none, none, none,
        np.zeros(time.size), np.zeros(time.size), none, force[:, None],
    )  # fmt: skip
    (piece,) = usable_pieces(robot, trace, FilterSettings(10.0, 4.0))
    at = slice(piece.begin, piece.end)
    start = (q[at][:1], qd[at][:1], np.zeros((0, 2)))
    rolled = rolled_out(robot, piece, start)
    off = float(np.sqrt(np.mean((rolled.q[:, 0] - q[at]) ** 2)))
    late = float(np.sqrt(np.mean(qd[at] ** 2))) * 0.5 / rate_hz
    assert off < 0.2 * late
