"""Which frames on the bus are a sender's own, where it hears itself."""

from __future__ import annotations

#: Frames kept. A reader that lags hears its own as late as what it answers: seconds at 500 Hz.
KEPT = 4096


class OwnFrames:
    """The newest frames that were sent, by their data."""

    def __init__(self) -> None:
        self._data: dict[bytes, None] = {}

    def add(self, data: bytes) -> None:
        """Keep a frame's data; the oldest go.

        Parameters
        ----------
        data : bytes
        """
        self._data[data] = None
        if len(self._data) > KEPT:
            del self._data[next(iter(self._data))]

    def take_over(self, other: OwnFrames) -> None:
        """Take what a sender before this one sent.

        Parameters
        ----------
        other : OwnFrames
        """
        for data in other._data:
            self.add(data)

    def __contains__(self, data: bytes) -> bool:
        return data in self._data
