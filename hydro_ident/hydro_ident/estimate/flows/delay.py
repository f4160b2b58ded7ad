"""The command delay, which all chambers share, with the chambers' own parameters."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from hydro_ident.estimate.flows.chambers import chambers_of, column_names
from hydro_ident.estimate.flows.flow_moments import (
    ChamberMoments,
    FlowGatherer,
    combination,
    instruments,
)
from hydro_ident.estimate.statistics.blocks import Blocks, blocks_of
from hydro_ident.estimate.statistics.least_squares import Fit, fit_of_solution
from hydro_ident.estimate.statistics.regression import (
    Solution,
    instrumental_parameters,
    misfit,
    solve_iv,
)
from hydro_model.robot import FloatArray, Robot

#: Delays tried before the Gauss-Newton steps, over the range.
_TRIED = 9
_STEPS, _SETTLED = 30, 1.0e-13
#: Rounds of Gauss-Newton steps; the chambers' shares are those of the round before.
_ROUNDS = 2

#: An estimator: parameters, covariance and noise of a chamber.
Solve = Callable[[Blocks], Solution]


@dataclass(frozen=True, slots=True)
class FittedChamber:
    """One chamber at the fitted delay.

    Attributes
    ----------
    names : tuple of str
        Of its columns.
    fit : Fit
        Its covariance includes what the delay's uncertainty adds.
    solution : Solution
    blocks : Blocks
    combines : dict of str to (w, p) array
        Its columns from those gathered, by recording.
    """

    names: tuple[str, ...]
    fit: Fit
    solution: Solution
    blocks: Blocks
    combines: dict[str, FloatArray]


@dataclass(frozen=True, slots=True)
class DelayFit:
    """Command delay and chambers.

    Attributes
    ----------
    delay_s, std_s, dof : float
        The deviation is infinite where the valves did not move.
    chambers : dict of str to FittedChamber
        By channel.
    longest_s : float
        Upper end of the range.
    """

    delay_s: float
    std_s: float
    dof: float
    chambers: dict[str, FittedChamber]
    longest_s: float


@dataclass(frozen=True, slots=True)
class _Chamber:
    """A chamber's moments over all recordings."""

    names: tuple[str, ...]
    parts: tuple[ChamberMoments, ...]

    def combines(self, delay_s: float) -> list[tuple[FloatArray, FloatArray]]:
        extras = len(self.names) - 3
        return [combination(delay_s / p.step_s, extras, p.windows) for p in self.parts]

    def blocks(self, delay_s: float) -> Blocks:
        return self._blocks([combine for combine, _ in self.combines(delay_s)])

    def _blocks(self, combines: Sequence[FloatArray]) -> Blocks:
        calm = [instruments(combine, len(self.names) - 3) for combine in combines]
        return blocks_of([p.moments for p in self.parts], combines, calm)

    def with_slope(self, delay_s: float, theta: FloatArray) -> Blocks:
        """With the balance's slope in the delay as one more column, per sampling interval."""
        step_s = self.parts[0].step_s
        combines = [
            np.column_stack([combine, slope @ theta * (step_s / part.step_s)])
            for part, (combine, slope) in zip(self.parts, self.combines(delay_s), strict=True)
        ]
        return self._blocks(combines)


def fit_delay(
    robot: Robot,
    gathered: Sequence[FlowGatherer],
    solve: Solve = solve_iv,
) -> DelayFit | None:
    """Fit the delay in [0, longest] together with every chamber's parameters.

    Delays over the range are tried, then Gauss-Newton steps follow: the balance's slope in the
    delay is one more column of every chamber, and the chambers' steps are averaged by their
    information.

    Parameters
    ----------
    robot : Robot
    gathered : sequence of FlowGatherer
        The range ends where the columns of one of them do.
    solve : callable
        The estimator.

    Returns
    -------
    DelayFit or None
        None where no chamber has enough windows.
    """
    chambers = _chambers(robot, gathered)
    if not chambers:
        return None
    parts = [p for c in chambers.values() for p in c.parts]
    step_s, longest = max(p.step_s for p in parts), min(p.longest_s for p in parts)
    weights = {name: solve(c.blocks(0.5 * longest)).weight for name, c in chambers.items()}
    delay = _coarse_delay(chambers, weights, longest)
    steps = {name: _delay_step(c, delay, solve) for name, c in chambers.items()}
    for _ in range(_ROUNDS):
        information = {name: 1.0 / s.variance for name, s in steps.items()}
        if sum(information.values()) <= 0.0:
            break
        delay = _settled_delay(chambers, (weights, information), delay, (longest, step_s))
        steps = {name: _delay_step(c, delay, solve) for name, c in chambers.items()}
    return _result(chambers, (delay, longest), steps)


def _settled_delay(
    chambers: dict[str, _Chamber],
    known: tuple[dict[str, FloatArray], dict[str, float]],
    delay_s: float,
    scale: tuple[float, float],
) -> float:
    """Gauss-Newton steps, averaged by given shares, until the delay stays."""
    (weights, information), (longest_s, step_s) = known, scale
    total = sum(information.values())
    for _ in range(_STEPS):
        move = 0.0
        for name, chamber in chambers.items():
            theta = instrumental_parameters(chamber.blocks(delay_s), weights[name])
            both = instrumental_parameters(chamber.with_slope(delay_s, theta), weights[name])
            move += float(both[-1]) * chamber.parts[0].step_s * information[name] / total
        moved = min(max(delay_s + move, 0.0), longest_s)
        settled = abs(moved - delay_s) <= _SETTLED * step_s
        delay_s = moved
        if settled:
            break
    return delay_s


def _chambers(robot: Robot, gathered: Sequence[FlowGatherer]) -> dict[str, _Chamber]:
    found = {}
    for chamber in chambers_of(robot):
        parts = [g.chambers[chamber.channel] for g in gathered if chamber.channel in g.chambers]
        parts = [p for p in parts if p.moments.lagged.any()]
        if not parts:
            continue
        names = column_names(chamber, parts[0].listed)
        if sum(int(p.moments.rows.sum()) for p in parts) > 10 * len(names):
            found[chamber.channel] = _Chamber(names, tuple(parts))
    return found


def _coarse_delay(
    chambers: dict[str, _Chamber], weights: dict[str, FloatArray], longest_s: float
) -> float:
    """The best of some delays, under the weights found at the middle one."""
    if longest_s <= 0.0:
        return 0.0
    tried = np.linspace(0.0, longest_s, _TRIED)
    misfits = [
        sum(_log_misfit(c.blocks(float(d)), weights[name]) for name, c in chambers.items())
        for d in tried
    ]
    return float(tried[int(np.argmin(misfits))])


def _log_misfit(blocks: Blocks, weight: FloatArray) -> float:
    squares, level = misfit(blocks, weight)
    count = float(blocks.count.sum())
    return count * math.log(max(squares, 1e-24 * level, 1e-300))


@dataclass(frozen=True, slots=True)
class _Step:
    """What one chamber says about the delay, and its parameters at this one."""

    plain: Solution
    carried: FloatArray  # what the parameters take up of an error of the delay, per second
    variance: float
    dof: float
    covariance: FloatArray
    theta_dof: FloatArray


def _delay_step(chamber: _Chamber, delay_s: float, solve: Solve) -> _Step:
    unit = chamber.parts[0].step_s
    plain = solve(chamber.blocks(delay_s))
    both = solve(chamber.with_slope(delay_s, plain.theta))
    variance = float(both.covariance[-1, -1]) * unit**2
    scale = np.append(np.ones(plain.theta.size), unit)
    slope = chamber.with_slope(delay_s, plain.theta)
    known = slope.held(np.arange(plain.theta.size), np.zeros(plain.theta.size + 1))
    own_slope = None if slope.own_x is None else slope.own_x[..., -1]
    carried = replace(known, y=slope.x[..., -1], own_y=own_slope)
    return _Step(
        plain,
        instrumental_parameters(carried, plain.weight) / unit,
        variance if variance > 0.0 else math.inf,
        float(both.dof[-1]),
        both.covariance * np.outer(scale, scale),
        both.dof[:-1],
    )


def _result(
    chambers: dict[str, _Chamber], delays: tuple[float, float], steps: dict[str, _Step]
) -> DelayFit:
    delay_s, longest_s = delays
    information = {name: 1.0 / s.variance for name, s in steps.items()}
    total = sum(information.values())
    fitted = {}
    for name, chamber in chambers.items():
        step, blocks = steps[name], chamber.blocks(delay_s)
        count = sum(int(p.moments.rows.sum()) for p in chamber.parts)
        fit = fit_of_solution(step.plain, blocks, count)
        if 0.0 < information[name] < math.inf:
            covariance = _with_shared_delay(step, information[name], total)
            fit = replace(fit, covariance=covariance, dof=step.theta_dof)
        parts = zip(chamber.parts, chamber.combines(delay_s), strict=True)
        combines = {part.moments.label: combine for part, (combine, _) in parts}
        fitted[name] = FittedChamber(chamber.names, fit, step.plain, blocks, combines)
    if total <= 0.0:
        return DelayFit(delay_s, math.inf, 1.0, fitted, longest_s)
    shares = np.array([i / total for i in information.values()])
    dof = 1.0 / float(np.sum(shares**2 / np.array([s.dof for s in steps.values()])))
    return DelayFit(delay_s, 1.0 / math.sqrt(total), dof, fitted, longest_s)


def _with_shared_delay(step: _Step, own: float, total: float) -> FloatArray:
    """Covariance of a chamber's parameters at the delay that all chambers share.

    The delay is the mean of the chambers' own, weighted by their information; what it is off by
    here, the parameters take up as their regressors do: ``theta = theta_k + b (d_k - d)`` with the
    chamber's own estimates of both.
    """
    carried = step.carried[:, None]
    path = np.concatenate([np.eye(carried.size), carried * (1.0 - own / total)], axis=1)
    elsewhere = carried @ carried.T * (total - own) / total**2
    return np.asarray(path @ step.covariance @ path.T + elsewhere)
