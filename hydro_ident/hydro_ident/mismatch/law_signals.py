"""What laws of the catalogue may look at, from a recording: the signals of a cylinder or joint.

`s` are rows of signals (N, SIGNAL_COUNT) that are changed in place.
"""

from __future__ import annotations

import numpy as np

from hydro_ident.estimate.traces import Trace
from hydro_ident.mismatch.material import Stretch
from hydro_model import signals as names
from hydro_model.cylinder import piston_force
from hydro_model.effects.rows import constant_signals, set_valve_signal, signal_rows
from hydro_model.robot import FloatArray, Robot


def wet_rows(robot: Robot, stretch: Stretch, index: int) -> FloatArray:
    """Signals of a cylinder, (N, SIGNAL_COUNT); NaN where nothing tells.

    Parameters
    ----------
    robot : Robot
        With current edges.
    stretch : Stretch
    index : int
        Of the cylinder.
    """
    trace = stretch.trace
    columns = (trace.p_a[:, index], trace.p_b[:, index], trace.supply, trace.tank)
    joint = robot.joint_index(robot.cylinders[index].joint)
    s = _rows(robot, stretch, index, joint, np.stack(columns, axis=1))
    s[:, names.PISTON_POSITION] = trace.stroke[:, index]
    reshape(s, robot, index, trace)
    return s


def reshape(s: FloatArray, robot: Robot, index: int, trace: Trace) -> None:
    """Write a trace's valve signal and rails, and the edges' flows at them, into its rows."""
    s[:, names.SUPPLY_PRESSURE], s[:, names.TANK_PRESSURE] = trace.supply, trace.tank
    u = trace.valve_signal[:, index]
    s[:, names.VALVE_RATE] = np.gradient(u, trace.step_s)
    set_valve_signal(s, robot, index, u)


def with_pressures(s: FloatArray, robot: Robot, index: int, trace: Trace) -> None:
    """Write a trace's pressures, and a robot's edges, into rows of the same motion."""
    columns = (names.PRESSURE_A, names.PRESSURE_B)
    s[:, columns] = np.stack((trace.p_a[:, index], trace.p_b[:, index]), axis=1)
    force = piston_force(robot.cylinders[index], trace.p_a[:, index], trace.p_b[:, index])
    s[:, names.PISTON_FORCE] = force
    for column, value in constant_signals(robot, index, None).items():
        s[:, column] = value
    reshape(s, robot, index, trace)


def with_edges(s: FloatArray, robot: Robot, index: int, trace: Trace) -> None:
    """Write a robot's edges, and their flows at a trace's signal, into rows of a like robot."""
    for column, value in constant_signals(robot, index, None).items():
        s[:, column] = value
    set_valve_signal(s, robot, index, trace.valve_signal[:, index])


def dry_rows(robot: Robot, stretch: Stretch, joint: int) -> FloatArray:
    """Signals of a joint without cylinder: its piston is the joint itself."""
    s = _rows(robot, stretch, None, joint, None)
    s[:, names.PISTON_FORCE] = stretch.trace.joint_torque[:, joint]
    s[:, names.LEVER] = 1.0
    return s


def _rows(
    robot: Robot,
    stretch: Stretch,
    cylinder: int | None,
    joint: int,
    pressures: FloatArray | None,
) -> FloatArray:
    trace, m = stretch.trace, stretch.moved
    q, qd, qdd = (trace.q, None, None) if m is None else (m.q, m.qd, m.qdd)
    oil = trace.oil_c
    return signal_rows(robot, cylinder, joint, trace.time_s, q, qd, qdd, pressures, oil_c=oil)
