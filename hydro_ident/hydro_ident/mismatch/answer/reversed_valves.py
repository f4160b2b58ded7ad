"""Valves whose signal, or whose piston's position, has the wrong sign in the recordings.

A fit holds edges above zero and stops at whatever is left of them there: numbers of no valve, in
whose residual the rest of the flows looks like physics. Solved for without that limit the edges
say what is wrong.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from hydro_ident.estimate.flows.chambers import INVERSE_BULK
from hydro_ident.estimate.flows.cylinder_fit import reversed_edges
from hydro_ident.estimate.forces.bounds import DEVIATIONS
from hydro_ident.mismatch.fitting.fitted import Fitted
from hydro_ident.mismatch.fitting.training import Training
from hydro_ident.mismatch.locating.dependence import Dependence
from hydro_ident.mismatch.unnamed.unknown import Unexplained
from hydro_model.robot import Robot

_EDGES = ("c_pa", "c_at", "c_pb", "c_bt")


def reversed_valves(training: Training, base: Fitted) -> dict[str, str]:
    """Names of valves of which every edge that is told is below zero, and what that says.

    Parameters
    ----------
    training : Training
    base : Fitted
        Without any effect that was found: a balance is linear in its edges.
    """
    names = training.predictor.names
    count = len(names)
    free = training.predictor.parameters(base.model) + base.bench.solve()[:count]
    std = np.sqrt(np.maximum(np.diag(base.covariance)[:count], 0.0))
    result = dict[str, str]()
    for valve in training.predictor.material.robot.valves:
        own = [f"{valve.name}.{edge}" for edge in _EDGES]
        at = [names.index(name) for name in own if name in names]
        told = [k for k in at if abs(free[k]) > DEVIATIONS * std[k] > 0.0]
        # One edge alone may be a wrong rail's: of a sign every way of the valve says the same.
        if len(told) > 1 and all(free[k] < 0.0 for k in told):
            edges = {names[k].rpartition(".")[2]: float(free[k]) for k in told}
            result[valve.name] = reversed_edges(valve.name, edges)
    return result


def untold(
    found: Sequence[Unexplained],
    reasons: Mapping[str, str],
    robot: Robot,
    left: Sequence[Dependence],
) -> tuple[Unexplained, ...]:
    """What has no name, with all of these valves' balances, whatever they seem to follow.

    Parameters
    ----------
    found : sequence of Unexplained
    reasons : mapping of str to str
        As `reversed_valves` returns them.
    robot : Robot
    left : sequence of Dependence
        Strongest first.
    """
    joints = {c.name: c.joint for c in robot.cylinders}
    texts = {
        f"{joints[valve.cylinder]}/flow_{side}": reasons[valve.name]
        for valve in robot.valves
        if valve.name in reasons
        for side in "ab"
    }
    kept = [one for one in found if one.channel not in texts]
    for channel, text in texts.items():
        best = next((d for d in left if d.name == channel), None)
        if best is not None:
            on = ("everywhere",)
            kept.append(Unexplained(channel, on, 1.0, None, f"{channel}: {text}", best))
    return tuple(kept)


def with_given_valves(robot: Robot, given: Robot, names: Sequence[str]) -> Robot:
    """A robot with edges and moduli of some valves and their cylinders as its file has them.

    Parameters
    ----------
    robot : Robot
    given : Robot
    names : sequence of str
        Of the valves.
    """
    fed = {v.cylinder for v in given.valves if v.name in names}
    bulk = {c.name: c.bulk_modulus_pa for c in given.cylinders}
    own = {f"{name}.{edge}" for name in names for edge in _EDGES}
    own |= {f"{name}.{INVERSE_BULK.removeprefix('inverse_')}" for name in fed}
    std = {k: s for k, s in robot.standard_deviations.items() if k not in own}
    std |= {k: s for k, s in given.standard_deviations.items() if k in own}
    return replace(
        robot,
        valves=tuple(
            g if g.name in names else v for v, g in zip(robot.valves, given.valves, strict=True)
        ),
        cylinders=tuple(
            replace(c, bulk_modulus_pa=bulk[c.name]) if c.name in fed else c
            for c in robot.cylinders
        ),
        standard_deviations=std,
    )


def reversed_notes(reasons: Mapping[str, str]) -> list[str]:
    """Those of such valves.

    Parameters
    ----------
    reasons : mapping of str to str
        As `reversed_valves` returns them.
    """
    return [
        f"{name}: {why}: its edges and its cylinder's bulk modulus stay as the robot file has them"
        for name, why in reasons.items()
    ]
