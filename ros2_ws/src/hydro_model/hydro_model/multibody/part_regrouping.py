"""Base parameters of barrels and rods: what regroups with the links, and what stays.

Of the six parameters of a cylinder three regroup whatever the chain, by geometry alone:

- the barrel's mass is a point mass of the parent link at the parent pin;
- the rod's mass is a point mass of the child link at the child pin;
- barrel and rod turn alike, so the rod's inertia adds to the barrel's.

The first moments and that inertia are in general parameters of their own. Where gravity or a
fixed axis hides one of them, a regressor of random motions shows it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hydro_model.multibody.closed_chain import FIRST, HOST, PART_SIZE, PIN, SECOND, part_rows
from hydro_model.robot import STANDARD_PARAMETERS, FloatArray, Robot

_SIZE = len(STANDARD_PARAMETERS)
_UPPER = np.triu_indices(3)
_SAMPLES = 60
#: Below this share of its norm outside the other columns' span, a column counts as in it.
_TOLERANCE = 1.0e-9
#: A pivot is good enough from this share of the largest one.
_PIVOT_SHARE = 0.1


def point_mass(at: FloatArray) -> FloatArray:
    """Standard parameters (10,) of 1 kg at a point (3,), in the same frame.

    `at` is the point.
    """
    inertia = at @ at * np.eye(3) - np.outer(at, at)
    return np.array([1.0, *at, *inertia[_UPPER]])


def with_parts(
    robot: Robot, leading: NDArray[np.intp], combination: FloatArray
) -> tuple[NDArray[np.intp], FloatArray]:
    """The base map of links, barrels and rods from that of the links.

    Parameters
    ----------
    robot : Robot
    leading : (b,) int array
        Leading columns of the links.
    combination : (b, 10 n) array

    Returns
    -------
    leading : (p,) int array
        Into `robot.parameter_names`, those of the links first and unchanged.
    combination : (p, 10 n + 6 k) array
    """
    links, parts = _SIZE * robot.dof, part_rows(robot)
    own = np.arange(len(parts)) * PART_SIZE + links
    masses = np.zeros((leading.size, len(parts)))
    for i, part in enumerate(parts):
        host = int(part[HOST])
        if host >= 0:
            columns = combination[:, _SIZE * host : _SIZE * host + _SIZE]
            masses[:, i] = columns @ point_mass(part[PIN : PIN + 3])
    first, second = FIRST - FIRST + 1, SECOND - FIRST + 1
    barrels, rods = own[0::2], own[1::2]
    candidates = np.sort(np.concatenate([barrels + first, barrels + second, rods + first]))
    chosen, weights = _independent(robot, leading, candidates)
    size = leading.size + len(chosen)
    everything = np.zeros((size, links + PART_SIZE * len(parts)))
    everything[: leading.size, :links] = combination
    everything[: leading.size, own] = masses
    everything[:, candidates] = weights
    # The rod turns as its barrel does.
    everything[:, rods + second] = everything[:, barrels + second]
    return np.concatenate([leading, np.array(chosen, dtype=np.intp)]), everything


def _independent(
    robot: Robot, leading: NDArray[np.intp], candidates: NDArray[np.intp]
) -> tuple[list[int], FloatArray]:
    """Candidates that lead, and all candidates' coefficients in the base parameters."""
    from hydro_model.multibody.rigid_body import regressor

    columns = regressor(robot, *_motions(robot)).reshape(-1, len(robot.parameter_names))
    of_links = columns[:, leading]
    basis = np.linalg.qr(of_links / np.linalg.norm(of_links, axis=0))[0]
    norms = np.linalg.norm(columns[:, candidates], axis=0)
    # Of a turned axis the cosine of a right angle is no zero: a column of nothing but rounding.
    there = norms > _TOLERANCE * norms.max()
    norms = np.where(there, norms, 0.0)
    unit = np.where(there, columns[:, candidates], 0.0) / np.where(there, norms, 1.0)
    left = unit - basis @ (basis.T @ unit)
    left -= basis @ (basis.T @ left)
    chosen: list[int] = []
    while len(chosen) < len(candidates):
        sizes = np.linalg.norm(left, axis=0)
        if sizes.max() <= _TOLERANCE:
            break
        pivot = int(np.flatnonzero(sizes >= _PIVOT_SHARE * sizes.max())[0])
        direction = left[:, pivot] / sizes[pivot]
        left -= np.outer(direction, direction @ left)
        left[:, pivot] = 0.0
        chosen.append(pivot)
    chosen.sort()
    return [int(candidates[k]) for k in chosen], _coefficients(of_links, unit, norms, chosen)


def _coefficients(
    of_links: FloatArray, unit: FloatArray, norms: FloatArray, chosen: list[int]
) -> FloatArray:
    """All candidates' coefficients: 1 of themselves, or those of the combination they are."""
    count = of_links.shape[1]
    weights = np.zeros((count + len(chosen), unit.shape[1]))
    weights[count + np.arange(len(chosen)), chosen] = 1.0
    dependent = np.setdiff1d(np.flatnonzero(norms > 0.0), chosen)
    if dependent.size:
        scale = np.concatenate([np.linalg.norm(of_links, axis=0), norms[chosen]])
        base = np.hstack([of_links, unit[:, chosen] * norms[chosen]]) / scale
        share = np.linalg.lstsq(base, unit[:, dependent], rcond=1e-13)[0]
        share[np.abs(share) < 10.0 * _TOLERANCE] = 0.0
        weights[:, dependent] = share / scale[:, None] * norms[dependent]
    return weights


def _motions(robot: Robot) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Motions within the joint limits, the same at every call."""
    rng = np.random.default_rng(0)
    low = [j.lower if np.isfinite(j.lower) else -np.pi for j in robot.joints]
    high = [j.upper if np.isfinite(j.upper) else np.pi for j in robot.joints]
    q = rng.uniform(low, high, (_SAMPLES, robot.dof))
    qd, qdd = rng.normal(size=(2, _SAMPLES, robot.dof))
    return q, 2.0 * qd, 5.0 * qdd
