"""The last pass over the recordings: scores on what is held out, and what is rolled out of it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

from hydro_ident.estimate.flows.hydraulics import HydraulicFit
from hydro_ident.estimate.flows.summed_flow import SummedComparison
from hydro_ident.estimate.forces.between_samples import with_curvature
from hydro_ident.estimate.forces.force_rows import LateForce, pressed_joints
from hydro_ident.estimate.forces.inertial import InertialFit
from hydro_ident.estimate.forces.late_forces import late_forces
from hydro_ident.estimate.forces.loads_apart import loads_apart
from hydro_ident.estimate.forces.zeros import with_zeros
from hydro_ident.estimate.scoring.scores import PLOT_POINTS, ChannelScore
from hydro_ident.estimate.statistics.moments import Moments
from hydro_ident.identify.channel_scores import ScorePlan, channel_scores
from hydro_ident.identify.estimation import Estimates, cleaned_notes
from hydro_ident.identify.gathering import score_source
from hydro_ident.identify.job import Job
from hydro_ident.identify.model_error import late_note, model_error_note
from hydro_ident.identify.survey import Survey, merged_signals
from hydro_ident.parameters.parameters import student_95
from hydro_ident.recordings.cleaning import Cleaner
from hydro_ident.recordings.sources import first_traces
from hydro_ident.rollouts.free_run import FreeRun, free_run, no_free_run
from hydro_ident.transducers import zero_pa
from hydro_model.robot import Robot

#: Rows of a channel per second, at most: those of a flow, one per hop of its windows (`hop_s`).
_ROWS_PER_S = 50.0
#: Recordings are rolled out over this much at their start: roll-outs need them in memory.
ROLLED_OUT_S = 300.0


@dataclass(frozen=True, slots=True)
class Scores:
    """What the last pass says.

    Attributes
    ----------
    held_out, fitted : tuple of ChannelScore
        On rows that took no part in the fit, and on those that did.
    summed : tuple of SummedComparison
    inertial : InertialFit or None
        That was scored, its covariance now with the zeros of the transducers and what forces do
        between samples.
    late : tuple of LateForce
        Forces that look late by so much that a friction is off.
    notes : tuple of str
        What was taken for outliers in recordings that took no part in the fit.
    loads : str
        That recordings which were fitted carry different loads; empty where they do not.
    """

    held_out: tuple[ChannelScore, ...]
    fitted: tuple[ChannelScore, ...]
    summed: tuple[SummedComparison, ...]
    inertial: InertialFit | None = None
    late: tuple[LateForce, ...] = ()
    notes: tuple[str, ...] = ()
    loads: str = ""


def scored(job: Job, estimates: Estimates) -> Scores:
    """The last pass: scores on what is held out, eq. 14 beside the chambers on the sources."""
    # Behind a reading of the spool nothing of the given command's delay is left.
    given = replace(job.robot, command_delay_s=0.0) if job.spools.taken else job.robot
    plan = ScorePlan(
        given,
        estimates.inertial,
        estimates.hydraulic,
        (job.plan.effects, estimates.effects),
        job.plan.split,
        job.plan.filters,
        job.plan.overlap_s,
        job.plan.still,
        _plot_spacing(job.checked, job.every),
        _plot_spacing(job.surveys, 1),
        estimates.cleaner,
    )
    run, same = job.workers.map, not job.others and bool(job.every)
    found = run(partial(score_source, plan=plan, scored=same, trained=True), job.sources)
    others, signals, notes = found, merged_signals(job.robot, job.checked), list[str]()
    if not same:
        if plan.cleaner is not None:
            robust = estimates.chosen.name == "robust"
            clean = Cleaner.of if robust else Cleaner.of_gross
            plan = replace(plan, cleaner=clean(job.robot, signals))
        others = run(partial(score_source, plan=plan, scored=True, trained=False), job.others)
        notes = cleaned_notes({s.name: s.cleaned for s in others})
    total = None
    for one in found:
        if one.summed is not None:
            if total is None:
                total = one.summed
            else:
                total.merge(one.summed)
    held_out = channel_scores(plan, [(s.name, s.tallies) for s in others], signals)
    fitted = channel_scores(plan, [(s.name, s.fitted) for s in found], job.signals)
    summed = () if total is None else total.result()
    late = [one.late for one in found if one.late is not None]
    fit = estimates.inertial and _widened(estimates.inertial, late, zero_pa(job.robot))
    loads = "" if fit is None else loads_apart(fit, late)
    said = _late(fit, late), tuple(notes), loads
    return Scores(tuple(held_out), tuple(fitted), summed, fit, *said)


def _widened(fit: InertialFit, gathered: Sequence[Moments], zero_pa: float) -> InertialFit:
    """With what zeros of transducers and the places of readings between commands may do."""
    fit = with_curvature(fit, gathered, behind=len(pressed_joints(fit.model)))
    return with_zeros(fit, gathered, zero_pa)


def _late(fit: InertialFit | None, gathered: Sequence[Moments]) -> tuple[LateForce, ...]:
    """Forces that look late, by plain least squares: outliers only make them look less so."""
    if fit is None or not gathered:
        return ()
    pairs = zip(fit.fit.dof.tolist(), fit.fit.std.tolist(), strict=True)
    widths = [student_95(dof) * std for dof, std in pairs]
    return (*fit.early, *late_forces(fit, gathered, widths))


def rolled_out(job: Job, found: Robot | None, hydraulic: HydraulicFit | None) -> FreeRun:
    """Free run of the given and of the identified robot on what is scored, by its voltages."""
    sources, others = job.commanded
    rolled = others or (sources if job.every else ())
    cleaner = Cleaner.of_gross(job.robot, merged_signals(job.robot, job.checked))
    checks = first_traces(rolled, ROLLED_OUT_S, cleaner)
    why_not = no_free_run(job.robot, hydraulic)
    return free_run(job.robot, found, checks, job.plan.split, job.plan.filters, why_not)


def _plot_spacing(surveys: Sequence[Survey], every: int) -> int:
    """Rows per row that is plotted."""
    rows = _ROWS_PER_S * sum(survey.duration_s for survey in surveys) / max(every, 1)
    return max(1, math.ceil(rows / PLOT_POINTS))


def score_notes(scores: Scores, wanted: bool, fit: InertialFit | None) -> list[str]:
    """What the last pass says, or that nothing was scored where something was wanted.

    Parameters
    ----------
    scores : Scores
    wanted : bool
        Whether something was to be scored.
    fit : InertialFit or None
    """
    late = [*scores.notes, *(late_note(one, fit) for one in scores.late if fit is not None)]
    if wanted and not scores.held_out:
        nothing = "no stretch of the bags can be used to check the predictions: nothing was scored"
        return [nothing, *late]
    note = model_error_note(scores.held_out)
    return [note, *late] if note else late
