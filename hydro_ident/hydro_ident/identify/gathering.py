"""The passes over recordings: each looks at one recording and gives what is combined later."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from hydro_ident.bag.streaming import OVERLAP_S, Piece
from hydro_ident.estimate.effects.listed_effects import ListedEffects
from hydro_ident.estimate.flows.chambers import WindowSettings, chambers_of
from hydro_ident.estimate.flows.exchange import Exchange
from hydro_ident.estimate.flows.flow_moments import FlowGatherer
from hydro_ident.estimate.flows.summed_flow import SummedFlow
from hydro_ident.estimate.forces.end_stops import at_end_stops
from hydro_ident.estimate.forces.inertial import ForceModel, force_rows
from hydro_ident.estimate.forces.late_forces import late_rows
from hydro_ident.estimate.forces.standstill import Rest, giving_way
from hydro_ident.estimate.scoring.scores import HoldOut, Tally
from hydro_ident.estimate.signals.added_noise import with_position_noise
from hydro_ident.estimate.signals.derivatives import FilterSettings
from hydro_ident.estimate.signals.traces import Trace, traces_of_piece
from hydro_ident.estimate.statistics.moments import Moments
from hydro_ident.estimate.statistics.robust import Weights
from hydro_ident.identify.channel_scores import ScoreKeeper, ScorePlan
from hydro_ident.identify.survey import Survey
from hydro_ident.recordings.cleaning import Cleaner
from hydro_ident.recordings.sources import Source
from hydro_model.robot import FloatArray, Robot

#: Periods of the parallel filter's cut-off over which it forgets to 1e-20.
_FORGOTTEN = 20.0


@dataclass(frozen=True, slots=True)
class GatherPlan:
    """What is gathered of a recording.

    Attributes
    ----------
    robot : Robot
    model : ForceModel
    effects : ListedEffects
    split : HoldOut
    filters : FilterSettings
        Of the quickest recording; slower ones have theirs as quick as they bear them.
    overlap_s : float
        Overlap of pieces over which the filters settle.
    windows : WindowSettings
    still : mapping of str to mapping of int to Rest
        By recording, how the joints stand that are still.
    forces, flows : bool
        Which rows are wanted.
    instruments : bool
        With the recorded references as instruments.
    force_weights : Weights or None
    flow_weights : mapping of str to mapping of str to Weights
        By recording, then by chamber.
    longest_delay_s : float
        Longest delay of the slowest recording, which all of them are to reach.
    cleaner : Cleaner or None
    rails_off_pa : mapping of str to float
        What constants of rails that were not read are taken to be off by.
    position_noise : (k, n) array or None
        Deviations of noise that positions are given, for as many further moments of the forces.
    exchange : Exchange or None
        Signals that stand in the place of flows' own.
    """

    robot: Robot
    model: ForceModel
    effects: ListedEffects
    split: HoldOut
    filters: FilterSettings
    overlap_s: float
    windows: WindowSettings
    still: Mapping[str, Mapping[int, Rest]]
    forces: bool = True
    flows: bool = True
    instruments: bool = False
    force_weights: Weights | None = None
    flow_weights: Mapping[str, Mapping[str, Weights]] = field(default_factory=dict)
    longest_delay_s: float = 0.0
    cleaner: Cleaner | None = None
    rails_off_pa: Mapping[str, float] = field(default_factory=dict)
    position_noise: FloatArray | None = None
    exchange: Exchange | None = None


@dataclass(slots=True)
class Gathered:
    """What one recording gives.

    Attributes
    ----------
    name : str
    forces : Moments or None
    flows : FlowGatherer
    force_weights : Weights or None
        With the residuals met.
    cleaned : dict of str to int
        Samples taken for outliers, by sensor.
    stopped_s : float
        Time at end stops, whose rows of forces are left out.
    disturbed : list of Moments
        As `forces`, with each noise that the plan gives positions.
    """

    name: str
    forces: Moments | None
    flows: FlowGatherer
    force_weights: Weights | None
    cleaned: dict[str, int] = field(default_factory=dict)
    stopped_s: float = 0.0
    disturbed: list[Moments] = field(default_factory=list)


def unfitted_notes(
    plan: GatherPlan, gathered: Sequence[Gathered], surveys: Sequence[Survey]
) -> list[str]:
    """Which recordings give no row to a channel, though they have all that it needs.

    Parameters
    ----------
    plan : GatherPlan
    gathered : sequence of Gathered
    surveys : sequence of Survey
        Of the same recordings.

    Returns
    -------
    list of str
        A sentence for each such recording.
    """
    notes = []
    wanted = (*plan.model.channels, *(c.channel for c in chambers_of(plan.robot)))
    for one, survey in zip(gathered, surveys, strict=True):
        rows = dict.fromkeys(wanted, 0.0)
        if one.forces is not None:
            rows |= dict(zip(plan.model.channels, one.forces.lagged.tolist(), strict=True))
        rows |= {name: float(c.moments.lagged.sum()) for name, c in one.flows.chambers.items()}
        told = {loss.channel for loss in survey.recording.losses}
        # Of these the verdict says that they did not move.
        told |= {plan.model.channels[j] for j in giving_way(plan.still.get(one.name, {}))}
        lacking = [name for name, count in rows.items() if count == 0.0 and name not in told]
        if lacking:
            notes.append(
                f"{one.name}: nothing of it is fitted in {', '.join(lacking)}: of its stretches"
                f" with all readings the longest lasts {survey.continuity.longest_s:.3g} s, and"
                " the filters' reach, end stops and what is held out leave nothing"
            )
    return notes


def overlap_s(filters: FilterSettings) -> float:
    """Overlap of pieces over which the filters settle."""
    return max(OVERLAP_S, _FORGOTTEN / filters.parallel_hz)


def gather_source(source: Source, plan: GatherPlan) -> Gathered:
    """Gather one recording.

    Parameters
    ----------
    source : Source
    plan : GatherPlan

    Returns
    -------
    Gathered
        The same whether the recording comes whole or in pieces.
    """
    weights = None if plan.force_weights is None else replace(plan.force_weights, residuals={})
    own_weights = plan.flow_weights.get(source.name, {})
    flow_weights = {k: replace(w, residuals={}) for k, w in own_weights.items()}
    flows = FlowGatherer(
        plan.robot,
        source.name,
        plan.windows,
        plan.effects.chamber_columns,
        plan.split.training,
        flow_weights,
        longest_s=plan.longest_delay_s,
        rails_off_pa=plan.rails_off_pa,
    )
    found = Gathered(source.name, None, flows, weights)
    for piece in source.pieces(overlap_s=plan.overlap_s):
        for trace in _traces(piece, plan.cleaner, found.cleaned):
            if plan.forces and np.isfinite(trace.q).all():
                _add_forces(found, plan, trace)
            if plan.flows:
                seen = trace if plan.exchange is None else plan.exchange.of(trace)
                flows.add(plan.effects.with_signal_laws(seen))
    # What is left are numbers: they travel between processes.
    flows.extra = flows.select = None
    return found


def gather_late(source: Source, plan: GatherPlan) -> Moments | None:
    """Rows of the forces that are fitted with columns for the time that they may be late by.

    Parameters
    ----------
    source : Source
    plan : GatherPlan

    Returns
    -------
    Moments or None
        Without robust weights; None where there are no rows.
    """
    found, still = None, plan.still.get(source.name, {})
    for piece in source.pieces(overlap_s=plan.overlap_s):
        for trace in _traces(piece, plan.cleaner, {}):
            rows = force_rows(plan.model, trace, plan.filters, still)
            if rows is None:
                continue
            late = plan.split.training(late_rows(plan.model, trace, rows, plan.filters))
            if found is None:
                found = Moments.like(late, source.name, sample_s=trace.step_s)
            found.add(late)
    return found


def _add_forces(found: Gathered, plan: GatherPlan, trace: Trace) -> None:
    still = plan.still.get(found.name, {})
    stopped = at_end_stops(plan.robot, trace, plan.filters, still)[trace.owned].any(axis=1)
    found.stopped_s += float(np.count_nonzero(stopped)) * trace.step_s
    rows = force_rows(plan.model, trace, plan.filters, still, plan.instruments)
    if rows is None:
        return
    rows = plan.split.training(rows)
    if found.forces is None:
        found.forces = Moments.like(rows, found.name, sample_s=trace.step_s)
    found.forces.add(rows, found.force_weights)
    for k, noise in enumerate(() if plan.position_noise is None else plan.position_noise):
        noisy = force_rows(plan.model, with_position_noise(trace, noise), plan.filters, still)
        if noisy is not None:
            noisy = plan.split.training(noisy)
            if len(found.disturbed) == k:
                found.disturbed.append(Moments.like(noisy, found.name))
            found.disturbed[k].add(noisy, None)


@dataclass(slots=True)
class Scored:
    """What the last pass finds in a recording.

    Attributes
    ----------
    name : str
    tallies, fitted : dict of str to Tally
        By channel: rows that took no part in the fit, and rows that did.
    summed : SummedFlow or None
    late : Moments or None
        Of `ScoreKeeper`.
    cleaned : dict of str to int
        Samples taken for outliers, by sensor.
    """

    name: str
    tallies: dict[str, Tally]
    fitted: dict[str, Tally]
    summed: SummedFlow | None
    late: Moments | None = None
    cleaned: dict[str, int] = field(default_factory=dict)


def score_source(source: Source, plan: ScorePlan, scored: bool, trained: bool) -> Scored:
    """Score one recording; compare eq. 14 with the chambers on one that was fitted.

    Parameters
    ----------
    source : Source
    plan : ScorePlan
    scored, trained : bool
        Whether (some of) it took no part in the fit, and whether (some of) it did.
    """
    keeper = ScoreKeeper(plan, scored, trained)
    comparison, cleaned = None, dict[str, int]()
    if trained and plan.hydraulic is not None:
        comparison = SummedFlow(plan.robot, plan.hydraulic.delay_of, plan.hydraulic.windows)
    for piece in source.pieces(overlap_s=plan.overlap_s):
        for trace in _traces(piece, plan.cleaner, cleaned):
            keeper.add(trace)
            if comparison is not None:
                comparison.add(plan.effects[1].with_signal_laws(trace))
    return Scored(source.name, keeper.tallies, keeper.fitted, comparison, keeper.late, cleaned)


def _traces(piece: Piece, cleaner: Cleaner | None, counts: dict[str, int]) -> tuple[Trace, ...]:
    """Traces of a piece, without the outliers, which are added to `counts` by sensor."""
    return traces_of_piece(piece if cleaner is None else cleaner.cleaned(piece, counts))
