"""What laws of the catalogue may look at, from a recording: the signals of a cylinder or joint.

`s` are rows of signals (N, SIGNAL_COUNT) that are changed in place.
"""

from __future__ import annotations

import numpy as np

from hydro_ident.estimate.flows.chambers import Chamber
from hydro_ident.estimate.signals.traces import Trace
from hydro_ident.mismatch.rows.material import Stretch
from hydro_model.effects import signals as names
from hydro_model.effects.compiled import signals_read
from hydro_model.effects.law import Stage
from hydro_model.effects.rows import constant_signals, set_valve_signal, signal_rows
from hydro_model.effects.targets import ActiveEffect
from hydro_model.hydraulics.cylinder import piston_force
from hydro_model.robot import FloatArray, Robot

#: What no law can look at where the pressure of chamber a, or b, is not known.
_OF_PRESSURE = {
    "a": frozenset({names.PRESSURE_A, names.VALVE_FLOW_A, names.PISTON_FORCE}),
    "b": frozenset({names.PRESSURE_B, names.VALVE_FLOW_B, names.PISTON_FORCE}),
}


def looks_across(one: ActiveEffect, chamber: Chamber) -> bool:
    """Whether what an effect does to a chamber's balance follows from the other's pressure, too.

    Parameters
    ----------
    one : ActiveEffect
    chamber : Chamber
    """
    if one.cylinder not in (None, chamber.index):
        return False
    laws = [
        term.law
        for term in one.effect.terms
        if term.stage is Stage.SIGNAL or term.stage.value.endswith(f"_{chamber.side}")
    ]
    states = one.effect.states if laws else ()
    laws += [law for state in states for law in (state.rate, state.initial)]
    beyond = _OF_PRESSURE["b" if chamber.side == "a" else "a"]
    return any(signals_read(law) & beyond for law in laws)


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
