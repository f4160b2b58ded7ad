"""Claiming the bus: one bridge at a time may send valve commands."""

from __future__ import annotations

import secrets
import time

from hydro_hw_bridge.bus.bus import Bus
from hydro_hw_bridge.errors import BridgeError
from hydro_hw_bridge.protocol.codec import Codec

CLAIM_PERIOD_S = 0.1
#: Ten claims: a bridge that lives has been heard by then, however busy its machine is.
LISTEN_S = 1.0
#: Both claiming: the one with the smaller number stays. Longer than two claims.
CONTEST_S = 0.3
#: A foreign bridge not heard for so long is gone.
GONE_S = 1.5


class Claim:
    """This bridge's claim on a bus, and what it hears of others.

    Parameters
    ----------
    bus : Bus
    codec : Codec

    Attributes
    ----------
    instance : int
        Random, 32 bits.
    """

    def __init__(self, bus: Bus, codec: Codec) -> None:
        self.instance = secrets.randbits(32)
        self._bus = bus
        self._codec = codec
        self._alive = 0
        self._heard_at: float | None = None

    def take(self) -> None:
        """Listen for another bridge, then claim the bus.

        Raises
        ------
        BridgeError
            There is another bridge on the bus.
        """
        self._listen(LISTEN_S, claiming=False)
        self._listen(CONTEST_S, claiming=True)

    def _listen(self, duration_s: float, *, claiming: bool) -> None:
        now = time.monotonic()
        end, next_claim = now + duration_s, now
        while (now := time.monotonic()) < end:
            if claiming and now >= next_claim:
                self.send()
                next_claim += CLAIM_PERIOD_S
            message = self._bus.receive(min(end - now, 0.02))
            frame = None if message is None else self._codec.receive(message)
            if frame is None or frame.role != "claim" or not frame.intact:
                continue
            other = self._codec.decode_claim(frame)
            if other != self.instance and (not claiming or other < self.instance):
                raise BridgeError(
                    f"another bridge (instance {other:08x}) is on CAN bus {self._bus.name},"
                    " expected to be the only one: stop it first"
                )

    def send(self) -> None:
        """Send one claim."""
        self._bus.send(self._codec.encode_claim(self.instance, self._alive))
        self._alive += 1

    def hear(self, instance: int) -> bool:
        """Take a claim from the bus; True where it is of another bridge."""
        if instance == self.instance:
            return False
        self._heard_at = time.monotonic()
        return True

    def others_gone(self) -> bool:
        """Whether a foreign bridge was heard, but not lately."""
        return self._heard_at is not None and time.monotonic() - self._heard_at > GONE_S
