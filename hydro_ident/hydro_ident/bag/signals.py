"""Ending on a signal without being cut off in the middle."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def stop_on_signals() -> Iterator[list[bool]]:
    """A list that turns non-empty on SIGINT, SIGTERM or SIGHUP, so that work ends in order.

    rclpy's own handlers would shut the middleware down under a loop that still uses it.
    """
    stop: list[bool] = []
    before = {
        number: signal.signal(number, lambda *_: stop.append(True))
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    }
    try:
        yield stop
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
