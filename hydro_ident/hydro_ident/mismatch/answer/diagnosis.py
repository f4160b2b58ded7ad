"""The diagnosis, step by step: the pure core of `hydro_ident diagnose`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from hydro_ident.bag.recording import Recording
from hydro_ident.errors import IdentError, NotEnoughDataError
from hydro_ident.identify.continuity import broken_up
from hydro_ident.identify.recording_summary import recording_summaries
from hydro_ident.identify.survey import Survey, by_torques, looked_at, recorded_notes
from hydro_ident.identify.verdict import BagLoss, wrong_robot
from hydro_ident.mismatch.answer.answering import STAGES, Answer, answered, base_to_search
from hydro_ident.mismatch.answer.channel_results import channels_of, rows_of_training
from hydro_ident.mismatch.answer.doubts import doubts
from hydro_ident.mismatch.answer.half_read import beside_half_read
from hydro_ident.mismatch.answer.hardly_shows import hardly_notes, parted_hardly
from hydro_ident.mismatch.answer.minor import minor_notes, parted, parted_unknown
from hydro_ident.mismatch.answer.moved_base import moved_base
from hydro_ident.mismatch.answer.not_testable import not_testable
from hydro_ident.mismatch.answer.notes import (
    apart,
    apart_notes,
    beyond_notes,
    data_notes,
    instant_notes,
    left_notes,
    listed_notes,
    search_notes,
    silent_notes,
    unverified_notes,
)
from hydro_ident.mismatch.answer.outcome import (
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
from hydro_ident.mismatch.answer.rail_constants import parted_rails, rail_notes
from hydro_ident.mismatch.answer.reversed_valves import (
    reversed_notes,
    reversed_valves,
    with_given_valves,
)
from hydro_ident.mismatch.answer.runs_off import runs_off
from hydro_ident.mismatch.answer.taken_out import off_notes, without_off_centre
from hydro_ident.mismatch.fitting.as_listed import as_listed_notes
from hydro_ident.mismatch.fitting.fitted import Fitted
from hydro_ident.mismatch.locating.locate import dependences
from hydro_ident.mismatch.modelling.model import Modelled, robot_of
from hydro_ident.mismatch.modelling.refinement import Refinement, refine
from hydro_ident.mismatch.naming.instants import at_own_instants, begun
from hydro_ident.mismatch.rows.off_centre import OffCentre
from hydro_ident.mismatch.settings import DiagnosisSettings
from hydro_ident.mismatch.split.listed_friction import bristle_notes
from hydro_ident.mismatch.split.one_pressure import half_read
from hydro_ident.mismatch.split.residuals import Residuals, residuals
from hydro_ident.mismatch.trials.exclusion import shut_out
from hydro_ident.mismatch.unnamed.unknown import Unexplained
from hydro_ident.recordings.sources import KeptSource, Source, check_names, sources_of
from hydro_ident.rollouts.free_run import FreeRun, free_run
from hydro_model.command_line.terminal import advance
from hydro_model.robot import FloatArray, Robot


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
    looked = looked_at(robot, sources, others)
    surveys = looked.surveys
    losses = (*looked.losses, *half_read(robot, surveys[: len(looked.sources)], surveys))
    recordings = recording_summaries(surveys, len(looked.sources))
    wrong = wrong_robot(robot, [s.recording for s in surveys])
    if not looked.sources:
        wrong = [one.text for one in looked.without]
    advance("fitting the structure", 1, STAGES)
    lay = partial(residuals, robot, looked.sources, looked.others, surveys, settings)
    held = list[Residuals]()
    try:
        if not wrong and (first := lay()) is not None:
            held.append(first)
            del first
    except NotEnoughDataError as error:
        wrong = [str(error)]
    if not held:
        problems = tuple(wrong) or (_too_little(robot, surveys[: len(looked.sources)]),)
        return Diagnosis(
            NOT_ENOUGH,
            robot,
            None,
            problems=problems,
            losses=losses,
            recordings=recordings,
            notes=(*looked.left_out, *recorded_notes(surveys)),
        )
    found = _diagnosed(held, lay, settings, losses)
    return replace(found, recordings=recordings, notes=(*looked.left_out, *found.notes))


def _too_little(robot: Robot, surveys: Sequence[Survey]) -> str:
    """Why what is fitted is not enough."""
    total = sum(s.duration_s for s in surveys)
    text = (
        f"{total:.3g} s of recording leave too few rows in any channel: record positions of every"
        " joint in motion, with chamber pressures (or joint torques), for half a minute or more"
    )
    if broken := broken_up([s.continuity for s in surveys], total):
        text = f"{text}; {broken}"
    wet = not by_torques(surveys)
    # By the recordings themselves: of what is too short for the filters no stretch is left.
    read = [(s.name, s.recording) for s in surveys]
    lacking = [n for n, r in read if not _any_read(*((r.p_a, r.p_b) if wet else (r.effort,)))]
    if not lacking or (wet and not robot.cylinders):
        return text
    return f"{text}; no {'chamber pressures' if wet else 'joint torque'} in {', '.join(lacking)}"


def _any_read(*columns: FloatArray | None) -> bool:
    return any(values is not None and np.isfinite(values).any() for values in columns)


def _diagnosed(
    held: list[Residuals],
    lay: Callable[[Sequence[OffCentre]], Residuals | None],
    settings: DiagnosisSettings,
    losses: tuple[BagLoss, ...],
) -> Diagnosis:
    advance("looking where residuals depend on something", 2, STAGES)
    # Where the recordings are laid out anew, nothing may hold the rows that were laid out first.
    work = held.pop()
    base = base_to_search(work)
    located = dependences(work.scan, base)
    answers = [answered(work, base)]
    del work, base
    answer = without_off_centre(answers, lay)
    material = answer.work.training.predictor.material
    answer = replace(answer, findings=beside_half_read(material, answer.findings))
    work, search, rejected, taken = answer.work, answer.search, answer.rejected, answer.taken
    whole, before, modelled, refined = _modelled(answer, settings)
    advance("rolling the models out", 6, STAGES)
    run = _rolled_out(work, whole, before, modelled.robot)
    findings, constants = parted_rails(work, answer.findings)
    findings, minor = parted(work.robot, findings, whole.deviations)
    seen = work.check.told(whole.model.terms)
    channels = channels_of(work, whole, seen)
    findings, hardly = parted_hardly(work, findings, channels)
    unknown, small = parted_unknown(answer.unknown, channels)
    notes = [*data_notes(work), *off_notes(work), *modelled.notes, *run.rejected]
    notes += rail_notes(work.robot, constants) + minor_notes(work.robot, minor, whole.deviations)
    notes += hardly_notes(hardly)
    notes += [refined.note] if refined is not None else []
    notes += small
    notes += listed_notes(work.robot, whole) + as_listed_notes(whole, work.training)
    notes += bristle_notes(work.training, whole)
    notes += search_notes(search, whole, rejected, taken) + silent_notes(findings)
    ratios = apart(work, whole, channels)
    told = {name for f in (*findings, *minor, *hardly, *constants) for name in f.channels}
    told |= {one.channel for one in unknown}
    untold = {name: ratio for name, ratio in ratios.items() if name not in told}
    notes += left_notes(channels) + apart_notes(untold) + unverified_notes(work, channels)
    notes += beyond_notes(work.check, seen)
    notes += moved_base(work.training, whole).values()
    notes += instant_notes(work, whole)
    # At rest dry friction is whatever holds the load, and what is left there no law's to explain.
    in_motion = channels_of(work, whole, replace(seen, mask=seen.rows_in_motion))
    off = runs_off(run)
    notes += off
    reservations = doubts(work, findings, in_motion, ratios)
    notes += [f"reservation: {one}" for one in reservations]
    return Diagnosis(
        _verdict(findings, [*rejected, *taken], channels, unknown, bool(off or reservations)),
        work.robot,
        modelled.robot,
        tuple(findings),
        tuple(rejected),
        unknown,
        not_testable(work.scan, search.scanned, _testable(answer)),
        channels,
        tuple(located),
        run,
        notes=tuple(notes),
        losses=losses,
        work=work,
        whole=whole,
        fitted=channels_of(work, whole, rows_of_training(work)),
        refinement=refined,
        reservations=(*off, *reservations) if findings else (),
    )


def _modelled(
    answer: Answer, settings: DiagnosisSettings
) -> tuple[Fitted, Robot, Modelled, Refinement | None]:
    """The final fit, the robots without findings and with them, and how roll-outs moved it."""
    work, whole, fixed = answer.work, answer.whole, settings.fixed_base
    predictor = work.training.predictor
    wrong = reversed_valves(work.training, work.base)

    def described(one: Fitted) -> Modelled:
        own = robot_of(predictor, one, work.robot, fixed)
        robot = with_given_valves(own.robot, work.robot, tuple(wrong)) if wrong else own.robot
        return replace(own, robot=robot, notes=(*own.notes, *reversed_notes(wrong)))

    modelled = described(whole)
    without = described(work.base) if answer.findings else modelled
    if settings.refine is None or wrong:
        return whole, without.robot, modelled, None
    refined = refine(work, whole, modelled.robot, settings.refine, fixed)
    return refined.whole, without.robot, replace(modelled, robot=refined.robot), refined


def _testable(answer: Answer) -> list[str]:
    """Names that these recordings can show: what was found, and tried and not taken.

    And what the robot's file lists, which is fitted all along.
    """
    names = [n for f in answer.findings for n in f.named.names]
    # What was taken back was testable as well, and so was what anything was weighed against, or
    # stood in the way of before the last scan.
    named = [f.named for f in (*answer.findings, *answer.rejected, *answer.taken)]
    names += [c.term.effect.name for n in named for c in n.tried]
    for one in (n.modelled for n in answer.search.named):
        names += [*shut_out(one.term.effect.name), *shut_out(one.name)]
    names += [t.effect.name for t in answer.work.base.model.terms]
    return names + [name for name, _, _ in answer.search.impossible]


def _rolled_out(work: Residuals, whole: Fitted, before: Robot, after: Robot) -> FreeRun:
    """Both models along the rows to verify on, with what comes and goes when it does there."""
    filters = work.training.predictor.material.filters
    there, _ = at_own_instants(work.training, work.check, whole.model)
    seen = begun(after, there.terms)
    given = seen if before is after else begun(before, there.terms)
    return free_run(given, seen, work.check_traces, work.split, filters)


def _verdict(
    findings: Sequence[Finding],
    rejected: Sequence[Finding],
    channels: Sequence[ChannelResult],
    unknown: Sequence[Unexplained],
    doubtful: bool,
) -> str:
    if findings:
        doubts = unknown or doubtful or any(f.verification.silent for f in findings)
        return PARTLY if doubts else EXPLAINED
    if unknown:
        return UNKNOWN
    # What does not stand out where it was found, either, never was a finding; nor is there
    # anything to improve where nothing but noise is left.
    lacking = {c.name for c in channels if not c.at_noise}
    stood_out = any(not f.verification.idle and lacking & set(f.channels) for f in rejected)
    return NO_IMPROVEMENT if stood_out else MATCHES
