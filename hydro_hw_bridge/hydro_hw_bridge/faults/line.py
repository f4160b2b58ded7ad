"""The bus between machine and bridge with faults: frames in, frames out. Pure, seeded."""

from __future__ import annotations

import random
from collections.abc import Callable, Iterable

import can

from hydro_hw_bridge.faults.bus_faults import BRIDGE, CONTENT, DEVICE, LINK, BusFault
from hydro_hw_bridge.faults.contents import Contents, copy_of
from hydro_hw_bridge.faults.noise import Noise
from hydro_hw_bridge.protocol.codec import Codec

#: Cycles whose frames are remembered, to tell a whole sample from a partial one.
KEPT_CYCLES = 4096


class FaultLine:
    """Carries frames both ways and does to them what the faults say.

    Parameters
    ----------
    codec : Codec
    faults : iterable of BusFault

    Attributes
    ----------
    cycle : int
        Sync frames of the device so far, less 1: -1 before the first.
    injected : int
        Frames that a fault changed, delayed, dropped or added.
    """

    def __init__(self, codec: Codec, faults: Iterable[BusFault] = ()) -> None:
        self.cycle = -1
        self.injected = 0
        self._codec = codec
        self._faults = tuple(faults)
        self._contents = Contents(codec)
        self._noise = Noise(codec)
        self._random = {fault: random.Random(fault.seed) for fault in self._faults}
        self._sync = codec.device_ids[0]
        self._held: list[tuple[int, str, can.Message]] = []
        self._swapped: dict[str, list[can.Message]] = {DEVICE: [], BRIDGE: []}
        self._position = 0
        self._counter = 0
        self._sent: dict[int, dict[int, set[bytes]]] = {}
        self._deeds: dict[str, Callable[[BusFault, can.Message], list[can.Message]]] = {
            "lost": lambda fault, message: [],
            "late": self._late,
            "split": self._split,
            "repeated": lambda fault, message: [message] * (1 + fault.amount),
            "reordered": self._reordered,
            "bit_flip": _flipped,
            "truncated": lambda fault, m: [copy_of(m, bytes(m.data)[: fault.amount])],
            "babble": self._among_others,
            "foreign": self._among_others,
            "second_bridge": self._second_bridge,
        }

    def add(self, fault: BusFault) -> None:
        """Put a fault on the line while it runs."""
        self._faults = (*self._faults, fault)
        self._random[fault] = random.Random(fault.seed)

    @property
    def link(self) -> str:
        """State of the bridge's end of the bus: ok, bus_off, queue_full or gone."""
        acting = [f.kind for f in self._faults if f.kind in LINK and f.acts(self.cycle)]
        return acting[0] if acting else "ok"

    def sent(self, counter: int) -> dict[int, set[bytes]]:
        """What the device sent under a sample counter, by identifier, broken sensors included."""
        return self._sent.get(counter, {})

    def take(self, message: can.Message, direction: str) -> list[can.Message]:
        """Carry one frame.

        Parameters
        ----------
        message : can.Message
        direction : {"device", "bridge"}
            Who sent it.

        Returns
        -------
        list of can.Message
            What arrives at the other end now, in this order.
        """
        due: list[can.Message] = []
        if direction == DEVICE and message.arbitration_id == self._sync:
            self.cycle += 1
            self._position = 0
            due = self._released(DEVICE)
        elif direction == DEVICE:
            self._position += 1
        message = self._with_contents(message, direction)
        if self.link in ("bus_off", "gone"):
            self.injected += 1
            return []
        swapped, self._swapped[direction] = self._swapped[direction], []
        return [*self._transported(message, direction), *due, *swapped]

    def late_answers(self) -> list[can.Message]:
        """Frames of the bridge that were held back until now."""
        return self._released(BRIDGE)

    def _released(self, direction: str) -> list[can.Message]:
        due = [m for at, way, m in self._held if way == direction and at <= self.cycle]
        self._held = [one for one in self._held if one[1] != direction or one[0] > self.cycle]
        return due

    def _with_contents(self, message: can.Message, direction: str) -> can.Message:
        for fault in self._acting(message, direction):
            if fault.kind in CONTENT:
                changed = self._contents.applied(fault, message)
                self.injected += bytes(changed.data) != bytes(message.data)
                message = changed
        if direction == DEVICE:
            self._remember(message)
        return message

    def _remember(self, message: can.Message) -> None:
        if message.arbitration_id == self._sync:
            frame = self._codec.receive(message)
            assert frame is not None
            self._counter = self._codec.sample_counter(frame)
            if len(self._sent) > KEPT_CYCLES:
                self._sent.pop(next(iter(self._sent)))
        frames = self._sent.setdefault(self._counter, {})
        frames.setdefault(message.arbitration_id, set()).add(bytes(message.data))

    def _acting(self, message: can.Message, direction: str) -> list[BusFault]:
        return [
            fault
            for fault in self._faults
            if fault.acts(self.cycle) and fault.about(message.arbitration_id, direction)
        ]

    def _transported(self, message: can.Message, direction: str) -> list[can.Message]:
        out = [message]
        for fault in self._acting(message, direction):
            deed = self._deeds.get(fault.kind)
            if deed is None:
                continue
            before = out
            out = [arriving for one in before for arriving in deed(fault, one)]
            self.injected += [bytes(m.data) for m in out] != [bytes(m.data) for m in before]
        return out

    def _late(self, fault: BusFault, message: can.Message) -> list[can.Message]:
        self._held.append((self.cycle + fault.amount, fault.direction, message))
        return []

    def _split(self, fault: BusFault, message: can.Message) -> list[can.Message]:
        """The rest of a cycle's frames arrives behind the next one's sync frame."""
        if self._position < fault.amount:
            return [message]
        self._held.append((self.cycle + 1, DEVICE, message))
        return []

    def _reordered(self, fault: BusFault, message: can.Message) -> list[can.Message]:
        """At random, a frame waits until the next one of its direction has passed."""
        if self._random[fault].random() < 0.5:
            return [message]
        self._swapped[fault.direction].append(message)
        return []

    def _among_others(self, fault: BusFault, message: can.Message) -> list[can.Message]:
        return self._noise.beside(fault, message, self._counter, self._random[fault])

    def _second_bridge(self, fault: BusFault, message: can.Message) -> list[can.Message]:
        if message.arbitration_id != self._sync:
            return [message]
        return [message, self._codec.encode_claim(fault.seed | 1, self.cycle)]


def _flipped(fault: BusFault, message: can.Message) -> list[can.Message]:
    data = bytearray(message.data)
    bit = fault.amount % (8 * len(data)) if data else 0
    if data:
        data[bit // 8] ^= 1 << bit % 8
    return [copy_of(message, bytes(data))]
