"""Lay out the rows of some recordings: which samples, in which channel, in which order."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hydro_ident.estimate.flows.chambers import Chamber, WindowSettings, chambers_of, window_rows
from hydro_ident.estimate.forces.end_stops import at_end_stops
from hydro_ident.estimate.forces.force_rows import ForceModel, Motion, measured_force
from hydro_ident.estimate.forces.standstill import Rest, held_still
from hydro_ident.estimate.signals.derivatives import FilterSettings, kept_samples, motion
from hydro_ident.estimate.signals.traces import Trace
from hydro_ident.mismatch.rows.law_signals import looks_across
from hydro_ident.mismatch.rows.lost_signals import held_trace, out_of_reach
from hydro_ident.mismatch.rows.material import (
    Material,
    Place,
    Stretch,
    other_pressure,
    pressure_of,
)
from hydro_model.arrays import BoolArray, IndexArray
from hydro_model.effects.catalogue import resolve
from hydro_model.robot import FloatArray, Robot


def material_of(
    robot: Robot,
    forces: ForceModel,
    traces: Sequence[Trace],
    filters: FilterSettings,
    windows: WindowSettings,
    still: Mapping[str, Mapping[int, Rest]],
    rest_speed: FloatArray | None = None,
    beside: Sequence[Trace] = (),
    flows_alone: bool = False,
) -> Material:
    """Lay out the rows of some traces.

    Parameters
    ----------
    robot : Robot
    forces : ForceModel
    traces : sequence of Trace
        Whole recordings, in order.
    filters : FilterSettings
    windows : WindowSettings
        With the longest delay that a candidate may have, in intervals of the quickest trace.
    still : mapping of str to mapping of int to Rest
        By recording, how the joints stand that are still.
    rest_speed : (n,) array, optional
    beside : sequence of Trace, optional
        What laws are found in, where that is more: a balance has rows where they are known, too.
    flows_alone : bool
        Without the rows of forces.

    Returns
    -------
    Material
    """
    paired = _paired(robot, (*traces, *beside))
    stretches = tuple(
        replace(_stretch(robot, t, filters, own, still, paired), number=k)
        for k, (t, own) in enumerate(zip(traces, _windows(windows, traces), strict=True))
    )
    of_forces = [] if flows_alone else _force_kinds(forces, stretches)
    kinds = [*of_forces, *_flow_kinds(robot, stretches)]
    names = tuple(dict.fromkeys(t.recording for t in traces))
    laid = _laid_out(forces, stretches, kinds)
    sizes = np.cumsum([0, *(kept.size for _, _, kept in laid)])
    places = tuple(
        Place(s, k, slice(int(begin), int(end)))
        for (k, s, _), begin, end in zip(laid, sizes[:-1], sizes[1:], strict=True)
    )
    number = {s: names.index(one.trace.recording) for s, one in enumerate(stretches)}
    return Material(
        robot,
        forces,
        filters,
        windows,
        stretches,
        tuple(name for name, _, _ in kinds),
        tuple(unit for _, unit, _ in kinds),
        places,
        _stacked(laid, lambda k, s, kept: np.full(kept.size, k)).astype(np.intp),
        _stacked(laid, lambda k, s, kept: np.full(kept.size, number[s])).astype(np.intp),
        names,
        _stacked(laid, lambda k, s, kept: stretches[s].trace.time_s[kept]),
        _stacked(laid, lambda k, s, kept: _follows(kept)).astype(np.bool_),
        rest_speed,
    )


#: Channel, stretch and samples of the rows of a place.
_Laid = tuple[int, int, IndexArray]


def _laid_out(
    forces: ForceModel,
    stretches: Sequence[Stretch],
    kinds: Sequence[tuple[str, str, int]],
) -> list[_Laid]:
    """Rows of every channel of every stretch that has any."""
    result = []
    for k, (_, _, index) in enumerate(kinds):
        for s, stretch in enumerate(stretches):
            kept = stretch.kept if index < 0 else stretch.starts[index]
            known = index >= 0 or _force_known(forces, stretch)[-index - 1]
            if known and kept.size:
                result.append((k, s, kept))
    return result


def _stacked(
    laid: Sequence[_Laid], values: Callable[[int, int, IndexArray], NDArray[Any]]
) -> NDArray[Any]:
    """Values of all places' rows after one another, (N,)."""
    return np.concatenate([np.zeros(0), *(values(k, s, kept) for k, s, kept in laid)])


def _follows(kept: IndexArray) -> BoolArray:
    """Which rows follow the one before without a gap."""
    step = np.diff(kept, prepend=kept[0] - 1)
    follows: BoolArray = step == (np.min(step[1:]) if kept.size > 1 else 1)
    follows[0] = False
    return follows


def _windows(windows: WindowSettings, traces: Sequence[Trace]) -> list[WindowSettings]:
    """Windows of every trace: so many intervals of the quickest are fewer of another one."""
    quickest_s = min((t.step_s for t in traces), default=0.0)
    return [
        replace(windows, max_delay_cycles=windows.max_delay_cycles * (quickest_s / t.step_s))
        for t in traces
    ]


def _stretch(
    robot: Robot,
    trace: Trace,
    filters: FilterSettings,
    windows: WindowSettings,
    still: Mapping[str, Mapping[int, Rest]],
    paired: Sequence[bool],
) -> Stretch:
    kept: IndexArray = np.zeros(0, dtype=np.intp)
    moved, stopped = None, None
    rests = still.get(trace.recording, {})
    if np.isfinite(trace.q).all():
        kept = kept_samples(trace.samples, trace.step_s, filters, trace.cycle, trace.core)
        q = held_still(trace.q, rests)
        if trace.samples > 3 * filters.order:
            moved = Motion(*motion(q, trace.step_s, filters))
            stopped = at_end_stops(robot, replace(trace, q=q), filters, rests)
    span = max(1, round(windows.length_s / trace.step_s))
    held = held_trace(trace, span)
    starts = tuple(
        _starts(trace, held, chamber, windows, robot.command_delay_s, both)
        for chamber, both in zip(chambers_of(robot), paired, strict=True)
    )
    kept = kept if moved is not None else kept[:0]
    return Stretch(held, moved, kept, starts, span, stopped=stopped, still=frozenset(rests))


def _paired(robot: Robot, traces: Sequence[Trace]) -> list[bool]:
    """Which chambers' balances wait for the pressure of the cylinder's other chamber as well.

    A balance knows its own pressure alone, but laws may look at both. Where the other one was read
    at times, they can be told, and rows without it would lack them; so would all rows of a robot
    whose file lists such a law.
    """
    listed = resolve(robot)
    return [
        any(np.isfinite(other_pressure(chamber, trace)).any() for trace in traces)
        or any(looks_across(one, chamber) for one in listed)
        for chamber in chambers_of(robot)
    ]


def _starts(
    trace: Trace,
    held: Trace,
    chamber: Chamber,
    windows: WindowSettings,
    delay_s: float,
    both: bool,
) -> IndexArray:
    """First samples of windows that touch no unknown one, and none that a delay may move there."""
    i = chamber.index
    signals = [trace.stroke[:, i], pressure_of(chamber, trace), trace.supply, trace.tank]
    signals += [other_pressure(chamber, trace)] if both else []
    known: BoolArray = np.asarray(np.isfinite(np.stack(signals)).all(axis=0))
    known = known[1:] & known[:-1]
    known &= out_of_reach(held.valve_signal[:, i], trace.step_s, delay_s)
    steps = np.where(known, 0.0, np.nan)[:, None]
    rows = window_rows(steps, trace, trace.valve_signal[:, i], windows)
    return np.searchsorted(trace.time_s, rows.time_s).astype(np.intp)


def _force_known(forces: ForceModel, stretch: Stretch) -> list[bool]:
    """Which joints' forces were measured throughout."""
    force = measured_force(forces, stretch.trace)
    return [bool(np.isfinite(column).all()) for column in force.T]


def _force_kinds(forces: ForceModel, stretches: Sequence[Stretch]) -> list[tuple[str, str, int]]:
    """Name, unit and minus one minus the joint of every force channel that was measured."""
    usable = [s for s in stretches if s.kept.size]
    if not usable:
        return []
    known = [
        any(column) for column in zip(*(_force_known(forces, s) for s in usable), strict=True)
    ]
    return [(name, forces.units[j], -1 - j) for j, name in enumerate(forces.channels) if known[j]]


def _flow_kinds(robot: Robot, stretches: Sequence[Stretch]) -> list[tuple[str, str, int]]:
    return [
        (chamber.channel, "m^3/s", k)
        for k, chamber in enumerate(chambers_of(robot))
        if any(s.starts[k].size for s in stretches)
    ]
