"""Joints and pressures that do not begin or end together: cycles need both.

A recorder that starts and stops loses some messages of one topic or the other; what is longer was
recorded in vain, or is a sensor that failed.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from hydro_ident.bag.grid import Topic
from hydro_model.arrays import IntArray
from hydro_msgs_docs.topics import CHAMBER_PRESSURES, JOINT_STATES

#: Up to so long, and so many cycles, topics may begin and end apart.
APART_S, APART_CYCLES = 0.1, 5
_PAIRS = ((JOINT_STATES, CHAMBER_PRESSURES), (CHAMBER_PRESSURES, JOINT_STATES))


@dataclass(frozen=True, slots=True)
class Outside:
    """Messages of a topic before the first cycle, or behind the last one.

    Attributes
    ----------
    count : int
    first_ns, last_ns : int
        Their stamps; without a meaning where there are none.
    """

    count: int = 0
    first_ns: int = 0
    last_ns: int = 0

    def more(self, stamp_ns: IntArray) -> Outside:
        """With stamps that follow, (N,)."""
        if not len(stamp_ns):
            return self
        first_ns = self.first_ns if self.count else int(stamp_ns[0])
        return Outside(self.count + len(stamp_ns), first_ns, int(stamp_ns[-1]))


@dataclass(frozen=True, slots=True)
class Ends:
    """What of joints and pressures lies outside the cycles.

    Attributes
    ----------
    first_ns, last_ns : int or None
        Stamps of the first cycle and of the last; None before there is one.
    heads, tails : mapping of str to Outside
        By topic, of those with messages: before the one and behind the other.
    """

    first_ns: int | None = None
    last_ns: int | None = None
    heads: Mapping[str, Outside] = field(default_factory=dict)
    tails: Mapping[str, Outside] = field(default_factory=dict)

    def then(self, cycle_ns: IntArray, topics: Mapping[str, Topic]) -> Ends:
        """With a stretch that follows.

        Parameters
        ----------
        cycle_ns : (N,) int64 array
            Its cycles; where there are any it may overlap with those before, but must have all
            that follows the last cycle before.
        topics : mapping of str to Topic
            Its messages.

        Returns
        -------
        Ends
        """
        heads, tails, first_ns, last_ns = self.heads, self.tails, self.first_ns, self.last_ns
        stamps = {n: topics[n].stamp_ns for n, _ in _PAIRS if n in topics}
        if first_ns is None:
            end = int(cycle_ns[0]) if len(cycle_ns) else np.inf
            heads = {**heads, **{n: _of(heads, n).more(s[s < end]) for n, s in stamps.items()}}
        if len(cycle_ns):
            first_ns = int(cycle_ns[0]) if first_ns is None else first_ns
            last_ns = int(cycle_ns[-1])
            tails = {n: Outside().more(s[s > last_ns]) for n, s in stamps.items()}
        elif first_ns is not None:
            tails = {**tails, **{n: _of(tails, n).more(s) for n, s in stamps.items()}}
        return Ends(first_ns, last_ns, heads, tails)

    def told(self, period_s: float, *, complete: bool = True) -> list[tuple[str, str]]:
        """Topics that begin or end long before the other one, or without it, each in words.

        Parameters
        ----------
        period_s : float
            Of the cycles.
        complete : bool
            No more cycles come.

        Returns
        -------
        list of (str, str)
            The topic and what it does.
        """
        if self.first_ns is None or self.last_ns is None:
            return []
        found = _told(self.heads, self.first_ns, period_s, ("begins", "after", "first"))
        if complete:
            found += _told(self.tails, self.last_ns, period_s, ("ends", "before", "last"))
        return found


def _told(
    outside: Mapping[str, Outside], cycle_ns: int, period_s: float, words: tuple[str, str, str]
) -> list[tuple[str, str]]:
    """Of one end; `cycle_ns` is the stamp of the cycle there."""
    least_s, found = max(APART_S, APART_CYCLES * period_s), list[tuple[str, str]]()
    far = {
        name: max(abs(one.first_ns - cycle_ns), abs(one.last_ns - cycle_ns)) * 1e-9
        for name, one in outside.items()
        if one.count
    }
    # A lone stamp that is years away is none of a stretch.
    long = [n for n, s in far.items() if min(s, outside[n].count * period_s) > least_s]
    does, how, which = words
    for name, other in _PAIRS:
        if name not in long:
            continue
        count = outside[name].count
        if other in long:
            text = f"its {which} {far[name]:.1f} s share no stamp with {other}:"
            found.append((name, f"{text} {count} messages make no cycle"))
        else:
            apart_s = far[name] - far.get(other, 0.0)
            text = f"{does} {apart_s:.1f} s {how} {name}:"
            found.append((other, f"{text} {count} messages of that make no cycle"))
    return found


def _of(outside: Mapping[str, Outside], name: str) -> Outside:
    return outside.get(name, Outside())
