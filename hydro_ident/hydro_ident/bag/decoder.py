"""Blocks of messages decoded into the columns of their topics, as far as there is memory."""

from __future__ import annotations

from pathlib import Path

from hydro_ident.bag import memory
from hydro_ident.bag.diagnostics import DIAGNOSTIC_ARRAY, Status, add_statuses
from hydro_ident.bag.mcap_types import MessageBlock
from hydro_ident.bag.series import Series, SeriesBuilder
from hydro_msgs_docs.cdr import FIELDS

_MOST_NOTES = 1000
#: Memory is asked for each time that so many more bytes have come.
_ASK_BYTES = 1 << 24
#: What decoding takes for each byte of a block, how often what is kept is needed again as columns
#: and in the work on them, and what a status takes at most for each byte of its message.
_PER_BYTE, _AGAIN, _PER_STATUS_BYTE = 6, 3, 24


class Decoder:
    """The messages of a bag on their way into columns.

    Parameters
    ----------
    path : Path
        Of the bag, for messages.
    notes : list of str
        Gets what could not be decoded.
    diagnostics : bool
        Keep what nodes said about themselves, too.

    Attributes
    ----------
    builders : dict of str to SeriesBuilder
        By topic.
    statuses : list of Status
    """

    def __init__(self, path: Path, notes: list[str], *, diagnostics: bool) -> None:
        self.builders: dict[str, SeriesBuilder] = {}
        self.statuses: list[Status] = []
        self._path = path
        self._notes = notes
        self._diagnostics = diagnostics
        self._unasked = 0
        self._said = 0

    def add(self, block: MessageBlock) -> None:
        """Decode a block.

        Parameters
        ----------
        block : MessageBlock

        Raises
        ------
        BagError
            There is no memory for it and what was decoded before.
        """
        channel = block.channel
        if channel.message_type == DIAGNOSTIC_ARRAY:
            if self._diagnostics:
                self._ask(_PER_STATUS_BYTE * int(block.length.sum()))
                if malformed := add_statuses(block, self.statuses, self._said):
                    self._say(f"{channel.topic}: {malformed} messages could not be decoded")
            return
        if channel.message_type not in FIELDS:
            return
        if channel.encoding != "cdr":
            self._say(f"{channel.topic}: expected encoding cdr, found '{channel.encoding}'")
            return
        builder = self.builders.get(channel.topic)
        if builder is None:
            builder = SeriesBuilder(channel.topic, channel.message_type)
            self.builders[channel.topic] = builder
        if builder.message_type != channel.message_type:
            self._say(
                f"{channel.topic}: messages of {channel.message_type} beside"
                f" {builder.message_type}, left out"
            )
            return
        self._ask(_PER_BYTE * int(block.length.sum()))
        builder.add(block)
        for name in builder.twice:
            self._say(
                f"{channel.topic}: expected each name once in a message, found {name} several"
                " times: none of its values there is taken"
            )

    def take(self) -> dict[str, Series]:
        """The columns of everything added since the last time, by topic.

        Raises
        ------
        BagError
            There is no memory for them.
        """
        self.require_tables()
        series = {}
        for topic, builder in self.builders.items():
            series[topic] = builder.finish()
            # One topic at a time is there twice.
            self.builders[topic] = SeriesBuilder(topic, builder.message_type)
        return series

    def take_statuses(self) -> list[Status]:
        """What nodes said since the last time."""
        statuses, self.statuses = self.statuses, []
        self._said += len(statuses)
        return statuses

    def require_tables(self) -> None:
        """See that there is memory for the columns of what was added.

        Raises
        ------
        BagError
            There is not.
        """
        self.require_cells(sum(builder.table_bytes for builder in self.builders.values()) // 8)

    def require_cells(self, cells: int) -> None:
        """See that there is memory for columns of so many numbers, and for the work on them.

        Parameters
        ----------
        cells : int

        Raises
        ------
        BagError
            There is not.
        """
        self._require(8 * _AGAIN * cells)

    def _ask(self, more: int) -> None:
        self._unasked += more
        if self._unasked >= _ASK_BYTES:
            held = sum(builder.held_bytes for builder in self.builders.values())
            self._require(self._unasked + _AGAIN * held)
            self._unasked = 0

    def _require(self, needed: int) -> None:
        memory.require(
            self._path,
            needed,
            what="a bag",
            found="that it takes a further",
            way_out="cut it into shorter ones",
        )

    def _say(self, text: str) -> None:
        """Note something once; what says a thousand different things is not listened to."""
        if len(self._notes) < _MOST_NOTES and text not in self._notes:
            self._notes.append(text)
