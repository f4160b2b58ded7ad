"""Identification of a robot from recordings: the pure core of `identify` and of its node.

Paper III-A (base parameters, viscous friction) and III-B (bulk modulus, valve edges), with the
errata of both. A stage that fails is rejected and said; the robot file's own numbers then stay
in the model, and the verdict is `partly_identified`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from hydro_ident.bag.recording import Recording
from hydro_ident.errors import IdentError
from hydro_ident.estimate.effects.listed_effects import ListedEffects
from hydro_ident.estimate.flows.hydraulics import HydraulicFit
from hydro_ident.estimate.flows.summed_flow import SummedComparison
from hydro_ident.estimate.flows.unread_rails import UNFITTING, file_constant
from hydro_ident.estimate.forces.closed_chain import part_notes
from hydro_ident.estimate.forces.inertial import InertialFit
from hydro_ident.estimate.scoring.scores import ChannelScore
from hydro_ident.identify.asked_filters import slowed_notes, usable_filters
from hydro_ident.identify.compare import Comparison
from hydro_ident.identify.consistent_robot import (
    PhysicalResult,
    impossible,
    physical_notes,
    physical_result,
    with_standard_parameters,
)
from hydro_ident.identify.estimation import Estimates, Estimation
from hydro_ident.identify.estimator_choice import Chosen
from hydro_ident.identify.identified_robot import identified_robot
from hydro_ident.identify.job import Job, Settings, prepared
from hydro_ident.identify.last_pass import Scores, rolled_out, score_notes, scored
from hydro_ident.identify.model_error import flagged, left_out
from hydro_ident.identify.position_noise import with_bias
from hydro_ident.identify.recording_summary import RecordingSummary, recording_summaries
from hydro_ident.identify.rejection import tested, within_bounds
from hydro_ident.identify.spool_openings import with_command_delay
from hydro_ident.identify.survey import Looked, looked_at, recorded_notes
from hydro_ident.identify.swapped_signals import swapped_signals
from hydro_ident.identify.verdict import (
    NOT_ENOUGH,
    BagLoss,
    judge,
    refused_numbers,
)
from hydro_ident.inspecting.mistaken_inputs import mistaken_rates
from hydro_ident.parameters.parameters import COMMAND_DELAY, Parameter, parameter_list
from hydro_ident.recordings.sources import Source, check_names, short_kept, sources_of
from hydro_ident.recordings.workers import Here, Workers
from hydro_ident.rollouts.free_run import FreeRun
from hydro_model.command_line.terminal import advance
from hydro_model.robot import Robot

__all__ = ["Identification", "Settings", "identify"]


@dataclass(frozen=True, slots=True)
class Identification:
    """What was identified, how well it predicts, and what could not be done.

    Attributes
    ----------
    verdict : str
        `identified`, `partly_identified` or `not_enough_data`.
    given : Robot
        The robot that identification started from.
    robot : Robot or None
        The identified robot; None with the verdict `not_enough_data`.
    parameters : tuple of Parameter
    channels : tuple of ChannelScore
    problems : tuple of str
        Why the verdict is not `identified`, a line each.
    notes : tuple of str
        Effects held, how channels were scored, what could not be rolled out.
    inertial : InertialFit or None
    hydraulic : HydraulicFit or None
    settings : Settings
    physical : PhysicalResult or None
        Consistent standard parameters that reproduce the base parameters; None with the verdict
        `not_enough_data`.
    summed : tuple of SummedComparison
        The paper's eq. 14 beside the separate chambers.
    losses : tuple of BagLoss
        Channels that a bag does not give.
    free_run : FreeRun or None
    comparison : Comparison or None
        With an earlier model, where one was given.
    estimator : Chosen or None
        Which one was used, and why.
    fitted : tuple of ChannelScore
        As `channels`, on the rows that were fitted.
    recordings : tuple of RecordingSummary
    """

    verdict: str
    given: Robot
    robot: Robot | None
    parameters: tuple[Parameter, ...]
    channels: tuple[ChannelScore, ...]
    problems: tuple[str, ...]
    notes: tuple[str, ...]
    inertial: InertialFit | None
    hydraulic: HydraulicFit | None
    settings: Settings
    physical: PhysicalResult | None = None
    summed: tuple[SummedComparison, ...] = ()
    losses: tuple[BagLoss, ...] = ()
    free_run: FreeRun | None = None
    comparison: Comparison | None = None
    estimator: Chosen | None = None
    fitted: tuple[ChannelScore, ...] = ()
    recordings: tuple[RecordingSummary, ...] = ()


#: Of an identification, as `advance` counts them.
_STAGES = 5


def identify(
    robot: Robot,
    training: Sequence[Recording | Source],
    validation: Sequence[Recording | Source] = (),
    settings: Settings | None = None,
    workers: Workers | None = None,
) -> Identification:
    """Identify a robot.

    Parameters
    ----------
    robot : Robot
        Its geometry and its list of effects are used, its numbers only for comparison.
    training : sequence of Recording or Source
        At least one. A source (`BagSource`) is read piece by piece, in flat memory.
    validation : sequence of Recording or Source
        Whole recordings to score on; without them every fifth block of `training` is held out.
    settings : Settings, optional
    workers : Workers, optional
        Where the recordings are read; here by default.

    Returns
    -------
    Identification

    Raises
    ------
    IdentError
        No recording was given.
    RobotError
        The robot lists an effect that is not in the catalogue.
    """
    if not training:
        raise IdentError("expected at least one recording to identify from, found none")
    settings, workers = settings or Settings(), workers or Here()
    sources, others = sources_of(training), sources_of(validation)
    check_names((*sources, *others))
    if isinstance(workers, Here):
        # Elsewhere, what a worker keeps is gone with its task.
        kept = short_kept((*sources, *others))
        sources, others = kept[: len(sources)], kept[len(sources) :]
    # A list of effects that cannot be is told before bags are read, which may take long.
    ListedEffects.of(robot)
    advance("first look at the bags", 0, _STAGES)
    looked = looked_at(robot, sources, others, workers.map)
    if not looked.sources:
        return _nothing(robot, looked, settings)
    job = prepared(robot, looked, settings, workers)
    advance("fitting", 1, _STAGES)
    estimates = Estimation(job.sources, job.plan, job.still, workers).run(
        settings.estimator, job.surveys, job.signals
    )
    if job.spools.taken:
        fit = with_command_delay(estimates.hydraulic, job.plan, job.commanded[0], workers)
        estimates = replace(estimates, hydraulic=fit)
    estimates = within_bounds(robot, estimates)
    if estimates.inertial is not None:
        estimates = replace(estimates, inertial=with_bias(estimates.inertial, job.bias))
    advance("scoring on what was held out", 2, _STAGES)
    last = scored(job, estimates)
    estimates = replace(estimates, inertial=last.inertial)
    swapped = swapped_signals(job, estimates, last.held_out or last.fitted)
    odd_rates = mistaken_rates([survey.recording for survey in job.surveys])
    estimates = tested(robot, estimates, last.held_out, swapped, odd_rates)
    return _concluded(job, estimates, last, settings)


def _nothing(robot: Robot, looked: Looked, settings: Settings) -> Identification:
    """What is said where no recording to identify from has a cycle."""
    return Identification(
        verdict=NOT_ENOUGH,
        given=robot,
        robot=None,
        parameters=(),
        channels=(),
        problems=tuple(one.text for one in looked.without),
        notes=recorded_notes(looked.surveys),
        inertial=None,
        hydraulic=None,
        settings=settings,
        losses=looked.losses,
        recordings=recording_summaries(looked.surveys, 0),
    )


def _concluded(job: Job, estimates: Estimates, last: Scores, settings: Settings) -> Identification:
    """What follows from the estimates that stand: model, verdict, roll-outs and bodies."""
    robot, scores = job.robot, last.held_out
    inertial, hydraulic, biases = estimates.inertial, estimates.hydraulic, estimates.effects.biases
    recordings = [survey.recording for survey in job.surveys]
    continuities = [survey.continuity for survey in job.surveys]
    asked = usable_filters(settings.filters, job.slowest_s)
    judged = judge(robot, recordings, inertial, hydraulic, continuities, asked)
    judged = judged.with_problem(last.loads)
    found = None
    if judged.verdict != NOT_ENOUGH:
        found = identified_robot(robot, inertial, hydraulic, biases)
        for text in refused_numbers(found):
            judged = judged.with_problem(text)
    advance("rolling the model out", 3, _STAGES)
    run = rolled_out(job, found, hydraulic)
    judged = judged.with_problem(run.failed)
    advance("finding bodies with these parameters", 4, _STAGES)
    physical = None
    if found is not None and found.base_parameters:
        physical = physical_result(found, robot)
        judged = judged.with_problem(impossible(physical))
        found = with_standard_parameters(found, physical.parameters)
    parameters = parameter_list(robot, inertial, hydraulic, biases)
    return Identification(
        verdict=judged.verdict,
        given=robot,
        robot=found,
        parameters=flagged(parameters, robot, inertial, left_out(scores), last.late),
        channels=scores,
        problems=judged.problems,
        notes=(
            *job.notes,
            *score_notes(last, bool(job.others or job.every), inertial),
            *estimates.notes,
            *slowed_notes(settings.filters, job.borne(settings.filters)),
            *(text for text in run.rejected if text not in judged.problems),
            *physical_notes(physical),
            *_held_notes(inertial, hydraulic, parameters),
        ),
        inertial=inertial,
        hydraulic=hydraulic,
        settings=replace(settings, filters=job.plan.filters),
        physical=physical,
        losses=job.looked.losses,
        free_run=run,
        summed=last.summed,
        fitted=last.fitted,
        recordings=recording_summaries(job.seen, len(job.sources)),
        estimator=estimates.chosen,
    )


def _held_notes(
    inertial: InertialFit | None, hydraulic: HydraulicFit | None, parameters: Sequence[Parameter]
) -> list[str]:
    """What was held, and where the command delay is at its bound."""
    notes = [] if inertial is None else list(part_notes(inertial.model.names, inertial.held))
    for fit in hydraulic.cylinders if hydraulic is not None else ():
        named = [f"{fit.cylinder}.{name}" for name in fit.names]
        notes += part_notes(named, fit.held)
    notes += _delay_notes(hydraulic) + _rail_notes(hydraulic)
    delay = [p.reason for p in parameters if p.name == COMMAND_DELAY and p.identifiable]
    return notes + [f"{COMMAND_DELAY}: {reason}" for reason in delay if reason]


def _delay_notes(hydraulic: HydraulicFit | None) -> list[str]:
    """That the valves' command delays differ, in words."""
    if hydraulic is None or not hydraulic.valve_delays or hydraulic.by_spools:
        return []
    found = ", ".join(
        f"{name} {1e3 * own.delay_s:.2f} +- {1e3 * own.std_s:.2f}"
        + (", its bound" if own.delay_s in (0.0, hydraulic.longest_s) else "")
        if math.isfinite(own.std_s)
        else f"{name} not told"
        for name, own in hydraulic.valve_delays.items()
    )
    return [
        f"{COMMAND_DELAY}: the valves' delays differ ({found} ms): each cylinder's oil and edges"
        " are fitted at that of its valve, the model has one for all"
    ]


def _rail_notes(hydraulic: HydraulicFit | None) -> list[str]:
    """What is to be said of rails that nobody read, whose constants the flows were fitted with."""
    notes = []
    for one in hydraulic.rails if hydraulic is not None else ():
        constant = file_constant(one.rail, one.given_pa, one.recordings)
        told = f"{constant} may be off by {1e-5 * one.error_pa:.2g} bar"
        if one.told:
            found, std = 1e-5 * (one.given_pa + one.off_pa), 1e-5 * one.std_pa
            told = f"{constant} {UNFITTING} {found:.4g} +- {std:.2g} bar do (gauge). Record it"
        notes.append(
            f"{told}: edges and oil are those of the file's constant, and their intervals reach as"
            " far as this one moves them"
        )
    return notes
