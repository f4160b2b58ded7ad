"""One identification as its passes need it: what is read of recordings, and how it is split."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace

from hydro_ident.estimate.effects.listed_effects import ListedEffects
from hydro_ident.estimate.flows.chambers import WindowSettings
from hydro_ident.estimate.flows.flow_moments import NEARLY
from hydro_ident.estimate.forces.inertial import ForceModel, force_model
from hydro_ident.estimate.forces.standstill import still_joints
from hydro_ident.estimate.scoring.scores import HoldOut
from hydro_ident.estimate.signals.derivatives import FilterSettings
from hydro_ident.estimate.signals.signal_survey import SignalSurvey
from hydro_ident.identify.command_updates import update_notes, with_updates
from hydro_ident.identify.continuity import bridged_notes, lost_notes, partial_notes
from hydro_ident.identify.estimator_choice import REFERENCED_SHARE, Choice, referenced_share
from hydro_ident.identify.gathering import GatherPlan, overlap_s
from hydro_ident.identify.position_noise import Look, PositionBias, position_bias
from hydro_ident.identify.spool_openings import (
    SpoolChoice,
    behind_spools,
    spool_choice,
    spools_of,
    told_by_spools,
)
from hydro_ident.identify.survey import (
    Looked,
    Survey,
    apart_notes,
    by_torques,
    merged_signals,
    still_positions,
    stuck_notes,
)
from hydro_ident.recordings.cleaning import Cleaner
from hydro_ident.recordings.sources import Source
from hydro_ident.recordings.workers import Workers
from hydro_model.robot import Robot

#: Longest delay that is tried, in cycles: each costs columns, and moments their squares.
MOST_CYCLES = 50


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
class Job:
    """One identification, surveyed and planned.

    Attributes
    ----------
    robot : Robot
    sources : tuple of Source
        To identify from.
    others : tuple of Source
        To validate on.
    seen : tuple of Survey
        Of all of them, in that order.
    signals : SignalSurvey
        Of the sources.
    plan : GatherPlan
    still : tuple of int
        Joints that did not move.
    every : int
        One block in so many is held out; 0: none is.
    workers : Workers
    bias : PositionBias
        What the positions' noise does to the forces' parameters.
    commanded : pair of tuple of Source
        `sources` and `others` with their voltages, where the openings are measured spools.
    spools : SpoolChoice
    looked : Looked
        What a first look found, with the recordings that are left out.
    """

    robot: Robot
    sources: tuple[Source, ...]
    others: tuple[Source, ...]
    seen: tuple[Survey, ...]
    signals: SignalSurvey
    plan: GatherPlan
    still: tuple[int, ...]
    every: int
    workers: Workers
    bias: PositionBias
    commanded: tuple[tuple[Source, ...], tuple[Source, ...]]
    spools: SpoolChoice
    looked: Looked

    @property
    def surveys(self) -> tuple[Survey, ...]:
        """Of the sources alone."""
        return self.seen[: len(self.sources)]

    @property
    def checked(self) -> tuple[Survey, ...]:
        """Of what is validated on: the sources themselves where there is nothing else."""
        return self.seen[len(self.sources) :] or self.surveys

    @property
    def slowest_s(self) -> float:
        """Sampling interval of the slowest recording that is fitted."""
        return max(_steps_s(self.surveys))

    def borne(self, asked: FilterSettings) -> dict[str, FilterSettings]:
        """Filters by recording, as quick as each of them bears those that were asked for."""
        steps_s = zip((survey.name for survey in self.seen), _steps_s(self.seen), strict=True)
        return {name: asked.borne_at(step_s) for name, step_s in steps_s}

    @property
    def checks(self) -> tuple[Source, ...]:
        """What is scored: other recordings, blocks of the sources, or nothing."""
        return self.others or (self.sources if self.every else ())

    @property
    def notes(self) -> tuple[str, ...]:
        """What is to be said of the recordings."""
        notes = [*self.looked.left_out, *apart_notes(self.seen)]
        notes += update_notes((*self.commanded[0], *self.commanded[1]))
        notes += [*stuck_notes(self.seen), *self.bias.notes, *self.spools.notes]
        for recording in (survey.recording for survey in self.seen):
            notes += [f"{recording.path.name}: {note}" for note in recording.notes]
            if recording.gaps:
                notes.append(f"{recording.path.name}: {len(recording.gaps)} gaps in the cycles")
        names, continuities = [s.name for s in self.seen], [s.continuity for s in self.seen]
        for told in (bridged_notes, lost_notes, partial_notes):
            notes += told(names, continuities)
        held = self.plan.effects.held
        notes += [f"effect {name} taken as listed, not fitted" for name in held]
        notes += [
            f"effect {name} is listed, but the fit of the valve's flows does not know it"
            for name in self.plan.effects.ignored
        ]
        stated_s, longest_s = self.robot.command_delay_s, self.plan.longest_delay_s
        if self.plan.flows and stated_s > longest_s:
            notes.append(
                f"the robot file states a command_delay_s of {stated_s:g} s: more than is tried,"
                f" which is {longest_s:g} s here ({MOST_CYCLES} cycles at most)"
            )
        if self.every:
            notes.append(
                f"scores are of one block in {self.every} of the bags, which the fit never saw"
            )
        elif not self.others:
            notes.append("nothing was held out: everything was fitted, nothing is scored")
        return tuple(notes)


def _steps_s(seen: Iterable[Survey]) -> list[float]:
    """From reading to reading."""
    return [max(s.recording.period_s, s.recording.read_s) for s in seen]


def prepared(robot: Robot, looked: Looked, settings: Settings, workers: Workers) -> Job:
    """Plan what is gathered of recordings.

    Parameters
    ----------
    robot : Robot
    looked : Looked
        With at least one recording to identify from.
    settings : Settings
    workers : Workers

    Returns
    -------
    Job

    Raises
    ------
    RobotError
        The robot lists an effect that is not in the catalogue.
    """
    sources, others, seen = looked.sources, looked.others, looked.surveys
    effects = ListedEffects.of(robot)
    surveys = seen[: len(sources)]
    signals = merged_signals(robot, surveys)
    every = 0 if others else settings.hold_out_every
    still = still_joints(robot, signals)
    windows, longest_s = _delays_tried(robot, surveys, settings.windows)
    cleaner = Cleaner.of_gross(robot, signals)

    def plan_at(filters: FilterSettings) -> GatherPlan:
        own = replace(effects, filters=filters)
        slowest = filters.borne_at(max(_steps_s(surveys)))
        return GatherPlan(
            robot,
            planned_force_model(robot, own, surveys),
            own,
            _hold_out(surveys, every, slowest) if every else HoldOut(every=0),
            filters,
            overlap_s(filters.borne_at(max(_steps_s(seen)))),
            windows,
            still_positions(surveys, still),
            longest_delay_s=longest_s,
            cleaner=cleaner,
        )

    free = settings.filters == FilterSettings()
    # What is slower has slower filters of its own, whatever else is fitted or scored.
    bias = PositionBias(settings.filters.borne_at(min(_steps_s(surveys))))
    # Instruments know nothing of the positions' noise.
    if settings.estimator != "iv" and referenced_share(surveys) < REFERENCED_SHARE:
        bias = position_bias(Look(plan_at, sources, still, signals, workers), bias.filters, free)
    plan = plan_at(bias.filters)
    volts = with_updates(robot, sources, others, seen, plan.split.training)
    spools = spool_choice(volts[0], seen, plan)
    sources, others = volts
    if spools.taken:
        plan = replace(plan, effects=behind_spools(plan.effects))
        sources, others = (spools_of(given) for given in (looked.sources, looked.others))
        seen = told_by_spools(robot, (*sources, *others), seen)
    own = sources, others, seen, signals, plan
    return Job(robot, *own, still, every, workers, bias, volts, spools, looked)


def _delays_tried(
    robot: Robot, surveys: Sequence[Survey], windows: WindowSettings
) -> tuple[WindowSettings, float]:
    """Windows with the delays of the slowest recording, and the longest of any recording in s.

    They end a cycle beyond what the robot file states, where that is longer: at the very end of
    what is tried, a delay could not come out larger than it is stated.
    """
    cycles_s = [survey.recording.period_s for survey in surveys]
    stated = math.ceil(robot.command_delay_s / max(cycles_s) - NEARLY)
    if windows.max_delay_cycles < stated < MOST_CYCLES:
        windows = replace(windows, max_delay_cycles=stated + 1.0)
    longest_s = windows.max_delay_cycles * max(cycles_s)
    return windows, min(longest_s, MOST_CYCLES * min(cycles_s))


def _hold_out(surveys: Sequence[Survey], every: int, filters: FilterSettings) -> HoldOut:
    durations = {s.name: max(s.duration_s, 1e-3) for s in surveys}
    return HoldOut.of(durations, every, parallel_hz=filters.parallel_hz)


def planned_force_model(
    robot: Robot, effects: ListedEffects, surveys: Sequence[Survey]
) -> ForceModel:
    """The force model with the listed effects: fitted, held or undone."""
    torque = by_torques(surveys)
    model = force_model(effects.level, torque, effects.force_names, effects.force_columns)
    changes = effects.held_torque if effects.changes else None
    corrected = effects.corrected if effects.errors else None
    values = effects.force_values
    return replace(model, effect_values=values, held=changes, corrected=corrected)
