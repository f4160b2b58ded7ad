"""A clock that starts over inside a bag, as a simulation's when its world is reset.

Two runs would lie in each other: the second is dropped as repeated stamps, or its cycles come in
between those of the first. They are put one behind the other instead, on a clock that goes on.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from hydro_ident.bag.series import Series
from hydro_ident.errors import BagError
from hydro_model.arrays import BoolArray, FloatArray, IntArray
from hydro_msgs_docs.topics import JOINT_STATES

#: Stamps that leap by more begin another run of messages; a restart repeats more than so much time
#: in more messages than a burst of late ones.
_LEAP_NS, FEW = 10**9, 10
#: Between the last cycle of a run and the first of the next: nothing is bridged over it.
_APART_NS = 10**9
#: More leaps than this are disorder, no restarts.
_MOST_LEAPS = 200


def starts_over(series: Mapping[str, Series]) -> bool:
    """Whether the clock of the joints does.

    Parameters
    ----------
    series : mapping of str to Series
        Messages of a bag by topic, in file order.
    """
    return JOINT_STATES in series and bool(_restarts(series[JOINT_STATES]))


def continued(path: Path, series: Mapping[str, Series]) -> tuple[dict[str, Series], list[str]]:
    """Topics on a clock that goes on where that of the bag starts over.

    Parameters
    ----------
    path : Path
        Of the bag, for messages.
    series : mapping of str to Series
        All messages of a bag by topic, in file order.

    Returns
    -------
    series : dict of str to Series
    notes : list of str
        In words, how often it starts over; empty where it does not.

    Raises
    ------
    BagError
        It does, and nothing tells which messages of a topic are of which run.
    """
    joints = series.get(JOINT_STATES)
    begins = [] if joints is None else _restarts(joints)
    if joints is None or not begins:
        return dict(series), []
    run = {topic: _runs_of(path, one, joints, begins) for topic, one in series.items() if len(one)}
    moved_ns, spans, end_ns = [], [], None
    for k in range(len(begins) + 1):
        stamps = np.concatenate([series[topic].stamp_ns[of == k] for topic, of in run.items()])
        first, last = int(stamps.min()), int(stamps.max())
        moved_ns.append(0 if end_ns is None else end_ns + _APART_NS - first)
        end_ns = last + moved_ns[-1]
        spans.append(f"{(last - first) * 1e-9:.1f} s")
    by_run = np.array(moved_ns, dtype=np.int64)
    moved = {
        t: replace(series[t], stamp_ns=series[t].stamp_ns + by_run[of]) for t, of in run.items()
    }
    note = (
        f"the clock of the stamps starts over ({len(begins)}x): {len(spans)} runs"
        f" ({', '.join(spans[:5])}{', ...' * (len(spans) > 5)}) in one bag, put one behind the"
        f" other with {_APART_NS * 1e-9:g} s in between"
    )
    return {**series, **moved}, [note]


def _runs_of(path: Path, series: Series, joints: Series, begins: list[int]) -> IntArray:
    """The run that each message of a topic is of, by its number."""
    every = np.arange(len(series))
    own = begins if series is joints else _restarts(series)
    back = np.flatnonzero(np.diff(series.stamp_ns) < -_LEAP_NS) + 1
    for rows in (own, back.tolist()):
        if len(rows) == len(begins):
            return np.searchsorted(rows, every, side="right")
    # By the time of reception, where that went on.
    came = joints.log_ns[begins]
    if all(int(joints.log_ns[:b].max()) < int(joints.log_ns[b:].min()) for b in begins):
        return np.searchsorted(came, series.log_ns, side="right")
    raise BagError(
        f"{path}: expected stamps that go on or start over in every topic alike, found that those"
        f" of {JOINT_STATES} start over {len(begins)} times and those of {series.topic}"
        f" {len(own)} times: record each run into a bag of its own"
    )


@dataclass(frozen=True, slots=True)
class _Part:
    """Messages between two leaps of their stamps."""

    series: Series
    rows: slice

    @property
    def stamp_ns(self) -> IntArray:
        return self.series.stamp_ns[self.rows]

    def repeats(self, earlier: _Part) -> bool:
        """Whether the same was measured over the same time, and not the same messages twice."""
        mine, theirs = self.stamp_ns, earlier.stamp_ns
        shared = int(min(mine.max(), theirs.max())) - int(max(mine.min(), theirs.min()))
        if len(mine) <= FEW or len(theirs) <= FEW or shared <= _LEAP_NS:
            return False
        told = self.told() & earlier.told()
        return bool(told.any()) and not self._copies(earlier)

    def values(self) -> FloatArray:
        return np.concatenate([v[self.rows] for v in self.series.fields.values()], axis=1)

    def told(self) -> BoolArray:
        return np.asarray(np.isfinite(self.values()).any(axis=0), dtype=np.bool_)

    def _copies(self, earlier: _Part) -> bool:
        """Whether most messages are there already, as in a bag that was put together twice."""
        _, at, there = np.intersect1d(self.stamp_ns, earlier.stamp_ns, return_indices=True)
        mine, theirs = self.values()[at], earlier.values()[there]
        same = ((mine == theirs) | np.isnan(mine) | np.isnan(theirs)).all(axis=1)
        return 2 * int(same.sum()) > len(self.stamp_ns)


def _restarts(series: Series) -> list[int]:
    """Rows of a topic in file order with which its clock starts over."""
    if not series.fields:  # names without values tell nothing twice
        return []
    leaps = np.flatnonzero(np.abs(np.diff(series.stamp_ns)) > _LEAP_NS) + 1
    if not (np.diff(series.stamp_ns) < -_LEAP_NS).any() or len(leaps) > _MOST_LEAPS:
        return []
    edges = [0, *leaps.tolist(), len(series)]
    found: list[int] = []
    run: list[_Part] = []
    for begin, end in pairwise(edges):
        part = _Part(series, slice(begin, end))
        if any(part.repeats(earlier) for earlier in run):
            found.append(begin)
            run = []
        run.append(part)
    return found
