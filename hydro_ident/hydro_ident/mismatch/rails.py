"""Rails as a model's laws have them give way under the flows of all valves."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from hydro_ident.errors import IdentError
from hydro_ident.estimate.traces import Trace
from hydro_ident.mismatch.rail_kernels import RailLaws, Valves, follow_rails
from hydro_model.effects.compiled import law_address, signals_read
from hydro_model.effects.effect import Stage
from hydro_model.effects.law import ROBOT_STAGES, InternalState, Term
from hydro_model.effects.targets import ActiveEffect
from hydro_model.robot import FloatArray, Robot
from hydro_model.signals import RETURN_FLOW, SIGNAL_COUNT, STATE_0, SUPPLY_FLOW

_FOLLOWED = frozenset({SUPPLY_FLOW, RETURN_FLOW, STATE_0})


def railed(robot: Robot, trace: Trace, terms: Sequence[ActiveEffect]) -> Trace:
    """The trace with the rails that its valves' flows and some laws agree on.

    A rail that gives way lets less flow, and less flow lets it give way less. The laws follow the
    flow with a lag, so both are found sample by sample. Flows that nothing tells are none: a valve
    whose signal is unknown counts as closed, and so does an edge to a chamber whose pressure is.
    The rails of all other chambers would be unknown with it.

    Parameters
    ----------
    robot : Robot
        With current edges; a cylinder that no valve feeds draws nothing.
    trace : Trace
        Valve signals as other laws have shaped them; rails as recorded.
    terms : sequence of ActiveEffect
        Effects with a law on the supply or the tank.

    Raises
    ------
    IdentError
        A law does not follow the flow by one linear state.
    """
    laws, valves = _laws(terms, trace.step_s), _valves(robot, trace)
    count, out = laws.value.size, np.empty((2, trace.samples))
    rows, fresh = np.full((count, SIGNAL_COUNT), np.nan), np.zeros(count, dtype=bool)
    supply, tank = np.ascontiguousarray(trace.supply), np.ascontiguousarray(trace.tank)
    follow_rails(laws, rows, fresh, valves, supply, tank, out)
    return replace(trace, supply=out[0], tank=out[1])


def _valves(robot: Robot, trace: Trace) -> Valves:
    at = {cylinder.name: i for i, cylinder in enumerate(robot.cylinders)}
    fed = [at[valve.cylinder] for valve in robot.valves]
    signal = np.ascontiguousarray(trace.valve_signal[:, fed])
    edges = [[v.c_pa, v.c_at, v.c_pb, v.c_bt] for v in robot.valves]
    return Valves(
        signal=np.where(np.isfinite(signal), signal, 0.0),
        p_a=np.ascontiguousarray(trace.p_a[:, fed]),
        p_b=np.ascontiguousarray(trace.p_b[:, fed]),
        edges=np.array(edges).reshape(-1, 4),
    )


def _laws(terms: Sequence[ActiveEffect], step_s: float) -> RailLaws:
    found = [(one, term) for one in terms for term in one.effect.terms]
    found = [(one, term) for one, term in found if term.stage in ROBOT_STAGES]
    states = [_state(one, term) for one, term in found]
    most = max(one.parameters.size for one, _ in found)
    parameters = np.zeros((len(found), most))
    for row, (one, _) in zip(parameters, found, strict=True):
        row[: one.parameters.size] = one.parameters
    response = [_response(s, row, step_s) for s, row in zip(states, parameters, strict=True)]
    return RailLaws(
        value=np.array([law_address(term.law) for _, term in found]),
        rate=np.array([law_address(state.rate) for state in states]),
        initial=np.array([law_address(state.initial) for state in states]),
        parameters=parameters,
        response=np.array(response),
        on_tank=np.array([term.stage is Stage.TANK for _, term in found]),
    )


def _state(one: ActiveEffect, term: Term) -> InternalState:
    """The state by which a law follows the flow."""
    states = one.effect.states
    if len(states) == 1 and states[0].linear and signals_read(term.law) == {STATE_0}:
        laws = (states[0].rate, states[0].initial)
        if all(signals_read(law) <= _FOLLOWED for law in laws):
            return states[0]
    raise IdentError(
        f"effect '{one.effect.name}': expected a law on the {term.stage.value} pressure that"
        " follows the flow by one linear state, found another form of it"
    )


def _response(state: InternalState, parameters: FloatArray, step_s: float) -> float:
    """What a state with rate r(x) is a step later, less x, per r(x): ``(exp(a h) - 1) / a``."""
    row = np.zeros(SIGNAL_COUNT)
    still = state.rate(row, parameters)
    row[STATE_0] = 1.0
    slope = state.rate(row, parameters) - still
    return math.expm1(slope * step_s) / slope if slope else step_s
