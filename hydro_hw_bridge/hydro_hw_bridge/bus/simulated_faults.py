"""python-can interface `simulated_faults`: error frames and bus-off where no CAN hardware is.

It carries frames as `udp_multicast` does. Bus-off and error frames cannot happen there, so this
interface makes them up, on command, and says so when it is opened.

    simulated_faults:239.74.163.2:43113:/tmp/faults

The last part is a file that is looked at all the time; it need not exist. Its content says what
happens from then on:

- `bus_off`: nothing is sent (python-can's `CanOperationError`) and nothing received, the state is
  `ERROR`, as for a controller that left the bus. It starts with a bus-off error frame.
- `queue_full`: nothing is sent, as the send queue takes no frame (`ENOBUFS`); frames are received.
- `gone`: sending and receiving fail, as of an interface that went down or was unplugged.
- `error_frames N`: N error frames of bus errors are received, once.
- `ok`, nothing or no file: as usual. After bus-off, it starts with a "restarted" error frame.

When one of these begins a line in the log says so, with the time of the monotonic clock.
"""

from __future__ import annotations

import errno
import logging
import re
import threading
import time
from collections import deque
from pathlib import Path
from typing import Any

import can

from hydro_hw_bridge.bus.bus_name import parse_bus
from hydro_hw_bridge.bus.bus_open import open_multicast
from hydro_hw_bridge.bus.error_frames import BUS_ERROR, BUS_OFF, PROTOCOL, RESTARTED, error_frame

INTERFACE = "simulated_faults"
#: How often the file is looked at.
LOOK_S = 0.01
_MOST = 1000
_BEGUN = "simulated from %d ns on: '%s'"


def begun_ns(log: str, text: str) -> int | None:
    """When something began that a file of simulated faults says, by the log of who opened it.

    Parameters
    ----------
    log : str
    text : str
        The file's content.

    Returns
    -------
    int or None
        Monotonic time, ns, of the first time in the log; None where it is not in there.
    """
    found = re.search(rf"simulated from (\d+) ns on: '{re.escape(text)}'", log)
    return None if found is None else int(found[1])


class SimulatedFaultsBus(can.BusABC):
    """`udp_multicast` with faults on command.

    Parameters
    ----------
    channel : str
        `GROUP:PORT:FILE`; the file may be left out, then no fault ever happens.
    can_filters : sequence of filters, optional
        As of python-can.

    Raises
    ------
    BridgeError
        The group or port is none, or the bus cannot be opened.
    """

    def __init__(self, channel: str, can_filters: Any = None, **_other: Any) -> None:
        group, _, rest = channel.partition(":")
        port, _, control = rest.partition(":")
        name = parse_bus(f"udp_multicast:{group}" + (f":{port}" if port else ""))
        self._inner = open_multicast(name, None)
        self._control = Path(control) if control else None
        self._looking = threading.Lock()
        self._look_at = 0.0
        self._text = self._wrong = ""
        self._off = self._full = False
        self._waiting: deque[can.Message] = deque()
        super().__init__(channel, can_filters=can_filters)
        self.channel_info = f"simulated CAN faults on {name}"
        source = f"on command of '{control}'" if control else "never, as no file was named"
        logging.getLogger(__name__).warning(
            "%s: bus-off and error frames are SIMULATED, %s", self.channel_info, source
        )

    @property
    def state(self) -> can.BusState:
        """ERROR during the simulated bus-off; it cannot be set."""
        return can.BusState.ERROR if self._off else can.BusState.ACTIVE

    @state.setter
    def state(self, new_state: can.BusState) -> None:
        raise NotImplementedError("the state is set by the file of simulated faults")

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Send a frame; `CanOperationError` during the simulated bus-off.

        `msg` and `timeout` (s) as for any python-can bus.
        """
        self._look()
        if self._off:
            raise can.CanOperationError("simulated bus-off: nothing can be sent")
        if self._full:
            raise can.CanOperationError("simulated full send queue", errno.ENOBUFS)
        if self._wrong:
            raise can.CanOperationError(self._wrong)
        self._inner.send(msg, timeout)

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        self._look()
        if self._wrong:
            raise can.CanOperationError(self._wrong)
        if self._waiting:
            return self._waiting.popleft(), True
        message = self._inner.recv(LOOK_S if timeout is None else min(timeout, LOOK_S))
        # A controller in bus-off does not hear what others send meanwhile.
        if message is None or self._off:
            return None, False
        return message, message.is_error_frame

    def _look(self) -> None:
        if self._control is None:
            return
        with self._looking:
            now = time.monotonic()
            if now < self._look_at:
                return
            self._look_at = now + LOOK_S
            try:
                text = self._control.read_text(encoding="utf-8").strip()
            except FileNotFoundError:
                text = ""
            if text != self._text:
                self._text = text
                now_ns = time.monotonic_ns()
                self._begin(text)
                logging.getLogger(__name__).warning(_BEGUN, now_ns, text)

    def _begin(self, text: str) -> None:
        word, _, number = text.partition(" ")
        was, self._off = self._off, word == "bus_off"
        self._full, self._wrong = word == "queue_full", ""
        if self._off != was:
            self._waiting.append(error_frame(BUS_OFF if self._off else RESTARTED))
        if word == "error_frames" and number.isdigit() and int(number) <= _MOST:
            self._waiting.extend([error_frame(PROTOCOL | BUS_ERROR)] * int(number))
        elif word == "gone":
            self._wrong = "simulated: the interface is gone"
        elif text not in ("", "ok", "bus_off", "queue_full"):
            self._wrong = (
                f"'{self._control}' should say ok, bus_off, queue_full, gone or error_frames N"
                f" with N up to {_MOST}, found '{text}'"
            )

    def fileno(self) -> int:
        """File descriptor of the socket."""
        return int(self._inner.fileno())

    def shutdown(self) -> None:
        """Close the socket."""
        super().shutdown()
        self._inner.shutdown()
