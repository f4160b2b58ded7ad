"""What can be wrong on a bus, as descriptions: which frames, from when on, for how long."""

from __future__ import annotations

from dataclasses import dataclass

from hydro_hw_bridge.faults.timed import Timed

DEVICE, BRIDGE = "device", "bridge"

#: Frames with other contents under valid checks: what a broken sensor or counter sends.
CONTENT = ("frozen", "frozen_alive", "wild", "stuck", "jump", "extreme", "clock_bit")
#: Frames that do not arrive as they were sent, and those of others. Noise passes a check by chance
#: alone; a foreign sender knows counter and CRC: nothing tells its frames from the machine's.
TRANSPORT = (
    "lost",
    "late",
    "split",
    "repeated",
    "reordered",
    "bit_flip",
    "truncated",
    "babble",
    "foreign",
    "second_bridge",
)
#: The bridge's own end of the bus.
LINK = ("bus_off", "queue_full", "gone")
KINDS = (*CONTENT, *TRANSPORT, *LINK)


@dataclass(frozen=True, slots=True)
class BusFault(Timed):
    """One fault on the bus.

    Attributes
    ----------
    kind : str
        One of `KINDS`.
    first_cycle, cycles : int
        From which cycle of the line on, and for how many. A cycle begins with a sync frame.
    direction : {"device", "bridge"}
        Who sends the frames.
    frames : tuple of int
        Identifiers; empty for all of the direction. Of babble and foreign those that are sent.
    signal : str
        `FRAME.Signal`, of the kinds stuck, jump and extreme.
    amount : int
        late: cycles; repeated: copies more; bit_flip: the bit; truncated: bytes left; jump: raw
        counts; extreme: 0 for the lowest raw value, otherwise the highest; babble, foreign: frames
        per cycle; split: how many frames stay in their own cycle.
    seed : int
        Of what is random in it.
    """

    kind: str
    first_cycle: int
    cycles: int
    direction: str = DEVICE
    frames: tuple[int, ...] = ()
    signal: str = ""
    amount: int = 1
    seed: int = 0

    def about(self, identifier: int, direction: str) -> bool:
        """Whether a frame is among those it is about; others send beside any."""
        of_all = not self.frames or self.kind in ("babble", "foreign")
        return direction == self.direction and (of_all or identifier in self.frames)
