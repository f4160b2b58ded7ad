"""What one chamber says about the command delay, and its parameters at a given one."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from hydro_ident.estimate.flows.chambers import chambers_of, column_names
from hydro_ident.estimate.flows.flow_moments import (
    RAILS,
    ChamberMoments,
    FlowGatherer,
    combination,
    instruments,
)
from hydro_ident.estimate.statistics.blocks import Blocks, blocks_of
from hydro_ident.estimate.statistics.regression import (
    Solution,
    instrumental_parameters,
    misfit,
    plain_parameters,
    solve_ols,
)
from hydro_model.robot import FloatArray, Robot

#: Delays tried before the Gauss-Newton steps, over the range.
_TRIED = 9
#: Edges of the rails, by `RAILS`: a chamber has one of each.
_OF_RAIL = (("c_pa", "c_pb"), ("c_at", "c_bt"))

#: An estimator: parameters, covariance and noise of a chamber.
Solve = Callable[[Blocks], Solution]


@dataclass(frozen=True, slots=True)
class GatheredChamber:
    """A chamber's moments over all recordings.

    Attributes
    ----------
    names : tuple of str
        Of its columns.
    parts : tuple of ChamberMoments
        By recording.
    """

    names: tuple[str, ...]
    parts: tuple[ChamberMoments, ...]

    def combines(self, delay_s: float) -> list[tuple[FloatArray, FloatArray]]:
        """Its columns at a delay in s from those gathered, and their slopes, by recording."""
        extras = len(self.names) - 3
        return [combination(delay_s / p.step_s, extras, p.windows) for p in self.parts]

    def blocks(self, delay_s: float, noise: bool = True) -> Blocks:
        """Its columns at a delay in s, with their instruments.

        `noise` is that of `blocks_of`.
        """
        return self._blocks([combine for combine, _ in self.combines(delay_s)], noise)

    def _blocks(self, combines: Sequence[FloatArray], noise: bool = True) -> Blocks:
        calm = [instruments(combine, len(self.names) - 3) for combine in combines]
        return blocks_of([p.moments for p in self.parts], combines, calm, noise)

    def with_slope(self, delay_s: float, theta: FloatArray, noise: bool = True) -> Blocks:
        """With the balance's slope in the delay as one more column, per sampling interval.

        Parameters
        ----------
        delay_s : float
        theta : (p,) array
        noise : bool
            As of `blocks_of`.
        """
        step_s = self.parts[0].step_s
        combines = [
            np.column_stack([combine, slope @ theta * (step_s / part.step_s)])
            for part, (combine, slope) in zip(self.parts, self.combines(delay_s), strict=True)
        ]
        return self._blocks(combines, noise)

    def with_rails(self, delay_s: float, theta: FloatArray) -> Blocks:
        """With the balance's slopes in the rails as more columns, per Pa, by `RAILS`.

        Parameters
        ----------
        delay_s : float
        theta : (p,) array
        """
        edges = [next(i for i, n in enumerate(self.names) if n in own) for own in _OF_RAIL]
        combines = []
        for combine, _ in self.combines(delay_s):
            slopes = np.zeros((len(combine), len(RAILS)))
            slopes[-len(RAILS) :] = np.diag(theta[edges])
            combines.append(np.column_stack([combine, slopes]))
        return self._blocks(combines)


def gathered_chambers(
    robot: Robot, gathered: Sequence[FlowGatherer]
) -> dict[str, GatheredChamber]:
    """Chambers with enough windows, by channel.

    Parameters
    ----------
    robot : Robot
    gathered : sequence of FlowGatherer
    """
    found = {}
    for chamber in chambers_of(robot):
        parts = [g.chambers[chamber.channel] for g in gathered if chamber.channel in g.chambers]
        parts = [p for p in parts if p.moments.lagged.any()]
        if not parts:
            continue
        names = column_names(chamber, parts[0].listed)
        if sum(int(p.moments.rows.sum()) for p in parts) > 10 * len(names):
            found[chamber.channel] = GatheredChamber(names, tuple(parts))
    return found


def coarse_delay(
    chambers: Mapping[str, GatheredChamber], weights: Mapping[str, FloatArray], longest_s: float
) -> float:
    """The best of some delays, under the weights found at the middle one.

    Parameters
    ----------
    chambers : mapping of str to GatheredChamber
    weights : mapping of str to (G,) array
    longest_s : float
    """
    if longest_s <= 0.0:
        return 0.0
    tried = np.linspace(0.0, longest_s, _TRIED)
    misfits = [
        sum(
            _log_misfit(c.blocks(float(d), noise=False), weights[name])
            for name, c in chambers.items()
        )
        for d in tried
    ]
    return float(tried[int(np.argmin(misfits))])


def _log_misfit(blocks: Blocks, weight: FloatArray) -> float:
    squares, level = misfit(blocks, weight)
    count = float(blocks.count.sum())
    return count * math.log(max(squares, 1e-24 * level, 1e-300))


def under_weights(solve: Solve) -> Callable[[Blocks, FloatArray], FloatArray]:
    """Parameters under given weights as an estimator has them: ordinary ones by no instruments.

    `solve` is the estimator.
    """
    return plain_parameters if solve is solve_ols else instrumental_parameters


@dataclass(frozen=True, slots=True)
class DelayStep:
    """What one chamber says about the delay, and its parameters at this one.

    Attributes
    ----------
    plain : Solution
    carried : (p,) array
        What the parameters take up of an error of the delay, per second.
    variance, dof : float
        Of the delay, s^2.
    covariance : (p + 1, p + 1) array
        Of the parameters and the delay.
    theta_dof : (p,) array
    """

    plain: Solution
    carried: FloatArray
    variance: float
    dof: float
    covariance: FloatArray
    theta_dof: FloatArray


def delay_step(chamber: GatheredChamber, delay_s: float, solve: Solve) -> DelayStep:
    """A chamber fitted at a delay, without and with the slope in it.

    Parameters
    ----------
    chamber : GatheredChamber
    delay_s : float
    solve : callable
    """
    unit = chamber.parts[0].step_s
    plain = solve(chamber.blocks(delay_s))
    slope = chamber.with_slope(delay_s, plain.theta)
    both = solve(slope)
    scale = np.append(np.ones(plain.theta.size), unit)
    known = slope.held(np.arange(plain.theta.size), np.zeros(plain.theta.size + 1))
    own_slope = None if slope.own_x is None else slope.own_x[..., -1]
    carried = replace(known, y=slope.x[..., -1], own_y=own_slope)
    return DelayStep(
        plain,
        under_weights(solve)(carried, plain.weight) / unit,
        _variance_of(both, unit),
        float(both.dof[-1]),
        both.covariance * np.outer(scale, scale),
        both.dof[:-1],
    )


def delay_variance(
    chamber: GatheredChamber, delay_s: float, weight: FloatArray, solve: Solve
) -> float:
    """Variance of the delay, s^2, as `DelayStep` has it.

    Parameters
    ----------
    chamber : GatheredChamber
    delay_s : float
    weight : (G,) array
        Under which the balance's slope is taken.
    solve : callable
    """
    theta = under_weights(solve)(chamber.blocks(delay_s, noise=False), weight)
    return _variance_of(solve(chamber.with_slope(delay_s, theta)), chamber.parts[0].step_s)


def _variance_of(solution: Solution, unit: float) -> float:
    """Of the last parameter, in so many seconds; infinite where nothing tells of it."""
    variance = float(solution.covariance[-1, -1]) * unit**2
    return variance if variance > 0.0 else math.inf


def with_shared_delay(step: DelayStep, own: float, total: float) -> FloatArray:
    """Covariance of a chamber's parameters at the delay that all chambers share.

    The delay is the mean of the chambers' own, weighted by their information; what it is off by
    here, the parameters take up as their regressors do: ``theta = theta_k + b (d_k - d)`` with the
    chamber's own estimates of both.

    Parameters
    ----------
    step : DelayStep
    own, total : float
        Information on the delay, of the chamber and of all.

    Returns
    -------
    (p, p) array
    """
    carried = step.carried[:, None]
    path = np.concatenate([np.eye(carried.size), carried * (1.0 - own / total)], axis=1)
    elsewhere = carried @ carried.T * (total - own) / total**2
    return np.asarray(path @ step.covariance @ path.T + elsewhere)
