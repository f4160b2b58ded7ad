"""Losses told from publishers' numbers, where it is not said whose number is whose."""

from __future__ import annotations

from collections.abc import Sequence

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hydro_ident.bag.publisher_numbers import PublisherNumbers


def _lost(numbers: Sequence[int], publishers: int) -> int:
    counted = PublisherNumbers()
    return sum(counted.missing_before(number, lambda: publishers) for number in numbers)


@pytest.mark.parametrize(
    ("numbers", "publishers", "lost"),
    [
        ([1, 2, 3], 1, 0),
        ([7, 8, 9], 1, 0),  # there before the recorder
        ([1, 2, 5, 6, 9], 1, 4),
        ([1000, 1, 1001, 2, 1002, 3], 2, 0),
        ([1000, 1, 1003, 2, 1004, 3], 2, 2),
        ([1000, 1001, 1, 2, 1002], 1, 0),  # one began anew
        ([0, 0, 0], 1, 0),  # a middleware without numbers
        ([5, 5, 7, 6, 8, 7], 2, 1),
    ],
)
def test_what_is_lost_is_counted_and_nothing_else(
    numbers: Sequence[int], publishers: int, lost: int
) -> None:
    assert _lost(numbers, publishers) == lost


#: Where publishers begin, and for each message whose it is and how many before it were lost.
STARTS = st.lists(st.integers(1, 60), min_size=1, max_size=4)
EVENTS = st.lists(st.tuples(st.integers(0, 3), st.sampled_from([0, 0, 0, 1, 7])), max_size=60)


def _played(starts: Sequence[int], events: Sequence[tuple[int, int]]) -> tuple[list[int], int]:
    """The numbers as they come, and how many between them do not."""
    last, numbers = list(starts), list(starts)
    for which, lost in events:
        at = which % len(last)
        last[at] += 1 + lost
        numbers.append(last[at])
    return numbers, sum(last) - sum(starts) - len(events)


@settings(derandomize=True, database=None)
@given(STARTS, EVENTS)
def test_never_more_is_counted_than_was_lost(
    starts: Sequence[int], events: Sequence[tuple[int, int]]
) -> None:
    numbers, lost = _played(starts, events)
    assert _lost(numbers, len(starts)) <= lost


@settings(derandomize=True, database=None)
@given(STARTS, EVENTS)
def test_all_is_counted_where_publishers_count_far_apart(
    starts: Sequence[int], events: Sequence[tuple[int, int]]
) -> None:
    apart = [start + 10_000 * i for i, start in enumerate(starts)]
    numbers, lost = _played(apart, events)
    assert _lost(numbers, len(starts)) == lost


@settings(derandomize=True, database=None)
@given(EVENTS, st.integers(1, 1000))
def test_publishers_that_begin_anew_are_no_loss(
    events: Sequence[tuple[int, int]], start: int
) -> None:
    last = [start] * 4
    numbers = list(last)
    for which, anew in events:
        last[which] = 1 if anew == 7 else last[which] + 1
        numbers.append(last[which])
    assert _lost(numbers, 4) == 0
