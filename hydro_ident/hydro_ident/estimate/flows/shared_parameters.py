"""What two fits share is one number: how the parameters of each follow it.

What is shared is averaged by its information. What a fit has alone then follows as least squares
of its own rows say, given the shared ones. By the covariance of its errors it would follow
further where noise that hardly changes makes one direction of the parameters very uncertain; two
chambers that do not quite agree, as of a valve whose spool lags, would then move each other's
edges by percents, though either is told to a hundredth of that.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hydro_ident.estimate.flows.delay import FittedChamber
from hydro_ident.estimate.statistics.regression import instrumental_parameters
from hydro_model.robot import FloatArray


def chambers_to_cylinder(fitted: Sequence[FittedChamber], order: Sequence[str]) -> FloatArray:
    """A cylinder's parameters as sums of its chambers' own.

    Parameters
    ----------
    fitted : sequence of FittedChamber
    order : sequence of str
        Names of the cylinder's parameters.

    Returns
    -------
    (p, q) array
        A row per parameter in order; columns are the chambers' parameters, one chamber after
        another.
    """
    shared = [name for name in order if sum(name in one.names for one in fitted) > 1]
    begins = np.cumsum([0, *(len(one.names) for one in fitted)])
    path = np.zeros((len(order), int(begins[-1])))
    among = [order.index(name) for name in shared]
    own = [
        [int(begin) + one.names.index(name) for name in shared]
        for begin, one in zip(begins, fitted, strict=False)
    ]
    informations = [_information(one, shared) for one in fitted]
    total = scale_free_inverse(np.sum(informations, axis=0))
    for at, information in zip(own, informations, strict=True):
        path[np.ix_(among, at)] = total @ information
    for begin, one, at in zip(begins, fitted, own, strict=False):
        rest = [k for k, name in enumerate(one.names) if name not in shared]
        rows = [order.index(one.names[k]) for k in rest]
        path[rows, int(begin) + np.array(rest, dtype=np.intp)] = 1.0
        follows = _follows(one, shared, rest)
        path[rows] += follows @ path[among]
        path[np.ix_(rows, at)] -= follows
    return path


def _information(one: FittedChamber, names: Sequence[str]) -> FloatArray:
    """Information of a chamber on some of its parameters, whatever the others are."""
    at = [one.names.index(name) for name in names]
    return scale_free_inverse(one.fit.covariance[np.ix_(at, at)])


def scale_free_inverse(matrix: FloatArray) -> FloatArray:
    """Inverse of a covariance, or of an information, whatever the parameters' units are.

    Parameters
    ----------
    matrix : (p, p) array
        Symmetric; what has a row of zeros has one in the inverse, too.

    Returns
    -------
    (p, p) array
        Pseudo-inverse: zero along directions of which the matrix says nothing.
    """
    size = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    square = np.outer(size, size)
    return np.asarray(np.linalg.pinv(matrix / square, rcond=1e-15, hermitian=True) / square)


def _follows(one: FittedChamber, held: Sequence[str], rest: Sequence[int]) -> FloatArray:
    """Change of a chamber's other least squares parameters per unit of those held."""
    free, weight = np.array(rest, dtype=np.intp), one.solution.weight
    result = np.zeros((len(rest), len(held)))
    for column, name in enumerate(held):
        at = one.names.index(name)
        shift = np.zeros(len(one.names))
        shift[at] = size = abs(one.fit.theta[at]) or 1.0
        moved, still = (
            instrumental_parameters(one.blocks.held(free, values), weight)
            for values in (shift, np.zeros_like(shift))
        )
        result[:, column] = (moved - still) / size
    return result
