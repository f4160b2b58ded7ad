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
from hydro_ident.estimate.forces.standstill import rests_of, still_joints
from hydro_ident.estimate.forces.tilts import keep_tilted
from hydro_ident.estimate.signals.derivatives import FilterSettings
from hydro_ident.estimate.signals.signal_survey import SignalSurvey
from hydro_ident.estimate.signals.traces import Trace
from hydro_ident.estimate.statistics.blocks import Blocks, blocks_of
from hydro_ident.estimate.statistics.least_squares import (
    MAX_COLLINEARITY,
    Fit,
    Rows,
    fit_of_solution,
)
from hydro_ident.estimate.statistics.moments import Moments
from hydro_ident.estimate.statistics.regression import Solution, solve_wls
from hydro_model.arrays import IndexArray
from hydro_model.hydraulics.cylinder import lever
from hydro_model.multibody.joint_ranges import limits
from hydro_model.robot import FloatArray, Joint

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

#: A robot file of less mass states none. Values of so many deviations show what there is.
LEAST_MASS_KG, CLEAR_DEVIATIONS = 1.0, 10.0


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
    select: Callable[[Rows], Rows] | None = None,
) -> InertialFit | None:
    """Weighted least squares of the force channels over all traces.

    Parameters
    ----------
    model : ForceModel
    traces : sequence of Trace
        In order of time within each recording.
    settings : FilterSettings, optional
    select : callable, optional
        Picks the rows that take part in the fit.

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
            rows = rows if select is None else select(rows)
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
    bounds = parameter_bounds(model)
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


def parameter_bounds(model: ForceModel) -> tuple[Bounds, ...]:
    """Physical bounds of every parameter."""
    scales = parameter_scales(model)
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
    scales = parameter_scales(model, fit.theta, fit.std)
    scales[[part.index for part in held]] = 0.0
    return tuple(
        bool(c < MAX_COLLINEARITY and s < scale)
        for c, s, scale in zip(fit.collinearity, fit.std, scales, strict=True)
    )


def parameter_scales(
    model: ForceModel, theta: FloatArray | None = None, std: FloatArray | None = None
) -> FloatArray:
    """Largest plausible size of every parameter: total mass times powers of the reach.

    The mass is the robot file's or, where that has none, what found values show of it.

    For friction, the force limit of the joint (its cylinder) over its rated speed, infinity where
    either has no limit; for effects, infinity (their bounds are the catalogue's).

    Parameters
    ----------
    model : ForceModel
    theta, std : array, optional
        Values that were found and their deviations, base parameters first.

    Returns
    -------
    (p,) array
    """
    robot = model.robot
    reach = sum(float(np.linalg.norm(j.translation_m)) for j in robot.joints)
    reach = max(reach + float(np.linalg.norm(robot.tip_offset_m)), 0.1)
    per_mass = [reach ** _power(name) for name in model.base.names]
    given = float(robot.link_inertia[:, 0].sum())
    mass = max(given, LEAST_MASS_KG)
    if given < LEAST_MASS_KG and theta is not None and std is not None:
        mass = max([mass, *_shown_masses(np.array(per_mass), theta, std)])
    scales = [mass * one for one in per_mass]
    for cylinder in robot.cylinders:
        at = robot.joint_index(cylinder.joint)
        lower, upper = limits(robot)[at].tolist()
        arm = float(np.abs(lever(cylinder, np.linspace(lower, upper, 21))).max())
        scales.append(_friction_scale(robot.joints[at], arm))
    scales += [_friction_scale(robot.joints[j]) for j in robot.dry_joints]
    return np.array([*scales, *[np.inf] * len(model.effect_names)])


def _power(name: str) -> int:
    """Power of a length in a base parameter: 0 of a mass, 1 of a moment, 2 of an inertia."""
    kind = name.rsplit(".", 1)[-1]
    return 0 if kind == "mass" else 1 if kind.startswith("mc") else 2


def _shown_masses(per_mass: FloatArray, theta: FloatArray, std: FloatArray) -> list[float]:
    """Masses in kg that there must be at least, by base parameters that are clearly not zero.

    A fit to hardly any motion finds large values of a few deviations.
    """
    size, deviation = np.abs(theta[: per_mass.size]), std[: per_mass.size]
    clear = np.isfinite(size) & (size > CLEAR_DEVIATIONS * deviation)
    shown: list[float] = (size[clear] / per_mass[clear]).tolist()
    return shown


def _friction_scale(joint: Joint, arm_m: float = 1.0) -> float:
    """Force limit over rated speed of a joint, or of the cylinder with this lever on it."""
    # An unlimited joint says nothing about the size of its friction.
    if not np.isfinite([joint.effort_limit, joint.velocity_limit]).all():
        return float(np.inf)
    return joint.effort_limit / arm_m / (joint.velocity_limit * arm_m)
