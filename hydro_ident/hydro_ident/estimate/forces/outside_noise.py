"""Forces from outside the noise that parameters take up, counted into their covariance.

Where a force of known shape and of a size that is known as one deviation may be in the readings,
no residual shows what of it the parameters have taken up, however long the recording is:
intervals by noise alone are too narrow. The estimates stay; the covariance has for each cause

    V + s s',    s = A sum_g w_g X_g' f

added up, as causes know nothing of each other (f is that force on the rows; A and w as in
`hydro_ident.estimate.statistics.solution`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from hydro_ident.estimate.forces.inertial import InertialFit
from hydro_ident.estimate.statistics.blocks import Blocks, blocks_of
from hydro_ident.estimate.statistics.moments import Moments
from hydro_ident.estimate.statistics.regression import plain_parameters
from hydro_ident.estimate.statistics.solution import MOST_DOF, levels
from hydro_model.arrays import IndexArray
from hydro_model.robot import FloatArray


def widened(
    fit: InertialFit,
    gathered: Sequence[Moments],
    columns: Sequence[int],
    sizes: Sequence[float],
) -> InertialFit:
    """A fit whose covariance has what forces from outside the noise move its parameters by.

    Parameters
    ----------
    fit : InertialFit
    gathered : sequence of Moments
        By recording, of rows that were fitted, without robust weights, and of the forces in
        columns behind the parameters'.
    columns : sequence of int
        Which of these, one per cause.
    sizes : sequence of float
        One deviation of each, in units of its column.

    Returns
    -------
    InertialFit
        The same estimates. What was held is left as it is. These deviations count as known, so
        that degrees of freedom are more.
    """
    own = fit.fit
    free = np.setdiff1d(np.arange(own.theta.size), [part.index for part in fit.held])
    moved = _moved(blocks_of(gathered), own.theta, free, columns) * np.asarray(sizes)
    covariance, before = own.covariance.copy(), np.diag(own.covariance)
    covariance[np.ix_(free, free)] += moved @ moved.T
    grown = np.where(before > 0.0, np.diag(covariance) / np.where(before > 0.0, before, 1.0), 1.0)
    # Satterthwaite's, with a part of the variance that is known; a fit may not say its own.
    dof = np.minimum(own.dof * grown[: own.dof.size] ** 2, MOST_DOF)
    return replace(fit, fit=replace(own, covariance=covariance, dof=dof))


def _moved(
    blocks: Blocks, theta: FloatArray, free: IndexArray, columns: Sequence[int]
) -> FloatArray:
    """What forces of the size of some columns move the free parameters by, (f, count)."""
    shift = np.zeros(blocks.x.shape[3])
    shift[: theta.size] = theta
    shift[free] = 0.0
    part = blocks.held(free, shift)
    weight = 1.0 / levels(part, theta[free]) ** 2
    return np.stack(
        [plain_parameters(replace(part, y=blocks.x[..., k]), weight) for k in columns], axis=1
    )
