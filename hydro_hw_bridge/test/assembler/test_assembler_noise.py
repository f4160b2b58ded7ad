"""Whole cycles while somebody else puts frames beside the device's."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import chain

import pytest

from hydro_hw_bridge.protocol.assembler import Assembler, Cycle, CycleKind
from hydro_hw_bridge.protocol.codec import Codec
from hydro_hw_bridge.protocol.frames import Frame

Frames = Callable[..., list[Frame]]
Hear = Callable[[list[Frame]], list[Cycle]]


@pytest.fixture
def hear(assembler: Assembler) -> Hear:
    """What frames make whole."""
    return lambda frames: [cycle for f in frames if (cycle := assembler.add(f)) is not None]


def _sent(frames: list[Frame]) -> dict[str, bytes]:
    return {frame.name: frame.data for frame in frames}


def _spoilt(frame: Frame) -> Frame:
    return replace(frame, intact=False)


def _another(frame: Frame) -> Frame:
    """Other contents that pass the checks."""
    return replace(frame, data=bytes(b ^ 0x55 for b in frame.data))


def _warned(hear: Hear, frames: Frames, counter: int) -> None:
    """A cycle in which a frame is one too many: it is held itself."""
    part = frames(counter)
    assert hear([*part[:4], _spoilt(part[3]), part[4]]) == []


@pytest.mark.parametrize(
    ("place", "before"),
    [(place, before) for place in (1, 2, 3, 4) for before in (True, False) if place < 4 or before],
)
def test_noise_that_passes_its_check_before_the_devices_frame_is_in_no_sample(
    assembler: Assembler, hear: Hear, frames: Frames, place: int, before: bool
) -> None:
    """What was spoilt before, in front of the device's own frame or behind, had told of it."""
    first, true = frames(5), frames(6)
    noise = _spoilt(first[place])
    at = place if before else place + 1
    heard = hear([*first[:at], noise, *first[at:]])
    others = [f for i, f in enumerate(true) if i != place]
    # All but one of the device's, the noise in its place, and then its own.
    heard += hear([*others, _another(true[place]), true[place]])
    heard += hear(frames(7)) + hear(frames(8))
    assert [c.counter for c in heard] == [5, 7]
    assert assembler.counters.contradicted == 1
    for cycle in heard:
        assert cycle.data == _sent(frames(cycle.counter))


def test_while_others_are_heard_a_cycle_is_given_out_as_the_next_begins(
    assembler: Assembler, hear: Hear, frames: Frames
) -> None:
    _warned(hear, frames, 5)
    assert [c.counter for c in hear(frames(6))] == [5]
    (held,) = hear(frames(7)[:1])
    assert (held.counter, held.kind) == (6, CycleKind.NEW)
    assert held.data == _sent(frames(6))
    assert assembler.counters.held == 2
    assert assembler.counter == 7
    # Also where the next one's sync frame is lost, and of a device that waits for an answer.
    assert hear(frames(7)[1:]) == []
    assert [c.counter for c in hear(frames(9))] == [7]
    assert [(c.counter, c.kind) for c in hear(frames(9))] == [
        (9, CycleKind.NEW), (9, CycleKind.REPEAT),
    ]  # fmt: skip


def test_a_second_without_noise_and_cycles_are_given_out_at_once(
    assembler: Assembler, hear: Hear, frames: Frames
) -> None:
    _warned(hear, frames, 5)
    cycles = [[c.counter for c in hear(frames(5 + k))] for k in range(1, 503)]
    assert cycles[:499] == [[4 + k] for k in range(1, 500)]
    # The last that is held, and the first that is not, are there with one sync frame.
    assert [*chain.from_iterable(cycles)] == list(range(5, 508))
    assert cycles[499:] == [[504, 505], [506], [507]]


@pytest.mark.parametrize("name", range(5))
def test_a_frame_that_is_spoilt_on_its_way_holds_nothing(
    assembler: Assembler, hear: Hear, frames: Frames, name: int
) -> None:
    """It is missing then: there is none too many."""
    for counter in range(1, 40, 2):
        part = frames(counter)
        hear([*part[:name], _spoilt(part[name]), *part[name + 1 :]])
        assert [c.counter for c in hear(frames(counter + 1))] == [counter + 1]
    assert assembler.counters.held == 0


def test_noise_before_the_first_cycle_is_no_part_of_it(
    assembler: Assembler, hear: Hear, frames: Frames
) -> None:
    part = frames(5)
    assert [c.counter for c in hear([_spoilt(part[3]), *part])] == [5]
    assert (assembler.counters.corrupt, assembler.counters.held) == (1, 0)
    lost = frames(6)
    assert hear([_spoilt(frame) for frame in lost]) == []
    assert [c.counter for c in hear(frames(7))] == [7]


@pytest.mark.parametrize("sync", ["there", "lost", "spoilt"])
def test_noise_between_two_cycles_tells_of_others_where_the_next_sync_frame_comes(
    assembler: Assembler, hear: Hear, frames: Frames, sync: str
) -> None:
    """Else it may be the next cycle's own frame."""
    hear(frames(5))
    following = frames(6)
    before = {"there": [], "lost": [], "spoilt": [_spoilt(following[0])]}[sync]
    assert hear([*before, _spoilt(following[3])]) == []
    nexts = following if sync == "there" else frames(7)
    assert [c.counter for c in hear(nexts)] == ([] if sync == "there" else [7])
    assert len(hear(frames(8))) == 1
    assert assembler.counters.held == (sync == "there")


def test_a_repeat_behind_a_spoilt_sync_frame_tells_of_nobody(
    assembler: Assembler, hear: Hear, frames: Frames
) -> None:
    hear(frames(5))
    assert hear([_spoilt(frame) for frame in frames(6)]) == []
    assert [c.counter for c in hear(frames(6))] == [6]
    assert [c.counter for c in hear(frames(7))] == [7]
    assert assembler.counters.held == 0


def test_for_how_many_cycles_whole_ones_are_held_is_given(codec: Codec, frames: Frames) -> None:
    few = Assembler(codec.cycle_frames, codec.sample_counter, 3)
    part = frames(1)
    heard = [few.add(frame) for frame in [*part[:4], _spoilt(part[3]), part[4]]]
    assert heard == [None] * 6
    counts = []
    for counter in range(2, 8):
        counts.append([c.counter for f in frames(counter) if (c := few.add(f)) is not None])
    assert counts == [[1], [2], [3, 4], [5], [6], [7]]


def test_a_device_that_repeats_what_was_spoilt_is_nobody_else(
    assembler: Assembler, hear: Hear, frames: Frames
) -> None:
    for counter in range(1, 20):
        part = frames(counter)
        assert hear([*part[:3], _spoilt(part[3]), part[4]]) == []
        assert [c.counter for c in hear(frames(counter))] == [counter]
    assert assembler.counters.held == 0


def test_of_two_senders_that_contradict_each_other_one_cycle_is_given_out_at_most(
    assembler: Assembler, hear: Hear, frames: Frames
) -> None:
    cycles = []
    for counter in range(5, 50):
        true = frames(counter)
        cycles += hear([*true, _another(true[4])])
    assert [c.counter for c in cycles] == [5]
    assert assembler.counters.contradicted == 45


def test_what_was_held_as_the_device_started_anew_is_given_out_no_more(
    assembler: Assembler, hear: Hear, frames: Frames
) -> None:
    _warned(hear, frames, 500)
    assert [c.counter for c in hear([*frames(501), *frames(0), frames(1)[0]])] == [500]
    cycles = hear([*frames(1)[1:], frames(2)[0]])
    assert [(c.counter, c.kind) for c in cycles] == [(1, CycleKind.RESTART)]


def test_what_comes_behind_a_sync_frame_from_afar_leaves_what_is_held_unlooked_at(
    assembler: Assembler, hear: Hear, frames: Frames
) -> None:
    """Nothing could contradict it: it is dropped."""
    _warned(hear, frames, 500)
    assert [c.counter for c in hear([*frames(501), frames(400)[0], *frames(502)])] == [500]
    assert [c.counter for c in hear(frames(503))] == [502]


def test_a_cycle_of_one_frame_is_whole_with_it(codec: Codec, frames: Frames) -> None:
    alone = Assembler(codec.cycle_frames[:1], codec.sample_counter)
    taken = [alone.add(frames(counter)[0]) for counter in (5, 6, 6)]
    cycles = [cycle for cycle in taken if cycle is not None]
    assert [(c.counter, c.kind.value) for c in cycles] == [(5, "new"), (6, "new"), (6, "repeat")]
