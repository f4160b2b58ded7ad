"""Instruments that do not show what is: offsets, gains and delays of sensors and commands."""

from __future__ import annotations

from dataclasses import replace

from hydro_model.effects.effect import Effect
from hydro_model.effects.law import ParameterSpec
from hydro_model.effects.readings import EVERY_CHAMBER, Readings, delayed
from hydro_model.robot import FloatArray, Robot

_DELAYS = ("timing", "force", "flow_a", "flow_b")


def _turned(r: Readings, joint: int, p: FloatArray) -> Readings:
    q = r.q.copy()
    q[:, joint] += p[0]
    return replace(r, q=q)


def _shifted(r: Readings, index: int, p: FloatArray) -> Readings:
    return r.with_pressure(index, r.pressure(index) + p[0])


def _stretched(r: Readings, index: int, p: FloatArray) -> Readings:
    return r.with_pressure(index, r.pressure(index) * (1.0 + p[0]))


def _shrunk(r: Readings, index: int, p: FloatArray) -> Readings:
    return r.with_pressure(index, r.pressure(index) / (1.0 + p[0]))


def _late(r: Readings, index: int, p: FloatArray) -> Readings:
    every = range(2 * r.p_a.shape[1]) if index == EVERY_CHAMBER else (index,)
    for one in every:
        r = r.with_pressure(one, delayed(r.pressure(one), float(p[0]), r.step_s))
    return r


def _early_command(r: Readings, index: int, p: FloatArray) -> Readings:
    # What acts now was recorded earlier: the record runs ahead of the valve.
    return replace(r, valve_signal=delayed(r.valve_signal, -float(p[0]), r.step_s))


def _later_command(robot: Robot, target: str, p: FloatArray) -> Robot:
    return replace(robot, command_delay_s=robot.command_delay_s + float(p[0]))


def _early_valve(r: Readings, index: int, p: FloatArray) -> Readings:
    signal = r.valve_signal.copy()
    signal[:, index] = delayed(signal[:, index], -float(p[0]), r.step_s)
    return replace(r, valve_signal=signal)


def _later_valve(robot: Robot, target: str, p: FloatArray) -> Robot:
    valves = tuple(
        replace(v, command_delay_s=v.command_delay_s + float(p[0])) if v.cylinder == target else v
        for v in robot.valves
    )
    return replace(robot, valves=valves)


ENCODER_OFFSET = Effect(
    name="encoder_offset",
    channel="force",
    equation="q_read = q + q0",
    source="reference mark of an encoder off its place",
    parameters=(ParameterSpec("offset", "rad", "q0 (m on a prismatic joint)", -0.5, 0.5, 0.0175),),
    terms=(),
    channels=("force", "flow_a", "flow_b"),
    acts_on="joint",
    reading=_turned,
    looks_like=("base_tilt", "first moments", "pressure_sensor_bias"),
    separating_experiment="drive to a known pose: a stop, a level or a plumb line",
)

PRESSURE_SENSOR_BIAS = Effect(
    name="pressure_sensor_bias",
    channel="force",
    equation="p_read = p + p0",
    source="zero error of pressure transducers, of data sheets",
    parameters=(ParameterSpec("bias", "Pa", "p0", -2e6, 2e6, 1e5, linear=True),),
    terms=(),
    channels=("force", "flow_a", "flow_b"),
    acts_on="pressure",
    reading=_shifted,
    looks_like=("constant_force_offset", "first moments", "base_tilt", "asymmetric_friction"),
    separating_experiment="read the zeros with the pump off and the valve open to tank",
)

PRESSURE_SENSOR_GAIN = Effect(
    name="pressure_sensor_gain",
    channel="force",
    equation="p_read = p (1 + e), gauge",
    source="span error of pressure transducers, of data sheets",
    parameters=(ParameterSpec("error", "1", "e", -0.2, 0.2, 0.01, linear=True),),
    terms=(),
    channels=("force", "flow_a", "flow_b"),
    acts_on="pressure",
    reading=_stretched,
    undo=_shrunk,
    looks_like=("first moments", "pressure_sensor_bias", "bulk modulus"),
    separating_experiment="both chambers and supply on one pressure, at several pressures",
)

PRESSURE_DELAY = Effect(
    name="pressure_delay",
    channel="timing",
    equation="p_read(t) = p(t - tau)",
    source="filters of transducers and converters, skew between devices",
    parameters=(ParameterSpec("delay", "s", "tau", 0.0, 0.1, 0.004),),
    terms=(),
    channels=_DELAYS,
    acts_on="pressure",
    reading=_late,
    looks_like=("valve_spool_lag", "line_dynamics", "command_delay"),
    separating_experiment="a chirp: force and motion lag by a phase that grows with frequency",
    limits="of chambers; delays of supply and tank do not show in motion",
    shared=True,
)

VALVE_DELAY = Effect(
    name="command_delay",
    channel="timing",
    equation="u_i(t) = u_i_command(t - tau), of the valve at hand",
    source="an amplifier or a channel of its own that is later than the others",
    parameters=(ParameterSpec("delay", "s", "tau", 0.0, 0.1, 0.006),),
    terms=(),
    channels=("timing", "flow_a", "flow_b"),
    change=_later_valve,
    reading=_early_valve,
    looks_like=("valve_spool_lag", "valve_rate_limit"),
    separating_experiment="a chirp of that valve: a delay's phase grows with frequency alone",
    limits="a roll-out holds the mean of a sample's commands where it is no whole number of them",
)

COMMAND_DELAY = Effect(
    name="command_delay",
    channel="timing",
    equation="u(t) = u_command(t - tau)",
    source="bus and amplifier of the valves, beyond the delay that every fit includes",
    parameters=(ParameterSpec("delay", "s", "tau", 0.0, 0.1, 0.006),),
    terms=(),
    channels=("timing", "flow_a", "flow_b"),
    acts_on="robot",
    change=_later_command,
    reading=_early_command,
    looks_like=("valve_spool_lag", "valve_rate_limit"),
    separating_experiment="a chirp at two amplitudes: a delay's phase grows with frequency alone",
    limits="one delay for all valves; it adds to the robot's command_delay_s",
    elsewhere=VALVE_DELAY,
)

SENSOR_EFFECTS = (ENCODER_OFFSET, PRESSURE_SENSOR_BIAS, PRESSURE_SENSOR_GAIN)
TIMING_EFFECTS = (PRESSURE_DELAY, COMMAND_DELAY)
