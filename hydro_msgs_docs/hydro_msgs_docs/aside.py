"""What a process says, written by threads of their own: nobody who works waits for a reader.

A pipe that nobody empties, a terminal that is held (Ctrl-S) and a disk that hangs keep a writer
waiting for ever. rclpy's logger waits so with the interpreter's lock, and all threads with it,
that which ends the process among them.
"""

from __future__ import annotations

import io
import os
import queue
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import lru_cache
from typing import Any, TextIO
from weakref import WeakKeyDictionary

#: What waits to be written at most; what comes then is counted.
_MOST = 1000
#: How long the end of a process waits for a reader.
_END_S = 1.0
_STDERR = 2
#: Arguments by which rclpy's logger writes to `/rosout` alone.
ROSOUT_ALONE = ("--disable-stdout-logs", "--disable-external-lib-logs")
_FORMAT = "[{severity}] [{time}] [{name}]: {message}"


class Aside:
    """Does one thing after the other in a thread of its own, for who may not wait for it.

    Parameters
    ----------
    do : callable
        Is given what was put in. May take for ever.
    lost : callable
        What is to be put in for so many that were left out.
    """

    def __init__(self, do: Callable[[Any], None], lost: Callable[[int], Any]) -> None:
        self._do, self._lost = do, lost
        self._left_out = 0
        self._queue: queue.SimpleQueue[Any] = queue.SimpleQueue()
        threading.Thread(target=self._run, name="aside", daemon=True).start()

    def put(self, one: Any) -> None:
        """Have it done; at once back, in any thread.

        Parameters
        ----------
        one : object
        """
        if self._queue.qsize() >= _MOST:
            self._left_out += 1
            return
        self._queue.put(one)

    def flush(self, patience_s: float) -> bool:
        """Wait until all that was put in is done; whether it is.

        Parameters
        ----------
        patience_s : float
        """
        done = threading.Event()
        self._queue.put(done)
        return done.wait(patience_s)

    def end(self, patience_s: float) -> None:
        """As `flush`; nothing is done any more after what was put in.

        Parameters
        ----------
        patience_s : float
        """
        self.flush(patience_s)
        self._queue.put(None)

    def _run(self) -> None:
        while (one := self._queue.get()) is not None:
            if isinstance(one, threading.Event):
                one.set()
                continue
            self._do(one)
            if self._left_out and self._queue.qsize() < _MOST:
                left_out, self._left_out = self._left_out, 0
                self._do(self._lost(left_out))


@lru_cache
def _written(number: int) -> Aside:
    """The one writer of text to a descriptor in this process.

    A reader that went away and a full disk are no matter.
    """

    def write(text: str) -> None:
        data = text.encode(errors="replace")
        with suppress(OSError):
            while data:
                data = data[os.write(number, data) :]

    return Aside(write, lambda count: f"{count} lines were left out, as nobody read them\n")


class _Stream(io.TextIOBase):
    """In the place of a standard stream; what is written to it is put aside."""

    def __init__(self, stream: TextIO) -> None:
        self._stream, self._aside = stream, _written(stream.fileno())

    def write(self, text: str) -> int:
        """Put it aside."""
        if text:
            self._aside.put(text)
        return len(text)

    def flush(self) -> None:
        """Nobody waits."""

    def isatty(self) -> bool:
        """Of the stream."""
        return self._stream.isatty()

    def fileno(self) -> int:
        """Of the stream."""
        return self._stream.fileno()

    def writable(self) -> bool:
        """It is."""
        return True


@contextmanager
def unread_streams() -> Iterator[None]:
    """Standard output and error that keep nobody waiting; at the end what waits has a second."""
    before = sys.stdout, sys.stderr
    try:
        streams = [_Stream(stream) for stream in before]
    except (OSError, io.UnsupportedOperation):
        yield  # no files of the system: whoever put them there reads them
        return
    sys.stdout, sys.stderr = streams
    try:
        yield
    finally:
        sys.stdout, sys.stderr = before
        for stream in streams:
            stream._aside.flush(_END_S)


class NodeLog:
    """The log of a node: lines on standard error as of ROS, and on `/rosout`.

    Parameters
    ----------
    node : rclpy.node.Node
    """

    def __init__(self, node: Any) -> None:
        from rclpy.logging import LoggingSeverity

        self._levels = LoggingSeverity
        self._logger = node.get_logger()
        self._format = os.environ.get("RCUTILS_CONSOLE_OUTPUT_FORMAT") or _FORMAT
        self._shown = ROSOUT_ALONE[0] not in sys.argv
        self._rosout = Aside(self._publish, lambda count: ("WARN", f"{count} lines left out"))

    def info(self, text: str) -> None:
        """Something that is as it should be."""
        self._say("INFO", text)

    def warn(self, text: str) -> None:
        """Something that should not be so."""
        self._say("WARN", text)

    def error(self, text: str) -> None:
        """Something that was refused, or has failed."""
        self._say("ERROR", text)

    def fatal(self, text: str) -> None:
        """Something after which the node cannot go on."""
        self._say("FATAL", text)

    def close(self) -> None:
        """Give what waits a second to be written and published; before the node is destroyed."""
        self._rosout.end(_END_S)
        _written(_STDERR).flush(_END_S)

    def _say(self, level: str, text: str) -> None:
        if not self._logger.is_enabled_for(self._levels[level]):
            return
        self._rosout.put((level, text))
        if self._shown:
            now_ns = time.time_ns()
            line = self._format
            for key, value in (
                ("{severity}", level),
                ("{time}", f"{now_ns // 10**9}.{now_ns % 10**9:09d}"),
                ("{name}", self._logger.name),
                ("{message}", text),
            ):
                line = line.replace(key, value)
            _written(_STDERR).put(f"{line}\n")

    def _publish(self, entry: tuple[str, str]) -> None:
        level, text = entry
        # Each in a line of its own: rclpy lets none write once as an error and once as another.
        if level == "INFO":
            self._logger.info(text)
        elif level == "WARN":
            self._logger.warn(text)
        elif level == "ERROR":
            self._logger.error(text)
        else:
            self._logger.fatal(text)


_logs: WeakKeyDictionary[Any, NodeLog] = WeakKeyDictionary()


def log_of(node: Any) -> NodeLog:
    """The log of a node, which is never waited for.

    Parameters
    ----------
    node : rclpy.node.Node

    Returns
    -------
    NodeLog
    """
    if node not in _logs:
        _logs[node] = NodeLog(node)
    return _logs[node]
