"""The command delay, which all chambers share, with the chambers' own parameters."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from hydro_ident.estimate.blocks import Blocks, blocks_of
from hydro_ident.estimate.chambers import WindowSettings, chambers_of, column_names
from hydro_ident.estimate.flow_moments import ChamberMoments, FlowGatherer, combination
from hydro_ident.estimate.least_squares import Fit, fit_of_solution
from hydro_ident.estimate.regression import Solution, solve_gls, whitened_squares
from hydro_model.robot import FloatArray, Robot

#: Delays tried before the Gauss-Newton steps, over the range.
_TRIED = 9
_STEPS, _SETTLED = 30, 1.0e-13


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
    combines : tuple of (w, p) array
        Its columns from those gathered, by recording.
    """

    names: tuple[str, ...]
    fit: Fit
    solution: Solution
    blocks: Blocks
    combines: tuple[FloatArray, ...]


@dataclass(frozen=True, slots=True)
class DelayFit:
    """Command delay and chambers.

    Attributes
    ----------
    delay_s, std_s, dof : float
        The deviation is infinite where the valves did not move.
    chambers : dict of str to FittedChamber
        By channel.
    """

    delay_s: float
    std_s: float
    dof: float
    chambers: dict[str, FittedChamber]


@dataclass(frozen=True, slots=True)
class _Chamber:
    """A chamber's moments over all recordings."""

    names: tuple[str, ...]
    parts: tuple[ChamberMoments, ...]
    windows: WindowSettings

    def combines(self, delay_s: float) -> list[tuple[FloatArray, FloatArray]]:
        extras = len(self.names) - 3
        return [combination(delay_s / p.step_s, extras, self.windows) for p in self.parts]

    def blocks(self, delay_s: float) -> Blocks:
        combines = [combine for combine, _ in self.combines(delay_s)]
        return blocks_of([p.moments for p in self.parts], combines)

    def with_slope(self, delay_s: float, theta: FloatArray) -> Blocks:
        """With the balance's slope in the delay as one more column, per sampling interval."""
        step_s = self.parts[0].step_s
        combines = [
            np.column_stack([combine, slope @ theta * (step_s / part.step_s)])
            for part, (combine, slope) in zip(self.parts, self.combines(delay_s), strict=True)
        ]
        return blocks_of([p.moments for p in self.parts], combines)


def fit_delay(
    robot: Robot, gathered: Sequence[FlowGatherer], windows: WindowSettings, factor: float = 1.0
) -> DelayFit | None:
    """Fit the delay in [0, longest] together with every chamber's parameters.

    Delays over the range are tried, then Gauss-Newton steps follow: the balance's slope in the
    delay is one more column of every chamber, and the chambers' steps are averaged by their
    information.

    Parameters
    ----------
    robot : Robot
    gathered : sequence of FlowGatherer
    windows : WindowSettings
    factor : float
        Of the variance, for robust weights.

    Returns
    -------
    DelayFit or None
        None where no chamber has enough windows.
    """
    chambers = _chambers(robot, gathered, windows)
    if not chambers:
        return None
    step_s = max(p.step_s for c in chambers.values() for p in c.parts)
    longest = step_s * windows.max_delay_cycles
    noise = {name: solve_gls(c.blocks(0.5 * longest), factor) for name, c in chambers.items()}
    delay = _coarse_delay(chambers, noise, longest)
    for _ in range(_STEPS):
        steps = [_delay_step(c, delay, factor, noise[name]) for name, c in chambers.items()]
        information = sum(1.0 / s.variance for s in steps)
        if information <= 0.0:
            break
        move = sum(s.step_s / s.variance for s in steps) / information
        moved = min(max(delay + move, 0.0), longest)
        settled = abs(moved - delay) <= _SETTLED * step_s
        delay = moved
        if settled:
            break
    return _result(chambers, delay, factor, noise)


def _chambers(
    robot: Robot, gathered: Sequence[FlowGatherer], windows: WindowSettings
) -> dict[str, _Chamber]:
    found = {}
    for chamber in chambers_of(robot):
        parts = [g.chambers[chamber.channel] for g in gathered if chamber.channel in g.chambers]
        parts = [p for p in parts if p.moments.lagged.any()]
        if not parts:
            continue
        names = column_names(chamber, parts[0].listed)
        if sum(int(p.moments.rows.sum()) for p in parts) > 10 * len(names):
            found[chamber.channel] = _Chamber(names, tuple(parts), windows)
    return found


def _coarse_delay(
    chambers: dict[str, _Chamber], noise: dict[str, Solution], longest_s: float
) -> float:
    """The best of some delays, under the noise found at the middle one."""
    if longest_s <= 0.0:
        return 0.0
    tried = np.linspace(0.0, longest_s, _TRIED)
    misfit = [
        sum(
            _log_likelihood(chamber.blocks(float(d)), noise[name].phi, noise[name].variance)
            for name, chamber in chambers.items()
        )
        for d in tried
    ]
    return float(tried[int(np.argmin(misfit))])


def _log_likelihood(blocks: Blocks, phi: FloatArray, variance: FloatArray) -> float:
    squares, level = whitened_squares(blocks, phi, variance)
    count = float(blocks.count.sum())
    return count * math.log(max(squares, 1e-24 * level, 1e-300))


@dataclass(frozen=True, slots=True)
class _Step:
    """What one chamber says about the delay."""

    step_s: float
    variance: float
    dof: float
    theta: FloatArray
    covariance: FloatArray
    theta_dof: FloatArray


def _delay_step(chamber: _Chamber, delay_s: float, factor: float, noise: Solution) -> _Step:
    unit = chamber.parts[0].step_s
    plain = solve_gls(chamber.blocks(delay_s), factor, noise)
    both = solve_gls(chamber.with_slope(delay_s, plain.theta), factor, plain)
    variance = float(both.covariance[-1, -1]) * unit**2
    scale = np.append(np.ones(plain.theta.size), unit)
    return _Step(
        float(both.theta[-1]) * unit,
        variance if variance > 0.0 else math.inf,
        float(both.dof[-1]),
        plain.theta,
        both.covariance * np.outer(scale, scale),
        both.dof[:-1],
    )


def _result(
    chambers: dict[str, _Chamber], delay_s: float, factor: float, noise: dict[str, Solution]
) -> DelayFit:
    steps = {n: _delay_step(c, delay_s, factor, noise[n]) for n, c in chambers.items()}
    information = {name: 1.0 / s.variance for name, s in steps.items()}
    total = sum(information.values())
    fitted = {}
    for name, chamber in chambers.items():
        step, blocks = steps[name], chamber.blocks(delay_s)
        solution = solve_gls(blocks, factor, noise[name])
        count = sum(int(p.moments.rows.sum()) for p in chamber.parts)
        fit = fit_of_solution(solution, blocks, count)
        if 0.0 < information[name] < math.inf:
            covariance = _with_shared_delay(step.covariance, total - information[name])
            fit = replace(fit, covariance=covariance, dof=step.theta_dof)
        combines = tuple(combine for combine, _ in chamber.combines(delay_s))
        fitted[name] = FittedChamber(chamber.names, fit, solution, blocks, combines)
    if total <= 0.0:
        return DelayFit(delay_s, math.inf, 1.0, fitted)
    shares = np.array([i / total for i in information.values()])
    dof = 1.0 / float(np.sum(shares**2 / np.array([s.dof for s in steps.values()])))
    return DelayFit(delay_s, 1.0 / math.sqrt(total), dof, fitted)


def _with_shared_delay(covariance: FloatArray, others: float) -> FloatArray:
    """Covariance of the parameters where other chambers add information on the delay.

    A measurement of the last parameter with variance 1 / others, by the Kalman update.
    """
    last = covariance[:, -1]
    update = np.outer(last, last) * (others / (1.0 + others * last[-1]))
    return np.asarray((covariance - update)[:-1, :-1])
