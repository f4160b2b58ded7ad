"""Signals that end a process: heard, and left as they were found."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator

import pytest

from hydro_msgs_docs.endings import SIGNALS, on_end, on_end_at_once, stop_on_signals

PATIENCE_S = 30.0


@pytest.fixture(autouse=True)
def handlers() -> Iterator[None]:
    """As they were, whatever a test does."""
    before = {number: signal.getsignal(number) for number in SIGNALS}
    yield
    signal.set_wakeup_fd(-1)
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.mark.parametrize("number", SIGNALS)
def test_every_signal_is_heard_each_time(number: signal.Signals) -> None:
    heard: list[bool] = []
    on_end(lambda: heard.append(True))
    signal.raise_signal(number)
    signal.raise_signal(number)
    assert heard == [True, True]


@pytest.mark.parametrize("number", SIGNALS)
def test_work_that_stops_on_a_signal_leaves_the_handlers_of_before(number: signal.Signals) -> None:
    heard: list[bool] = []
    on_end(lambda: heard.append(True))
    before = [signal.getsignal(one) for one in SIGNALS]
    with stop_on_signals() as stop:
        assert not stop
        signal.raise_signal(number)
        assert stop
    assert [signal.getsignal(one) for one in SIGNALS] == before
    assert not heard


@pytest.mark.parametrize("number", SIGNALS)
def test_a_thread_of_its_own_hears_at_once(number: signal.Signals) -> None:
    heard = threading.Event()
    threads: list[str] = []

    def end() -> None:
        threads.append(threading.current_thread().name)
        heard.set()

    on_end_at_once(end)
    signal.raise_signal(number)
    assert heard.wait(PATIENCE_S)
    heard.clear()
    signal.raise_signal(number)
    assert heard.wait(PATIENCE_S)
    assert threads == ["endings", "endings"]
