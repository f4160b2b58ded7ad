"""The messages of a topic that comes in stretches, in order of their stamps, each stamp once."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from hydro_ident.bag.grid import Repeats, Topic
from hydro_ident.bag.series import Series
from hydro_ident.errors import BagError
from hydro_model.arrays import IntArray


class LateError(BagError):
    """A stamp that belongs among those that were given away already."""


def joined(old: Series, new: Series) -> Series:
    """Two stretches of a topic as one.

    Parameters
    ----------
    old, new : Series
        In file order.

    Returns
    -------
    Series
    """
    names = tuple(dict.fromkeys((*old.names, *new.names)))
    stamped: list[Series] = [s for s in (old, new) if len(s)]
    count = sum(len(s) for s in stamped)
    fields = {}
    for name in dict.fromkeys((*old.fields, *new.fields)):
        widths = [s.fields[name].shape[1] for s in stamped if name in s.fields]
        wide = len(names) if names else max(widths, default=1)
        values, at = np.full((count, wide), np.nan), 0
        for s in stamped:
            if name in s.fields:
                columns = [names.index(n) for n in s.names] if names else list(range(wide))
                values[at : at + len(s), columns] = s.fields[name]
            at += len(s)
        fields[name] = values
    return Series(
        old.topic,
        old.message_type,
        np.concatenate([old.stamp_ns, new.stamp_ns]),
        np.concatenate([old.log_ns, new.log_ns]),
        names,
        fields,
        old.malformed + new.malformed,
        old.malformed_why or new.malformed_why,
    )


def joined_cells(old: Series, new: Series) -> tuple[int, int]:
    """Numbers that two stretches of a topic have room for as one, and those that are there.

    Parameters
    ----------
    old, new : Series

    Returns
    -------
    room, filled : int
    """
    every = (*old.fields.values(), *new.fields.values())
    fields, names = {*old.fields, *new.fields}, {*old.names, *new.names}
    wide = len(names) * len(fields) or sum(values.shape[1] for values in every)
    filled = sum(int(np.count_nonzero(~np.isnan(values))) for values in every)
    return (len(old) + len(new)) * wide, filled


@dataclass(slots=True)
class Window:
    """Messages of a topic between reading and use.

    Attributes
    ----------
    kept : Series or None
        In order of their stamps; messages of one stamp are put together.
    newest_ns : int or None
        Newest stamp so far; None before the first message.
    repeats : Repeats
        Of all messages so far.
    given_ns : int or None
        Later messages must be newer than this.
    """

    kept: Series | None = None
    newest_ns: int | None = None
    repeats: Repeats = field(default_factory=Repeats)
    given_ns: int | None = None

    @property
    def count(self) -> int:
        """Messages so far."""
        return self.repeats.messages

    def add(self, fresh: Series) -> None:
        """Take in the next messages.

        Parameters
        ----------
        fresh : Series
            In file order.

        Raises
        ------
        LateError
            One of them is not newer than what was given away.
        """
        if not len(fresh):
            return
        if self.given_ns is not None and int(fresh.stamp_ns.min()) <= self.given_ns:
            raise LateError(f"{fresh.topic}: expected stamps after {self.given_ns}")
        known = 0 if self.kept is None else len(self.kept)
        topic = Topic.of(fresh if self.kept is None else joined(self.kept, fresh))
        row = topic.row
        firsts = topic.series.stamp_ns[np.sort(row[row >= known])]
        before = firsts[:1] if self.newest_ns is None else np.array([self.newest_ns])
        so_far = np.maximum.accumulate(np.concatenate([before, firsts]))
        late = int(np.sum(firsts < so_far[1:]))
        self.repeats += replace(topic.repeats, messages=len(fresh), disordered=late)
        self.newest_ns = int(so_far[-1])
        self.kept = _rows(topic.series, row)

    def forget(self, before_ns: int) -> None:
        """Leave out messages older than `before_ns`."""
        if self.kept is not None:
            begin = int(np.searchsorted(self.kept.stamp_ns, before_ns))
            self.kept = _rows(self.kept, np.arange(begin, len(self.kept)))

    def give(self, until_ns: int | None) -> Series | None:
        """Give away messages; later ones must be newer.

        Parameters
        ----------
        until_ns : int or None
            Newest stamp that goes; all go for None.

        Returns
        -------
        Series or None
            In order of the stamps; None where there are none.
        """
        if until_ns is not None:
            given = until_ns if self.given_ns is None else max(until_ns, self.given_ns)
            self.given_ns = given
        if self.kept is None:
            return None
        every = len(self.kept)
        end = every
        if until_ns is not None:
            end = int(np.searchsorted(self.kept.stamp_ns, until_ns, side="right"))
        if not end:
            return None
        given_away = _rows(self.kept, np.arange(end))
        self.kept = _rows(self.kept, np.arange(end, every)) if end < every else None
        return given_away


def _rows(series: Series, chosen: IntArray) -> Series:
    fields = {name: values[chosen] for name, values in series.fields.items()}
    stamps, received = series.stamp_ns[chosen], series.log_ns[chosen]
    return replace(series, stamp_ns=stamps, log_ns=received, fields=fields)
