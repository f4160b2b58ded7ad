"""The signals that end a process in order: Ctrl-C, the system's, and a terminal that goes away."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

#: SIGHUP is what an ssh connection that drops leaves behind.
SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


def on_end(end: Callable[[], None]) -> None:
    """Call something on every signal that ends a process.

    Parameters
    ----------
    end : callable
        May raise, for what is to be unwound.
    """
    for number in SIGNALS:
        signal.signal(number, lambda *_: end())


@contextmanager
def stop_on_signals() -> Iterator[list[bool]]:
    """A list that turns non-empty on every signal that ends a process, so that work ends in order.

    rclpy's own handlers would shut the middleware down under a loop that still uses it. The
    handlers of before are back afterwards.
    """
    stop: list[bool] = []
    before = {number: signal.getsignal(number) for number in SIGNALS}
    on_end(lambda: stop.append(True))
    try:
        yield stop
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def on_end_at_once(end: Callable[[], None]) -> None:
    """Call something from a thread of its own on every signal that ends a process.

    Python runs its signal handlers in the main thread, once that is back from whatever it waits
    for; a wait inside ROS does not end on a signal. What wakes the thread here is the byte that
    Python's handler in C writes at once, whatever the main thread does.

    Parameters
    ----------
    end : callable
        Has to be safe in any thread, and more than once.
    """
    reading, writing = os.pipe()
    os.set_blocking(writing, False)
    signal.set_wakeup_fd(writing, warn_on_full_buffer=False)
    for number in SIGNALS:
        signal.signal(number, _written_already)

    def wait() -> None:
        while os.read(reading, 1):
            end()

    threading.Thread(target=wait, name="endings", daemon=True).start()


def _written_already(*_: object) -> None:
    return None
