"""The integrated mass balance of one cylinder chamber, linear in its parameters.

With gauge pressures, flow into the chamber positive (`hydro_model.hydraulics.valve`) and V the
chamber's volume, eqs. 10 to 12 say ``q(u, p) - dV/dt = V / beta dp/dt``. Over a window it becomes

    dV = c_1 int g_1 dt + c_2 int g_2 dt - (1 / beta) int V dp

with one edge open for u > 0 and the other for u < 0. No pressure is differentiated: the balance
over a window sees the transducers' noise at its two ends only. The two chambers are fitted apart
(better conditioned than the summed form of eq. 14).

The command is held between samples and takes effect `delay_s` later; a delay that is no whole
number of samples splits the interval in which the signal changes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from hydro_ident.estimate.signals.traces import Trace
from hydro_ident.estimate.statistics.least_squares import BoolArray, Rows
from hydro_model.hydraulics.cylinder import chamber_volumes
from hydro_model.robot import Cylinder, FloatArray, Robot, Valve

Side = Literal["a", "b"]

#: Valve edges of each chamber: the one open for u > 0, then for u < 0.
EDGES: dict[Side, tuple[str, str]] = {"a": ("c_pa", "c_at"), "b": ("c_bt", "c_pb")}
INVERSE_BULK = "inverse_bulk_modulus"
#: A dead volume enters the balance as V0 / beta: fitted under this suffix, then divided.
OVER_BULK = "/bulk_modulus"


@dataclass(frozen=True, slots=True)
class WindowSettings:
    """Windows of the mass balance.

    Attributes
    ----------
    length_s : float
        A window is a boxcar filter of the balance: 40 ms passes the hydraulic mode (1.6-4.4 Hz)
        whole, while the pressure noise at its ends stays a percent of the compressed volume.
    hop_s : float
        Between the starts of two windows.
    max_delay_cycles : float
        Longest command delay fitted, in sampling intervals (`identify` goes beyond one where the
        robot file states a longer delay).
    """

    length_s: float = 0.04
    hop_s: float = 0.02
    max_delay_cycles: float = 1.0

    def span(self, step_s: float) -> int:
        """Sampling intervals in a window; `step_s`: the length of one."""
        return max(1, round(self.length_s / step_s))

    def reaching(self, delay_s: float, step_s: float) -> WindowSettings:
        """The same, of delays up to this one at least.

        Parameters
        ----------
        delay_s : float
        step_s : float
            Sampling interval of the recording.
        """
        cycles = math.ceil(delay_s / step_s)
        return self if cycles <= self.max_delay_cycles else replace(self, max_delay_cycles=cycles)


@dataclass(frozen=True, slots=True)
class Chamber:
    """One chamber of one cylinder.

    Attributes
    ----------
    index : int
        Of the cylinder in the robot.
    side : {"a", "b"}
    cylinder : Cylinder
    valve : Valve
    """

    index: int
    side: Side
    cylinder: Cylinder
    valve: Valve

    @property
    def channel(self) -> str:
        """Name of the residual channel, `<joint>/flow_<side>`."""
        return f"{self.cylinder.joint}/flow_{self.side}"

    @property
    def edges(self) -> tuple[str, str]:
        """The two edge coefficients, of u > 0 and of u < 0."""
        return EDGES[self.side]


def chambers_of(robot: Robot) -> tuple[Chamber, ...]:
    """Every chamber that a valve feeds, cylinder by cylinder, A before B."""
    fed = {valve.cylinder: valve for valve in robot.valves}
    sides: tuple[Side, Side] = ("a", "b")
    return tuple(
        Chamber(i, side, cylinder, fed[cylinder.name])
        for i, cylinder in enumerate(robot.cylinders)
        if cylinder.name in fed
        for side in sides
    )


def column_names(chamber: Chamber, extra: Sequence[str] = ()) -> tuple[str, ...]:
    """Columns of `chamber_rows`: inverse bulk modulus, two edges, then the listed effects'.

    `extra` are the names of the latter.
    """
    return (INVERSE_BULK, *chamber.edges, *extra)


def chamber_rows(
    chamber: Chamber,
    trace: Trace,
    delay_s: float,
    windows: WindowSettings,
    extra: FloatArray | None = None,
) -> Rows:
    """Rows of a chamber's balance over the windows of one trace, as mean flows in m^3/s.

    Parameters
    ----------
    chamber : Chamber
    trace : Trace
    delay_s : float
        From the stamp of a command to its effect.
    windows : WindowSettings
    extra : (N - 1, e) array, optional
        Volume into the chamber over each sampling interval per unit of a further parameter.

    Returns
    -------
    Rows
        One channel: y is the mean volume rate, x the columns of `column_names`; windows that
        touch a sample without signal or pressure are left out.
    """
    x = trace.stroke[:, chamber.index]
    volume = chamber_volumes(chamber.cylinder, x)[0 if chamber.side == "a" else 1]
    pressure = (trace.p_a if chamber.side == "a" else trace.p_b)[:, chamber.index]
    opening, closing = edge_integrals(chamber, trace, delay_s)
    compressed = 0.5 * (volume[1:] + volume[:-1]) * np.diff(pressure)
    columns = [-compressed, opening, closing]
    if extra is not None:
        columns += list(extra.T)
    steps = np.stack([np.diff(volume), *columns], axis=1)
    return window_rows(steps, trace, trace.valve_signal[:, chamber.index], windows)


def window_rows(
    steps: FloatArray, trace: Trace, signal: FloatArray, windows: WindowSettings
) -> Rows:
    """Sums over windows of what a balance takes up per sampling interval, as mean rates.

    Parameters
    ----------
    steps : (N - 1, 1 + p) array
        The left-hand side, then the columns.
    trace : Trace
    signal : (N,) array
        Valve signal; windows that touch a sample where it is unknown are left out.
    windows : WindowSettings

    Returns
    -------
    Rows
        One channel.
    """
    h = trace.step_s
    known = _signal_known(signal, windows.max_delay_cycles)
    span = windows.span(h)
    hop = max(1, round(windows.hop_s / h))
    begin, end = trace.owned.start, min(trace.owned.stop, steps.shape[0] - span + 1)
    # Windows start on multiples of the hop in their recording, whatever pieces it comes in.
    start = np.arange(begin + (-trace.cycle - begin) % hop, end, hop)
    # A gap would spoil every later sum: zero it, and drop the windows that touch it.
    broken = ~(known & np.isfinite(steps).all(axis=1))
    total = _running_sum(np.where(broken[:, None], 0.0, steps))
    gaps = _running_sum(broken.astype(float)[:, None])[:, 0]
    start = start[gaps[start + span] == gaps[start]]
    means = (total[start + span] - total[start]) / (span * h)
    return Rows(
        means[:, :1],
        means[:, None, 1:],
        trace.time_s[start],
        trace.label,
        step_s=hop * h,
        stride=max(1, round(span / hop)),
    )


def _running_sum(steps: FloatArray) -> FloatArray:
    return np.concatenate([np.zeros((1, steps.shape[1])), np.cumsum(steps, axis=0)])


def edge_integrals(
    chamber: Chamber, trace: Trace, delay_s: float
) -> tuple[FloatArray, FloatArray]:
    """Integrals over each sampling interval of the two edges' flows at unit coefficient.

    The signal changes within the interval, a delay after its sample; each part's flow is that at
    its middle (`edge_flows`, eqs. 11 to 13, of an edge whose coefficient is 1).

    Parameters
    ----------
    chamber : Chamber
    trace : Trace
    delay_s : float

    Returns
    -------
    opening, closing : (N - 1,) array
        Into the chamber while u > 0, and while u <= 0.
    """
    from hydro_ident.estimate.flows.edge_kernels import integrate_edges

    i, h = chamber.index, trace.step_s
    late, soon, fraction = held_parts(trace.valve_signal[:, i], delay_s, h)
    pressure = trace.p_a[:, i] if chamber.side == "a" else trace.p_b[:, i]
    result = np.empty((2, late.size))
    integrate_edges(
        np.ascontiguousarray(late), np.ascontiguousarray(soon), fraction, h,
        np.ascontiguousarray(pressure), trace.supply, trace.tank, chamber.side == "a", result,
    )  # fmt: skip
    return result[0], result[1]


def held_parts(
    signal: FloatArray, delay_s: float, step_s: float
) -> tuple[FloatArray, FloatArray, float]:
    """A held signal within each sampling interval, a delay after its samples.

    Parameters
    ----------
    signal : (N,) array
    delay_s, step_s : float

    Returns
    -------
    late, soon : (N - 1,) array
        At the interval's start and after its change; NaN where that lies before the signal.
    fraction : float
        Share of the interval that the first of them lasts.
    """
    whole = math.floor(delay_s / step_s + 1e-9)
    late, soon = _shifted(signal, whole + 1)[:-1], _shifted(signal, whole)[:-1]
    return late, soon, delay_s / step_s - whole


def _signal_known(signal: FloatArray, delay_cycles: float) -> BoolArray:
    """Intervals whose signal is known at every delay: all delays are fitted on the same."""
    known = np.ones(signal.size, dtype=bool)
    for k in range(math.ceil(delay_cycles) + 1):
        known &= np.isfinite(_shifted(signal, k))
    return known[:-1]


def _shifted(signal: FloatArray, samples: int) -> FloatArray:
    """The signal `samples` earlier; NaN where that lies before the trace."""
    return np.concatenate([np.full(samples, np.nan), signal])[: signal.size]
