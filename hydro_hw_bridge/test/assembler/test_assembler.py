"""Cycles out of frames under every kind of loss and disorder."""

from __future__ import annotations

import random
from collections.abc import Callable
from dataclasses import replace

import pytest

from hydro_hw_bridge.protocol.assembler import Assembler, Cycle, CycleCounters, CycleKind
from hydro_hw_bridge.protocol.codec import Codec
from hydro_hw_bridge.protocol.frames import Frame

Frames = Callable[..., list[Frame]]


def feed(assembler: Assembler, frames: list[Frame]) -> list[Cycle]:
    return [cycle for frame in frames if (cycle := assembler.add(frame)) is not None]


def assert_unmixed(codec: Codec, cycle: Cycle) -> None:
    got = codec.readings(cycle.data)
    assert got.counter == cycle.counter
    assert set(got.pressures_pa) == {500.0 * (cycle.counter % 1000)}
    assert got.positions == pytest.approx([cycle.counter % 1000 * 1e-3] * 2, abs=1e-5)


def test_cycles_come_out_as_sent(assembler: Assembler, frames: Frames, codec: Codec) -> None:
    start = 2**32 - 20
    sent = [(start + i) % 2**32 for i in range(40)]
    cycles = [c for counter in sent for c in feed(assembler, frames(counter))]
    assert [c.counter for c in cycles] == sent
    assert {c.kind for c in cycles} == {CycleKind.NEW}
    assert assembler.counters == CycleCounters(complete=40)
    for cycle in cycles:
        assert_unmixed(codec, cycle)


def test_a_cycle_cannot_be_changed_and_a_misspelt_counter_is_an_error(
    assembler: Assembler, frames: Frames
) -> None:
    (cycle,) = feed(assembler, frames(5))
    for record, field in ((cycle, "counter"), (assembler.counters, "misspelt")):
        with pytest.raises(AttributeError):
            setattr(record, field, 6)
        assert not hasattr(record, "__dict__")


@pytest.mark.parametrize("missing", range(1, 5))
def test_a_missing_frame_means_no_sample(
    assembler: Assembler, frames: Frames, missing: int
) -> None:
    feed(assembler, frames(1))
    part = frames(2)
    del part[missing]
    assert feed(assembler, part) == []
    assert len(feed(assembler, frames(3))) == 1
    assert assembler.counters.incomplete == 1
    assert assembler.counters.lost == 0


def test_a_missing_sync_loses_the_cycle(assembler: Assembler, frames: Frames) -> None:
    feed(assembler, frames(1))
    assert feed(assembler, frames(2)[1:]) == []
    assert [c.counter for c in feed(assembler, frames(3))] == [3]
    assert assembler.counters.lost == 1
    assert assembler.counters.out_of_order == 4


def test_whole_cycles_lost_are_counted(assembler: Assembler, frames: Frames) -> None:
    feed(assembler, frames(10))
    feed(assembler, frames(30))
    assert assembler.counters.lost == 19


def test_corrupt_frames_update_nothing(assembler: Assembler, frames: Frames, codec: Codec) -> None:
    part = frames(1)
    bad = replace(part[2], intact=False, data=bytes(8))
    assert feed(assembler, [part[0], bad, *part[1:2], *part[3:]]) == []
    assert assembler.counters.corrupt == 1
    (cycle,) = feed(assembler, [part[2], part[0]])
    assert_unmixed(codec, cycle)


def test_a_sync_whose_alive_counter_is_not_its_sample_counter_is_corrupt(
    assembler: Assembler, frames: Frames
) -> None:
    part = frames(1)
    wrong = replace(part[0], alive=2)
    assert feed(assembler, [wrong, *part[1:]]) == []
    assert assembler.counters.corrupt == 1
    assert assembler.counter is None


@pytest.mark.parametrize("protected", [True, False])
def test_frames_before_the_first_sync_are_not_used(
    assembler: Assembler, frames: Frames, protected: bool
) -> None:
    """Unprotected frames have no alive counter that would tell."""
    heard = frames(1)[1:] if protected else [replace(f, alive=None) for f in frames(1)[1:]]
    assert feed(assembler, heard) == []
    assert assembler.counters == CycleCounters(out_of_order=4)


def test_a_repeated_cycle_is_accepted_once_and_counted(
    assembler: Assembler, frames: Frames, codec: Codec
) -> None:
    first = feed(assembler, frames(5))
    again = feed(assembler, frames(5)) + feed(assembler, frames(5))
    assert [c.kind for c in first + again] == [CycleKind.NEW, CycleKind.REPEAT, CycleKind.REPEAT]
    assert again[0].data == first[0].data
    assert assembler.counters == CycleCounters(complete=1, repeated=2, begun_again=2)
    assert feed(assembler, frames(6))[0].kind is CycleKind.NEW
    assert_unmixed(codec, again[0])


@pytest.mark.parametrize("missing", range(1, 5))
def test_a_cycle_of_which_a_frame_is_not_sent_again_is_not_repeated(
    assembler: Assembler, frames: Frames, missing: int
) -> None:
    feed(assembler, frames(5))
    part = frames(5)
    del part[missing]
    assert feed(assembler, part) == []
    assert assembler.counters == CycleCounters(complete=1, begun_again=1)


@pytest.mark.parametrize("heard", [1, 3, 5])
def test_a_second_try_that_was_measured_anew_contradicts_nothing(
    assembler: Assembler, frames: Frames, heard: int
) -> None:
    """Not even where the bus doubles its frames: its own are not those of the first try."""
    true, anew = frames(5), frames(21)  # the same alive counter
    doubled = [frame for frame in anew[1:] for _ in range(2)]
    cycles = feed(assembler, [*true[:heard], true[0], *doubled])
    assert len(cycles) == (2 if heard == 5 else 1)
    assert all(cycles[-1].data[f.name] == f.data for f in true[:heard])
    assert assembler.counters.contradicted == 0
    assert assembler.counters.duplicates == 4


def test_a_repeated_cycle_does_not_change_what_was_accepted(
    assembler: Assembler, frames: Frames, codec: Codec
) -> None:
    first = feed(assembler, frames(5))[0]
    other = [replace(f, data=g.data) for f, g in zip(frames(5), frames(21), strict=True)]
    other[0] = frames(5)[0]
    again = feed(assembler, other)[0]
    assert again.data == first.data
    assert_unmixed(codec, again)


@pytest.mark.parametrize("complete", [False, True])
def test_of_two_different_frames_none_is_used(
    assembler: Assembler, frames: Frames, codec: Codec, complete: bool
) -> None:
    """Another sender's frame under the device's identifier, before the cycle is whole or after."""
    true, false = frames(5), frames(21)  # the same alive counter
    cycle = [*true, false[2]] if complete else [*true[:3], false[2], *true[3:]]
    assert len(feed(assembler, cycle)) == complete
    assert assembler.counters.contradicted == 1
    assert_unmixed(codec, feed(assembler, [*frames(6), frames(7)[0]])[0])


def test_a_contradicted_cycle_may_be_sent_again(
    assembler: Assembler, frames: Frames, codec: Codec
) -> None:
    true, false = frames(5), frames(21)
    assert feed(assembler, [*true[:2], false[2], *true[2:]]) == []
    assert_unmixed(codec, feed(assembler, [*true, true[0]])[0])


@pytest.mark.parametrize("complete", [False, True])
def test_an_intruder_contradicts_once_a_cycle_and_none_of_its_frames_is_kept(
    assembler: Assembler, frames: Frames, codec: Codec, complete: bool
) -> None:
    true, false = frames(5), frames(21)
    heard = 5 if complete else 2
    assert len(feed(assembler, [*true[:heard], *false[1:], *true[heard:]])) == complete
    assert assembler.counters.contradicted == 1
    assert assembler.counters.out_of_order == 3 + 5 - heard
    # The device sends the cycle again, and again.
    assert_unmixed(codec, feed(assembler, [*true, *true])[0])


def test_a_corrupt_sync_after_a_contradiction_is_in_no_sample(
    assembler: Assembler, frames: Frames, codec: Codec
) -> None:
    true, false = frames(5), frames(21)
    wrong = replace(frames(6)[0], alive=true[0].alive)  # counter and alive counter of two cycles
    assert feed(assembler, [*true[:2], false[1], wrong]) == []
    assert assembler.counters == CycleCounters(contradicted=1, corrupt=1)
    assert_unmixed(codec, feed(assembler, [*true, true[0]])[0])


@pytest.mark.parametrize("heard", [2, 3])
def test_two_tries_make_one_sample(assembler: Assembler, frames: Frames, heard: int) -> None:
    part = frames(5)
    assert feed(assembler, part[:heard]) == []
    cycles = feed(assembler, [part[0], *part[heard:], *part[1:heard]])
    assert [c.kind for c in cycles] == [CycleKind.NEW]
    assert assembler.counters == CycleCounters(
        complete=1, incomplete=1, duplicates=heard - 1, begun_again=1
    )


def test_a_sync_frame_that_came_twice_is_no_second_try(
    assembler: Assembler, frames: Frames
) -> None:
    part = frames(5)
    assert len(feed(assembler, [part[0], *part])) == 1
    assert assembler.counters == CycleCounters(complete=1, begun_again=1)


def test_a_frame_twice_is_a_duplicate(assembler: Assembler, frames: Frames) -> None:
    part = frames(5)
    cycles = feed(assembler, [part[0], part[1], part[1], *part[2:], part[4]])
    assert len(cycles) == 1
    assert assembler.counters.duplicates == 2


def test_data_frames_in_any_order_after_the_sync(assembler: Assembler, frames: Frames) -> None:
    part = frames(5)
    assert len(feed(assembler, [part[0], *reversed(part[1:])])) == 1


@pytest.mark.parametrize("late", [40, 39, 25])
def test_a_late_cycle_is_dropped_whole(
    assembler: Assembler, frames: Frames, codec: Codec, late: int
) -> None:
    feed(assembler, frames(40))
    feed(assembler, frames(41)[:2])
    # 16 cycles back (25) the alive counters are those of the present cycle.
    assert feed(assembler, frames(late)) == []
    assert assembler.counters.out_of_order == 5
    cycle = feed(assembler, frames(42))[0]
    assert_unmixed(codec, cycle)
    assert assembler.counters.incomplete == 1
    assert assembler.counters.restarts == 0


@pytest.mark.parametrize("present", [40, 41])
def test_two_late_cycles_around_one_that_is_not_are_no_restart(
    assembler: Assembler, frames: Frames, codec: Codec, present: int
) -> None:
    """Whether that one is new or sent again: the device still counts where it did."""
    feed(assembler, frames(40))
    assert feed(assembler, frames(30)) == []
    assert len(feed(assembler, frames(present))) == 1
    assert feed(assembler, frames(31)) == []
    assert assembler.counters.restarts == 0
    (cycle,) = feed(assembler, frames(present + 1))
    assert (cycle.counter, cycle.kind) == (present + 1, CycleKind.NEW)
    assert_unmixed(codec, cycle)


#: After 49 days at 500 Hz half of what a counter of 32 bits holds is over; the last is 37 h before
#: all of it is.
@pytest.mark.parametrize("before", [1000, 2**31 - 100, 2**31 + 100, 2**32 - 2**26 - 10])
@pytest.mark.parametrize("first", [0, 5])
def test_two_cycles_in_a_row_from_the_past_are_a_restart(
    assembler: Assembler, frames: Frames, codec: Codec, before: int, first: int
) -> None:
    feed(assembler, frames(before))
    assert feed(assembler, frames(first)) == []
    cycles = feed(assembler, frames(first + 1)) + feed(assembler, frames(first + 2))
    assert [c.kind for c in cycles] == [CycleKind.RESTART, CycleKind.NEW]
    assert assembler.counters.restarts == 1
    assert assembler.counters.lost == 0
    assert_unmixed(codec, cycles[0])


@pytest.mark.parametrize(("far", "kind"), [(-1, "new"), (0, "restart")])
def test_what_is_further_ahead_than_37_hours_went_back(
    assembler: Assembler, frames: Frames, far: int, kind: str
) -> None:
    feed(assembler, frames(7))
    next_one = 7 + 2**26 + far
    cycles = feed(assembler, frames(next_one)) + feed(assembler, frames(next_one + 1))
    assert [c.kind.value for c in cycles] == [kind]


@pytest.mark.parametrize("start", [7, 2**32 - 1000])
@pytest.mark.parametrize("ahead", [2**10, 2**10 + 1, 2**26 - 1])
def test_one_sync_frame_far_ahead_is_no_leap_and_two_in_a_row_are(
    assembler: Assembler, frames: Frames, codec: Codec, start: int, ahead: int
) -> None:
    far, sure = (start + ahead) % 2**32, ahead == 2**10
    feed(assembler, frames(start))
    assert len(feed(assembler, frames(far))) == sure
    assert assembler.counters.out_of_order == (0 if sure else 5)
    if not sure:
        # The device goes on where it was: nothing was lost, and the next leap is a first one.
        assert [c.counter for c in feed(assembler, frames(start + 1))] == [start + 1]
        assert assembler.counters.lost == 0
        assert feed(assembler, frames((far + 1) % 2**32)) == []
        ahead += 1
        far = (far + 2) % 2**32
        (cycle,) = feed(assembler, frames(far))
        assert (cycle.counter, cycle.kind) == (far, CycleKind.NEW)
        assert_unmixed(codec, cycle)
    assert assembler.counters.lost == ahead - 1
    assert assembler.counters.restarts == 0


def test_a_restarted_lockstep_device_repeats_its_first_cycle(
    assembler: Assembler, frames: Frames
) -> None:
    feed(assembler, frames(1000))
    feed(assembler, frames(0))
    assert [c.kind for c in feed(assembler, frames(0))] == [CycleKind.RESTART]


@pytest.mark.parametrize("seed", range(20))
def test_no_disorder_ever_gives_a_mixed_sample(
    assembler: Assembler, frames: Frames, codec: Codec, seed: int
) -> None:
    rng = random.Random(seed)
    stream: list[Frame] = []
    for counter in range(100):
        for frame in frames(counter):
            fate = rng.random()
            if fate < 0.05:
                continue
            stream.append(replace(frame, intact=False) if fate < 0.08 else frame)
            if fate > 0.95:
                stream.append(frame)
    for _ in range(30):
        i = rng.randrange(len(stream) - 8)
        stream[i], stream[i + rng.randrange(8)] = stream[i + rng.randrange(8)], stream[i]
    accepted = []
    for cycle in feed(assembler, stream):
        assert_unmixed(codec, cycle)
        if cycle.kind is CycleKind.NEW:
            accepted.append(cycle.counter)
    assert accepted == sorted(set(accepted))
    assert len(accepted) > 30
