"""The diagnosis, step by step: the pure core of `hydro_ident diagnose`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from hydro_ident.bag.recording import Recording
from hydro_ident.continuity import broken_up
from hydro_ident.errors import IdentError, NotEnoughDataError
from hydro_ident.free_run import free_run
from hydro_ident.mismatch.answering import STAGES, answered, base_to_search
from hydro_ident.mismatch.causes import one_per_cause
from hydro_ident.mismatch.channel_results import channels_of, rows_of_training
from hydro_ident.mismatch.held_out import rms
from hydro_ident.mismatch.instants import at_own_instants, begun
from hydro_ident.mismatch.locate import dependences
from hydro_ident.mismatch.minor import minor_notes, parted, parted_unknown
from hydro_ident.mismatch.model import robot_of
from hydro_ident.mismatch.notes import (
    apart_notes,
    data_notes,
    instant_notes,
    left_notes,
    search_notes,
    silent_notes,
)
from hydro_ident.mismatch.outcome import (
    EXPLAINED,
    MATCHES,
    NO_IMPROVEMENT,
    NOT_ENOUGH,
    PARTLY,
    UNKNOWN,
    ChannelResult,
    Diagnosis,
    Finding,
)
from hydro_ident.mismatch.refinement import refine
from hydro_ident.mismatch.residuals import Residuals, residuals
from hydro_ident.mismatch.settings import (
    FAR,
    FEW_MOTIONS,
    DiagnosisSettings,
)
from hydro_ident.mismatch.unknown import Unexplained, not_testable
from hydro_ident.recording_summary import recording_summaries
from hydro_ident.sources import KeptSource, Source, check_names, sources_of
from hydro_ident.survey import Survey, recorded_notes, survey_source
from hydro_ident.verdict import BagLoss, losses_of, wrong_robot
from hydro_model.robot import Robot
from hydro_model.terminal import advance

#: Share of the error (rms) left by findings that explain less than is left.
_HARDLY = 0.7


def diagnose(
    robot: Robot,
    training: Sequence[Recording | Source],
    validation: Sequence[Recording | Source] = (),
    settings: DiagnosisSettings | None = None,
) -> Diagnosis:
    """Find the physics that a robot's model leaves out.

    Parameters
    ----------
    robot : Robot
        Its structure, with the effects it lists, is what is refitted first.
    training : sequence of Recording or Source
        To fit and select on; at least one.
    validation : sequence of Recording or Source
        To verify on; without them every fifth block of `training` is kept for it.
    settings : DiagnosisSettings, optional

    Returns
    -------
    Diagnosis

    Raises
    ------
    IdentError
        No recording was given, or two of one name.
    RobotError
        The robot lists an effect that does not resolve.
    """
    if not training:
        raise IdentError("expected at least one recording to diagnose, found none")
    settings = settings or DiagnosisSettings()
    sources, others = (
        [KeptSource(source) for source in sources_of(given)] for given in (training, validation)
    )
    check_names((*sources, *others))
    advance("first look at the bags", 0, STAGES)
    surveys = [survey_source(source, robot) for source in (*sources, *others)]
    losses = losses_of([s.recording for s in surveys])
    recordings = recording_summaries(surveys, len(sources))
    wrong = wrong_robot(robot, [s.recording for s in surveys])
    advance("fitting the structure", 1, STAGES)
    try:
        work = None if wrong else residuals(robot, sources, others, surveys, settings)
    except NotEnoughDataError as error:
        work, wrong = None, [str(error)]
    if work is None:
        problems = tuple(wrong) or (_too_little(robot, surveys),)
        return Diagnosis(
            NOT_ENOUGH,
            robot,
            None,
            problems=problems,
            losses=losses,
            recordings=recordings,
            notes=recorded_notes(surveys),
        )
    return replace(_diagnosed(work, settings, losses), recordings=recordings)


def _too_little(robot: Robot, surveys: Sequence[Survey]) -> str:
    total = sum(s.duration_s for s in surveys)
    text = (
        f"{total:.3g} s of recording leave too few rows in any channel: record positions of every"
        " joint in motion, with chamber pressures (or joint torques), for half a minute or more"
    )
    if broken := broken_up([s.continuity for s in surveys], total):
        text = f"{text}; {broken}"
    wet = any(s.wet for s in surveys) or not any(s.dry for s in surveys)
    lacking = [s.name for s in surveys if not (s.wet if wet else s.dry)]
    if not lacking or (wet and not robot.cylinders):
        return text
    return f"{text}; no {'chamber pressures' if wet else 'joint torque'} in {', '.join(lacking)}"


def _diagnosed(
    work: Residuals, settings: DiagnosisSettings, losses: tuple[BagLoss, ...]
) -> Diagnosis:
    advance("looking where residuals depend on something", 2, STAGES)
    base = base_to_search(work)
    located = dependences(work.scan, base)
    answer = answered(work, base)
    work, search, whole, unknown = answer.work, answer.search, answer.whole, answer.unknown
    rejected, taken = answer.rejected, answer.taken
    findings: Sequence[Finding] = answer.findings
    names = [n for f in findings for n in f.named.names]
    # What was tried and not taken, or taken back, was testable.
    names += [f.named.term.effect.name for f in (*rejected, *taken)]
    names += [name for name, _, _ in search.impossible]
    predictor, fixed = work.training.predictor, settings.fixed_base
    modelled = robot_of(predictor, whole, work.robot, fixed)
    before = robot_of(predictor, work.base, work.robot, fixed) if findings else modelled
    refined = None
    if settings.refine is not None:
        refined = refine(work, whole, modelled.robot, settings.refine, fixed)
        whole, modelled = refined.whole, replace(modelled, robot=refined.robot)
    advance("rolling the models out", 6, STAGES)
    filters, few = predictor.material.filters, predictor.material.motions < FEW_MOTIONS
    there, _ = at_own_instants(work.training, work.check, whole.model)
    seen = begun(modelled.robot, there.terms)
    given = seen if before.robot is modelled.robot else begun(before.robot, there.terms)
    run = free_run(given, seen, work.check_traces, work.split, filters)
    findings, minor = parted(work.robot, findings, whole.deviations)
    notes = [*data_notes(work), *modelled.notes, *run.rejected]
    notes += minor_notes(work.robot, minor, whole.deviations)
    notes += [refined.note] if refined is not None else []
    channels = channels_of(work, whole, work.check)
    unknown, small = parted_unknown(unknown, channels)
    notes += small
    notes += search_notes(search, whole, rejected, taken) + silent_notes(findings)
    told = {name for f in (*findings, *minor) for name in f.channels}
    told |= {one.channel for one in unknown}
    notes += left_notes(channels) + apart_notes(work, whole, channels, told)
    notes += instant_notes(work, whole)
    doubtful = few or _hardly_better(findings, channels)
    return Diagnosis(
        _verdict(findings, [*rejected, *taken], unknown, doubtful),
        work.robot,
        modelled.robot,
        tuple(one_per_cause(findings)),
        tuple(rejected),
        unknown,
        not_testable(work.scan, search.scanned, names),
        channels,
        tuple(located),
        run,
        notes=tuple(notes),
        losses=losses,
        work=work,
        whole=whole,
        fitted=channels_of(work, whole, rows_of_training(work)),
        refinement=refined,
    )


def _hardly_better(findings: Sequence[Finding], channels: Sequence[ChannelResult]) -> bool:
    """Whether more is left than was explained where something was found, far above the sensors."""
    named = {name for finding in findings for name in finding.channels}
    return any(
        rms(c.measured - c.after) > max(_HARDLY * rms(c.measured - c.before), FAR * c.noise_floor)
        for c in channels
        if c.name in named
    )


def _verdict(
    findings: Sequence[Finding],
    rejected: Sequence[Finding],
    unknown: Sequence[Unexplained],
    doubtful: bool,
) -> str:
    if findings:
        doubts = unknown or doubtful or any(f.verification.silent for f in findings)
        return PARTLY if doubts else EXPLAINED
    if unknown:
        return UNKNOWN
    return NO_IMPROVEMENT if rejected else MATCHES
