"""Frames of others on the bus: noise under any identifier, and a sender that knows the checks."""

from __future__ import annotations

import random

import can

from hydro_hw_bridge.faults.bus_faults import BRIDGE, BusFault
from hydro_hw_bridge.protocol.codec import Codec
from hydro_hw_bridge.protocol.e2e import protect

_FOREIGN = 0x7FF
#: Of noise: frames of the length that their identifier has, and frames under one of ours.
RIGHT_LENGTH, OURS = 0.9, 0.9


class Noise:
    """Draws the frames that others put beside each frame of a direction.

    Parameters
    ----------
    codec : Codec
    """

    def __init__(self, codec: Codec) -> None:
        self._codec = codec
        self._frames = {frame.identifier: frame for frame in codec.layout.frames}
        self._ids = {BRIDGE: (codec.bridge_ids[0],)}

    def beside(
        self, fault: BusFault, message: can.Message, alive: int, source: random.Random
    ) -> list[can.Message]:
        """A frame with those of others before and behind it.

        Parameters
        ----------
        fault : BusFault
            babble or foreign; `amount` frames a cycle on the average.
        message : can.Message
        alive : int
            Counter of the present cycle.
        source : random.Random

        Returns
        -------
        list of can.Message
        """
        ids = fault.frames or self._ids.get(fault.direction, self._codec.device_ids)
        per_frame = fault.amount / len(self._ids.get(fault.direction, self._codec.device_ids))
        count = int(per_frame) + (source.random() < per_frame % 1.0)
        make = self._foreign if fault.kind == "foreign" else self._babble
        others = [make(source.choice(ids), alive, source) for _ in range(count)]
        at = source.randint(0, count)
        return [*others[:at], message, *others[at:]]

    def _babble(self, identifier: int, _alive: int, source: random.Random) -> can.Message:
        """Mostly the right length under an identifier of ours; CRC and counter fit by chance."""
        if source.random() > OURS:
            identifier = source.randrange(_FOREIGN)
        frame = self._frames.get(identifier)
        known = frame is not None and source.random() < RIGHT_LENGTH
        size = frame.size if frame is not None and known else source.randrange(9)
        return can.Message(
            arbitration_id=identifier,
            is_extended_id=source.random() < 0.05,
            data=source.randbytes(size),
            check=False,
        )

    def _foreign(self, identifier: int, alive: int, source: random.Random) -> can.Message:
        """Any contents under the counter of the present cycle and a CRC that fits."""
        frame = self._frames[identifier]
        data = bytearray(source.randbytes(frame.size))
        if frame.identifiers is not None:
            protect(data, alive, frame.identifiers)
        return can.Message(
            arbitration_id=identifier, is_extended_id=frame.extended, data=data, check=False
        )
