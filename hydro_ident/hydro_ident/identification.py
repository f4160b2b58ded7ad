"""Identification of a robot from recordings: the pure core of `identify` and of its node.

Paper III-A (base parameters, viscous friction) and III-B (bulk modulus, valve edges), with the
errata of both. A stage that fails is rejected and said; the robot file's own numbers then stay
in the model, and the verdict is `partly_identified`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial

from hydro_ident.bag.recording import Recording
from hydro_ident.channel_scores import ScorePlan, channel_scores, score_notes
from hydro_ident.compare import Comparison
from hydro_ident.consistent_robot import (
    PhysicalResult,
    physical_notes,
    physical_result,
    with_standard_parameters,
)
from hydro_ident.errors import IdentError
from hydro_ident.estimate.chambers import (
    WindowSettings,
)
from hydro_ident.estimate.closed_chain import part_notes
from hydro_ident.estimate.derivatives import FilterSettings
from hydro_ident.estimate.hydraulics import HydraulicFit
from hydro_ident.estimate.inertial import (
    ForceModel,
    InertialFit,
    force_model,
)
from hydro_ident.estimate.listed_effects import ListedEffects
from hydro_ident.estimate.scores import PLOT_POINTS, ChannelScore, HoldOut
from hydro_ident.estimate.summed_flow import SummedComparison
from hydro_ident.estimation import Estimation
from hydro_ident.estimator_choice import Choice, Chosen
from hydro_ident.free_run import FreeRun, free_run, no_free_run
from hydro_ident.gathering import GatherPlan, score_source
from hydro_ident.identified_robot import has_definite_mass, identified_robot
from hydro_ident.parameters import Parameter, parameter_list
from hydro_ident.sources import Source, check_names, first_traces, sources_of
from hydro_ident.survey import (
    Survey,
    merged_signals,
    still_joints_of,
    still_positions,
    survey_source,
)
from hydro_ident.verdict import (
    NOT_ENOUGH,
    BagLoss,
    Judgement,
    judge,
    losses_of,
)
from hydro_ident.workers import Here, Workers
from hydro_model.robot import Robot

#: Recordings are rolled out over this much at their start: roll-outs need them in memory.
ROLLED_OUT_S = 300.0


@dataclass(frozen=True, slots=True)
class Settings:
    """Choices of the estimators.

    Attributes
    ----------
    filters : FilterSettings
    windows : WindowSettings
    hold_out_every : int
        Without bags to validate on, every so many blocks one is kept from the fit and scored;
        0: everything is fitted and nothing scored.
    estimator : {"auto", "ols", "wls", "robust", "iv"}
    """

    filters: FilterSettings = field(default_factory=FilterSettings)
    windows: WindowSettings = field(default_factory=WindowSettings)
    hold_out_every: int = 5
    estimator: Choice = "auto"


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
    effects = ListedEffects.of(robot)
    sources, others = sources_of(training), sources_of(validation)
    check_names((*sources, *others))
    seen = workers.map(partial(survey_source, robot=robot), (*sources, *others))
    surveys, checked = seen[: len(sources)], seen[len(sources) :]
    signals = merged_signals(robot, surveys)
    every = 0 if others else settings.hold_out_every
    split = _hold_out(surveys, every) if every else HoldOut(every=0)
    still = still_joints_of(robot, signals)
    plan = GatherPlan(
        robot,
        _force_model(robot, effects, surveys),
        effects,
        split,
        settings.filters,
        settings.windows,
        still_positions(surveys, still),
    )
    estimates = Estimation(sources, plan, still, workers).run(settings.estimator, surveys, signals)
    inertial, hydraulic, fitted = estimates.inertial, estimates.hydraulic, estimates.effects
    scores, summed = _scores(
        ScorePlan(
            robot,
            inertial,
            hydraulic,
            (effects, fitted),
            split,
            settings.filters,
            plan.still if every else {},
            _plot_spacing(checked or surveys, every),
        ),
        (sources, others if others else sources if every else ()),
        (checked or surveys, workers),
    )
    recordings = [survey.recording for survey in surveys]
    judged = judge(robot, recordings, inertial, hydraulic, scores)
    found = None
    if judged.verdict != NOT_ENOUGH:
        found, judged = _model(robot, inertial, hydraulic, fitted.biases, judged)
    checks = first_traces(others if others else sources if every else (), ROLLED_OUT_S)
    run = free_run(robot, found, checks, split, settings.filters, no_free_run(robot, hydraulic))
    judged = judged.with_problem(run.failed)
    physical = None
    if found is not None and found.base_parameters:
        physical = physical_result(found, robot)
        found = with_standard_parameters(found, physical.parameters)
    return Identification(
        verdict=judged.verdict,
        given=robot,
        robot=found,
        parameters=parameter_list(robot, inertial, hydraulic, fitted.biases),
        channels=tuple(scores),
        problems=judged.problems,
        notes=(
            *_notes(seen, effects, others, every),
            *_score_notes(scores, bool(others or every)),
            *estimates.notes,
            *(text for text in run.rejected if text not in judged.problems),
            *physical_notes(physical),
            *(() if inertial is None else part_notes(inertial.model.base, inertial.held)),
        ),
        inertial=inertial,
        hydraulic=hydraulic,
        settings=settings,
        physical=physical,
        losses=losses_of([survey.recording for survey in seen]),
        free_run=run,
        summed=summed,
        estimator=estimates.chosen,
    )


def _model(
    robot: Robot,
    inertial: InertialFit | None,
    hydraulic: HydraulicFit | None,
    biases: Mapping[str, float],
    judged: Judgement,
) -> tuple[Robot, Judgement]:
    """The identified robot; without its base parameters where they make no possible machine."""
    found = identified_robot(robot, inertial, hydraulic, biases)
    count = 0 if inertial is None else len(inertial.model.base.names)
    if inertial is None or all(inertial.identifiable[:count]) or has_definite_mass(found):
        return found, judged
    text = (
        "the base parameters that were determined make no positive definite mass matrix with the"
        " robot file's for the others: all stay the robot file's in the model"
    )
    return identified_robot(robot, None, hydraulic, biases), judged.with_problem(text)


def _scores(
    plan: ScorePlan,
    sources: tuple[Sequence[Source], Sequence[Source]],
    seen: tuple[Sequence[Survey], Workers],
) -> tuple[list[ChannelScore], tuple[SummedComparison, ...]]:
    """The last pass: scores on the second sources, eq. 14 beside the chambers on the first."""
    (training, checks), (surveys, workers) = sources, seen
    same = training is checks
    found = workers.map(partial(score_source, plan=plan, scored=same, summed=True), training)
    scored = (
        found
        if same
        else workers.map(partial(score_source, plan=plan, scored=True, summed=False), checks)
    )
    total = None
    for one in found:
        if one.summed is not None:
            if total is None:
                total = one.summed
            else:
                total.merge(one.summed)
    signals = merged_signals(plan.robot, surveys)
    scores = channel_scores(plan, [(s.name, s.tallies) for s in scored], signals)
    return scores, () if total is None else total.result()


def _plot_spacing(surveys: Sequence[Survey], every: int) -> int:
    """Rows per row that is plotted."""
    rows = 50.0 * sum(survey.duration_s for survey in surveys) / max(every, 1)
    return max(1, math.ceil(rows / PLOT_POINTS))


def _hold_out(surveys: Sequence[Survey], every: int) -> HoldOut:
    return HoldOut.of({s.name: max(s.duration_s, 1e-3) for s in surveys}, every)


def _force_model(robot: Robot, effects: ListedEffects, surveys: Sequence[Survey]) -> ForceModel:
    torque = any(s.dry for s in surveys) and not any(s.wet for s in surveys)
    return force_model(robot, torque, effects.force_names, effects.force_columns)


def _score_notes(scores: Sequence[ChannelScore], wanted: bool) -> list[str]:
    if wanted and not scores:
        return ["no stretch of the bags can be used to check the predictions: nothing was scored"]
    return score_notes(scores)


def _notes(
    seen: Sequence[Survey],
    effects: ListedEffects,
    validation: Sequence[Source],
    every: int,
) -> tuple[str, ...]:
    notes = []
    for recording in (survey.recording for survey in seen):
        notes += [f"{recording.path.name}: {note}" for note in recording.notes]
        if recording.gaps:
            notes.append(f"{recording.path.name}: {len(recording.gaps)} gaps in the cycles")
    notes += [f"effect {name} taken as listed, not fitted" for name in effects.held]
    if every:
        notes.append(f"scores are of one block in {every} of the bags, which the fit never saw")
    elif not validation:
        notes.append("nothing was held out: everything was fitted, nothing is scored")
    return tuple(notes)
