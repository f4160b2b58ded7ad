"""Measured spools as the openings of the valves, in the place of the voltages.

What passes a valve follows its spool, and a spool follows its command late, past a null and not at
once: of voltages alone oil and edges take that up. A spool is taken where it was read through all
recordings, of every valve, and leaves less of the flows. The command delay stays the voltages'.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from hydro_ident.bag.recorded_run import Recording
from hydro_ident.bag.recording import with_losses
from hydro_ident.bag.streaming import OVERLAP_S, PIECE_S, Piece
from hydro_ident.estimate.effects.listed_effects import ListedEffects
from hydro_ident.estimate.flows.delay import ValveDelay, fit_delay
from hydro_ident.estimate.flows.hydraulics import HydraulicFit
from hydro_ident.identify.command_updates import saves, signals_fitted
from hydro_ident.identify.gathering import GatherPlan, gather_source
from hydro_ident.identify.survey import Survey, survey_source
from hydro_ident.parameters.parameters import COMMAND_DELAY
from hydro_ident.recordings.sources import Source
from hydro_ident.recordings.workers import Workers
from hydro_model.robot import Robot
from hydro_msgs_docs.topics import VALVE_STATE

#: Effects between a command and its spool, which a reading of the spool holds.
BEFORE_SPOOLS = frozenset(
    {"command_delay", "valve_hysteresis", "valve_null_bias", "valve_rate_limit"}
    | {"valve_spool_lag"}
)


@dataclass(frozen=True, slots=True)
class SpoolRead:
    """A recording whose valves' signals are their measured spools.

    Attributes
    ----------
    source : Source
    """

    source: Source

    @property
    def name(self) -> str:
        """Of the bag."""
        return self.source.name

    def pieces(self, piece_s: float = PIECE_S, overlap_s: float = OVERLAP_S) -> Iterator[Piece]:
        """The recording with spools as voltages.

        Parameters
        ----------
        piece_s, overlap_s : float
            As of `BagSource`.
        """
        for piece in self.source.pieces(piece_s, overlap_s):
            yield replace(piece, recording=_by_spools(piece.recording))


def _by_spools(recording: Recording) -> Recording:
    if recording.spool is None:
        return recording
    rated = np.array([valve.rated_voltage_v for valve in recording.robot.valves])
    # A position moves on from reading to reading: in between it is the mean of both.
    changed = replace(recording, valve_v=recording.spool * rated, updated_between=True)
    if recording.valve_v is not None:
        return changed
    return with_losses(replace(changed, valve_source=VALVE_STATE), VALVE_STATE, "")


@dataclass(frozen=True, slots=True)
class SpoolChoice:
    """Whether measured spools are the openings, and what is to be said of it.

    Attributes
    ----------
    taken : bool
    notes : tuple of str
    """

    taken: bool = False
    notes: tuple[str, ...] = ()


def spool_choice(volts: Sequence[Source], seen: Sequence[Survey], plan: GatherPlan) -> SpoolChoice:
    """Spools, where all were read and they leave less of the flows than the voltages.

    Parameters
    ----------
    volts : sequence of Source
        What is fitted, by its voltages.
    seen : sequence of Survey
        First of these recordings, then of those that are only scored.
    plan : GatherPlan
        By the voltages.
    """
    if not any(one.spools.read.any() for one in seen):
        return SpoolChoice()
    names = plan.robot.valve_names
    for one in seen:
        for k, valve in enumerate(names):
            if why := one.spools.why_not(k):
                return _left(f"in {one.name} the spool of {valve} {why}")
    effects = replace(ListedEffects.of(plan.robot), filters=plan.filters)
    how = plan.split.training, plan.windows
    by_volts = signals_fitted(effects, volts, *how)
    if by_volts is not None:
        by_spools = signals_fitted(behind_spools(effects), spools_of(volts), *how)
        if by_spools is None or not saves(by_volts, by_spools):
            return _left("they explain the flows no better than the voltages do")
    return SpoolChoice(
        True,
        (
            "the valves' openings are their measured spools: oil and edges are fitted, and flows"
            f" scored, with these; {COMMAND_DELAY} and free runs go by the voltages",
        ),
    )


def _left(why: str) -> SpoolChoice:
    return SpoolChoice(notes=(f"measured spools were not taken for the valves' openings: {why}",))


def spools_of(sources: Sequence[Source]) -> tuple[Source, ...]:
    """Recordings with spools as voltages."""
    return tuple(SpoolRead(source) for source in sources)


def told_by_spools(
    robot: Robot, sources: Sequence[Source], seen: Sequence[Survey]
) -> tuple[Survey, ...]:
    """First looks at recordings, those without any voltage once more, by their spools.

    Parameters
    ----------
    robot : Robot
    sources : sequence of Source
        By their spools.
    seen : sequence of Survey
        Of the same recordings.
    """
    return tuple(
        one if one.spools.told.any() else survey_source(source, robot)
        for source, one in zip(sources, seen, strict=True)
    )


def behind_spools(effects: ListedEffects) -> ListedEffects:
    """Listed effects without those that lie between commands and spools, which stay as listed.

    Parameters
    ----------
    effects : ListedEffects
    """
    active = tuple(o for o in effects.active if o.effect.name not in BEFORE_SPOOLS)
    return replace(effects, robot=replace(effects.robot, command_delay_s=0.0), active=active)


def with_command_delay(
    hydraulic: HydraulicFit | None,
    plan: GatherPlan,
    sources: Sequence[Source],
    workers: Workers,
) -> HydraulicFit | None:
    """A fit by spools with the delay of the commands, each valve's chambers at its spool's.

    Parameters
    ----------
    hydraulic : HydraulicFit or None
        By spools.
    plan : GatherPlan
        Of that fit.
    sources : sequence of Source
        The same recordings with their voltages.
    workers : Workers

    Returns
    -------
    HydraulicFit or None
        The delay is the robot file's, with a deviation that is infinite, where no voltage tells.
    """
    if hydraulic is None:
        return None
    robot = plan.robot
    effects = replace(ListedEffects.of(robot), filters=plan.filters)
    by_volts = replace(plan, forces=False, effects=effects)
    gathered = workers.map(partial(gather_source, plan=by_volts), sources)
    found = fit_delay(robot, [g.flows for g in gathered])
    own = {
        v.name: hydraulic.valve_delays.get(
            v.name, ValveDelay(hydraulic.delay_s, hydraulic.delay_std_s)
        )
        for v in robot.valves
    }
    fit = replace(hydraulic, valve_delays=own, by_spools=True)
    if found is None:
        return replace(fit, delay_s=robot.command_delay_s, delay_std_s=np.inf)
    return replace(
        fit,
        delay_s=found.delay_s,
        delay_std_s=found.std_s,
        delay_dof=found.dof,
        longest_s=found.longest_s,
    )
