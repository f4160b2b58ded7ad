"""How the last commands go to 0 V: one per stamp, as long as samples come, and not for ever."""

from __future__ import annotations

import pytest

from hydro_control.core.winding_down import LAST_SAMPLE_S, RAMP_S, WindingDown

NOW_S, STAMP = 100.0, 1_000_000_000
PERIOD_NS, PERIOD_S = 3_000_000, 0.003


def test_without_samples_it_is_over_soon() -> None:
    down = WindingDown(STAMP, NOW_S)
    assert down.left_s(NOW_S) == pytest.approx(LAST_SAMPLE_S)
    assert down.left_s(NOW_S + 0.04) == pytest.approx(LAST_SAMPLE_S - 0.04)
    assert down.left_s(NOW_S + LAST_SAMPLE_S + 0.01) == 0.0
    assert down.stamp_ns == STAMP
    # A command may be 10 ms old: whoever is not heard for five times that is gone.
    assert LAST_SAMPLE_S == 0.05


def test_every_sample_is_answered_once_and_in_order() -> None:
    down = WindingDown(STAMP, NOW_S)
    assert not down.takes(STAMP, NOW_S)
    assert not down.takes(STAMP - PERIOD_NS, NOW_S)
    assert down.takes(STAMP + 1, NOW_S)
    assert down.stamp_ns == STAMP + 1
    assert not down.takes(STAMP + 1, NOW_S)
    assert not down.takes(STAMP, NOW_S)
    assert down.stamp_ns == STAMP + 1


def test_a_sample_that_is_not_answered_puts_nothing_off() -> None:
    down = WindingDown(STAMP, NOW_S)
    down.takes(STAMP, NOW_S + 0.04)
    assert down.left_s(NOW_S + 0.04) == pytest.approx(LAST_SAMPLE_S - 0.04)
    down.takes(STAMP + 1, NOW_S + 0.04)
    assert down.left_s(NOW_S + 0.04) == pytest.approx(LAST_SAMPLE_S)


def test_however_many_samples_come_it_ends() -> None:
    down, now_s, taken = WindingDown(STAMP, NOW_S), NOW_S, 0
    while down.left_s(now_s) > 0.0:
        taken += 1
        now_s += PERIOD_S
        assert down.takes(STAMP + taken * PERIOD_NS, now_s)
        down.answered(zero=False)
    assert taken == 167
    assert RAMP_S == 0.5


def test_it_is_over_at_0_v() -> None:
    down = WindingDown(STAMP, NOW_S)
    down.takes(STAMP + 1, NOW_S)
    down.answered(zero=False)
    assert down.left_s(NOW_S) > 0.0
    down.answered(zero=True)
    assert down.left_s(NOW_S) == 0.0
