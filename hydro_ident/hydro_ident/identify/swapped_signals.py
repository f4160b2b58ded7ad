"""Whether flows that are predicted badly are of signals that were swapped.

Edges of swapped pressures may all be above zero, with small deviations, and their flows predicted
better than by their mean: they pass for a machine of which much physics is left out. What tells
the two apart is another of the robot's signals in the place of the chamber's own: physics that is
left out is left out with that as well, and its rows fit it no better.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

from hydro_ident.estimate.flows.chambers import Chamber
from hydro_ident.estimate.flows.cylinder_fit import ChamberFit, CylinderFit
from hydro_ident.estimate.flows.exchange import Exchange, exchanges
from hydro_ident.estimate.flows.hydraulics import HydraulicFit, hydraulic_fit
from hydro_ident.estimate.scoring.scores import ChannelScore
from hydro_ident.identify.estimation import Estimates
from hydro_ident.identify.gathering import gather_source
from hydro_ident.identify.job import Job
from hydro_model.robot import Robot

#: Flows are predicted badly below this fit (%), where errors are above so many times the noise:
#: only then other signals are tried, each of which costs a look at the recordings.
_POOR_PCT, _LOUD = 90.0, 10.0
#: Signals are swapped where others leave less than this share of the residuals, and a fit that is
#: no longer poor. Behind a valve that is off its null, whose other edge was open, another pressure
#: left 0.38 of them, and a poor fit (`bias` 0.08, the simulated crane); others left 0.85.
_FAR_BETTER = 0.2


@dataclass(frozen=True, slots=True)
class Swapped:
    """Signals of one cylinder that were likely swapped.

    Attributes
    ----------
    why : str
        In words.
    pressures : tuple of str
        Those of them that are pressures, in words: forces are of the wrong ones, too.
    """

    why: str
    pressures: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class _Better:
    """A chamber, the signals that explain it, and how many times smaller residuals are."""

    chamber: Chamber
    exchange: Exchange
    times: float


def swapped_signals(
    job: Job, estimates: Estimates, scores: Sequence[ChannelScore]
) -> dict[str, Swapped]:
    """Cylinders whose signals were likely swapped.

    Parameters
    ----------
    job : Job
    estimates : Estimates
    scores : sequence of ChannelScore
        On held-out rows; where nothing was held out, on those that were fitted.

    Returns
    -------
    dict of str to Swapped
        By the cylinder's name; empty where all flows are predicted well, without another look.
    """
    fit = estimates.hydraulic
    if fit is None:
        return {}
    summaries = {s.name: s.summary() for s in scores}
    poor = {n: float(s["fit_after_pct"]) for n, s in summaries.items() if _is_poor(s)}
    suspects = {c.chamber.channel: c for c in _chambers(fit) if c.chamber.channel in poor}
    better: dict[str, _Better] = {}
    at = tuple(sorted({c.chamber.index for c in suspects.values()}))
    for exchange in exchanges(at, len(job.robot.cylinders)) if at else ():
        if better.keys() >= suspects.keys():
            break
        found = _fitted(job, estimates, exchange)
        for one in _chambers(found) if found is not None else ():
            own = suspects.get(one.chamber.channel)
            if own is None or not _has_edges(one):
                continue
            left, here = float(own.fit.channel_std[0]), float(one.fit.channel_std[0])
            times, name = left / max(here, 1e-12 * left), one.chamber.channel
            known = better[name].times if name in better else 1.0 / _FAR_BETTER
            if times > known and 100.0 - (100.0 - poor[name]) / times > _POOR_PCT:
                better[name] = _Better(one.chamber, exchange, times)
    return {c.cylinder: _told(job.robot, c, better) for c in fit.cylinders if _any(c, better)}


def _is_poor(score: Mapping[str, float | str]) -> bool:
    loud = float(score["rmse_after"]) > _LOUD * float(score["noise_floor"])
    return loud and float(score["fit_after_pct"]) < _POOR_PCT


def _chambers(fit: HydraulicFit) -> list[ChamberFit]:
    return [chamber for cylinder in fit.cylinders for chamber in cylinder.chambers]


def _has_edges(one: ChamberFit) -> bool:
    """Whether a valve could have the edges of a chamber's fit."""
    values = dict(zip(one.names, one.fit.theta.tolist(), strict=True))
    return all(values[name] > 0.0 for name in one.chamber.edges)


def _fitted(job: Job, estimates: Estimates, exchange: Exchange) -> HydraulicFit | None:
    """The chambers with other signals, as they are first fitted: without weights of outliers."""
    plan = replace(
        job.plan,
        forces=False,
        effects=estimates.effects,
        cleaner=estimates.cleaner,
        exchange=exchange,
    )
    gathered = job.workers.map(partial(gather_source, plan=plan), job.sources)
    return hydraulic_fit(job.robot, [g.flows for g in gathered], plan.windows)


def _any(fit: CylinderFit, better: Mapping[str, _Better]) -> bool:
    return any(c.chamber.channel in better for c in fit.chambers)


def _told(robot: Robot, fit: CylinderFit, better: Mapping[str, _Better]) -> Swapped:
    found = [better[c.chamber.channel] for c in fit.chambers if c.chamber.channel in better]
    words = [(one, one.exchange.words(robot, one.chamber)) for one in found]
    goes_by = ", ".join(
        f"{one.chamber.channel} goes by {signal} (residuals {one.times:.0f} times smaller)"
        for one, signal in words
    )
    pressures = [signal for one, signal in words if one.exchange.of_pressures]
    return Swapped(
        f"{goes_by}: these signals are likely swapped, in the mapping or the wiring",
        tuple(pressures),
    )
