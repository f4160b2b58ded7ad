"""Where the messages of a buffer of records are: from record to record, and in rounds at once.

Only the length of a record tells where the next one begins, and from record to record Python takes
longer than all else does that reads a bag. But a machine's messages come in rounds: cycle by cycle
the same topics in the same order, as long as before. Where the last few did, numpy looks at the
heads of all rounds that would follow; as far as each is the one expected, its record is there.
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


class RecordWalk:
    """Finds the messages of a buffer that holds nothing but messages, schemas and channels.

    Parameters
    ----------
    data : bytes
    note : callable
        Given opcode and body of every other record.

    Attributes
    ----------
    whole : bool
        The buffer ended with a record, as far as it was walked.
    """

    def __init__(self, data: bytes, note: Callable[[int, bytes], None]) -> None:
        self._data, self._note = data, note
        self.whole = True

    def bodies(self, block: int) -> Iterator[NDArray[np.int64]]:
        """Where bodies of message records begin, in order, piece by piece.

        Parameters
        ----------
        block : int
            Messages in a block: no piece goes beyond one.

        Yields
        ------
        (N,) int64 array
            A whole head is before each, and all that it declares, `MESSAGE_HEAD` bytes or more,
            behind.
        """
        data, end, head = self._data, len(self._data), _HEAD.unpack_from
        at, room, wait = 0, block, _FEWEST
        found: list[int] = []
        while at + _HEAD.size <= end:
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
            if len(found) < min(wait, room):
                continue
            # Before the first message of each channel a chunk describes it: not the first third.
            sizes = round_of([*found, at + _HEAD.size][len(found) // 3 :])
            yield np.array(found, dtype=np.int64)
            room = room - len(found) or block
            rounds = bodies_of_rounds(data, at, sizes, room)
            found, wait = [], min(2 * wait, _MOST)
            if rounds.size:
                yield rounds
                at += rounds.size // len(sizes) * sum(sizes)
                room, wait = room - rounds.size or block, _FEWEST
        if found:
            yield np.array(found, dtype=np.int64)
        self.whole = at == end


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


def bodies_of_rounds(data: bytes, at: int, sizes: Sequence[int], most: int) -> NDArray[np.int64]:
    """Bodies of the messages that follow in rounds.

    Parameters
    ----------
    data : bytes
    at : int
        Where the first record would begin.
    sizes : sequence of int
        Of a round's records, heads included; `MESSAGE_HEAD` or more behind each head. Of none
        there are no messages.
    most : int
        Messages.

    Returns
    -------
    (N,) int64 array
        Of whole rounds, in order.
    """
    size = sum(sizes)
    count = min((len(data) - at) // size, most // len(sizes)) if sizes else 0
    if count == 0:
        return np.zeros(0, dtype=np.int64)
    begins = np.cumsum([0, *sizes[:-1]])
    heads = [_HEAD.pack(MESSAGE, one - _HEAD.size) for one in sizes]
    rounds = np.frombuffer(data, np.uint8, count * size, at).reshape(count, size)
    places = (begins[:, None] + np.arange(_HEAD.size)).ravel()
    expected = np.frombuffer(b"".join(heads), np.uint8)
    differs = (rounds[:, places] != expected).any(axis=1)
    same = int(np.argmax(differs)) if differs.any() else count
    starts = at + size * np.arange(same)[:, None]
    return np.asarray(starts + begins + _HEAD.size, dtype=np.int64).ravel()
