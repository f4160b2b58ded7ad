"""Bulk modulus and valve edges per cylinder, and the command delay, from the chamber balances.

Each chamber is fitted by itself (`hydro_ident.estimate.chambers`); what the two chambers of a
cylinder share, the bulk modulus above all, is then combined weighted by its information. A
result outside physical bounds is rejected and said, never replaced.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from hydro_ident.estimate.chambers import (
    INVERSE_BULK,
    Chamber,
    WindowSettings,
    chamber_rows,
    chambers_of,
    column_names,
)
from hydro_ident.estimate.least_squares import Fit, Rows, weighted_least_squares
from hydro_ident.estimate.traces import Trace
from hydro_model.robot import FloatArray, Robot

#: Effective bulk modulus of a hydraulic chamber: from a foaming reservoir to steel-piped oil.
BULK_BOUNDS_PA = (1.0e7, 5.0e9)
#: A parameter whose column resembles the others this much is not told apart from them.
MAX_COLLINEARITY = 1.0e3

#: Names and columns of the listed effects' linear parameters for a chamber and a trace.
ExtraColumns = Callable[[Chamber, Trace], tuple[tuple[str, ...], FloatArray]]


@dataclass(frozen=True, slots=True)
class ChamberFit:
    """Fit of one chamber alone.

    Attributes
    ----------
    chamber : Chamber
    names : tuple of str
        Of the columns.
    fit : Fit
    """

    chamber: Chamber
    names: tuple[str, ...]
    fit: Fit


@dataclass(frozen=True, slots=True)
class CylinderFit:
    """Hydraulic parameters of one cylinder, both chambers combined.

    Attributes
    ----------
    cylinder, valve : str
    names : tuple of str
        `inverse_bulk_modulus`, the four edges, then linear parameters of listed effects.
    theta : (p,) array
    covariance : (p, p) array
    identifiable : tuple of bool
    rejected : str
        Why the values are not to be used; empty where they are good.
    chambers : tuple of ChamberFit
    """

    cylinder: str
    valve: str
    names: tuple[str, ...]
    theta: FloatArray
    covariance: FloatArray
    identifiable: tuple[bool, ...]
    rejected: str
    chambers: tuple[ChamberFit, ...]

    def value(self, name: str) -> tuple[float, float]:
        """A parameter and its standard deviation."""
        at = self.names.index(name)
        return float(self.theta[at]), float(np.sqrt(self.covariance[at, at]))

    def bulk_modulus(self) -> tuple[float, float]:
        """Bulk modulus and its standard deviation (to first order), Pa."""
        inverse, std = self.value(INVERSE_BULK)
        return 1.0 / inverse, std / inverse**2


@dataclass(frozen=True, slots=True)
class HydraulicFit:
    """Hydraulic parameters of a robot.

    Attributes
    ----------
    delay_s, delay_std_s : float
        Command delay; the deviation is infinite where the valves did not move.
    cylinders : tuple of CylinderFit
        Those with a valve and at least one chamber recorded.
    windows : WindowSettings
    """

    delay_s: float
    delay_std_s: float
    cylinders: tuple[CylinderFit, ...]
    windows: WindowSettings


def fit_hydraulics(
    robot: Robot,
    traces: Sequence[Trace],
    windows: WindowSettings | None = None,
    extra: ExtraColumns | None = None,
    select: Callable[[Rows], Rows] | None = None,
) -> HydraulicFit | None:
    """Fit the command delay, then every chamber, then combine the chambers of each cylinder.

    Parameters
    ----------
    robot : Robot
    traces : sequence of Trace
    windows : WindowSettings, optional
    extra : callable, optional
        Columns of listed effects.
    select : callable, optional
        Picks the rows that take part in the fit.

    Returns
    -------
    HydraulicFit or None
        None where no chamber has pressures, stroke and valve signal.
    """
    windows = windows or WindowSettings()
    build = _RowBuilder(tuple(traces), windows, extra, select or (lambda rows: rows))
    start = max(trace.step_s for trace in traces) * windows.max_delay_cycles if traces else 0.0
    chambers = [c for c in chambers_of(robot) if build.enough(c, start)]
    if not chambers:
        return None
    delay = _profile_delay(build, chambers, start)
    fits = [build.fit(chamber, delay) for chamber in chambers]
    cylinders = []
    for index in sorted({chamber.index for chamber in chambers}):
        cylinders.append(_combine([f for f in fits if f.chamber.index == index]))
    return HydraulicFit(
        delay, _delay_std(build, chambers, delay, start), tuple(cylinders), windows
    )


@dataclass(frozen=True, slots=True)
class _RowBuilder:
    traces: tuple[Trace, ...]
    windows: WindowSettings
    extra: ExtraColumns | None
    select: Callable[[Rows], Rows]

    def rows(self, chamber: Chamber, delay_s: float) -> list[Rows]:
        built = []
        for trace in self.traces:
            columns = self.extra(chamber, trace)[1] if self.extra else None
            rows = chamber_rows(chamber, trace, delay_s, self.windows, columns)
            built.append(self.select(rows))
        return [rows for rows in built if rows.time_s.size]

    def names(self, chamber: Chamber) -> tuple[str, ...]:
        listed = self.extra(chamber, self.traces[0])[0] if self.extra else ()
        return column_names(chamber, listed)

    def enough(self, chamber: Chamber, delay_s: float) -> bool:
        rows = self.rows(chamber, delay_s)
        return sum(r.time_s.size for r in rows) > 10 * len(self.names(chamber))

    def fit(self, chamber: Chamber, delay_s: float) -> ChamberFit:
        rows = self.rows(chamber, delay_s)
        return ChamberFit(chamber, self.names(chamber), weighted_least_squares(rows))

    def stacked(self, chamber: Chamber, delay_s: float) -> tuple[FloatArray, FloatArray]:
        rows = self.rows(chamber, delay_s)
        x = np.concatenate([r.x[:, 0] for r in rows])
        return x, np.concatenate([r.y[:, 0] for r in rows])

    def misfit(self, chamber: Chamber, delay_s: float) -> float:
        """Log-likelihood of a chamber at a delay, its own variance fitted (a profile)."""
        x, y = self.stacked(chamber, delay_s)
        norms = np.linalg.norm(x, axis=0)
        norms[norms == 0.0] = 1.0
        theta = np.linalg.lstsq(x / norms, y, rcond=1e-12)[0]
        squares = float(np.sum((y - (x / norms) @ theta) ** 2))
        return y.size * math.log(max(squares, 1e-24 * float(y @ y), 1e-300))


def _profile_delay(build: _RowBuilder, chambers: Sequence[Chamber], longest_s: float) -> float:
    """The delay in [0, longest_s] that fits all chambers best: a coarse grid, then Brent."""
    from scipy.optimize import minimize_scalar

    def objective(delay_s: float) -> float:
        return sum(build.misfit(chamber, float(delay_s)) for chamber in chambers)

    if longest_s <= 0.0:
        return 0.0
    grid = np.linspace(0.0, longest_s, 6)
    values = [objective(d) for d in grid]
    best = int(np.argmin(values))
    low, high = grid[max(best - 1, 0)], grid[min(best + 1, grid.size - 1)]
    found = minimize_scalar(
        objective, bounds=(low, high), method="bounded", options={"xatol": 1e-4 * longest_s}
    )
    return float(found.x) if found.fun < values[best] else float(grid[best])


def _delay_std(
    build: _RowBuilder, chambers: Sequence[Chamber], delay_s: float, longest_s: float
) -> float:
    """Deviation of the delay: the sensitivity of the balance to it as one more column."""
    step = 0.05 * longest_s
    if step <= 0.0:
        return math.inf
    near = min(max(delay_s, step), longest_s - step)
    information = 0.0
    for chamber in chambers:
        theta = build.fit(chamber, delay_s).fit.theta
        ahead, behind = build.rows(chamber, near + step), build.rows(chamber, near - step)
        augmented = []
        for rows, after, before in zip(build.rows(chamber, delay_s), ahead, behind, strict=True):
            count = min(rows.time_s.size, after.time_s.size, before.time_s.size)
            slope = (after.x[-count:] - before.x[-count:]) @ theta / (2.0 * step)
            x = np.concatenate([rows.x[-count:], slope[..., None]], axis=2)
            augmented.append(Rows(rows.y[-count:], x, rows.time_s[-count:], rows.label))
        std = weighted_least_squares(augmented).std[-1]
        information += 1.0 / std**2 if std > 0.0 else 0.0
    return 1.0 / math.sqrt(information) if information > 0.0 else math.inf


def _combine(fits: Sequence[ChamberFit]) -> CylinderFit:
    """Merge chambers: parameters of the same name are one, weighted by their information."""
    names = tuple(dict.fromkeys(name for f in fits for name in f.names))
    order = sorted(names, key=lambda n: (n != INVERSE_BULK, not n.startswith("c_")))
    information = np.zeros((len(order), len(order)))
    weighted = np.zeros(len(order))
    scale = np.array([max(_magnitudes(fits, name)) for name in order])
    collinear = np.zeros(len(order))
    for f in fits:
        at = np.array([order.index(name) for name in f.names])
        size = scale[at]
        inverse = np.linalg.pinv(
            f.fit.covariance / np.outer(size, size), rcond=1e-15, hermitian=True
        )
        information[np.ix_(at, at)] += inverse
        weighted[at] += inverse @ (f.fit.theta / size)
        collinear[at] = np.maximum(collinear[at], f.fit.collinearity)
    covariance = np.linalg.pinv(information, rcond=1e-15, hermitian=True)
    theta = np.asarray(covariance @ weighted * scale, dtype=float)
    covariance = covariance * np.outer(scale, scale)
    std = np.sqrt(np.diag(covariance))
    # Edges and bulk modulus cannot be zero; what an effect adds may well be.
    known = tuple(
        bool(c < MAX_COLLINEARITY and (s < abs(v) or not _essential(name)))
        for name, c, s, v in zip(order, collinear, std, theta, strict=True)
    )
    chamber = fits[0].chamber
    values = dict(zip(order, theta, strict=True))
    return CylinderFit(
        chamber.cylinder.name,
        chamber.valve.name,
        tuple(order),
        theta,
        np.asarray(covariance, dtype=float),
        known,
        _reason(values, dict(zip(order, known, strict=True)), len(fits)),
        tuple(fits),
    )


def _essential(name: str) -> bool:
    return name == INVERSE_BULK or name.startswith("c_")


def _magnitudes(fits: Sequence[ChamberFit], name: str) -> list[float]:
    values = [
        float(max(abs(f.fit.theta[f.names.index(name)]), f.fit.std[f.names.index(name)]))
        for f in fits
        if name in f.names
    ]
    return [v if v > 0.0 else 1.0 for v in values]


def _reason(values: Mapping[str, float], known: Mapping[str, bool], chambers: int) -> str:
    """Why a cylinder's hydraulics cannot be used; empty where they can."""
    if chambers < 2:
        return "only one of its two chambers was recorded"
    edges = [name for name in values if name.startswith("c_")]
    unknown = [name for name in (INVERSE_BULK, *edges) if not known[name]]
    if unknown:
        return f"{', '.join(unknown)} cannot be told from these data"
    wrong = [f"{name} = {values[name]:.3g}" for name in edges if values[name] <= 0.0]
    if wrong:
        return f"expected edge coefficients above 0, found {', '.join(wrong)}"
    low, high = BULK_BOUNDS_PA
    inverse = values[INVERSE_BULK]
    if not 1.0 / high <= inverse <= 1.0 / low:
        found = f"{1.0 / inverse:.3g}" if inverse > 0.0 else f"1 / ({inverse:.3g} 1/Pa)"
        return f"expected a bulk modulus from {low:.0e} to {high:.0e} Pa, found {found}"
    return ""
