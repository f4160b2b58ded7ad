"""The signals that end a process in order: Ctrl-C, the system's, and a terminal that goes away."""

from __future__ import annotations

import signal
from collections.abc import Callable

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
