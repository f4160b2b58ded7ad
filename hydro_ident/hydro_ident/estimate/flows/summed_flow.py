"""The summed flow equation of the paper (eq. 14), for comparison with the separate chambers.

Eq. 14 divides each chamber's balance by its length and adds the two, so that the piston force
takes the place of the pressures. With Q = -(Q1 / x + Q2 / (S - x)), integrated over the windows
of `hydro_ident.estimate.flows.chambers`:

    d(A1 ln x - A2 ln(S - x)) = int Q1 / x dt + int Q2 / (S - x) dt - df / beta

One regression with five parameters takes the place of two with three. The edges open for the same
sign of u (P-A with B-T, A-T with P-B) then have columns that differ by the pressures alone.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from hydro_ident.estimate.flows.chambers import (
    INVERSE_BULK,
    Chamber,
    WindowSettings,
    chamber_rows,
    chambers_of,
    edge_integrals,
    window_rows,
)
from hydro_ident.estimate.signals.traces import Trace
from hydro_ident.estimate.statistics.least_squares import Rows
from hydro_model.hydraulics.cylinder import piston_force
from hydro_model.robot import FloatArray, Robot

#: Columns of `summed_rows`.
SUMMED_NAMES = (INVERSE_BULK, "c_pa", "c_at", "c_bt", "c_pb")


@dataclass(frozen=True, slots=True)
class Conditioning:
    """A regression's estimates and how well its columns are told apart.

    Attributes
    ----------
    names : tuple of str
    theta : (p,) array
        Ordinary least squares.
    condition_number : float
        Of the regressor, its columns scaled to the same length.
    error_factor : (p,) array
        By which each parameter's error grows because its column resembles the others (square
        root of the variance inflation).
    """

    names: tuple[str, ...]
    theta: FloatArray
    condition_number: float
    error_factor: FloatArray


@dataclass(frozen=True, slots=True)
class SummedComparison:
    """Eq. 14 and the separate chambers of one cylinder on the same windows.

    Attributes
    ----------
    cylinder : str
    rows : int
        Windows of the summed form.
    summed, chamber_a, chamber_b : Conditioning
    """

    cylinder: str
    rows: int
    summed: Conditioning
    chamber_a: Conditioning
    chamber_b: Conditioning


def summed_rows(
    pair: tuple[Chamber, Chamber], trace: Trace, delay_s: float, windows: WindowSettings
) -> Rows:
    """Rows of eq. 14 over the windows of one trace, in m^2/s.

    Parameters
    ----------
    pair : tuple of Chamber
        Chambers A and B of a cylinder.
    trace : Trace
    delay_s : float
    windows : WindowSettings

    Returns
    -------
    Rows
        One channel, columns `SUMMED_NAMES`; windows that reach an end stop are left out.
    """
    index, cylinder = pair[0].index, pair[0].cylinder
    x = trace.stroke[:, index].copy()
    x[~((x > 0.0) & (x < cylinder.stroke_m))] = np.nan
    rest = cylinder.stroke_m - x
    level = cylinder.area_a_m2 * np.log(x) - cylinder.area_b_m2 * np.log(rest)
    force = piston_force(cylinder, trace.p_a[:, index], trace.p_b[:, index])
    (a_open, a_close), (b_open, b_close) = (edge_integrals(c, trace, delay_s) for c in pair)
    length_a, length_b = 0.5 * (x[1:] + x[:-1]), 0.5 * (rest[1:] + rest[:-1])
    columns = (
        np.diff(level),
        -np.diff(force),
        a_open / length_a,
        a_close / length_a,
        # Edge flows count into chamber B, the paper's Q2 out of it.
        -b_open / length_b,
        -b_close / length_b,
    )
    return window_rows(np.stack(columns, axis=1), trace, trace.valve_signal[:, index], windows)


@dataclass(slots=True)
class _Normal:
    """Normal equations of one regression, summed over pieces."""

    names: tuple[str, ...]
    matrix: FloatArray
    vector: FloatArray
    rows: int = 0

    @staticmethod
    def of(names: Sequence[str]) -> _Normal:
        count = len(names)
        return _Normal(tuple(names), np.zeros((count, count)), np.zeros(count))

    def add(self, rows: Rows) -> None:
        x, y = rows.x[:, 0], rows.y[:, 0]
        self.matrix += x.T @ x
        self.vector += x.T @ y
        self.rows += y.size

    def solve(self) -> Conditioning | None:
        size = np.sqrt(np.diag(self.matrix))
        if self.rows <= len(self.names) or not (size > 0.0).all():
            return None
        values, vectors = np.linalg.eigh(self.matrix / np.outer(size, size))
        if values[0] <= 1e-14 * values[-1]:
            return None
        inverse = (vectors / values) @ vectors.T
        return Conditioning(
            self.names,
            inverse @ (self.vector / size) / size,
            float(np.sqrt(values[-1] / values[0])),
            np.sqrt(np.diag(inverse)),
        )


class SummedFlow:
    """Compares the summed form with the separate chambers, piece by piece of the recordings.

    Parameters
    ----------
    robot : Robot
    delay_of : callable
        Command delay in s, as fitted, of a valve by its name.
    windows : WindowSettings
    """

    def __init__(
        self, robot: Robot, delay_of: Callable[[str], float], windows: WindowSettings
    ) -> None:
        self._windows = windows
        chambers = chambers_of(robot)
        self._pairs = list(zip(chambers[::2], chambers[1::2], strict=True))
        # Numbers, as sums travel between processes.
        self._delays_s = [delay_of(a.valve.name) for a, _ in self._pairs]
        self._sums = [
            (_Normal.of(SUMMED_NAMES), *(_Normal.of((INVERSE_BULK, *c.edges)) for c in pair))
            for pair in self._pairs
        ]

    def add(self, trace: Trace) -> None:
        """Take in the windows of one trace.

        Parameters
        ----------
        trace : Trace
            Its valve signal as the fit of the chambers had it.
        """
        each = zip(self._pairs, self._delays_s, self._sums, strict=True)
        for pair, delay_s, (summed, *separate) in each:
            summed.add(summed_rows(pair, trace, delay_s, self._windows))
            for chamber, normal in zip(pair, separate, strict=True):
                normal.add(chamber_rows(chamber, trace, delay_s, self._windows))

    def merge(self, other: SummedFlow) -> None:
        """Take in what another recording gave."""
        for mine, theirs in zip(self._sums, other._sums, strict=True):
            for normal, more in zip(mine, theirs, strict=True):
                normal.matrix += more.matrix
                normal.vector += more.vector
                normal.rows += more.rows

    def result(self) -> tuple[SummedComparison, ...]:
        """The comparison, without cylinders that the traces do not determine."""
        found = []
        for pair, sums in zip(self._pairs, self._sums, strict=True):
            summed, chamber_a, chamber_b = (normal.solve() for normal in sums)
            if summed and chamber_a and chamber_b:
                name, rows = pair[0].cylinder.name, sums[0].rows
                found.append(SummedComparison(name, rows, summed, chamber_a, chamber_b))
        return tuple(found)


def summed_dict(comparison: SummedComparison) -> dict[str, Any]:
    """A cylinder's entry under `summed_flow` of result.json.

    Parameters
    ----------
    comparison : SummedComparison

    Returns
    -------
    dict
        Condition numbers of the summed form and of either chamber, then by parameter the two
        estimates and the factors by which collinearity multiplies their errors.
    """
    summed, chambers = comparison.summed, (comparison.chamber_a, comparison.chamber_b)
    parameters = {}
    for name, value, factor in zip(summed.names, summed.theta, summed.error_factor, strict=True):
        separate = {
            side: {
                "value": float(c.theta[c.names.index(name)]),
                "error_factor": float(c.error_factor[c.names.index(name)]),
            }
            for side, c in zip("ab", chambers, strict=True)
            if name in c.names
        }
        parameters[name] = {
            "summed": {"value": float(value), "error_factor": float(factor)},
            "separate": separate,
        }
    return {
        "windows": comparison.rows,
        "condition_number": {
            "summed": summed.condition_number,
            "chamber_a": chambers[0].condition_number,
            "chamber_b": chambers[1].condition_number,
        },
        "parameters": parameters,
    }
