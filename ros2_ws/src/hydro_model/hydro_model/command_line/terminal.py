"""What a command shows on a terminal and nowhere else: colours, and progress of long work.

Long work calls `advance` wherever it is; a command that wants its progress shown does its work
inside `progress_bar`: a bar on a terminal, plain lines now and then in a log. A thread of its own
keeps both going while a stage says nothing for long. Without it, in processes that are forked
inside it and in tests, `advance` does nothing.
"""

from __future__ import annotations

import os
import shutil
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import TextIO

_CODES = {"red": "31", "green": "32", "yellow": "33", "bold": "1", "dim": "2"}
_CLEAR = "\r\x1b[2K"
_WIDTH, _EVERY_S = 24, 0.1
#: In a log: nothing of work that is soon done, then a line per stage, and one now and then.
_QUIET_S, _LINE_EVERY_S = 15.0, 30.0
#: How often a stage that says nothing is drawn again: as often as its seconds change.
_TICK_S = 1.0


def is_terminal(stream: TextIO) -> bool:
    """Whether a person watches a stream on something that knows escape codes.

    Parameters
    ----------
    stream : file
    """
    return stream.isatty() and os.environ.get("TERM", "") != "dumb"


def coloured(text: str, colour: str, stream: TextIO | None = None) -> str:
    """A text in a colour where that is wanted.

    Parameters
    ----------
    text : str
    colour : {"red", "green", "yellow", "bold", "dim"}
    stream : file, optional
        Where it will be printed; standard output by default.

    Returns
    -------
    str
        The text alone where the stream is no terminal or NO_COLOR is set (https://no-color.org).
    """
    if os.environ.get("NO_COLOR") or not is_terminal(stream or sys.stdout):
        return text
    return f"\x1b[{_CODES[colour]}m{text}\x1b[0m"


def _percent(done: int, total: int) -> int:
    """Of a stage, rounded; a hundred is what is done alone."""
    if done >= total:
        return 100 if total else 0
    return min(round(100.0 * max(done, 0) / total), 99)


class _Bar:
    """One line on standard error that is written over."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream
        self._begun = time.monotonic()
        self._drawn = 0.0
        self._what = ""

    def draw(self, what: str, done: int, total: int) -> None:
        now = time.monotonic()
        if what == self._what and now - self._drawn < _EVERY_S:
            return
        self._what, self._drawn = what, now
        percent = _percent(done, total)
        full = round(0.01 * percent * _WIDTH)
        bar = "#" * full + "." * (_WIDTH - full)
        line = f"[{bar}] {percent:3}% {now - self._begun:5.0f} s  {what}"
        columns = shutil.get_terminal_size().columns
        self._stream.write(_CLEAR + line[: max(columns - 1, 10)])
        self._stream.flush()

    def clear(self) -> None:
        self._stream.write(_CLEAR)
        self._stream.flush()


class _Lines:
    """Plain lines on standard error, for logs: few, and none of what does not take long."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream
        self._begun = time.monotonic()
        self._written = 0.0
        self._what = ""

    def draw(self, what: str, done: int, total: int) -> None:
        now = time.monotonic()
        soon = now - self._begun < _QUIET_S
        if soon or (what == self._what and now - self._written < _LINE_EVERY_S):
            return
        self._what, self._written = what, now
        share = f" ({_percent(done, total)}%)" if total else ""
        self._stream.write(f"{now - self._begun:.0f} s: {what}{share}\n")
        self._stream.flush()

    def clear(self) -> None:
        """Lines stay."""


class _Listener:
    """In the place of a bar: somebody who wants to know when."""

    def __init__(self, hear: Callable[[str, int, int], None]) -> None:
        self.draw = hear

    def clear(self) -> None:
        """Nothing is on the screen."""


_bar: _Bar | _Lines | _Listener | None = None
#: The last that `advance` was told inside `progress_bar`.
_said: tuple[str, int, int] | None = None
#: Held by whoever writes a bar or lines, and while a process is forked.
_drawing = threading.RLock()


def _forked() -> None:
    """In a process that was forked: the bar is its parent's, and the thread is not there."""
    global _bar, _drawing
    _drawing = threading.RLock()
    _bar = _bar and _Listener(lambda what, done, total: None)


# Nobody is in the middle of writing when a process is forked: it would find standard error locked
# for good, by a thread that it does not have.
os.register_at_fork(
    before=lambda: _drawing.acquire(),
    after_in_parent=lambda: _drawing.release(),
    after_in_child=_forked,
)


def _keep_drawing(bar: _Bar | _Lines, ended: threading.Event) -> None:
    """Draw what was said last again and again: a stage that takes long shows that it goes on."""
    while not ended.wait(_TICK_S):
        with _drawing:
            if _said is None or ended.is_set():
                continue
            try:
                bar.draw(*_said)
            except (
                OSError,
                ValueError,
            ):  # nobody reads it any more, which `advance` is told as well
                return


@contextmanager
def progress_heard(hear: Callable[[str, int, int], None]) -> Iterator[None]:
    """Tell a function what the work inside says of its progress, instead of showing it.

    Parameters
    ----------
    hear : callable
        Takes what `advance` takes.
    """
    global _bar
    before, _bar = _bar, _Listener(hear)
    try:
        yield
    finally:
        _bar = before


@contextmanager
def progress_bar() -> Iterator[None]:
    """Show what the work inside says of its progress, on standard error: a bar, or plain lines.

    Results go to standard output or to files, also as JSON: progress is in nobody's way there.
    """
    global _bar, _said
    if _bar is not None:
        yield
        return
    bar = _Bar(sys.stderr) if is_terminal(sys.stderr) else _Lines(sys.stderr)
    ended = threading.Event()
    thread = threading.Thread(target=_keep_drawing, args=(bar, ended), name="bar", daemon=True)
    try:
        _bar, _said = bar, None
        # Without a thread more it is drawn where the work says something, alone.
        with suppress(RuntimeError):
            thread.start()
        yield
    finally:
        if _bar is bar:  # not where a fork of it ends
            _bar = None
            ended.set()
            if thread.is_alive():
                thread.join()
            bar.clear()


def advance(what: str, done: int, total: int) -> None:
    """Say how far work has come.

    Parameters
    ----------
    what : str
        In a few words.
    done, total : int
        Steps; the last call of a stage may leave them unequal.
    """
    global _said
    if _bar is not None:
        with _drawing:
            _said = what, done, total
            _bar.draw(what, done, total)


def say(text: str) -> None:
    """Print a line on standard output, beside a bar.

    Parameters
    ----------
    text : str
    """
    with _drawing:
        if _bar is not None:
            _bar.clear()
        print(text, flush=True)
