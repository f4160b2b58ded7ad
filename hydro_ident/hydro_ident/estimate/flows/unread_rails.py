"""Rails that nobody read: what their constants, of the robot file, may be off by.

A balance takes the file's constant for what nobody recorded. Another one changes the drop over
the edges of that rail, and edges and oil take up the change: to first order by a column that is
the edges' slope in the rail. With it beside the others the flows tell by how much the constant is
off, unless the chambers' pressures hardly move; where that is much, slopes are taken there anew.
The parameters stay those of the constant; their errors reach as far as what the flows tell of it,
or as a constant is usually off.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from hydro_ident.estimate.flows.delay_steps import DelayStep, GatheredChamber, Solve
from hydro_ident.estimate.flows.flow_moments import RAILS
from hydro_ident.estimate.forces.bounds import DEVIATIONS
from hydro_ident.estimate.statistics.blocks import Blocks
from hydro_ident.estimate.statistics.least_squares import (
    MAX_COLLINEARITY,
    collinearity,
)
from hydro_ident.estimate.statistics.regression import instrumental_parameters, stacked_columns
from hydro_model.robot import FloatArray, Robot

#: A pump's setting, read off its gauge, is right to this share of it; a tank line's pressure lies
#: somewhere between none and twice what is stated, with an atmosphere at least.
_SUPPLY_SHARE, _LEAST_TANK_PA = 0.1, 1.0e5
#: What a constant is off by is worth a word from this share of it on, and this pressure.
_LEAST_SHARE, _LEAST_PA = 0.01, 1.0e5
#: Times that slopes are taken anew, each from half of a constant on at least, and the step (share
#: of the deviation, Pa) that ends it.
_ROUNDS, _SETTLED_SHARE, _SETTLED_PA = 6, 0.1, 1.0e3

#: Between `file_constant` and the pressure that fits.
UNFITTING = "do not fit what passes the valves:"


@dataclass(frozen=True, slots=True)
class RailConstant:
    """What flows tell of a rail that nobody read.

    Attributes
    ----------
    rail : str
    given_pa : float
        The robot file's constant.
    off_pa, std_pa : float
        What it is off by, and the deviation of that, with what chambers and recordings differ
        by; infinite where flows do not tell.
    usual_pa : float
        What such a constant may be off by.
    recordings : tuple of str
        Those without it, where others read it.
    """

    rail: str
    given_pa: float
    off_pa: float
    std_pa: float
    usual_pa: float
    recordings: tuple[str, ...] = ()

    @property
    def large(self) -> bool:
        """Whether it is off by more than is worth a word, or by more than its deviation."""
        least = max(_LEAST_SHARE * self.given_pa, _LEAST_PA)
        return abs(self.off_pa) > max(self.std_pa, least)

    @property
    def told(self) -> bool:
        """Whether flows contradict the constant."""
        return self.large and abs(self.off_pa) > DEVIATIONS * self.std_pa

    @property
    def error_pa(self) -> float:
        """What the parameters' errors are to count it as."""
        found = math.hypot(self.off_pa, self.std_pa)
        return found if self.told else min(found, self.usual_pa)


#: By rail: what a chamber's parameters take up of each Pa that the constant is off by.
Carried = Mapping[str, FloatArray]
#: What rails are off by, linearised where they are off by what is given in Pa, by rail.
Linearised = Callable[[Mapping[str, float]], Sequence[RailConstant]]


@dataclass(frozen=True, slots=True)
class _Told:
    """What a chamber tells of one rail: offset and variance, by recording, and who lacks it."""

    mean: tuple[float, float]
    recordings: Mapping[str, tuple[float, float]]
    lacking: frozenset[str]


def file_constant(rail: str, given_pa: float, recordings: Sequence[str] = ()) -> str:
    """The begin of a sentence on the constant of a rail that nobody read.

    Parameters
    ----------
    rail : str
    given_pa : float
        Of the robot file.
    recordings : sequence of str
        Those without it, where others read it.
    """
    where = f" in {', '.join(recordings)}" if recordings else ""
    return f"{rail} was not recorded{where}, and the robot file's {1e-5 * given_pa:.4g} bar"


def rail_constants(
    robot: Robot,
    chambers: Mapping[str, tuple[GatheredChamber, float, DelayStep]],
    solve: Solve,
) -> tuple[tuple[RailConstant, ...], dict[str, Carried]]:
    """What the rails' constants are off by to first order, and what chambers take up of it.

    Parameters
    ----------
    robot : Robot
    chambers : mapping of str to (GatheredChamber, float, DelayStep)
        With their delays in s.
    solve : callable
        The estimator.

    Returns
    -------
    constants : tuple of RailConstant
        Of rails that were not read; empty where all were.
    carried : dict of str to mapping of str to (p,) array
        By chamber, then by rail.
    """
    told: dict[str, list[_Told]] = {}
    carried: dict[str, Carried] = {}
    for name, (chamber, delay_s, step) in chambers.items():
        own, carried[name] = _of_chamber(chamber, delay_s, step, solve)
        for rail, found in own.items():
            told.setdefault(rail, []).append(found)
    labels = {part.moments.label for chamber, _, _ in chambers.values() for part in chamber.parts}
    given = dict(zip(RAILS, (robot.supply_pressure_pa, robot.tank_pressure_pa), strict=True))
    usual = (_SUPPLY_SHARE * given["supply"], max(given["tank"], _LEAST_TANK_PA))
    constants = []
    for rail, usual_pa in zip(RAILS, usual, strict=True):
        if rail not in told:
            continue
        mean, std = _mean([one.mean for one in told[rail]])
        std = math.hypot(std, _between_recordings(told[rail]))
        lacking = set().union(*(one.lacking for one in told[rail]))
        some = tuple(sorted(lacking)) if labels - lacking else ()
        constants.append(RailConstant(rail, given[rail], mean, std, usual_pa, some))
    return tuple(constants), carried


def settled_constants(
    found: Sequence[RailConstant], linearised: Linearised
) -> tuple[RailConstant, ...]:
    """Constants whose slopes were taken where they are: a flow follows the root of the drop.

    Parameters
    ----------
    found : sequence of RailConstant
        As linearised at the robot file's.
    linearised : callable
        Takes another look at the recordings.

    Returns
    -------
    tuple of RailConstant
        Those that are off by next to nothing stay as linearised; where steps do not end, the
        last one is a deviation more.
    """
    large = {one.rail for one in found if one.large}
    if not large:
        return tuple(found)
    at, step = dict.fromkeys(large, 0.0), {one.rail: one.off_pa for one in found}
    result = tuple(found)
    for _ in range(_ROUNDS):
        for one in result:
            if one.rail in large:
                now = one.given_pa + at[one.rail]
                at[one.rail] += max(step[one.rail], -0.5 * now)
        moved = linearised(at)
        step = {one.rail: one.off_pa for one in moved}
        result = tuple(replace(one, off_pa=at.get(one.rail, 0.0) + one.off_pa) for one in moved)
        if all(_is_settled(one) for one in moved if one.rail in large):
            return result
    return tuple(
        replace(one, std_pa=math.hypot(one.std_pa, step[one.rail])) if one.rail in large else one
        for one in result
    )


def _is_settled(step: RailConstant) -> bool:
    return abs(step.off_pa) <= max(_SETTLED_SHARE * step.std_pa, _SETTLED_PA)


def _mean(found: Sequence[tuple[float, float]]) -> tuple[float, float]:
    """Mean of values with variances, and its deviation, widened by their scatter (Birge)."""
    known = [(value, variance) for value, variance in found if math.isfinite(variance)]
    if not known:
        return 0.0, math.inf
    information = sum(1.0 / variance for _, variance in known)
    mean = sum(value / variance for value, variance in known) / information
    squares = sum((value - mean) ** 2 / variance for value, variance in known)
    return mean, math.sqrt(max(1.0, squares / max(len(known) - 1, 1)) / information)


def _between_recordings(told: Sequence[_Told]) -> float:
    """Deviation of the recordings' own constants beyond their noise (DerSimonian and Laird)."""
    labels = dict.fromkeys(label for one in told for label in one.recordings)
    means = [_mean([t.recordings[n] for t in told if n in t.recordings]) for n in labels]
    known = [(value, std**-2) for value, std in means if math.isfinite(std)]
    if len(known) < 2:
        return 0.0
    total = sum(weight for _, weight in known)
    mean = sum(value * weight for value, weight in known) / total
    squares = sum(weight * (value - mean) ** 2 for value, weight in known)
    share = total - sum(weight**2 for _, weight in known) / total
    return math.sqrt(max(0.0, squares - (len(known) - 1)) / share)


def _of_chamber(
    chamber: GatheredChamber, delay_s: float, step: DelayStep, solve: Solve
) -> tuple[dict[str, _Told], Carried]:
    """What a chamber tells of the rails' constants, and what it takes up."""
    theta = step.plain.theta
    blocks, count = chamber.with_rails(delay_s, theta), theta.size
    used = _used(blocks, count)
    if not used:
        return {}, {}
    free = np.array([*range(count), *(count + k for k in used)], dtype=np.intp)
    beside = blocks.held(free, np.zeros(count + len(RAILS)))
    both = solve(beside)
    # A pressure that stands still makes a rail and its edge one column: noise tells them apart.
    alone = collinearity(stacked_columns(beside, both.residual_std))[count:] < MAX_COLLINEARITY
    own, lacking = _by_recording(chamber, delay_s, theta, both.theta[:count], solve)
    told, carried = {}, {}
    plain = blocks.held(np.arange(count), np.zeros(count + len(RAILS)))
    for at, k in enumerate(used):
        rail = RAILS[k]
        variance = float(both.covariance[count + at, count + at])
        known = bool(alone[at]) and variance > 0.0
        mean = float(both.theta[count + at]), variance if known else math.inf
        told[rail] = _Told(mean, own[rail] if known else {}, frozenset(lacking[rail]))
        own_y = None if blocks.own_x is None else blocks.own_x[..., count + k]
        moved = replace(plain, y=blocks.x[..., count + k], own_y=own_y)
        carried[rail] = instrumental_parameters(moved, step.plain.weight)
    return told, carried


def _by_recording(
    chamber: GatheredChamber, delay_s: float, slope: FloatArray, theta: FloatArray, solve: Solve
) -> tuple[dict[str, dict[str, tuple[float, float]]], dict[str, set[str]]]:
    """By rail: what each recording tells, parameters `theta` given, and which ones lack it.

    `slope` are the parameters that the slopes are of; one recording alone tells no difference.
    """
    own: dict[str, dict[str, tuple[float, float]]] = {rail: {} for rail in RAILS}
    lacking: dict[str, set[str]] = {rail: set() for rail in RAILS}
    for part in chamber.parts:
        if not part.moments.lagged.any():
            continue
        blocks = replace(chamber, parts=(part,)).with_rails(delay_s, slope)
        used, label = _used(blocks, theta.size), part.moments.label
        for k in used:
            lacking[RAILS[k]].add(label)
        if not used or len(chamber.parts) < 2:
            continue
        free = np.array([theta.size + k for k in used], dtype=np.intp)
        found = solve(blocks.held(free, np.append(theta, np.zeros(len(RAILS)))))
        for at, k in enumerate(used):
            variance = float(found.covariance[at, at])
            if variance > 0.0:
                own[RAILS[k]][label] = float(found.theta[at]), variance
    return own, lacking


def _used(blocks: Blocks, count: int) -> list[int]:
    """Rails that were not read, by their place; `count`: columns before theirs."""
    return [k for k in range(len(RAILS)) if blocks.x[..., count + k].any()]
