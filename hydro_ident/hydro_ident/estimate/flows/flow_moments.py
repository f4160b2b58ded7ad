"""The chambers' balances gathered in one pass, for every command delay at once.

The flow columns of `hydro_ident.estimate.flows.chambers` are smooth in the delay between two
samples: gathered at a few delays per sampling interval, they are interpolated at any other to far
below the transducers' noise, with their slope. Fitting the delay needs no further look at the
rows. Beside what is taken of a pressure's differences stands the same of its neighbours in time,
as an instrument: readings hold their noise at a window's two ends.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from hydro_ident.estimate.flows.chambers import (
    Chamber,
    WindowSettings,
    chambers_of,
    edge_integrals,
    window_rows,
)
from hydro_ident.estimate.signals.neighbours import neighbour_mean
from hydro_ident.estimate.signals.traces import Trace
from hydro_ident.estimate.statistics.moments import Moments
from hydro_ident.estimate.statistics.robust import Weights
from hydro_ident.estimate.statistics.rows import Rows
from hydro_model.hydraulics.cylinder import chamber_volumes
from hydro_model.robot import FloatArray, Robot

#: Names and columns of the listed effects' linear parameters for a chamber and a trace.
ExtraColumns = Callable[[Chamber, Trace], tuple[tuple[str, ...], FloatArray]]
#: Picks the rows that take part in a fit.
Select = Callable[[Rows], Rows]

#: Delays per sampling interval: a cubic, wrong by some 1e-8 of a column.
_NODES = 4
#: Share of a cycle by which the rates of two recordings may differ and be the same.
NEARLY = 0.01
#: Rails, in the order of their gathered columns, and the step of these slopes, Pa.
RAILS, _RAIL_STEP_PA = ("supply", "tank"), 1.0e4
_AT = 0.5 - 0.5 * np.cos(np.pi * (np.arange(_NODES) + 0.5) / _NODES)


def delay_nodes(windows: WindowSettings) -> FloatArray:
    """Delays at which the columns are gathered, in sampling intervals."""
    whole = max(1, math.ceil(windows.max_delay_cycles))
    return np.concatenate([_AT + k for k in range(whole)])


def delay_weights(cycles: float, windows: WindowSettings) -> tuple[FloatArray, FloatArray]:
    """Weights of the gathered delays that give the column at another, and its slope.

    Parameters
    ----------
    cycles : float
        Delay in sampling intervals.
    windows : WindowSettings

    Returns
    -------
    weights, slopes : (nodes,) array
        The slope is per sampling interval.
    """
    nodes = delay_nodes(windows)
    interval = min(max(math.floor(cycles), 0), nodes.size // _NODES - 1)
    powers = np.arange(_NODES)
    at = cycles - interval
    inverse = np.linalg.inv(np.vander(_AT, _NODES, increasing=True))
    slope = powers * at ** np.maximum(powers - 1, 0)
    weights, slopes = np.zeros(nodes.size), np.zeros(nodes.size)
    own = slice(interval * _NODES, (interval + 1) * _NODES)
    weights[own] = at**powers @ inverse
    slopes[own] = slope @ inverse
    return weights, slopes


def combination(
    cycles: float, extras: int, windows: WindowSettings
) -> tuple[FloatArray, FloatArray]:
    """Columns of `chambers.column_names` from the gathered ones, and their slopes in the delay.

    `instruments` are the same with the columns of the neighbours' pressures.

    Parameters
    ----------
    cycles : float
        Delay in sampling intervals.
    extras : int
        Number of the listed effects' columns.
    windows : WindowSettings

    Returns
    -------
    combine, slope : (2 (1 + extras) + 2 nodes + rails, 3 + extras) array
    """
    weights, slopes = delay_weights(cycles, windows)
    count = weights.size
    combine = np.zeros((2 * (1 + extras) + 2 * count + len(RAILS), 3 + extras))
    slope = np.zeros_like(combine)
    begin = 2 * (1 + extras)
    for column in (1, 2):
        rows = slice(begin + (column - 1) * count, begin + column * count)
        combine[rows, column], slope[rows, column] = weights, slopes
    combine[0, 0] = 1.0
    combine[1 : 1 + extras, 3:] = np.eye(extras)
    return combine, slope


def instruments(combine: FloatArray, extras: int) -> FloatArray:
    """The instruments from the gathered columns: those of the pressures' neighbours.

    Parameters
    ----------
    combine : (w, p) array
        Of the columns, `combination`.
    extras : int

    Returns
    -------
    (w, p) array
        Edges, in which noise stands under a root and is summed up, are their own.
    """
    own, calm = slice(0, 1 + extras), slice(1 + extras, 2 * (1 + extras))
    result = combine.copy()
    result[calm], result[own] = combine[own], 0.0
    return result


def gathered_rows(
    chamber: Chamber,
    trace: Trace,
    windows: WindowSettings,
    extra: tuple[FloatArray, FloatArray] | None = None,
) -> Rows:
    """Rows of a chamber's balance with its flow columns at every gathered delay.

    A difference of two readings over a window holds their noise, which makes oil look stiffer
    than it is. The same difference of the readings' neighbours does not hold it: an instrument.

    Parameters
    ----------
    chamber : Chamber
    trace : Trace
    windows : WindowSettings
    extra : pair of (N - 1, e) array, optional
        As for `chambers.chamber_rows`, and the same of the pressures' neighbours.

    Returns
    -------
    Rows
        One channel; columns: compressed volume, extra, both of the neighbours' pressures, one
        edge at every delay, the other, then by rail the slope in it of the edge that it feeds or
        drains, at the middle of the delays; zero where the rail was read.
    """
    side = 0 if chamber.side == "a" else 1
    volume = chamber_volumes(chamber.cylinder, trace.stroke[:, chamber.index])[side]
    pressure = (trace.p_a if chamber.side == "a" else trace.p_b)[:, chamber.index]
    middle = 0.5 * (volume[1:] + volume[:-1])
    edges = [edge_integrals(chamber, trace, d * trace.step_s) for d in delay_nodes(windows)]
    columns = []
    for readings, more in zip(
        (pressure, neighbour_mean(pressure, trace.step_s, windows.span(trace.step_s))),
        extra or (None, None),
        strict=True,
    ):
        columns += [-middle * np.diff(readings), *(() if more is None else more.T)]
    columns += [opening for opening, _ in edges] + [closing for _, closing in edges]
    columns += _rail_slopes(chamber, trace, windows)
    steps = np.stack([np.diff(volume), *columns], axis=1)
    return window_rows(steps, trace, trace.valve_signal[:, chamber.index], windows)


def _rail_slopes(chamber: Chamber, trace: Trace, windows: WindowSettings) -> list[FloatArray]:
    """Volumes through the edges of unit coefficient per Pa of each rail that nobody read."""
    delay_s = 0.5 * windows.max_delay_cycles * trace.step_s
    slopes = []
    for rail, read in zip(RAILS, trace.rails_read, strict=True):
        if read:
            slopes.append(np.zeros(trace.samples - 1))
            continue
        sides = [
            sum(edge_integrals(chamber, replace(trace, **{rail: moved}), delay_s))
            for moved in (getattr(trace, rail) + s * _RAIL_STEP_PA for s in (-0.5, 0.5))
        ]
        slopes.append(np.asarray(sides[1] - sides[0]) / _RAIL_STEP_PA)
    return slopes


@dataclass(slots=True)
class ChamberMoments:
    """Moments of one chamber in one recording.

    Attributes
    ----------
    listed : tuple of str
        The listed effects' columns.
    moments : Moments
    step_s : float
        Sampling interval of the recording.
    windows : WindowSettings
        As gathered: with the delays that its columns reach.
    read_s : float
        As of `Trace`.
    """

    listed: tuple[str, ...]
    moments: Moments
    step_s: float
    windows: WindowSettings
    read_s: float = 0.0

    @property
    def longest_s(self) -> float:
        """Longest delay that its columns reach."""
        return self.windows.max_delay_cycles * self.step_s


@dataclass(slots=True)
class FlowGatherer:
    """Gathers the balances of every chamber of a recording, trace by trace in order.

    Attributes
    ----------
    robot : Robot
    label : str
        Of the recording.
    windows : WindowSettings
    extra : callable or None
        Columns of listed effects.
    select : callable or None
        Picks the rows that take part.
    weights : mapping of str to Weights
        Robust weights by chamber.
    chambers : dict of str to ChamberMoments
    longest_s : float
        Longest delay of any recording: at a finer rate it is more cycles than `windows` say.
    rails_off_pa : mapping of str to float
        What the robot file's constants are taken to be off by, of rails that were not read.
    """

    robot: Robot
    label: str
    windows: WindowSettings
    extra: ExtraColumns | None = None
    select: Select | None = None
    weights: dict[str, Weights] = field(default_factory=dict)
    chambers: dict[str, ChamberMoments] = field(default_factory=dict)
    longest_s: float = 0.0
    rails_off_pa: Mapping[str, float] = field(default_factory=dict)

    def add(self, trace: Trace) -> None:
        """Take in the next trace; its valve signals as the listed laws shape them."""
        windows = self.windows.reaching(self.longest_s - NEARLY * trace.step_s, trace.step_s)
        unread = [rail for rail, read in zip(RAILS, trace.rails_read, strict=True) if not read]
        off = {rail: self.rails_off_pa[rail] for rail in unread if rail in self.rails_off_pa}
        trace = replace(trace, **{rail: getattr(trace, rail) + pa for rail, pa in off.items()})
        for chamber in chambers_of(self.robot):
            listed, rows = self._rows(chamber, trace, windows)
            if not rows.time_s.size:
                continue
            name = chamber.channel
            if name not in self.chambers:
                moments = Moments.like(rows, self.label, sample_s=trace.step_s)
                self.chambers[name] = ChamberMoments(
                    listed, moments, trace.step_s, windows, trace.read_s
                )
            self.chambers[name].moments.add(rows, self.weights.get(name))

    def _rows(
        self, chamber: Chamber, trace: Trace, windows: WindowSettings
    ) -> tuple[tuple[str, ...], Rows]:
        listed, columns = self.extra(chamber, trace) if self.extra else ((), None)
        both = None
        if self.extra and columns is not None and listed:
            both = columns, self.extra(chamber, _calm(trace, windows))[1]
        rows = gathered_rows(chamber, trace, windows, both)
        return listed, rows if self.select is None else self.select(rows)


def _calm(trace: Trace, windows: WindowSettings) -> Trace:
    """The trace with its chambers' pressures by their neighbours."""
    step_s, span = trace.step_s, windows.span(trace.step_s)
    p_a, p_b = (neighbour_mean(p, step_s, span) for p in (trace.p_a, trace.p_b))
    return replace(trace, p_a=p_a, p_b=p_b)
