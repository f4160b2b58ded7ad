"""Logs in which commands changed between the samples, as their samples are too few to show.

A command is taken as held from its sample on. In a log that keeps one cycle in five or ten of a
faster controller it is not: it went on changing, and what passed the valve until the next sample
is nearer to the mean of both. Held, such commands are late by half a sampling interval, which no
delay above zero makes good; bulk moduli and leakages take it up. Which of both a log is, its
commands alone do not say. The chambers' balances do: fitted with a delay at zero under held
commands, and better with means, they are of commands that changed between the samples.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from hydro_ident.bag.streaming import OVERLAP_S, PIECE_S, Piece
from hydro_ident.estimate.effects.listed_effects import ListedEffects
from hydro_ident.estimate.flows.chambers import WindowSettings
from hydro_ident.estimate.flows.delay import DelayFit, fit_delay
from hydro_ident.estimate.flows.flow_moments import FlowGatherer, Select
from hydro_ident.estimate.signals.traces import traces_of_piece
from hydro_ident.estimate.statistics.regression import misfit
from hydro_ident.identify.survey import Survey
from hydro_ident.recordings.sources import Source
from hydro_model.robot import Robot

#: Cycles from which on a controller may well be faster than the log.
SLOW_S = 0.0035
#: A delay below this share of a sampling interval is none.
_NONE = 0.02
#: Share of the squares that means have to save: held commands are what a controller sends.
_SAVES = 0.01


@dataclass(frozen=True, slots=True)
class UpdatedBetween:
    """A recording whose commands changed between its samples.

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
        """The recording, marked as one.

        Parameters
        ----------
        piece_s, overlap_s : float
            As of `BagSource`.
        """
        for piece in self.source.pieces(piece_s, overlap_s):
            yield replace(piece, recording=replace(piece.recording, updated_between=True))


def with_updates(
    robot: Robot,
    sources: Sequence[Source],
    others: Sequence[Source],
    surveys: Sequence[Survey],
    select: Select | None = None,
) -> tuple[tuple[Source, ...], tuple[Source, ...]]:
    """Recordings with their commands as they were updated: held, or changing between the samples.

    Parameters
    ----------
    robot : Robot
    sources : sequence of Source
        That tell.
    others : sequence of Source
        Of the same machine and controller.
    surveys : sequence of Survey
        Of the sources, then of the others.
    select : callable, optional
        Picks the rows that may tell: those that are fitted, not those that scores are of.

    Returns
    -------
    sources, others : tuple of Source
        `UpdatedBetween` in place of those that are too slow to show their commands.
    """
    cycle_s = {survey.name: survey.recording.period_s for survey in surveys}
    slow = [source for source in sources if cycle_s[source.name] > SLOW_S]
    if not slow or not _between(robot, slow, select):
        return tuple(sources), tuple(others)
    own, further = (
        tuple(UpdatedBetween(s) if cycle_s[s.name] > SLOW_S else s for s in given)
        for given in (sources, others)
    )
    return own, further


def update_notes(sources: Sequence[Source]) -> list[str]:
    """What was found of the commands of recordings, in words."""
    return [
        f"{source.name}: commands changed between its samples (held, they come half a sampling"
        " interval late): in each interval the mean of its two commands is taken"
        for source in sources
        if isinstance(source, UpdatedBetween)
    ]


def _between(robot: Robot, slow: Sequence[Source], select: Select | None) -> bool:
    effects = ListedEffects.of(robot)
    held = signals_fitted(effects, slow, select)
    if held is None or held.delay_s > _NONE * held.longest_s:
        return False
    mean = signals_fitted(effects, [UpdatedBetween(source) for source in slow], select)
    return mean is not None and saves(held, mean)


def saves(one: DelayFit, other: DelayFit) -> bool:
    """Whether valves' signals leave clearly smaller squares of the same chambers than others.

    Parameters
    ----------
    one : DelayFit
    other : DelayFit
        That is to be better.
    """
    if other.chambers.keys() != one.chambers.keys():
        return False
    total, saved = 0.0, 0.0
    for name, before in one.chambers.items():
        weight = before.solution.weight
        squares = [misfit(c.blocks, weight)[0] for c in (before, other.chambers[name])]
        total, saved = total + squares[0], saved + squares[0] - squares[1]
    return saved > _SAVES * total


def signals_fitted(
    effects: ListedEffects,
    sources: Sequence[Source],
    select: Select | None,
    windows: WindowSettings | None = None,
) -> DelayFit | None:
    """The chambers of recordings with their valves' signals, as a first look has them.

    Parameters
    ----------
    effects : ListedEffects
    sources : sequence of Source
    select : callable or None
        As of `with_updates`.
    windows : WindowSettings, optional

    Returns
    -------
    DelayFit or None
        None where no chamber has enough windows.
    """
    robot, windows = effects.robot, windows or WindowSettings()
    gathered = []
    for source in sources:
        flows = FlowGatherer(robot, source.name, windows, effects.chamber_columns, select)
        for piece in source.pieces():
            for trace in traces_of_piece(piece):
                flows.add(effects.with_signal_laws(trace))
        gathered.append(flows)
    return fit_delay(robot, gathered)
