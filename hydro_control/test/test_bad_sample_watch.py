"""The watch over samples that no voltage follows from, by itself."""

from __future__ import annotations

import pytest

from hydro_control.monitoring.bad_samples import BadSampleWatch

STEP_NS = 2_000_000
SECOND_NS = 1_000_000_000


def judged(watch: BadSampleWatch, stamps_ns: range, found: str = "") -> list[str]:
    """What a watch says of samples."""
    return [watch.judge(stamp_ns, found, anew=False) for stamp_ns in stamps_ns]


def samples(first: int, count: int) -> range:
    """Their stamps."""
    return range(first * STEP_NS, (first + count) * STEP_NS, STEP_NS)


def test_good_samples_in_a_row_are_counted_from_the_last_bad_one() -> None:
    watch = BadSampleWatch()
    assert judged(watch, samples(0, 100)) == [""] * 100
    assert (watch.shut, watch.found, watch.fault) == ("", "", "")
    shut = "this; 0 V until 25 samples in a row are good"
    assert judged(watch, samples(100, 1), "this") == [shut]
    assert (watch.shut, watch.found) == (shut, "this")
    assert judged(watch, samples(101, 24)) == [shut] * 24
    assert judged(watch, samples(125, 2), "that") == [shut.replace("this", "that")] * 2
    assert judged(watch, samples(127, 24)) == [watch.shut] * 24
    assert watch.shut
    assert judged(watch, samples(151, 1)) == [shut.replace("this", "that")]
    assert (watch.shut, watch.fault) == ("", "")
    assert judged(watch, samples(152, 100)) == [""] * 100


def test_they_are_counted_anew_where_the_filters_start_anew() -> None:
    watch = BadSampleWatch()
    judged(watch, samples(0, 1), "this")
    judged(watch, samples(1, 23))
    shut = "this; 0 V until 25 samples in a row are good"
    assert watch.judge(55 * STEP_NS, "", anew=True) == shut
    assert judged(watch, samples(56, 23)) == [shut] * 23
    assert watch.shut
    assert judged(watch, samples(79, 2)) == [shut, ""]


@pytest.mark.parametrize("first_is_bad", [True, False])
def test_a_long_run_of_bad_samples_is_one(first_is_bad: bool) -> None:
    watch = BadSampleWatch()
    judged(watch, samples(0, 1 - first_is_bad))
    for begins in (1, 300):
        judged(watch, samples(begins, 100), "this")
        judged(watch, samples(begins + 100, 100))
    assert (watch.shut, watch.fault) == ("", "")


@pytest.mark.parametrize("over_ns", [0, 1])
def test_the_third_within_a_second_is_latched(over_ns: int) -> None:
    watch = BadSampleWatch()
    for stamp_ns in (0, 100, 200):  # of long ago, and latched: forgotten
        judged(watch, range(stamp_ns, stamp_ns + 1), "this")
        judged(watch, range(stamp_ns + 1, stamp_ns + 99))
    assert watch.fault
    watch.forget()
    assert (watch.shut, watch.found, watch.fault) == ("", "", "")
    begins = 5 * SECOND_NS
    for stamp_ns in (begins, begins + SECOND_NS // 2):
        judged(watch, range(stamp_ns, stamp_ns + 1), "this")
        judged(watch, range(stamp_ns + 1, stamp_ns + 200))
    assert (watch.shut, watch.fault) == ("", "")
    third = begins + SECOND_NS + over_ns
    (said,) = judged(watch, range(third, third + 1), "this")
    if over_ns:
        assert watch.fault == ""
        assert said == watch.shut
    else:
        again = "this; it came and went 3 times in 1.000 s"
        assert said == watch.fault
        assert said == f"{again}: latched until the controller is activated anew"
