"""What stamps say of the clock behind them: gaps, other rates, and stamps that went back."""

from __future__ import annotations

from collections.abc import Iterable

import pytest

from hydro_control.monitoring.stamps import StampWatch


def watch_after(spacings_s: Iterable[float], dt_s: float = 0.002) -> StampWatch:
    watch = StampWatch(dt_s)
    for one in spacings_s:
        watch.follows(one)
    return watch


@pytest.mark.parametrize(
    ("dt_s", "gap_s", "none_s"),
    [(0.002, 0.052, 0.05), (0.001, 0.051, 0.05), (0.01, 0.11, 0.1), (0.02, 0.22, 0.2)],
)
def test_a_gap_is_more_than_fifty_milliseconds_and_ten_samples(
    dt_s: float, gap_s: float, none_s: float
) -> None:
    watch = StampWatch(dt_s)
    assert watch.is_gap(gap_s)
    assert not watch.is_gap(none_s)
    # Stamps are counted in whole samples: half a one more or less is a stamp that jitters.
    assert not watch.is_gap(none_s + 0.4 * dt_s)
    assert watch.is_gap(gap_s - 0.4 * dt_s)


@pytest.mark.parametrize(
    ("apart_s", "dt_s", "said"),
    [
        (0.0045451, 0.002, "4.55 ms apart, expected 2 ms"),
        (0.0045449, 0.002, "4.54 ms apart, expected 2 ms"),
        (0.002, 0.0045451, "2 ms apart, expected 4.55 ms"),
        (0.002, 0.0045449, "2 ms apart, expected 4.54 ms"),
    ],
)
def test_both_rates_are_told_in_milliseconds(apart_s: float, dt_s: float, said: str) -> None:
    assert said in watch_after([apart_s] * 50, dt_s).other_rate


def test_another_rate_is_told_by_the_fiftieth_spacing_and_not_before() -> None:
    assert watch_after([0.004] * 49, 0.003).other_rate == ""
    assert watch_after([0.004] * 50, 0.003).other_rate == (
        "samples are 4 ms apart, expected 3 ms (rate_hz of the robot file): correct one of both,"
        " then activate anew"
    )


@pytest.mark.parametrize(
    ("apart_s", "other"),
    [
        (0.00181, False), (0.00219, False), (0.00179, True), (0.00221, True),
        (0.004, False), (0.0042, False), (0.00423, True), (0.006, False),
        (0.0005, True), (0.0001, True),
    ],
)  # fmt: skip
def test_rates_are_others_beyond_a_tenth_of_a_sample(apart_s: float, other: bool) -> None:
    """Every second or third sample that is lost each time is no other rate."""
    assert bool(watch_after([apart_s] * 50).other_rate) is other


def test_single_samples_that_are_lost_or_late_tell_nothing() -> None:
    assert watch_after([0.002, 0.0271] * 24 + [0.002] * 2).other_rate == ""
    assert watch_after([0.0027] * 30 + [0.002] * 20).other_rate != ""


def test_what_was_judged_once_is_not_judged_again_until_forgotten() -> None:
    watch = watch_after([0.002] * 50 + [0.003] * 60)
    assert watch.other_rate == ""
    watch.forget()
    for _ in range(50):
        watch.follows(0.003)
    assert watch.other_rate != ""
    for _ in range(60):
        watch.follows(0.002)
    assert watch.other_rate != ""
    watch.forget()
    assert watch.other_rate == ""


def test_stamps_that_went_back_by_more_than_a_gap_are_told_until_forgotten() -> None:
    watch = StampWatch(0.002)
    assert watch.gone_back == ""
    watch.older(0.05)
    assert watch.gone_back == ""
    watch.older(0.0523)
    assert watch.gone_back == (
        "stamps went back by 0.052 s, expected them to grow (bridge or clock began anew, or two"
        " publish samples): activate the controller anew"
    )
    watch.older(0.002)
    assert watch.gone_back != ""
    watch.forget()
    assert watch.gone_back == ""
