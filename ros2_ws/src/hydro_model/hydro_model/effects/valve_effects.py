"""What a valve does between the command and the opening of its edges.

The order of `VALVE_EFFECTS` is the order in which they act on the signal: the spool follows the
command late, then its position is biased, and the edges open past their overlap.
"""

from __future__ import annotations

import math

from hydro_model.effects.effect import Effect
from hydro_model.effects.law import InternalState, ParameterSpec, Row, Stage, Term, nothing
from hydro_model.effects.signals import STATE_0, STATE_1, VALVE_SIGNAL


def _signal(s: Row, p: Row) -> float:
    return s[VALVE_SIGNAL]


def _spool(s: Row, p: Row) -> float:
    return s[STATE_0]


def _limited_rate(s: Row, p: Row) -> float:
    return p[0] * math.tanh((s[VALVE_SIGNAL] - s[STATE_0]) / (p[0] * p[1]))


def _limited_after(s: Row, p: Row) -> float:
    # sinh(gap / (r tau)) decays with tau; beyond 20 it is an exponential.
    gap = (s[VALVE_SIGNAL] - s[STATE_0]) / (p[0] * p[1])
    left = abs(gap) - p[2] / p[1]
    if abs(gap) < 20.0:
        left = math.asinh(math.sinh(abs(gap)) * math.exp(-p[2] / p[1]))
    elif left < 20.0:
        left = math.asinh(0.5 * math.exp(left))
    return s[VALVE_SIGNAL] - math.copysign(left, gap) * p[0] * p[1]


def _spool_velocity(s: Row, p: Row) -> float:
    return s[STATE_1]


def _spool_acceleration(s: Row, p: Row) -> float:
    omega = 2.0 * math.pi * p[0]
    return omega * (omega * (s[VALVE_SIGNAL] - s[STATE_0]) - 2.0 * p[1] * s[STATE_1])


def _biased(s: Row, p: Row) -> float:
    return s[VALVE_SIGNAL] + p[0]


def _past_deadband(s: Row, p: Row) -> float:
    u = s[VALVE_SIGNAL]
    return u - min(max(u, -p[0]), p[0])


def _bent(s: Row, p: Row) -> float:
    u = s[VALVE_SIGNAL]
    if p[1] <= 0.0:
        return u * (1.0 + p[0] * (abs(u) - 1.0))
    beyond = u - min(max(u, -p[1]), p[1])
    return (u + p[0] * beyond) / (1.0 + p[0] * (1.0 - p[1]))


# A spool with hysteresis. Of a play STATE_0 is where it stands; with a travel it is how far it
# stands behind the command as it came, STATE_1.


def _spool_moves(s: Row, p: Row) -> float:
    if p[2] <= 0.0:
        gap = s[VALVE_SIGNAL] - s[STATE_0]
        return (gap - min(max(gap, -p[0]), p[0])) / p[1]
    coming = (s[VALVE_SIGNAL] - s[STATE_1]) / p[1]
    return (p[0] * coming - s[STATE_0] * abs(coming)) / (2.0 * p[0] + p[2])


def _spool_after(s: Row, p: Row) -> float:
    if p[2] <= 0.0:
        gap = s[VALVE_SIGNAL] - s[STATE_0]
        beyond = gap - min(max(gap, -p[0]), p[0])
        return s[STATE_0] - beyond * math.expm1(-p[3] / p[1])
    came = (s[STATE_1] - s[VALVE_SIGNAL]) * math.expm1(-p[3] / p[1])
    end = math.copysign(p[0], came)
    return end + (s[STATE_0] - end) * math.exp(-abs(came) / (2.0 * p[0] + p[2]))


def _spool_at_rest(s: Row, p: Row) -> float:
    return 0.0 if p[2] > 0.0 else s[VALVE_SIGNAL]


def _command_comes(s: Row, p: Row) -> float:
    return (s[VALVE_SIGNAL] - s[STATE_1]) / p[1]


def _command_after(s: Row, p: Row) -> float:
    return s[STATE_1] + (s[STATE_1] - s[VALVE_SIGNAL]) * math.expm1(-p[3] / p[1])


def _spool_behind(s: Row, p: Row) -> float:
    return s[STATE_1] - s[STATE_0] if p[2] > 0.0 else s[STATE_0]


RATE_LIMIT = Effect(
    name="valve_rate_limit",
    channel="flow",
    equation="du/dt = r tanh((u_in - u) / (r tau))",
    source="slew limit of spool actuators; tau is the small lag that rounds it",
    parameters=(
        ParameterSpec("rate", "1/s", "r, fastest change of the opening", 0.1, 1e4, 80.0),
        ParameterSpec(
            "time_constant", "s", "tau, lag far from the limit", 1e-4, 0.05, 5e-4, optional=True
        ),
    ),
    terms=(Term(Stage.SIGNAL, _spool),),
    states=(InternalState(_limited_rate, _signal, 1.0, after=_limited_after),),
    channels=("flow_a", "flow_b"),
    looks_like=("valve_spool_lag", "command_delay"),
    separating_experiment="the same chirp at a small and at a large amplitude",
)

SPOOL_LAG = Effect(
    name="valve_spool_lag",
    channel="flow",
    equation="u'' = w^2 (u_in - u) - 2 zeta w u',  w = 2 pi f",
    source="second-order response of valve data sheets",
    parameters=(
        ParameterSpec("frequency", "Hz", "f, undamped natural frequency", 1.0, 1500.0, 100.0),
        ParameterSpec("damping", "1", "zeta", 0.2, 3.0, 0.8, optional=True),
    ),
    terms=(Term(Stage.SIGNAL, _spool),),
    states=(
        InternalState(_spool_velocity, _signal, 1.0, linear=True),
        InternalState(_spool_acceleration, nothing, 100.0, linear=True),
    ),
    channels=("flow_a", "flow_b"),
    looks_like=("command_delay", "pressure_delay", "valve_rate_limit"),
    separating_experiment="chirp of the command to twice the lag's frequency",
)

#: Over what travel of the command a spool takes up its hysteresis, beyond that of a play.
TRAVEL = ParameterSpec(
    "travel",
    "1",
    "l, of the command, over which the spool comes to follow it, beyond 2 h; 0: a play",
    0.0,
    0.5,
    0.05,
    optional=True,
    default=0.0,
)

HYSTERESIS = Effect(
    name="valve_hysteresis",
    channel="flow",
    equation="tau u' = (u_in - u) - clip(u_in - u, -h, h): play of half width h;  l > 0:"
    " z' = (h v - z |v|) / (2 h + l),  u = w - z,  v = w' = (u_in - w) / tau",
    source="play operator; Visintin, Differential Models of Hysteresis (1994); l > 0: Dahl,"
    " AIAA Journal 14 (1976), with the command's way in place of a distance",
    parameters=(
        ParameterSpec("half_width", "1", "h", 0.0, 0.2, 0.002),
        ParameterSpec(
            "time_constant", "s", "tau, in which the play is taken up", 1e-4, 0.02, 5e-4,
            optional=True,
        ),
        TRAVEL,
    ),
    terms=(Term(Stage.SIGNAL, _spool_behind),),
    states=(
        InternalState(_spool_moves, _spool_at_rest, 1.0, after=_spool_after),
        InternalState(_command_comes, _signal, 1.0, after=_command_after),
    ),
    channels=("flow_a", "flow_b"),
    looks_like=("valve_spool_lag", "command_delay", "valve_deadband"),
    separating_experiment="slow triangles of the command at two amplitudes",
    limits="one play, or one branch that the travel rounds, where a real spool's are many",
)  # fmt: skip

NULL_BIAS = Effect(
    name="valve_null_bias",
    channel="flow",
    equation="u = u_in + u0",
    source="mechanical null of the spool off the electrical one",
    parameters=(ParameterSpec("bias", "1", "u0", -0.2, 0.2, 0.005),),
    terms=(Term(Stage.SIGNAL, _biased),),
    channels=("flow_a", "flow_b"),
    looks_like=("internal_leakage", "one-sided valve_deadband"),
    separating_experiment="slow ramps of the command through zero, both ways",
)

DEADBAND = Effect(
    name="valve_deadband",
    channel="flow",
    equation="u = u_in - clip(u_in, -d, d)",
    source="overlap of the control edges",
    parameters=(ParameterSpec("width", "1", "d, overlap either way", 0.0, 0.6, 0.01),),
    terms=(Term(Stage.SIGNAL, _past_deadband),),
    channels=("flow_a", "flow_b"),
    looks_like=("valve_gain_nonlinearity", "supply_droop"),
    separating_experiment="staircase of small commands through zero",
)

#: Where an opening that grows in two straight pieces has its corner.
KNEE = ParameterSpec(
    "knee",
    "1",
    "w, opening at which the slope changes by the factor 1 + k; 0: it changes evenly",
    0.0,
    0.95,
    0.1,
    optional=True,
    default=0.0,
)

GAIN_NONLINEARITY = Effect(
    name="valve_gain_nonlinearity",
    channel="flow",
    equation="u = u_in (1 + k (|u_in| - 1));"
    "  w > 0: u = (u_in + k (u_in - clip(u_in, -w, w))) / (1 + k (1 - w))",
    source="progressive (k > 0) or saturating (k < 0) edges, evenly or at a knee; the full opening"
    " stays",
    parameters=(ParameterSpec("progression", "1", "k", -0.9, 0.9, 0.1), KNEE),
    terms=(Term(Stage.SIGNAL, _bent),),
    channels=("flow_a", "flow_b"),
    looks_like=("supply_droop", "valve_deadband"),
    separating_experiment="staircase of commands up to full opening, one joint at a time",
)

VALVE_EFFECTS = (RATE_LIMIT, SPOOL_LAG, HYSTERESIS, NULL_BIAS, DEADBAND, GAIN_NONLINEARITY)
