"""Whole runs of the simulated machine in one compiled loop, under a plain position servo.

For studies over many machines: a minute of run takes a second or two. The machine is the same as
behind the bus, cycle by cycle; only the controller is another one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hydro_hw_bridge.errors import BridgeError
from hydro_hw_bridge.rig import kernel_following
from hydro_hw_bridge.rig.payload import Payload, loaded
from hydro_hw_bridge.rig.plant import PLAYS, Plant
from hydro_hw_bridge.rig.process import Process
from hydro_hw_bridge.rig.truth import Truth
from hydro_model.robot import FloatArray, Robot

#: Twice the step behind the bus: soft chambers and few stiff parts allow it.
STEP_S = 100.0e-6


@dataclass(frozen=True, slots=True)
class Servo:
    """Position servo of every cylinder.

    Attributes
    ----------
    gain_1_s : (m,) array
        Position error to speed.
    damping_m_ns : (m,) array
        Washed-out force to speed, m/(N s).
    washout_s : float
    """

    gain_1_s: FloatArray
    damping_m_ns: FloatArray
    washout_s: float = 1.0


@dataclass(frozen=True, slots=True)
class Track:
    """A run as it really was, N cycles.

    Attributes
    ----------
    cycle_s : float
    states : (N, size) array
        Before each cycle, laid out as `Plant.state`.
    commands : (N, m) array
        Normalised spool positions asked by the servo, by cylinder, at the cycle's stamp.
    asked : (N, m) array
        What the spools were asked over the cycle, on average: late, and past any hysteresis.
    seen : (N, n) array
        Joint positions as the encoders showed them.
    """

    cycle_s: float
    states: FloatArray
    commands: FloatArray
    asked: FloatArray
    seen: FloatArray


def follow(
    plant: Plant,
    servo: Servo,
    q_ref: FloatArray,
    qd_ref: FloatArray,
    *,
    seed: int,
    payload: Payload | None = None,
    step_s: float = STEP_S,
) -> Track:
    """Drive a machine along joint targets.

    Parameters
    ----------
    plant : Plant
        At its initial pose; used up.
    servo : Servo
    q_ref, qd_ref : (N, n) array
        One row per cycle.
    seed : int
        Of the encoders' noise.
    payload : Payload, optional
        A load at the tip.
    step_s : float
        Longest integration step.

    Returns
    -------
    Track

    Raises
    ------
    BridgeError
        The state left the finite numbers.
    """
    robot, truth = plant.robot, plant.truth
    count, n, m = len(q_ref), robot.dof, len(robot.cylinders)
    cycle_s = 1.0 / robot.sensors.rate_hz
    steps = max(1, int(np.ceil(cycle_s / step_s - 1e-9)))
    jitter = np.random.default_rng(seed).standard_normal((count, n))
    states = np.empty((count, plant.state.size))
    commands, asked, seen = np.zeros((count, m)), np.zeros((count, m)), np.empty((count, n))
    late = truth.command_delay_cycles + truth.extras.machine.command_delay_s / cycle_s
    kernel_following.follow(
        plant.state,
        np.ascontiguousarray(q_ref),
        np.ascontiguousarray(qd_ref),
        jitter * truth.sensors.encoder_noise_counts,
        _encoders(robot, truth),
        *Process(truth.extras.machine, m, cycle_s).draw(count),
        _gains(robot, servo),
        late,
        _payload(robot, truth, payload, cycle_s),
        np.zeros((m, PLAYS)),
        steps,
        cycle_s,
        np.zeros((4, plant.state.size)),
        *plant.records,
        states,
        commands,
        asked,
        seen,
    )
    if not np.isfinite(plant.state).all():
        raise BridgeError(f"plant of {robot.name}: the state is no longer finite")
    return Track(cycle_s, states, commands, asked, seen)


def true_rates(plant: Plant, track: Track, payload: Payload | None = None) -> FloatArray:
    """Time derivatives of a run's states without the random forces, (N, size).

    Parameters
    ----------
    plant : Plant
        A machine as the run's (its own state is not used).
    track : Track
    payload : Payload, optional
        As in the run; the plant carries it afterwards.
    """
    # Zeros: rates of mounts and hoses that a machine does not have are not filled in.
    out, count = np.zeros_like(track.states), len(track.states)
    split = count if payload is None else min(count, round(payload.from_s / track.cycle_s))
    for begin, end in ((0, split), (split, count)):
        if begin == end:
            continue
        if payload is not None and begin == split:
            plant.load_tip(payload.mass_kg)
        states = np.ascontiguousarray(track.states[begin:end])
        asked, start = np.ascontiguousarray(track.asked[begin:end]), begin * track.cycle_s
        kernel_following.rates_along(
            states, asked, start, track.cycle_s, *plant.records, out[begin:end]
        )
    return out


@dataclass(frozen=True, slots=True)
class Signals:
    """What goes into a machine's balances: (N, n) of joints, (N, m) of cylinders, (N, 2) lines.

    Attributes
    ----------
    q, qd, qdd : (N, n) array
    p_a, p_b, rise_a, rise_b : (N, m) array
        Gauge pressures and their derivatives.
    lines : (N, 2) array
        Supply and tank, gauge.
    asked : (N, m) array
        Normalised spool positions.
    """

    q: FloatArray
    qd: FloatArray
    qdd: FloatArray
    p_a: FloatArray
    p_b: FloatArray
    rise_a: FloatArray
    rise_b: FloatArray
    lines: FloatArray
    asked: FloatArray


def balance_residuals(plant: Plant, signals: Signals) -> FloatArray:
    """What is left of a plain machine's balances, (N, 3 m): per cylinder force, flow A, flow B.

    Forces in N, flows in m^3/s. Friction but the viscous part, and all extras, are left out.
    """
    s = signals
    out = np.empty((len(s.q), 3 * s.p_a.shape[1]))
    arrays = (s.q, s.qd, s.qdd, s.p_a, s.p_b, s.rise_a, s.rise_b, s.lines, s.asked)
    kernel_following.balances(*(np.ascontiguousarray(a) for a in arrays), *plant.records, out)
    return out


def late_commands(commands: FloatArray, delay_cycles: float) -> FloatArray:
    """Commands (N, m) late by a time: what the spools are asked over each cycle, on average.

    `delay_cycles` need not be whole.
    """
    late = int(np.floor(delay_cycles))
    share = delay_cycles - late
    padded = np.vstack([np.zeros((late + 1, commands.shape[1])), commands])
    count = len(commands)
    return np.asarray(share * padded[:count] + (1.0 - share) * padded[1 : count + 1])


def _encoders(robot: Robot, truth: Truth) -> FloatArray:
    extras, rows = truth.extras.sensors, []
    for joint in robot.joints:
        size = (1.0 if joint.prismatic else 2.0 * np.pi) / robot.sensors.encoder_counts_per_rev
        rows.append(
            (
                truth.sensors.encoder_offset.get(joint.name, 0.0),
                extras.encoder_swing.get(joint.name, 0.0),
                extras.encoder_swing_count.get(joint.name, 0.0),
                size,
            )
        )
    return np.array(rows)


def _gains(robot: Robot, servo: Servo) -> FloatArray:
    rows = []
    for i, cylinder in enumerate(robot.cylinders):
        valve = robot.valve_of(cylinder.name)
        rows.append(
            (
                *(servo.gain_1_s[i], servo.damping_m_ns[i], servo.washout_s),
                *(valve.c_pa, valve.c_at),
            )
        )
    return np.array(rows)


def _payload(robot: Robot, truth: Truth, payload: Payload | None, cycle_s: float) -> FloatArray:
    """The cycle of the exchange, then mass, centre of mass and inertia of the last link."""
    if payload is None:
        return np.full(14, -1.0)
    link = loaded(truth.links[-1], payload.mass_kg, robot.tip_offset_m)
    at = float(round(payload.from_s / cycle_s))
    return np.concatenate([[at, link.mass_kg], link.com_m, link.inertia_com_kg_m2.ravel()])
