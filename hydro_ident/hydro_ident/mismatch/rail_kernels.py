"""Compiled: rails that give way under the valves' flows, sample by sample along a recording."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from hydro_ident.estimate.edge_kernels import root
from hydro_model.effects.compiled import call_law
from hydro_model.kernel import kernel
from hydro_model.robot import FloatArray
from hydro_model.signals import RETURN_FLOW, STATE_0, SUPPLY_FLOW

#: Passes between a rail at rest and the flow at it, at most, and the change that ends them, Pa.
_PASSES, _ENOUGH_PA = 64, 1.0


class RailLaws(NamedTuple):
    """Laws of one internal state each, which follows the flow: addresses and numbers by law."""

    value: Any  # (k,) int
    rate: Any  # (k,) int
    initial: Any  # (k,) int
    parameters: FloatArray  # (k, p)
    response: FloatArray  # (k,) what a state moves by until the next sample, per its rate
    on_tank: Any  # (k,) bool, else on the supply


class Valves(NamedTuple):
    """What the valves' flows follow from, beside the rails; unknown signals are closed valves.

    An edge to a chamber whose pressure is unknown (NaN) counts as closed, too.
    """

    signal: FloatArray  # (N, c)
    p_a: FloatArray  # (N, c)
    p_b: FloatArray  # (N, c)
    edges: FloatArray  # (c, 4): c_pa, c_at, c_pb, c_bt


@kernel
def _through(edge: float, drop: float, opening: float) -> float:
    """Flow through an edge; none by a drop that is unknown."""
    return 0.0 if math.isnan(drop) else edge * root(drop) * opening


@kernel
def _drawn(valves: Any, k: int, supply: float) -> float:
    total = 0.0
    for i in range(valves.edges.shape[0]):
        u = valves.signal[k, i]
        if u > 0.0:
            total += _through(valves.edges[i, 0], supply - valves.p_a[k, i], u)
        elif u < 0.0:
            total -= _through(valves.edges[i, 2], supply - valves.p_b[k, i], u)
    return total


@kernel
def _returned(valves: Any, k: int, tank: float) -> float:
    total = 0.0
    for i in range(valves.edges.shape[0]):
        u = valves.signal[k, i]
        if u > 0.0:
            total += _through(valves.edges[i, 3], valves.p_b[k, i] - tank, u)
        elif u < 0.0:
            total -= _through(valves.edges[i, 1], valves.p_a[k, i] - tank, u)
    return total


@kernel
def _rail(laws: Any, rows: FloatArray, on_tank: bool, recorded: float) -> float:
    rail = recorded
    for j in range(laws.value.shape[0]):
        if laws.on_tank[j] == on_tank:
            rail += call_law(laws.value[j], rows[j], laws.parameters[j])
    return rail


@kernel
def _set_flows(rows: FloatArray, valves: Any, k: int, supply: float, tank: float) -> None:
    drawn, returned = _drawn(valves, k, supply), _returned(valves, k, tank)
    for j in range(rows.shape[0]):
        rows[j, SUPPLY_FLOW], rows[j, RETURN_FLOW] = drawn, returned


@kernel
def _rest(
    laws: Any, rows: FloatArray, fresh: Any, valves: Any, k: int, supply: float, tank: float
) -> None:
    """States at rest where none are known yet: rail and flow agree, relaxed by half."""
    for j in range(fresh.shape[0]):
        if fresh[j]:
            rows[j, STATE_0] = 0.0
    for _ in range(_PASSES):
        now, back = _rail(laws, rows, False, supply), _rail(laws, rows, True, tank)
        _set_flows(rows, valves, k, now, back)
        most = 0.0
        for j in range(fresh.shape[0]):
            if fresh[j]:
                wanted = call_law(laws.initial[j], rows[j], laws.parameters[j])
                step = 0.5 * (wanted - rows[j, STATE_0])
                rows[j, STATE_0] += step
                # What is unknown stays so and is waited for by nobody.
                if abs(step) > most:
                    most = abs(step)
        if most < _ENOUGH_PA:
            break


@kernel
def follow_rails(
    laws: Any,
    rows: FloatArray,
    fresh: Any,
    valves: Any,
    supply: FloatArray,
    tank: FloatArray,
    out: FloatArray,
) -> None:
    """Supply and tank that the valves' flows and the laws agree on.

    The laws' states follow the flow with a lag, and the rails are theirs: of one sample's rails
    follow its flows, and of these the states at the next.

    Parameters
    ----------
    laws : RailLaws
    rows : (k, SIGNAL_COUNT) array
        Scratch: what each law looks at; its state is unknown (NaN) at the start.
    fresh : (k,) bool array
        Scratch.
    valves : Valves
    supply, tank : (N,) array
        As recorded, Pa.
    out : (2, N) array
        Filled: supply and tank in Pa.
    """
    for k in range(supply.shape[0]):
        some = False
        for j in range(fresh.shape[0]):
            fresh[j] = math.isnan(rows[j, STATE_0])
            some = some or fresh[j]
        if some:
            _rest(laws, rows, fresh, valves, k, supply[k], tank[k])
        out[0, k] = _rail(laws, rows, False, supply[k])
        out[1, k] = _rail(laws, rows, True, tank[k])
        _set_flows(rows, valves, k, out[0, k], out[1, k])
        for j in range(fresh.shape[0]):
            rate = call_law(laws.rate[j], rows[j], laws.parameters[j])
            moved = rows[j, STATE_0] + laws.response[j] * rate
            if not math.isnan(moved):
                rows[j, STATE_0] = moved
