"""Recordings of different loads at the tip, which no common fit is right for.

The rows are fitted once more with a load at the tip in each recording but the first, beside the
common parameters. Loads that clearly differ, and explain most of what is left in a force, are a
problem: the parameters are some mean of several machines'.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hydro_ident.estimate.forces.inertial import InertialFit
from hydro_ident.estimate.statistics.blocks import Blocks, blocks_of
from hydro_ident.estimate.statistics.moments import Moments
from hydro_ident.estimate.statistics.regression import solve_wls
from hydro_model.arrays import IndexArray
from hydro_model.multibody.payload_parameters import payload_effect
from hydro_model.robot import FloatArray

#: Loads differ from so many deviations on, where that explains this share of a force's residual.
_DEVIATIONS, _SHARE = 5.0, 0.5


def loads_apart(fit: InertialFit, gathered: Sequence[Moments]) -> str:
    """Which recordings carry another load at the tip than the first, in words.

    Parameters
    ----------
    fit : InertialFit
    gathered : sequence of Moments
        Of the rows that were fitted, by recording; columns behind the model's are left out.

    Returns
    -------
    str
        Empty where loads do not differ, or where that would explain little.
    """
    used = [one for one in gathered if one.lagged.any()]
    if len(used) < 2:
        return ""
    free, shift = _free(fit, len(used) - 1)
    blocks = blocks_of(used, _with_loads(fit, used))
    size = len(fit.model.names)
    common, both = blocks.held(free[free < size], shift), blocks.held(free, shift)
    without, beside = solve_wls(common), solve_wls(both)
    loads = slice(int(np.count_nonzero(free < size)), None)
    masses, std = beside.theta[loads], np.sqrt(np.diag(beside.covariance)[loads])
    apart = np.flatnonzero(np.abs(masses) > _DEVIATIONS * std)
    shares = 1.0 - _squares(both, beside.theta) / _squares(common, without.theta)
    most = int(np.argmax(shares))
    if not apart.size or shares[most] < _SHARE:
        return ""
    told = ", ".join(f"{used[k + 1].label} {masses[k]:+.3g} +- {std[k]:.2g} kg" for k in apart)
    return (
        f"recordings disagree as though with different loads at the tip: beside {used[0].label},"
        f" {told} (one standard deviation), which is {shares[most]:.0%} of what is left in"
        f" {fit.model.channels[most]}; the base parameters are some mean of theirs: identify"
        " recordings of one load together, without those at rest, in which friction bears a part"
    )


def _free(fit: InertialFit, loads: int) -> tuple[IndexArray, FloatArray]:
    """Columns that are fitted, the loads' behind the others, and values of the held ones."""
    size, held = len(fit.model.names), [part.index for part in fit.held]
    shift = np.zeros(size + loads)
    shift[held] = fit.fit.theta[held]
    return np.setdiff1d(np.arange(size + loads), held), shift


def _with_loads(fit: InertialFit, used: Sequence[Moments]) -> list[FloatArray]:
    """The model's columns and a load's of each recording but the first, from those gathered."""
    size, base = len(fit.model.names), len(fit.model.base.names)
    effect = payload_effect(fit.model.robot, fit.model.base.combination)[:, 0]
    found = []
    for k, one in enumerate(used):
        combine = np.zeros((one.width - 1, size + len(used) - 1))
        combine[:size, :size] = np.eye(size)
        if k:
            combine[:base, size + k - 1] = effect
        found.append(combine)
    return found


def _squares(blocks: Blocks, theta: FloatArray) -> FloatArray:
    """Sum of squares that is left in each channel, (k,)."""
    x, y = blocks.rows
    left = np.sum((y - x @ theta) ** 2, axis=1)
    return np.maximum(np.bincount(blocks.channel, left, blocks.channels), 1e-300)
