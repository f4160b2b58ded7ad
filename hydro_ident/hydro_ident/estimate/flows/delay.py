"""The command delay with the chambers' own parameters: of all valves, or of each its own.

Valves whose delays agree within their errors have one, and every chamber tells of it. Where they
do not, a common delay would make oil softer behind an early valve and stiffer behind a late one,
by a per mille for some 0.1 ms: each valve's chambers are then fitted at its own delay.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from hydro_ident.estimate.flows.chambers import chambers_of
from hydro_ident.estimate.flows.delay_steps import (
    DelayStep,
    GatheredChamber,
    Solve,
    coarse_delay,
    delay_step,
    delay_variance,
    gathered_chambers,
    under_weights,
    with_shared_delay,
)
from hydro_ident.estimate.flows.flow_moments import FlowGatherer
from hydro_ident.estimate.flows.unread_rails import Carried, RailConstant, rail_constants
from hydro_ident.estimate.forces.bounds import DEVIATIONS
from hydro_ident.estimate.statistics.blocks import Blocks
from hydro_ident.estimate.statistics.least_squares import Fit, fit_of_solution
from hydro_ident.estimate.statistics.regression import Solution, solve_iv
from hydro_model.robot import FloatArray, Robot

__all__ = ["DelayFit", "FittedChamber", "Solve", "ValveDelay", "fit_delay"]

_STEPS, _SETTLED = 30, 1.0e-9
#: Rounds of Gauss-Newton steps, and the share of a sampling interval by which the delay moved
#: beyond which another follows: the chambers' shares are those of where a round began.
_ROUNDS, _FAR = 2, 0.1
#: Share of a sampling interval by which delays are off without any noise, as pressures are taken
#: for straight within it (`python -m hydro_ident.study.pressure_coverage`: 9 us of 2 ms).
STRAIGHT = 0.005
#: That share per second of the interval where this is more: what a straight line leaves out grows
#: with the interval's square. Thinned-out runs of the crane without noise are off by up to 0.12 %
#: of 2 ms, 0.20 % of 4, 0.57 % of 10 and 2.1 % of 20.
STRAIGHT_PER_S = 1.0


def straight_s(step_s: float) -> float:
    """By how much a delay in s is off without any noise, as one deviation.

    Parameters
    ----------
    step_s : float
        The longest sampling interval.
    """
    return max(STRAIGHT, STRAIGHT_PER_S * step_s) * step_s


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
    off : tuple of (p,) array
        What its parameters may have taken up, as one deviation: of a delay beyond the range, of
        pressures taken for straight. The same cause is at the same place in all chambers.
    carried : dict of str to (p,) array
        What they take up of each Pa that an unread rail's constant is off by.
    """

    names: tuple[str, ...]
    fit: Fit
    solution: Solution
    blocks: Blocks
    combines: dict[str, FloatArray]
    off: tuple[FloatArray, ...]
    carried: Carried = field(default_factory=dict)

    def shifts(self, rails: Sequence[RailConstant]) -> list[FloatArray]:
        """By cause, the same in all chambers: a deviation of the parameters (p,) from outside."""
        zero = np.zeros(len(self.names))
        return [*self.off, *(self.carried.get(r.rail, zero) * r.error_pa for r in rails)]


@dataclass(frozen=True, slots=True)
class ValveDelay:
    """The delay of one valve among others that differ, and its standard deviation, in s."""

    delay_s: float
    std_s: float


@dataclass(frozen=True, slots=True)
class DelayFit:
    """Command delay and chambers.

    Attributes
    ----------
    delay_s, std_s, dof : float
        The deviation is infinite where the valves did not move, and reaches every valve's own
        where they differ.
    chambers : dict of str to FittedChamber
        By channel.
    longest_s : float
        Upper end of the range.
    valves : dict of str to ValveDelay
        By valve, where they differ.
    rails : tuple of RailConstant
        Of rails that nobody read, to first order.
    """

    delay_s: float
    std_s: float
    dof: float
    chambers: dict[str, FittedChamber]
    longest_s: float
    valves: dict[str, ValveDelay] = field(default_factory=dict)
    rails: tuple[RailConstant, ...] = ()


@dataclass(frozen=True, slots=True)
class _Group:
    """Chambers with one delay; `beyond_s`: how far a bound is from where they would have it."""

    chambers: Mapping[str, GatheredChamber]
    delay_s: float
    beyond_s: float
    steps: Mapping[str, DelayStep]

    @property
    def variances(self) -> dict[str, float]:
        return {name: s.variance for name, s in self.steps.items()}

    @property
    def information(self) -> float:
        return sum(1.0 / s.variance for s in self.steps.values())

    def std_s(self, read_s: float) -> float:
        if self.information <= 0.0:
            return math.inf
        return math.hypot(1.0 / math.sqrt(self.information), straight_s(read_s))

    @property
    def dof(self) -> float:
        total = self.information
        if total <= 0.0:
            return 1.0
        shares = [(1.0 / s.variance / total, s.dof) for s in self.steps.values()]
        return 1.0 / sum(share**2 / dof for share, dof in shares)


@dataclass(frozen=True, slots=True)
class _Range:
    """Delays from 0 to `longest_s`.

    `step_s` is the longest sampling interval, `read_s` the longest from reading to reading.
    """

    longest_s: float
    step_s: float
    read_s: float


def fit_delay(
    robot: Robot,
    gathered: Sequence[FlowGatherer],
    solve: Solve = solve_iv,
) -> DelayFit | None:
    """Fit the delay in [0, longest] together with every chamber's parameters.

    Delays over the range are tried, then Gauss-Newton steps follow: the balance's slope in the
    delay is one more column of every chamber, and the chambers' steps are averaged by their
    information. From there on every valve goes its own way; where they part, each stays there.

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
    chambers = gathered_chambers(robot, gathered)
    if not chambers:
        return None
    parts = [p for c in chambers.values() for p in c.parts]
    step_s = max(p.step_s for p in parts)
    read_s = max(step_s, *(p.read_s for p in parts))
    limits = _Range(min(p.longest_s for p in parts), step_s, read_s)
    middle = 0.5 * limits.longest_s
    weights = {name: solve(c.blocks(middle)).weight for name, c in chambers.items()}
    begin = coarse_delay(chambers, weights, limits.longest_s)
    common = _settled(chambers, begin, limits, weights, solve)
    own = _own_groups(robot, common, limits, weights, solve)
    group_of = {name: g for g in (own.values() if own else [common]) for name in g.chambers}
    rails, carried = rail_constants(
        robot,
        {n: (c, group_of[n].delay_s, group_of[n].steps[n]) for n, c in chambers.items()},
        solve,
    )
    fitted = {
        n: replace(_fitted(group_of[n], n, straight_s(limits.read_s)), carried=carried[n])
        for n in chambers
    }
    std_s = common.std_s(limits.read_s)
    valves = {n: ValveDelay(g.delay_s, g.std_s(limits.read_s)) for n, g in own.items()}
    if len({one.delay_s for one in valves.values()}) < 2:
        valves = {}
    apart = max((abs(one.delay_s - common.delay_s) for one in valves.values()), default=0.0)
    return DelayFit(
        common.delay_s, max(std_s, apart), common.dof, fitted, limits.longest_s, valves, rails
    )


def _own_groups(
    robot: Robot,
    common: _Group,
    limits: _Range,
    weights: Mapping[str, FloatArray],
    solve: Solve,
) -> dict[str, _Group]:
    """Every valve with a delay of its own; none where they agree within their errors."""
    by_valve: dict[str, dict[str, GatheredChamber]] = {}
    for chamber in chambers_of(robot):
        if chamber.channel in common.chambers:
            own = by_valve.setdefault(chamber.valve.name, {})
            own[chamber.channel] = common.chambers[chamber.channel]
    if len(by_valve) < 2:
        return {}
    groups = {
        name: _settled(chambers, common.delay_s, limits, weights, solve, common.variances)
        for name, chambers in by_valve.items()
    }
    return groups if _differ(list(groups.values()), limits.read_s) else {}


def _differ(groups: Sequence[_Group], read_s: float) -> bool:
    """Whether delays differ by more than their errors.

    At a bound only the side is told: how far beyond it is a step that no deviation knows of.
    """
    told = [(g.delay_s, g.std_s(read_s)) for g in groups if g.information > 0.0]
    pairs = itertools.combinations(told, 2)
    return any(abs(a - b) > DEVIATIONS * math.hypot(c, d) for (a, c), (b, d) in pairs)


def _settled(
    chambers: Mapping[str, GatheredChamber],
    delay_s: float,
    limits: _Range,
    weights: Mapping[str, FloatArray],
    solve: Solve,
    variances: Mapping[str, float] | None = None,
) -> _Group:
    """Chambers at the delay that is best for them together, from one near it on.

    `variances` of it are there where they are known; the chambers' shares are those.
    """
    beyond = 0.0
    for _ in range(_ROUNDS):
        if variances is None:
            variances = {
                name: delay_variance(c, delay_s, weights[name], solve)
                for name, c in chambers.items()
            }
        information = {name: 1.0 / variances[name] for name in chambers}
        if sum(information.values()) <= 0.0:
            break
        began = delay_s
        delay_s, beyond = _stepped(chambers, (weights, information), delay_s, limits, solve)
        if abs(delay_s - began) <= _FAR * limits.step_s:
            break
        variances = None
    steps = {name: delay_step(c, delay_s, solve) for name, c in chambers.items()}
    return _Group(chambers, delay_s, beyond, steps)


def _stepped(
    chambers: Mapping[str, GatheredChamber],
    known: tuple[Mapping[str, FloatArray], Mapping[str, float]],
    delay_s: float,
    limits: _Range,
    solve: Solve,
) -> tuple[float, float]:
    """Gauss-Newton steps, averaged by given shares, until the delay stays, and the step left."""
    (weights, information), parameters = known, under_weights(solve)
    total, beyond = sum(information.values()), 0.0
    for _ in range(_STEPS):
        move = 0.0
        for name, chamber in chambers.items():
            theta = parameters(chamber.blocks(delay_s, noise=False), weights[name])
            both = parameters(chamber.with_slope(delay_s, theta, noise=False), weights[name])
            move += float(both[-1]) * chamber.parts[0].step_s * information[name] / total
        moved = min(max(delay_s + move, 0.0), limits.longest_s)
        beyond = delay_s + move - moved
        settled = abs(moved - delay_s) <= _SETTLED * limits.step_s
        delay_s = moved
        if settled:
            break
    return delay_s, beyond


def _fitted(group: _Group, name: str, straight: float) -> FittedChamber:
    chamber, step, delay_s = group.chambers[name], group.steps[name], group.delay_s
    blocks, own = chamber.blocks(delay_s), 1.0 / step.variance
    count = sum(int(p.moments.rows.sum()) for p in chamber.parts)
    fit = fit_of_solution(step.plain, blocks, count)
    if 0.0 < own < math.inf:
        covariance = with_shared_delay(step, own, group.information)
        fit = replace(fit, covariance=covariance, dof=step.theta_dof)
    parts = zip(chamber.parts, chamber.combines(delay_s), strict=True)
    combines = {part.moments.label: combine for part, (combine, _) in parts}
    off = tuple(np.asarray(step.carried * off_s) for off_s in (group.beyond_s, straight))
    return FittedChamber(chamber.names, fit, step.plain, blocks, combines, off)
