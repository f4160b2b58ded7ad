"""Compiled: rails that give way under the valves' flows, along a recording.

A rail and the flow at it answer to one another much quicker than by the law's lag where the rail
gives way much. The steps are implicit, by a method of second order that damps whatever is quicker
than they are (Alexander's of two stages). Explicit ones, a sample long, ring and run off: at 50 Hz
a supply that loses 32 bar with a lag of 20 ms was off by 7 bar.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from hydro_model.effects.compiled import call_law
from hydro_model.effects.signals import (
    PISTON_POSITION,
    PRESSURE_A,
    PRESSURE_B,
    RETURN_FLOW,
    STATE_0,
    SUPPLY_FLOW,
    SUPPLY_PRESSURE,
    TANK_PRESSURE,
    VALVE_FLOW_A,
    VALVE_FLOW_B,
    VALVE_SIGNAL,
)
from hydro_model.hydraulics.root_kernels import root
from hydro_model.numerics.kernel import kernel
from hydro_model.robot import FloatArray

#: Share of a step after which each stage's rates hold.
_STAGE = 1.0 - math.sqrt(0.5)
#: A step is no longer than this share of the quickest law's lag: rails are true to 0.2 %.
_LONGEST = 0.25
#: No more steps than that from sample to sample, where a lag of a whole interval has it: a quicker
#: one is over by the next sample, and of what moves 6e-4 is out of place (rms; 5e-3 at most).
_MOST = 4
#: Looks for a rail that agrees with its flow, at most, and the difference that ends them, Pa.
_PASSES, _ENOUGH_PA = 64, 1e-3


class RailLaws(NamedTuple):
    """Laws of one internal state each, which follows its line's flow, by law."""

    value: Any  # (k,) int, addresses
    rate: Any  # (k,) int
    initial: Any  # (k,) int
    parameters: FloatArray  # (k, p)
    slope: FloatArray  # (k,) of a state's rate in the state itself, 1/s
    on_tank: Any  # (k,) bool, else on the supply


class FlowLaws(NamedTuple):
    """Laws of valves' flows without states, each valve's in the order in which they act."""

    value: Any  # (l,) int, addresses
    parameters: FloatArray  # (l, p)
    valve: Any  # (l,) int
    on_b: Any  # (l,) bool, of the flow into chamber b, else into a


class Lines(NamedTuple):
    """What rails and flows follow from along a recording; unknown signals are closed valves.

    An edge to a chamber whose pressure is unknown (NaN) counts as closed, too.
    """

    supply: FloatArray  # (N,) as recorded, Pa
    tank: FloatArray  # (N,)
    before: FloatArray  # (N, c) signals of valves from a sample on
    after: FloatArray  # (N, c) and from their change on until the next
    change: FloatArray  # (c,) when that is, in parts of the interval
    p_a: FloatArray  # (N, c)
    p_b: FloatArray  # (N, c)
    stroke: FloatArray  # (N, c)
    edges: FloatArray  # (c, 4): c_pa, c_at, c_pb, c_bt


class Instant(NamedTuple):
    """Scratch: what laws and flows look at."""

    rows: FloatArray  # (k, SIGNAL_COUNT) each law's signals, with its state
    start: FloatArray  # (k,) states that a stage starts from
    begin: FloatArray  # (k,) states that a step began with
    up: FloatArray  # (c,) openings of valves by positive signals
    down: FloatArray  # (c,) and by negative ones
    p_a: FloatArray  # (c,)
    p_b: FloatArray  # (c,)
    rails: FloatArray  # (2,) supply and tank as recorded
    ports: FloatArray  # (c, SIGNAL_COUNT) what laws of each valve's flow look at


@kernel
def _open(lines: Any, now: Any, k: int, begin: float, length: float) -> None:
    """Mean openings over a step that begins at a part of an interval, in parts of it."""
    for i in range(lines.change.shape[0]):
        early = min(max((lines.change[i] - begin) / length, 0.0), 1.0)
        before, after = lines.before[k, i], lines.after[k, i]
        now.up[i] = early * max(before, 0.0) + (1.0 - early) * max(after, 0.0)
        now.down[i] = early * max(-before, 0.0) + (1.0 - early) * max(-after, 0.0)


@kernel
def _look(lines: Any, now: Any, k: int, part: float) -> None:
    """Pressures at a part of the interval behind a sample, straight between samples."""
    after = min(k + 1, lines.supply.shape[0] - 1)
    now.rails[0] = lines.supply[k] + part * (lines.supply[after] - lines.supply[k])
    now.rails[1] = lines.tank[k] + part * (lines.tank[after] - lines.tank[k])
    for i in range(now.p_a.shape[0]):
        now.p_a[i] = lines.p_a[k, i] + part * (lines.p_a[after, i] - lines.p_a[k, i])
        now.p_b[i] = lines.p_b[k, i] + part * (lines.p_b[after, i] - lines.p_b[k, i])
        port, x = now.ports[i], lines.stroke[k, i]
        port[PRESSURE_A], port[PRESSURE_B] = now.p_a[i], now.p_b[i]
        port[PISTON_POSITION] = x + part * (lines.stroke[after, i] - x)


@kernel
def _through(edge: float, drop: float, opening: float) -> float:
    """Flow through an edge; none by a drop that is unknown."""
    return 0.0 if math.isnan(drop) else edge * root(drop) * opening


@kernel
def _passes(flows: Any, now: Any, i: int, on_b: bool, signal: float, into: float) -> float:
    """What laws leave of a flow into a chamber; all of it where a pressure is unknown."""
    port = now.ports[i]
    if math.isnan(port[PRESSURE_A] + port[PRESSURE_B] + port[PISTON_POSITION]):
        return into
    column = VALVE_FLOW_B if on_b else VALVE_FLOW_A
    port[VALVE_SIGNAL], port[column] = signal, into
    for j in range(flows.value.shape[0]):
        if flows.valve[j] == i and flows.on_b[j] == on_b:
            port[column] += call_law(flows.value[j], port, flows.parameters[j])
    return float(port[column])


@kernel
def _sided(
    flows: Any, now: Any, i: int, on_tank: bool, on_b: bool, signal: float, passing: float
) -> float:
    """What laws leave of a flow from the supply into a chamber, or out of one into the tank."""
    way = -1.0 if on_tank else 1.0
    return float(way * _passes(flows, now, i, on_b, signal, way * passing))


@kernel
def _flow(lines: Any, flows: Any, now: Any, on_tank: bool, rail: float, other: float) -> float:
    """Drawn from the supply or returned to the tank by all valves; `other` is the other rail."""
    edges, total = lines.edges, 0.0
    for i in range(edges.shape[0]):
        up, down, p_a, p_b = now.up[i], now.down[i], now.p_a[i], now.p_b[i]
        port = now.ports[i]
        port[SUPPLY_PRESSURE], port[TANK_PRESSURE] = rail, other
        if on_tank:
            port[SUPPLY_PRESSURE], port[TANK_PRESSURE] = other, rail
        if up > 0.0:
            drop = p_b - rail if on_tank else rail - p_a
            passing = _through(edges[i, 3 if on_tank else 0], drop, up)
            total += _sided(flows, now, i, on_tank, on_tank, up, passing)
        if down > 0.0:
            drop = p_a - rail if on_tank else rail - p_b
            passing = _through(edges[i, 1 if on_tank else 2], drop, down)
            total += _sided(flows, now, i, on_tank, not on_tank, -down, passing)
    return total


@kernel
def _rail(laws: Any, now: Any, on_tank: bool) -> float:
    rail = now.rails[1] if on_tank else now.rails[0]
    for j in range(laws.value.shape[0]):
        if laws.on_tank[j] == on_tank:
            rail += call_law(laws.value[j], now.rows[j], laws.parameters[j])
    return float(rail)


@kernel
def _gap(
    lines: Any, laws: Any, flows: Any, now: Any, step_s: float, on_tank: bool, rail: float
) -> float:
    """A rail less what laws make of it by the flow at it over a step, or at rest where that is 0.

    The states are left as they are with it.
    """
    flow = _flow(lines, flows, now, on_tank, rail, _rail(laws, now, not on_tank))
    for j in range(laws.value.shape[0]):
        if laws.on_tank[j] != on_tank:
            continue
        row, parameters = now.rows[j], laws.parameters[j]
        row[RETURN_FLOW if on_tank else SUPPLY_FLOW] = flow
        if step_s > 0.0:
            # Rates are linear in the state: their part without it, at the end of the step.
            row[STATE_0] = 0.0
            rate = call_law(laws.rate[j], row, parameters)
            row[STATE_0] = (now.start[j] + step_s * rate) / (1.0 - step_s * laws.slope[j])
        else:
            row[STATE_0] = call_law(laws.initial[j], row, parameters)
    return rail - float(_rail(laws, now, on_tank))


@kernel
def _settle(lines: Any, laws: Any, flows: Any, now: Any, step_s: float, on_tank: bool) -> None:
    """States after a step with whose rail the flow agrees.

    A rail that gives way lowers the flow that makes it, so that the gap grows by no less than the
    rail: its end is between any rail and that less its gap, and false position finds it (with the
    weight of an end that stays halved, as the Illinois algorithm has it).
    """
    one = _rail(laws, now, on_tank)
    gap_one = _gap(lines, laws, flows, now, step_s, on_tank, one)
    other = one - gap_one
    gap_other = _gap(lines, laws, flows, now, step_s, on_tank, other)
    for _ in range(_PASSES):
        # What is unknown stays so and is waited for by nobody.
        if not abs(gap_other) > _ENOUGH_PA:
            break
        between = other - gap_other * (other - one) / (gap_other - gap_one)
        gap = _gap(lines, laws, flows, now, step_s, on_tank, between)
        if gap * gap_other < 0.0:
            one, gap_one = other, gap_other
        else:
            gap_one *= 0.5
        other, gap_other = between, gap


@kernel
def _settle_both(lines: Any, laws: Any, flows: Any, now: Any, step_s: float) -> None:
    for on_tank in (False, True):
        for j in range(laws.value.shape[0]):
            if laws.on_tank[j] == on_tank:
                _settle(lines, laws, flows, now, step_s, on_tank)
                break


@kernel
def _step(
    lines: Any, laws: Any, flows: Any, now: Any, k: int, begin: float, length: float, step_s: float
) -> None:
    """States over a step that begins at a part of an interval and has a length in parts of it."""
    for j in range(now.begin.shape[0]):
        now.begin[j] = now.start[j] = now.rows[j, STATE_0]
    _open(lines, now, k, begin, length)
    _look(lines, now, k, begin + _STAGE * length)
    _settle_both(lines, laws, flows, now, _STAGE * step_s)
    for j in range(now.begin.shape[0]):
        moved = now.rows[j, STATE_0] - now.begin[j]
        now.start[j] = now.begin[j] + (1.0 - _STAGE) / _STAGE * moved
    _look(lines, now, k, begin + length)
    _settle_both(lines, laws, flows, now, _STAGE * step_s)


@kernel
def follow_rails(
    lines: Any, laws: Any, flows: Any, now: Any, sample_s: float, out: FloatArray
) -> None:
    """Supply and tank that the valves' flows and the laws agree on.

    At rest with the first sample's flows; from there on the laws' states follow the flows, and
    these the rails. A step within which a valve changes has its mean opening, and pressures are
    straight from sample to sample.

    Parameters
    ----------
    lines : Lines
    laws : RailLaws
    flows : FlowLaws
    now : Instant
    sample_s : float
        Sampling interval.
    out : (2, N) array
        Filled: supply and tank in Pa.
    """
    quickest = 0.0
    for j in range(laws.slope.shape[0]):
        quickest = max(quickest, abs(laws.slope[j]))
    count = min(max(1, math.ceil(sample_s * quickest / _LONGEST)), _MOST)
    length, last = 1.0 / count, lines.supply.shape[0] - 1
    for k in range(last + 1):
        _look(lines, now, k, 0.0)
        if k == 0:
            _open(lines, now, k, 0.0, 1.0)
            for j in range(now.begin.shape[0]):
                now.rows[j, STATE_0] = 0.0
            _settle_both(lines, laws, flows, now, 0.0)
        out[0, k] = _rail(laws, now, False)
        out[1, k] = _rail(laws, now, True)
        if k < last:
            for part in range(count):
                _step(lines, laws, flows, now, k, part * length, length, length * sample_s)
