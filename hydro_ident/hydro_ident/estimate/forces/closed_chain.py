"""Barrels and rods among the base parameters: fitted where the data show them, else held.

Their forces are small beside the links': a first moment of a few kg m against a thousand. Fitted
all the same they would only spoil the others, so a parameter of a barrel or rod stays in the fit
only where the force that it alone explains stands well above what the model leaves; otherwise it
is held at the robot file's value, whose force is taken off the regressand, and that is said.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from hydro_ident.estimate.statistics.least_squares import Fit
from hydro_model.arrays import IndexArray
from hydro_model.multibody.base_parameters import BaseMap
from hydro_model.robot import STANDARD_PARAMETERS, STANDARD_UNITS, Cylinder, FloatArray, Robot

#: The estimator: from the columns that are free and the values (p,) of those that are not (zero
#: elsewhere) to the fit of the free ones.
Solve = Callable[[IndexArray, FloatArray], Fit]

#: A parameter is detected where its size exceeds its largest error: of noise, so many standard
#: deviations;
DEVIATIONS = 5.0
#: of the force that any model lacks, as a share of the force itself, in whatever shape hurts most;
MODEL_SHARE = 5.0e-5
#: and of held values, which may be off by this share of their size.
UNSURE = 0.3
#: Larger than this many parts, or below zero by `DEVIATIONS`, is no part.
LARGEST_SHARE = 12.0
_SINGULAR = 1.0e-14
_STEEL_KG_M3 = 7850.0
#: Outer diameter of a barrel of unknown make in bores.
_OUTER = 1.2


@dataclass(frozen=True, slots=True)
class HeldPart:
    """A parameter that is not fitted: of a barrel, a rod or a listed effect, or at its bound.

    Attributes
    ----------
    index : int
        In the regression's columns, of which the base parameters come first.
    value : float
        The robot file's, or the bound.
    reason : str
    """

    index: int
    value: float
    reason: str


def expected_sizes(robot: Robot, base: BaseMap) -> FloatArray:
    """Sizes (p,) that parameters of barrels and rods have on such a machine; infinite for links.

    The robot file's parts; a steel tube and a steel bar where it has none.
    """
    rows = []
    for cylinder in robot.closed_chains:
        for part, guess in ((cylinder.barrel, _tube(cylinder)), (cylinder.rod, _bar(cylinder))):
            rows.append(guess if part is None else part.parameters)
    values = np.concatenate([np.zeros(len(robot.standard_names)), np.ravel(rows)])
    sizes = np.abs(base.combination[:, : values.size]) @ values
    sizes[: base.link_count] = np.inf
    return np.asarray(sizes)


def steel_masses(cylinder: Cylinder) -> tuple[float, float]:
    """Masses of a steel barrel and rod of a cylinder's size, kg; 0 of one along its joint."""
    return _tube(cylinder)[0], _bar(cylinder)[0]


def _tube(c: Cylinder) -> tuple[float, float, float]:
    return _slender((_OUTER**2 - 1.0) * c.bore_m**2, _length_m(c))


def _bar(c: Cylinder) -> tuple[float, float, float]:
    return _slender(c.rod_m**2, _length_m(c))


def _length_m(c: Cylinder) -> float:
    # Of one along its joint `x0_m` is a position, and its bodies are parts of the links.
    return c.x0_m if c.l1_m > 0.0 else 0.0


def _slender(square_m2: float, length_m: float) -> tuple[float, float, float]:
    mass = _STEEL_KG_M3 * np.pi / 4.0 * square_m2 * length_m
    return mass, mass * length_m / 2.0, mass * length_m**2 / 3.0


def fit_with_parts(
    robot: Robot, base: BaseMap, size: int, solve: Solve
) -> tuple[Fit, tuple[HeldPart, ...]]:
    """Fit of all parameters that the data show, the others of barrels and rods held.

    Parameters
    ----------
    robot : Robot
    base : BaseMap
        Its columns come first in the regression.
    size : int
        Columns of the regression.
    solve : callable
        The estimator.

    Returns
    -------
    Fit
        Of all parameters; a held one's deviation is that of the fit with all of them free.
    tuple of HeldPart
    """
    trial = solve(np.arange(size), np.zeros(size))
    if base.link_count == len(base.names):
        return trial, ()
    sizes, given = expected_sizes(robot, base), base.combination @ robot.parameter_vector
    reasons = _undetected(base, trial, sizes)
    while True:
        fit = held_fit(trial, {i: float(given[i]) for i in sorted(reasons)}, solve)
        wrong = _implausible(base, fit, sizes, reasons)
        if not wrong:
            break
        reasons |= wrong
    return fit, tuple(HeldPart(i, float(given[i]), reasons[i]) for i in sorted(reasons))


def part_notes(names: Sequence[str], held: Sequence[HeldPart]) -> tuple[str, ...]:
    """What was held: a line per cylinder for its barrel and rod, and one per other parameter.

    Parameters
    ----------
    names : sequence of str
        Of all parameters.
    held : sequence of HeldPart
    """
    groups: dict[str, dict[str, list[str]]] = {}
    for part in held:
        name = names[part.index]
        owner, _, rest = name.rpartition(".")
        cylinder, _, body = owner.rpartition("_")
        of_part = body in ("barrel", "rod")
        group = groups.setdefault(cylinder if of_part else name, {})
        group.setdefault(part.reason, []).append(f"{body} {rest}" if of_part else "")
    return tuple(
        f"{owner}: "
        + "; ".join(
            f"{', '.join(what)} held at the robot file's value: {reason}" if what[0] else reason
            for reason, what in reasons.items()
        )
        for owner, reasons in groups.items()
    )


def _undetected(base: BaseMap, trial: Fit, sizes: FloatArray) -> dict[int, str]:
    """What the data cannot show, by cylinder, the worst first: holding it helps the others.

    Barrel and rod lie on one line, so that one of them is told only with the other: where a
    parameter of a cylinder is below detection, all of them are held.
    """
    reasons: dict[int, str] = {}
    # A part may be larger than the robot file says, if the data are sure of that.
    most = LARGEST_SHARE * sizes
    seen = np.maximum(sizes, np.minimum(np.abs(trial.theta[: sizes.size]), most))
    lacking = MODEL_SHARE * float(np.sqrt(trial.theta @ trial.gram @ trial.theta))
    while True:
        held = np.array(sorted(reasons), dtype=np.intp)
        free = np.setdiff1d(np.arange(trial.theta.size), held)
        errors = np.full(trial.theta.size, np.inf)
        noise = DEVIATIONS * _conditional_std(trial, free, held)
        by_force, by_held = _worst_errors(trial.gram, free, held, UNSURE * seen[held])
        errors[free] = np.maximum(noise, lacking * by_force) + by_held
        parts = [int(i) for i in free if base.link_count <= i < len(base.names)]
        # Of a part that is said to have nothing, and has nothing, any error is too much.
        nothing = np.full(seen.size, np.inf)
        off = errors[: seen.size]
        far = np.divide(off, seen, out=nothing, where=(seen > 0.0) & np.isfinite(off))
        worst = max(parts, key=lambda i: float(far[i]), default=-1)
        if worst < 0 or errors[worst] <= seen[worst]:
            return reasons
        for i in parts:
            if _cylinder(base.names[i]) == _cylinder(base.names[worst]):
                reasons[i] = (
                    f"below detection (the data leave {base.names[worst]} uncertain by"
                    f" {errors[worst]:.2g} {unit_of(base.names[worst])}, where such a part has"
                    f" {sizes[worst]:.2g} {unit_of(base.names[worst])})"
                )


def unit_of(name: str) -> str:
    """Unit of a standard parameter, by its last word."""
    return STANDARD_UNITS[STANDARD_PARAMETERS.index(name.rsplit(".", 1)[-1])]


def _cylinder(name: str) -> str:
    """Cylinder of `<cylinder>_<barrel or rod>.<parameter>`."""
    return name.rsplit("_", 1)[0]


def _conditional_std(trial: Fit, free: IndexArray, held: IndexArray) -> FloatArray:
    """Standard deviations of the free parameters once the others are known."""
    covariance = trial.covariance
    known = held[np.diag(covariance)[held] > 0.0]
    cross = covariance[np.ix_(free, known)]
    inverse = np.linalg.pinv(covariance[np.ix_(known, known)], rcond=1e-12, hermitian=True)
    variance = np.diag(covariance)[free] - np.einsum("ij,jk,ik->i", cross, inverse, cross)
    std = np.sqrt(np.maximum(variance, 0.0))
    # A column that vanishes or lies in the others' span has no variance in a pseudo-inverse.
    std[~np.isfinite(trial.collinearity[free])] = np.inf
    return np.asarray(std)


def _worst_errors(
    gram: FloatArray, free: IndexArray, held: IndexArray, unsure: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Largest error of each free parameter: by a force of the residual's size, by held values.

    With ``X'`` the part of a column that the others do not explain, a force f moves the
    parameter by ``|X'.f| / |X'|^2 <= |f| / |X'|``, reached where f looks like it: forces that a
    model lacks do, and do not average out. Held values may be off by `unsure`.
    """
    lengths = np.sqrt(np.diag(gram)[free])
    used = free[lengths > 0.0]
    size = lengths[lengths > 0.0]
    by_force, by_held = np.full(free.size, np.inf), np.zeros(free.size)
    values, vectors = np.linalg.eigh(gram[np.ix_(used, used)] / np.outer(size, size))
    # What lies in the span of the others is given an error beyond any size.
    inverse = 1.0 / np.maximum(values, _SINGULAR)
    weights = (vectors * inverse) @ vectors.T @ (gram[np.ix_(used, held)] / size[:, None])
    by_force[lengths > 0.0] = np.sqrt(vectors**2 @ inverse) / size
    by_held[lengths > 0.0] = np.abs(weights / size[:, None]) @ unsure
    return by_force, by_held


def _implausible(
    base: BaseMap, fit: Fit, sizes: FloatArray, reasons: dict[int, str]
) -> dict[int, str]:
    """Values that no barrel or rod has: forces that the model lacks pass for them."""
    return {
        i: f"the fit gives {fit.theta[i]:.3g} {unit_of(base.names[i])}, where such a part has"
        f" {sizes[i]:.3g} {unit_of(base.names[i])}: what the model lacks passes for it"
        for i in range(base.link_count, len(base.names))
        if i not in reasons
        and not -DEVIATIONS * fit.std[i] < fit.theta[i] < LARGEST_SHARE * sizes[i]
    }


def held_fit(trial: Fit, values: dict[int, float], solve: Solve) -> Fit:
    """A fit of the other columns, put back among the held ones.

    Parameters
    ----------
    trial : Fit
        With more columns free; held parameters keep its deviations.
    values : dict of int to float
        Held values by column.
    solve : callable
        The estimator.
    """
    if not values:
        return trial
    size = trial.theta.size
    held, shift = list(values), np.zeros(size)
    shift[held] = list(values.values())
    free = np.setdiff1d(np.arange(size), held)
    fit = solve(free, shift)
    theta, collinear, dof = shift, trial.collinearity.copy(), trial.dof.copy()
    theta[free], collinear[free] = fit.theta, fit.collinearity
    if dof.size:
        dof[free] = fit.dof
    covariance = np.zeros_like(trial.covariance)
    covariance[np.ix_(free, free)] = fit.covariance
    covariance[held, held] = np.diag(trial.covariance)[held]
    return replace(fit, theta=theta, covariance=covariance, collinearity=collinear, dof=dof)
