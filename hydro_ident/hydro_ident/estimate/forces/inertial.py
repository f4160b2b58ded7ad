"""Base inertial parameters with viscous friction (paper III-A with its errata).

The regression over the rows of `hydro_ident.estimate.forces.force_rows`, with what it can tell.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from hydro_ident.estimate.forces.bounds import Bounds, fit_within_bounds, force_bounds
from hydro_ident.estimate.forces.closed_chain import HeldPart, fit_with_parts, held_fit
from hydro_ident.estimate.forces.force_rows import (
    ForceModel,
    LateForce,
    Motion,
    force_columns,
    force_model,
    force_rows,
    measured_force,
)
from hydro_ident.estimate.forces.listed_values import keep_listed
from hydro_ident.estimate.forces.plausible_sizes import parameter_scales
from hydro_ident.estimate.forces.standstill import rests_of, still_joints
from hydro_ident.estimate.forces.tilts import keep_tilted
from hydro_ident.estimate.signals.derivatives import FilterSettings
from hydro_ident.estimate.signals.signal_survey import SignalSurvey
from hydro_ident.estimate.signals.traces import Trace
from hydro_ident.estimate.statistics.blocks import Blocks, blocks_of
from hydro_ident.estimate.statistics.least_squares import (
    MAX_COLLINEARITY,
    Fit,
    fit_of_solution,
)
from hydro_ident.estimate.statistics.moments import Moments
from hydro_ident.estimate.statistics.regression import Solution, solve_wls
from hydro_model.arrays import IndexArray
from hydro_model.robot import FloatArray

__all__ = [
    "ForceModel",
    "InertialFit",
    "Motion",
    "fit_inertial",
    "force_columns",
    "force_model",
    "force_rows",
    "identifiable_parameters",
    "inertial_fit",
    "measured_force",
    "parameter_bounds",
    "parameter_scales",
]


@dataclass(frozen=True, slots=True)
class InertialFit:
    """Base parameters and viscous friction of a robot.

    Attributes
    ----------
    model : ForceModel
    fit : Fit
    identifiable : tuple of bool
        Per name of the model, see `identifiable_parameters`.
    still : tuple of int
        Joints that did not move.
    settings : FilterSettings
    held : tuple of HeldPart
        Parameters of barrels and rods and of listed effects that stayed the robot file's, and
        parameters at a bound.
    rejected : str
        Why none of the values is to be used; empty where they are good.
    early : tuple of LateForce
        Forces read early, whose frictions are held at 0 for that reason.
    """

    model: ForceModel
    fit: Fit
    identifiable: tuple[bool, ...]
    still: tuple[int, ...]
    settings: FilterSettings
    held: tuple[HeldPart, ...] = ()
    rejected: str = ""
    early: tuple[LateForce, ...] = ()

    @property
    def missing(self) -> tuple[str, ...]:
        """Names that the data do not determine, other than those held on purpose."""
        held = {part.index for part in self.held}
        pairs = enumerate(zip(self.model.names, self.identifiable, strict=True))
        return tuple(name for i, (name, known) in pairs if not known and i not in held)


def fit_inertial(
    model: ForceModel,
    traces: Sequence[Trace],
    settings: FilterSettings | None = None,
) -> InertialFit | None:
    """Weighted least squares of the force channels over all traces.

    Parameters
    ----------
    model : ForceModel
    traces : sequence of Trace
        In order of time within each recording.
    settings : FilterSettings, optional

    Returns
    -------
    InertialFit or None
        None where no trace carries a force with all joint angles.
    """
    settings = settings or FilterSettings()
    usable = [t for t in traces if np.isfinite(t.q).all()]
    if not usable:
        return None
    signals = SignalSurvey.of(model.robot, usable)
    still = still_joints(model.robot, signals)
    rests = rests_of(signals, still)
    gathered: dict[str, Moments] = {}
    for trace in usable:
        rows = force_rows(model, trace, settings, rests)
        if rows is not None:
            name = trace.recording
            fresh = Moments.like(rows, name, sample_s=trace.step_s)
            gathered.setdefault(name, fresh).add(rows)
    return inertial_fit(model, list(gathered.values()), still, settings)


def inertial_fit(
    model: ForceModel,
    gathered: Sequence[Moments],
    still: tuple[int, ...],
    settings: FilterSettings,
    solve: Callable[[Blocks], Solution] = solve_wls,
    beside: Sequence[HeldPart] = (),
) -> InertialFit | None:
    """Fit to what was gathered of every recording.

    Parameters
    ----------
    model : ForceModel
    gathered : sequence of Moments
    still : tuple of int
        Joints that did not move.
    settings : FilterSettings
    solve : callable
        The estimator.
    beside : sequence of HeldPart
        What is to be held, whatever the data show of it.

    Returns
    -------
    InertialFit or None
        None where there are too few rows.
    """
    count = sum(int(one.rows.sum()) for one in gathered)
    if count <= 10 * len(model.names) or not any(one.lagged.any() for one in gathered):
        return None
    blocks = blocks_of(gathered)

    def fit_free(free: IndexArray, shift: FloatArray) -> Fit:
        part = blocks.held(free, shift)
        return fit_of_solution(solve(part), part, count)

    fit, held = fit_with_parts(model.robot, model.base, len(model.names), fit_free)
    bounds = parameter_bounds(model, fit)
    determined = partial(identifiable_parameters, model)
    fit, held = keep_tilted(model, fit, held, fit_free, determined)
    fit, held = keep_listed(model, fit, held, fit_free, determined)
    if beside:
        held = (*held, *beside)
        fit = held_fit(fit, {part.index: part.value for part in held}, fit_free)
    fit, held = fit_within_bounds(fit, held, bounds, fit_free, determined)
    known = identifiable_parameters(model, fit, held)
    rejected = _outside(model, fit, known, bounds)
    return InertialFit(model, fit, known, still, settings, held, rejected)


def parameter_bounds(model: ForceModel, fit: Fit) -> tuple[Bounds, ...]:
    """Physical bounds of every parameter, with sizes of what was found where a file has less."""
    scales = _scales(model, fit)
    return force_bounds(model.names, model.base.names, model.effect_names, scales)


def _outside(model: ForceModel, fit: Fit, known: Sequence[bool], bounds: Sequence[Bounds]) -> str:
    """Which parameters are clearly outside their bounds; empty where none is."""
    rows = zip(model.names, fit.theta, fit.std, known, bounds, strict=True)
    return ", ".join(
        limits.text(name, value, std)
        for name, value, std, determined, limits in rows
        if determined and limits.clear(value, std)
    )


def identifiable_parameters(
    model: ForceModel, fit: Fit, held: Sequence[HeldPart] = ()
) -> tuple[bool, ...]:
    """Which parameters the recorded motion determines.

    Two conditions: its column is not a combination of the others (`Fit.collinearity` below
    `MAX_COLLINEARITY`; joints that stand still have been held exactly, so that their columns
    degenerate exactly), and its standard deviation stays below what the parameter could be at
    most on a machine of this size (`parameter_scales`). What was held is not determined.
    """
    scales = _scales(model, fit)
    scales[[part.index for part in held]] = 0.0
    return tuple(
        bool(c < MAX_COLLINEARITY and s < scale)
        for c, s, scale in zip(fit.collinearity, fit.std, scales, strict=True)
    )


def _scales(model: ForceModel, fit: Fit) -> FloatArray:
    """Of a column among the others' least squares takes the shortest solution, with its errors."""
    std = np.where(fit.collinearity < MAX_COLLINEARITY, fit.std, np.inf)
    return parameter_scales(model, fit.theta, std)
