"""Windows of all topics of a bag that is read by stretches: what may be given away, and when."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path

from hydro_ident.bag.aligned import TYPES
from hydro_ident.bag.clock_restarts import continued, starts_over
from hydro_ident.bag.decoder import Decoder
from hydro_ident.bag.series import Series, SeriesBuilder, too_empty
from hydro_ident.bag.stretch_cycles import Known, LearntError
from hydro_ident.bag.window import LateError, Window, joined_cells
from hydro_ident.errors import BagError
from hydro_model.robot import Robot
from hydro_msgs_docs.topics import CHAMBER_PRESSURES, JOINT_STATES, OIL_TEMPERATURE

#: What is joined to the joints and further ahead of them than this goes by another clock, or they
#: have ended: it would be held, and put in order with every stretch, to the end.
_AHEAD_NS = 5 * 10**9
#: Topics that are joined to the cycles.
_JOINED = tuple(topic for topic in TYPES if topic != OIL_TEMPERATURE)


@dataclass(slots=True)
class TopicWindows:
    """Messages of all topics between decoding and the cycles.

    Parameters
    ----------
    path : Path
        Of the bag, for messages.
    notes : list of str
        Gets what is to be said of its clock.
    decoder : Decoder
    known : Known
    late_s : float
        How late a message may be behind the newest.

    Attributes
    ----------
    windows : dict of str to Window
        By topic.
    """

    path: Path
    notes: list[str]
    decoder: Decoder
    known: Known
    late_s: float
    windows: dict[str, Window] = field(default_factory=dict)
    _cycles: bool = False
    #: Something that is joined to cycles was given away before there were any.
    _alone: bool = False
    #: Up to where joined topics were given away as the joints came.
    _reached_ns: int | None = None

    def collect(self, robot: Robot | None, *, bare: bool) -> None:
        """Take in what was decoded.

        Parameters
        ----------
        robot : Robot or None
            With one, topics are joined to its cycles.
        bare : bool
            Some cycles were made without `/chamber_pressures`.

        Raises
        ------
        LearntError
            It does not fit to what was given away, or only the whole tells whether it is refused.
        """
        self._cycles = robot is not None
        self.decoder.require_tables()
        for topic, fresh in self._fresh().items():
            builder = self.decoder.builders[topic]
            if topic not in self.windows:
                # What is joined but comes first now must not be older than what went without it.
                begun = self._is_joined(topic, builder)
                self.windows[topic] = Window(given_ns=self._reached_ns if begun else None)
            window = self.windows[topic]
            if len(fresh) and not window.count and self._too_late(topic, bare):
                raise LearntError(replace(self.known, waits=self.known.waits | {topic}))
            self._require_room(window, fresh)
            try:
                window.add(fresh)
            except LateError as error:
                raise LearntError(replace(self.known, whole=True)) from error

    def _fresh(self) -> dict[str, Series]:
        fresh = {t: self._taken(builder) for t, builder in self.decoder.builders.items()}
        if self.known.whole:
            fresh, restarts = continued(self.path, fresh)
            self.notes += restarts
        elif starts_over(fresh):
            raise LearntError(replace(self.known, whole=True))
        return fresh

    def _taken(self, builder: SeriesBuilder) -> Series:
        try:
            return builder.take()
        except BagError as error:
            if self.known.whole:
                raise
            # Too few numbers for its names: the whole may be dense enough.
            raise LearntError(replace(self.known, whole=True)) from error

    def _require_room(self, window: Window, fresh: Series) -> None:
        """See that what is kept has room for the names that come, which are columns of it, too."""
        if window.kept is None or window.kept.names == fresh.names or not len(fresh):
            return
        cells, filled = joined_cells(window.kept, fresh)
        if too_empty(cells, filled):
            raise LearntError(replace(self.known, whole=True))
        self.decoder.require_cells(cells)

    def _too_late(self, topic: str, bare: bool) -> bool:
        """Whether stretches were made without a topic that they should have had."""
        return bare if topic == CHAMBER_PRESSURES else topic == JOINT_STATES and self._alone

    def _is_joined(self, topic: str, builder: SeriesBuilder) -> bool:
        return self._cycles and topic in _JOINED and builder.message_type == TYPES[topic]

    @property
    def joined(self) -> dict[str, Window]:
        """Windows of topics that are joined to the cycles."""
        builders = self.decoder.builders.items()
        return {t: self.windows[t] for t, b in builders if self._is_joined(t, b)}

    def give(self, *, last: bool) -> dict[str, Series]:
        """Messages by topic that no later ones will come between.

        Parameters
        ----------
        last : bool
            No more come: all of them.

        Raises
        ------
        LearntError
            Some are so far ahead of the joints that the bag is better read as one.
        """
        joined, late_ns = self.joined, round(self.late_s * 1e9)
        cycles = joined.get(JOINT_STATES)
        if not last and cycles is not None and cycles.newest_ns is not None:
            newest = [one.newest_ns for one in joined.values() if one.newest_ns is not None]
            if max(newest) > cycles.newest_ns + _AHEAD_NS:
                raise LearntError(replace(self.known, whole=True))
        given: dict[str, Series] = {}
        for topic, window in self.windows.items():
            until = window.newest_ns
            if topic in joined and cycles is not None and cycles.count:
                until = cycles.newest_ns
                self._reached_ns = None if until is None else until - late_ns
            elif topic in joined and until is not None:
                until = None if JOINT_STATES in self.known.waits else until
                self._alone |= until is not None
            if last:
                some = window.give(None)
            else:
                some = None if until is None else window.give(until - late_ns)
            if some is not None:
                given[topic] = some
        return given
