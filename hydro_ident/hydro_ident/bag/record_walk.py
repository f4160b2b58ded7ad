"""Where the messages of a buffer of records are: from record to record, and in rounds at once.

Only the length of a record tells where the next one begins, and from record to record Python takes
longer than all else does that reads a bag. But a machine's messages come in rounds: cycle by cycle
the same topics in the same order, as long as before. Where the last few did, numpy looks at the
heads of all rounds that would follow; as far as each is the one expected, its record is there. And
most chunks begin as the one before did: there the rounds follow that followed then.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from hydro_ident.bag.mcap_gather import MESSAGE_HEAD

SCHEMA, CHANNEL, MESSAGE = 0x03, 0x04, 0x05

_HEAD = struct.Struct("<BQ")
#: After so many messages one by one a round is looked for; after twice as many each time that
#: there was none, up to the most: a look costs as much as a few dozen of them.
_FEWEST, _MOST = 12, 1024
#: Bytes up to the first rounds beyond which these are not remembered.
LONGEST_OPENING = 1 << 18


class RecordWalk:
    """Finds the messages of buffers that hold nothing but messages, schemas and channels.

    Parameters
    ----------
    note : callable
        Given opcode and body of every other record.

    Attributes
    ----------
    whole : bool
        The last buffer ended with a record, as far as it was walked.
    """

    def __init__(self, note: Callable[[int, bytes], None]) -> None:
        self._note = note
        self._opening: _Opening | None = None
        self.whole = True

    def bodies(self, data: bytes, block: int) -> Iterator[NDArray[np.int64]]:
        """Where bodies of message records begin, in order, piece by piece.

        Parameters
        ----------
        data : bytes
        block : int
            Messages in a block: no piece goes beyond one.

        Yields
        ------
        (N,) int64 array
            A whole head is before each, and all that it declares, `MESSAGE_HEAD` bytes or more,
            behind.
        """
        at, room, wait, round_ = 0, block, _FEWEST, _NO_ROUND
        opening, known = self._opening, False
        if opening and opening.bodies.size <= block and opening.begins(data):
            for opcode, body in opening.others:
                self._note(opcode, body)
            yield opening.bodies
            at, round_, known = opening.end, opening.round, True
            room = room - opening.bodies.size or block
        while True:
            rounds = round_.bodies(data, at, room)
            if rounds.size:
                if not known and at <= LONGEST_OPENING:
                    self._opening = _Opening(data, at, round_)
                known = True
                yield rounds
                at += rounds.size // len(round_.sizes) * round_.size
                room, wait = room - rounds.size or block, _FEWEST
            most = min(wait, room)
            found, at = self._one_by_one(data, at, most)
            if found:
                yield np.array(found, dtype=np.int64)
            if len(found) < most:
                break
            # Before the first message of each channel a chunk describes it: not the first third.
            sizes = round_of([*found, at + _HEAD.size][len(found) // 3 :])
            round_ = Round(sizes) if sizes else _NO_ROUND
            room, wait = room - len(found) or block, min(2 * wait, _MOST)
        self.whole = at == len(data)

    def _one_by_one(self, data: bytes, at: int, most: int) -> tuple[list[int], int]:
        """Bodies of at most so many messages, fewer at the end of it all; and the place behind."""
        end, head = len(data), _HEAD.unpack_from
        found: list[int] = []
        while len(found) < most and at + _HEAD.size <= end:
            opcode, length = head(data, at)
            body = at + _HEAD.size
            if length > end - body:
                break
            if opcode == MESSAGE and length >= MESSAGE_HEAD:
                found.append(body)
            elif opcode in (SCHEMA, CHANNEL):
                self._note(opcode, data[body : body + length])
            else:
                break
            at = body + length
        return found, at


def round_of(bodies: Sequence[int]) -> list[int]:
    """The shortest round that some messages came in.

    Parameters
    ----------
    bodies : sequence of int
        Where records of messages have their bodies, and where that of the next one would be.

    Returns
    -------
    list of int
        Sizes of its records, heads included, as they would follow; empty where no round came
        twice.
    """
    sizes = [after - before for before, after in pairwise(bodies)]
    for count in range(1, len(sizes) // 2 + 1):
        if sizes[count:] == sizes[:-count]:
            return sizes[-count:]
    return []


class Round:
    """Messages that come again and again in the same order, as long as before.

    Parameters
    ----------
    sizes : sequence of int
        Of a round's records, heads included; `MESSAGE_HEAD` or more behind each head. Of none
        there are no messages.

    Attributes
    ----------
    sizes : sequence of int
    size : int
        Of the round.
    """

    def __init__(self, sizes: Sequence[int]) -> None:
        self.sizes, self.size = sizes, sum(sizes)
        begins = np.cumsum([0, *sizes], dtype=np.int64)[:-1]
        self._bodies = begins + _HEAD.size
        self._heads = b"".join(_HEAD.pack(MESSAGE, one - _HEAD.size) for one in sizes)
        self._places = (begins[:, None] + np.arange(_HEAD.size)).ravel()

    def bodies(self, data: bytes, at: int, most: int) -> NDArray[np.int64]:
        """Bodies of the messages that follow in rounds.

        Parameters
        ----------
        data : bytes
        at : int
            Where the first record would begin.
        most : int
            Messages.

        Returns
        -------
        (N,) int64 array
            Of whole rounds, in order.
        """
        if not self.sizes:
            return np.zeros(0, dtype=np.int64)
        count = min((len(data) - at) // self.size, most // len(self.sizes))
        rounds = np.frombuffer(data, np.uint8, count * self.size, at).reshape(count, self.size)
        heads = rounds.take(self._places, axis=1)
        if heads.tobytes() != self._heads * count:
            # Where the first other one is, takes longer to find.
            expected = np.frombuffer(self._heads, np.uint8)
            count = int(np.argmax((heads != expected).any(axis=1)))
        starts = np.arange(at, at + self.size * count, self.size, dtype=np.int64)
        return (starts[:, None] + self._bodies).ravel()


_NO_ROUND = Round(())


class _Opening:
    """How a buffer begins up to its first rounds.

    `data` is the buffer, `end` where they begin, `round_` what they are.
    """

    def __init__(self, data: bytes, end: int, round_: Round) -> None:
        self.round, self.end = round_, end
        self.others: list[tuple[int, bytes]] = []
        #: All but the bodies of messages: where it is, and what.
        self._same: list[tuple[int, bytes]] = []
        bodies = []
        at = before = 0
        while at < end:
            opcode, length = _HEAD.unpack_from(data, at)
            body, at = at + _HEAD.size, at + _HEAD.size + length
            if opcode == MESSAGE:
                bodies.append(body)
                self._same.append((before, data[before:body]))
                before = at
            else:
                self.others.append((opcode, data[body:at]))
        self.bodies = np.array(bodies, dtype=np.int64)

    def begins(self, data: bytes) -> bool:
        """Whether a buffer begins so, with the same descriptions of its channels."""
        return len(data) >= self.end and all(data.startswith(b, at) for at, b in self._same)
