"""What listed effects do that a fit takes as listed: torques of bodies, errors of sensors."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from hydro_ident.estimate.forces.force_rows import Motion
from hydro_ident.estimate.signals.derivatives import FilterSettings, motion
from hydro_ident.estimate.signals.traces import Trace, strokes
from hydro_model.effects import ActiveEffect, Readings
from hydro_model.effects.bending import Load
from hydro_model.effects.catalogue import acting_share
from hydro_model.effects.rows import signal_rows
from hydro_model.effects.signals import PISTON_FORCE, PISTON_POSITION
from hydro_model.effects.targets import joint_of
from hydro_model.multibody.rigid_body import inverse_dynamics
from hydro_model.robot import FloatArray, Robot

#: Samples that a derivative needs.
_FEWEST = 5


def held_torque(
    robot: Robot, changes: Sequence[ActiveEffect], trace: Trace, moved: Motion
) -> FloatArray:
    """Joint torques of effects that change the robot's bodies, and of their laws.

    Parameters
    ----------
    robot : Robot
        With gravity as a listed tilt turns it, which all of them are then in.
    changes : sequence of ActiveEffect
    trace : Trace
    moved : Motion

    Returns
    -------
    (N, n) array
    """
    state = (moved.q, moved.qd, moved.qdd)
    total, plain = np.zeros_like(moved.q), inverse_dynamics(robot, *state)
    for one in changes:
        if one.effect.known_torques is not None:
            load = Load.of(robot, joint_of(robot, one), *state)
            total += one.effect.known_torques(load, one.parameters, trace.step_s)
            continue
        if one.effect.change is None:
            continue
        changed = one.effect.change(robot, one.target, one.parameters)
        # A tilt is in the regressor, whose masses are the fit's and not the robot file's.
        changed = replace(changed, gravity_m_s2=robot.gravity_m_s2)
        acts = acting_share(one, trace.time_s)[:, None]
        total += acts * (inverse_dynamics(changed, *state) - plain)
    return total


def sensor_errors(effects: Iterable[ActiveEffect]) -> list[ActiveEffect]:
    """Effects of instruments alone: what a roll-out does not have by itself.

    A late command, say, is a reading that shifts the record and a change of the robot, which says
    the same once more: a roll-out of that robot is to be given the record as it is.

    Parameters
    ----------
    effects : iterable of ActiveEffect
    """
    return [e for e in effects if e.effect.reading is not None and e.effect.change is None]


def corrected(robot: Robot, errors: Sequence[ActiveEffect], trace: Trace) -> Trace:
    """A trace without the errors of its instruments.

    A reading of the opposite sign undoes one, to first order in its size.

    Parameters
    ----------
    robot : Robot
    errors : sequence of ActiveEffect
        Effects with a reading.
    trace : Trace

    Returns
    -------
    Trace
    """
    if not errors:
        return trace
    rails, signal = (trace.supply, trace.tank), trace.valve_signal
    r = Readings(trace.step_s, trace.q, trace.p_a, trace.p_b, *rails, signal, trace.joint_torque)
    for one in errors:
        r = one.effect.undone(r, one.index, one.parameters)
    return replace(
        trace,
        q=r.q,
        stroke=strokes(robot, r.q, trace.stroke.copy()),
        p_a=r.p_a,
        p_b=r.p_b,
        supply=r.supply,
        tank=r.tank,
        valve_signal=r.valve_signal,
    )


def moving_signals(
    robot: Robot, one: ActiveEffect, trace: Trace, moved: Motion
) -> tuple[int, FloatArray]:
    """Joint that an effect of motion acts on, and the signals its laws see."""
    if one.joint is None:
        index = one.cylinder or 0
        at = robot.joint_index(robot.cylinders[index].joint)
        return at, cylinder_signals(robot, trace, index, moved)
    # The piston of a joint without cylinder is the joint itself.
    motion = moved.q, moved.qd, moved.qdd
    signals = signal_rows(robot, None, one.joint, trace.time_s, *motion, oil_c=trace.oil_c)
    signals[:, PISTON_FORCE] = trace.joint_torque[:, one.joint]
    return one.joint, signals


def known_motion(trace: Trace, filters: FilterSettings) -> Motion | None:
    """Motion of the joints whose angles are known, NaN of the others; None of a few samples.

    Parameters
    ----------
    trace : Trace
    filters : FilterSettings
        As quick as the trace bears them.
    """
    if trace.samples < _FEWEST:
        return None
    known = np.isfinite(trace.q).all(axis=0)
    own = np.full((3, *trace.q.shape), np.nan)
    own[:, :, known] = motion(trace.q[:, known], trace.step_s, filters.borne_at(trace.step_s))
    return Motion(*own)


def cylinder_signals(
    robot: Robot, trace: Trace, index: int, moved: Motion | None = None
) -> FloatArray:
    """Signals of one cylinder over a trace; velocities only where the motion is known."""
    joint = robot.joint_index(robot.cylinders[index].joint)
    pressures = np.column_stack(
        [trace.p_a[:, index], trace.p_b[:, index], trace.supply, trace.tank]
    )
    signals = signal_rows(
        robot,
        index,
        joint,
        trace.time_s,
        trace.q if moved is None else moved.q,
        None if moved is None else moved.qd,
        None if moved is None else moved.qdd,
        pressures,
        trace.valve_signal[:, index],
        trace.oil_c,
    )
    signals[:, PISTON_POSITION] = trace.stroke[:, index]
    return signals
