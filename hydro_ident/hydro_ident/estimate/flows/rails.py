"""Rails as a model's laws have them give way under the flows of all valves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from hydro_ident.errors import IdentError
from hydro_ident.estimate.flows.in_series import valve_laws
from hydro_ident.estimate.flows.rail_kernels import (
    FlowLaws,
    Instant,
    Lines,
    RailLaws,
    follow_rails,
)
from hydro_ident.estimate.signals.traces import Trace
from hydro_model.arrays import IntArray
from hydro_model.effects.compiled import law_address, signals_read
from hydro_model.effects.effect import Stage
from hydro_model.effects.law import FLOW, ROBOT_STAGES, InternalState, Term
from hydro_model.effects.rows import constant_signals
from hydro_model.effects.signals import (
    PISTON_POSITION,
    PRESSURE_A,
    PRESSURE_B,
    RETURN_FLOW,
    SIGNAL_COUNT,
    SIGNAL_NAMES,
    STATE_0,
    SUPPLY_FLOW,
    SUPPLY_PRESSURE,
    TANK_PRESSURE,
    VALVE_FLOW_A,
    VALVE_FLOW_B,
    VALVE_SIGNAL,
)
from hydro_model.effects.targets import ActiveEffect
from hydro_model.robot import FloatArray, Robot

#: The flow that each line's laws follow.
_FLOW = {Stage.SUPPLY: SUPPLY_FLOW, Stage.TANK: RETURN_FLOW}
#: What laws of a valve's flow may look at beside constants.
_PORT = {
    PISTON_POSITION, PRESSURE_A, PRESSURE_B, SUPPLY_PRESSURE, TANK_PRESSURE,
    VALVE_FLOW_A, VALVE_FLOW_B, VALVE_SIGNAL,
}  # fmt: skip


def railed(
    robot: Robot,
    trace: Trace,
    terms: Sequence[ActiveEffect],
    delays_s: Sequence[float],
    flow_terms: Sequence[ActiveEffect] = (),
) -> Trace:
    """The trace with the rails that its valves' flows and some laws agree on.

    A rail that gives way lets less flow, and less flow lets it give way less. The laws follow the
    flow with a lag: from rest at the first sample, both are solved for together in every step from
    sample to sample. Flows that nothing tells are none: a valve whose signal is unknown counts as
    closed, and so does an edge to a chamber whose pressure is. The rails of all other chambers
    would be unknown with it.

    Parameters
    ----------
    robot : Robot
        With current edges; a cylinder that no valve feeds draws nothing.
    trace : Trace
        Valve signals as other laws have shaped them; rails as recorded.
    terms : sequence of ActiveEffect
        Effects with a law on the supply or the tank.
    delays_s : sequence of float
        Command delay of each cylinder's valve: it draws that much later.
    flow_terms : sequence of ActiveEffect, optional
        Effects with a law of a valve's flow: rails give what passes it. Those with internal
        states are left out, as in a roll-out: a hose's oil is stored for milliseconds.

    Raises
    ------
    IdentError
        A law does not follow the flow of its line by one linear state, or one of a valve's flow
        looks at what is not known here.
    """
    laws, lines, out = _laws(terms), _lines(robot, trace, delays_s), np.empty((2, trace.samples))
    flows, now = _flow_laws(robot, flow_terms), _instant(robot, laws, lines)
    follow_rails(lines, laws, flows, now, float(trace.step_s), out)
    return replace(trace, supply=out[0], tank=out[1])


def _lines(robot: Robot, trace: Trace, delays_s: Sequence[float]) -> Lines:
    fed = _fed(robot)
    cycles = np.array(delays_s, dtype=float)[fed] / trace.step_s
    # As `edge_integrals` has it: within an interval the signal changes from that before it.
    whole = np.floor(cycles + 1e-9).astype(np.int64)
    signal = np.where(np.isfinite(trace.valve_signal), trace.valve_signal, 0.0)[:, fed]
    edges = [[v.c_pa, v.c_at, v.c_pb, v.c_bt] for v in robot.valves]
    return Lines(
        supply=np.ascontiguousarray(trace.supply),
        tank=np.ascontiguousarray(trace.tank),
        before=_later(signal, whole + 1),
        after=_later(signal, whole),
        change=cycles - whole,
        p_a=np.ascontiguousarray(trace.p_a[:, fed]),
        p_b=np.ascontiguousarray(trace.p_b[:, fed]),
        stroke=np.ascontiguousarray(trace.stroke[:, fed]),
        edges=np.array(edges).reshape(-1, 4),
    )


def _later(signal: FloatArray, samples: IntArray) -> FloatArray:
    """Signals (N, c), each so many samples later, and as the first one before."""
    row = np.arange(len(signal))[:, None] - samples
    return np.ascontiguousarray(np.take_along_axis(signal, np.maximum(row, 0), axis=0))


def _fed(robot: Robot) -> list[int]:
    """Index of each valve's cylinder."""
    at = {cylinder.name: i for i, cylinder in enumerate(robot.cylinders)}
    return [at[valve.cylinder] for valve in robot.valves]


def _instant(robot: Robot, laws: RailLaws, lines: Lines) -> Instant:
    count, valves = laws.value.size, len(lines.edges)
    ports = np.full((valves, SIGNAL_COUNT), np.nan)
    for port, index in zip(ports, _fed(robot), strict=True):
        for column, value in constant_signals(robot, index, None).items():
            port[column] = value
    return Instant(
        rows=np.full((count, SIGNAL_COUNT), np.nan),
        start=np.empty(count), begin=np.empty(count),
        up=np.empty(valves), down=np.empty(valves),
        p_a=np.empty(valves), p_b=np.empty(valves), rails=np.empty(2), ports=ports,
    )  # fmt: skip


def _laws(terms: Sequence[ActiveEffect]) -> RailLaws:
    found = [(one, term) for one in terms for term in one.effect.terms]
    found = [(one, term) for one, term in found if term.stage in ROBOT_STAGES]
    states = [_state(one, term) for one, term in found]
    parameters = _padded([one for one, _ in found])
    slopes = [_slope(state, row) for state, row in zip(states, parameters, strict=True)]
    return RailLaws(
        value=np.array([law_address(term.law) for _, term in found]),
        rate=np.array([law_address(state.rate) for state in states]),
        initial=np.array([law_address(state.initial) for state in states]),
        parameters=parameters,
        slope=np.array(slopes),
        on_tank=np.array([term.stage is Stage.TANK for _, term in found]),
    )


def _padded(terms: Sequence[ActiveEffect]) -> FloatArray:
    """Their parameters, row by row, with zeros behind them."""
    table = np.zeros((len(terms), max((one.parameters.size for one in terms), default=0)))
    for row, one in zip(table, terms, strict=True):
        row[: one.parameters.size] = one.parameters
    return table


def _flow_laws(robot: Robot, terms: Sequence[ActiveEffect]) -> FlowLaws:
    rows = []
    for valve, index in enumerate(_fed(robot)):
        for on_b, side in enumerate("ab"):
            own = valve_laws(terms, index, side)
            rows += [(valve, on_b, side, one) for one in own if not one.effect.states]
    laws = [one.effect.term(FLOW[side]).law for _, _, side, one in rows]
    known = _PORT | set(constant_signals(robot, 0, None))
    for (_, _, _, one), law in zip(rows, laws, strict=True):
        if beyond := signals_read(law) - known:
            raise IdentError(
                f"effect '{one.effect.name}': expected a law of the valve's flow that looks at"
                " signal, pressures, rails and stroke, found one that also looks at"
                f" {', '.join(SIGNAL_NAMES[k] for k in sorted(beyond))}"
            )
    return FlowLaws(
        value=np.array([law_address(law) for law in laws], dtype=np.int64),
        parameters=_padded([one for *_, one in rows]),
        valve=np.array([valve for valve, *_ in rows], dtype=np.int64),
        on_b=np.array([bool(on_b) for _, on_b, *_ in rows], dtype=np.bool_),
    )


def _state(one: ActiveEffect, term: Term) -> InternalState:
    """The state by which a law follows the flow of its line."""
    states = one.effect.states
    if len(states) == 1 and states[0].linear and signals_read(term.law) == {STATE_0}:
        laws = (states[0].rate, states[0].initial)
        if all(signals_read(law) <= {_FLOW[term.stage], STATE_0} for law in laws):
            return states[0]
    raise IdentError(
        f"effect '{one.effect.name}': expected a law on the {term.stage.value} pressure that"
        " follows the flow by one linear state, that of its own line; found another form of it"
    )


def _slope(state: InternalState, parameters: FloatArray) -> float:
    """Of a linear state's rate in the state, 1/s."""
    row = np.zeros(SIGNAL_COUNT)
    still = state.rate(row, parameters)
    row[STATE_0] = 1.0
    return state.rate(row, parameters) - still
