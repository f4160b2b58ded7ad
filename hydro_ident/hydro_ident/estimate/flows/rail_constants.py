"""Rails that nobody read: what their constants, of the robot file, may be off by.

A balance takes the file's constant for what nobody recorded. Another one changes the drop over
the edges of that rail, and edges and oil take up the change: to first order by a column that is
the edges' slope in the rail. With it beside the others the flows tell by how much the constant is
off, unless the chambers' pressures hardly move. The parameters stay those of the constant; their
errors reach as far as what the flows tell of it, or as a constant is usually off.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from hydro_ident.estimate.flows.delay_steps import DelayStep, GatheredChamber, Solve
from hydro_ident.estimate.flows.flow_moments import RAILS
from hydro_ident.estimate.forces.bounds import DEVIATIONS
from hydro_ident.estimate.statistics.regression import instrumental_parameters
from hydro_model.robot import FloatArray, Robot

#: A pump's setting, read off its gauge, is right to this share of it; a tank line's pressure lies
#: somewhere between none and twice what is stated, with an atmosphere at least.
_SUPPLY_SHARE, _LEAST_TANK_PA = 0.1, 1.0e5


@dataclass(frozen=True, slots=True)
class RailConstant:
    """What flows tell of a rail that nobody read.

    Attributes
    ----------
    rail : str
    given_pa : float
        The robot file's constant.
    off_pa, std_pa : float
        What it is off by, and the deviation of that; infinite where flows do not tell.
    usual_pa : float
        What such a constant may be off by.
    """

    rail: str
    given_pa: float
    off_pa: float
    std_pa: float
    usual_pa: float

    @property
    def told(self) -> bool:
        """Whether flows contradict the constant."""
        return abs(self.off_pa) > DEVIATIONS * self.std_pa

    @property
    def error_pa(self) -> float:
        """What the parameters' errors are to count it as."""
        found = math.hypot(self.off_pa, self.std_pa)
        return found if self.told else min(found, self.usual_pa)


#: By rail: what a chamber's parameters take up of each Pa that the constant is off by.
Carried = Mapping[str, FloatArray]


def rail_constants(
    robot: Robot,
    chambers: Mapping[str, tuple[GatheredChamber, float, DelayStep]],
    solve: Solve,
) -> tuple[tuple[RailConstant, ...], dict[str, Carried]]:
    """What the rails' constants are off by, and what chambers take up of it.

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
    told: dict[str, list[tuple[float, float]]] = {}
    carried: dict[str, Carried] = {}
    for name, (chamber, delay_s, step) in chambers.items():
        own, carried[name] = _of_chamber(chamber, delay_s, step, solve)
        for rail, found in own.items():
            told.setdefault(rail, []).append(found)
    given = dict(zip(RAILS, (robot.supply_pressure_pa, robot.tank_pressure_pa), strict=True))
    usual = (_SUPPLY_SHARE * given["supply"], max(given["tank"], _LEAST_TANK_PA))
    constants = []
    for rail, usual_pa in zip(RAILS, usual, strict=True):
        if rail not in told:
            continue
        information = sum(1.0 / variance for _, variance in told[rail])
        off = sum(value / variance for value, variance in told[rail])
        mean, std = (off / information, information**-0.5) if information else (0.0, math.inf)
        constants.append(RailConstant(rail, given[rail], mean, std, usual_pa))
    return tuple(constants), carried


def _of_chamber(
    chamber: GatheredChamber, delay_s: float, step: DelayStep, solve: Solve
) -> tuple[dict[str, tuple[float, float]], Carried]:
    """What a chamber tells of the rails' constants, with variances, and what it takes up."""
    theta = step.plain.theta
    blocks, count = chamber.with_rails(delay_s, theta), theta.size
    used = [k for k in range(len(RAILS)) if blocks.x[..., count + k].any()]
    if not used:
        return {}, {}
    free = np.array([*range(count), *(count + k for k in used)], dtype=np.intp)
    both = solve(blocks.held(free, np.zeros(count + len(RAILS))))
    told, carried = {}, {}
    plain = blocks.held(np.arange(count), np.zeros(count + len(RAILS)))
    for at, k in enumerate(used):
        variance = float(both.covariance[count + at, count + at])
        told[RAILS[k]] = float(both.theta[count + at]), variance if variance > 0.0 else math.inf
        own_y = None if blocks.own_x is None else blocks.own_x[..., count + k]
        moved = replace(plain, y=blocks.x[..., count + k], own_y=own_y)
        carried[RAILS[k]] = instrumental_parameters(moved, step.plain.weight)
    return told, carried
