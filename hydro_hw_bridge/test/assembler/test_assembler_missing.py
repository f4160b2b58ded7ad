"""What keeps cycles from being whole, as it is told."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import pytest

from hydro_hw_bridge.protocol.assembler import Assembler
from hydro_hw_bridge.protocol.frames import Frame

Frames = Callable[..., list[Frame]]
NAMES = ("SYNC", "ENCODERS", "PRESSURES_1", "PRESSURES_2", "VALVE_FEEDBACK")


def feed(assembler: Assembler, frames: list[Frame], *without: int) -> None:
    for k, frame in enumerate(frames):
        if k not in without:
            assembler.add(frame)


@pytest.mark.parametrize("first", [0, 1])
def test_it_is_told_by_the_next_cycle_until_one_is_whole(
    assembler: Assembler, frames: Frames, first: int
) -> None:
    """From the very first cycle on, or after whole ones."""
    for counter in range(first):
        feed(assembler, frames(counter))
    assert assembler.missing == ()
    feed(assembler, frames(5), 1, 4)
    feed(assembler, frames(6), 2)
    assert assembler.missing == ("ENCODERS", "VALVE_FEEDBACK") if not first else ("SYNC",)
    feed(assembler, frames(7)[:4])
    assert assembler.missing == ("PRESSURES_1",)
    feed(assembler, frames(8)[:1])
    assert assembler.missing == ("VALVE_FEEDBACK",)
    feed(assembler, frames(8)[1:])
    assert assembler.missing == ()
    feed(assembler, frames(9))
    assert assembler.missing == ()


def test_cycles_whose_sync_frame_is_lost_lack_that(assembler: Assembler, frames: Frames) -> None:
    feed(assembler, frames(1))
    feed(assembler, frames(3)[:2])
    assert assembler.missing == ("SYNC",)
    feed(assembler, frames(4)[:1])
    assert assembler.missing == ("PRESSURES_1", "PRESSURES_2", "VALVE_FEEDBACK")


def test_a_cycle_that_is_begun_again_says_what_it_lacked(
    assembler: Assembler, frames: Frames
) -> None:
    """Not yet whole, or whole and sent again; a sync frame that came twice says nothing new."""
    for _ in range(2):
        feed(assembler, frames(1), 3)
    assert assembler.missing == ("PRESSURES_2",)
    feed(assembler, frames(1)[:1])
    feed(assembler, frames(1)[:1])
    feed(assembler, frames(1))
    assert assembler.missing == ()
    feed(assembler, frames(1), 2)
    assert assembler.missing == ()
    feed(assembler, frames(1), 1)
    assert assembler.missing == ("PRESSURES_1",)
    feed(assembler, frames(1)[:1])
    assert assembler.missing == ("ENCODERS",)
    feed(assembler, frames(1)[:1])
    assert assembler.missing == ("ENCODERS",)
    # Of a repeated one that is not whole the next cycle says nothing: it was whole before.
    feed(assembler, frames(1))
    feed(assembler, frames(1)[:2])
    feed(assembler, frames(2)[:1])
    assert assembler.missing == ()


def test_sync_frames_alone_lack_all_others(assembler: Assembler, frames: Frames) -> None:
    feed(assembler, frames(1))
    for _ in range(3):
        feed(assembler, frames(1)[:1])
    assert assembler.missing == NAMES[1:]
    # One more is a try, and says more once it is begun again.
    feed(assembler, frames(1)[:2])
    feed(assembler, frames(1)[:1])
    assert assembler.missing == NAMES[2:]


def test_of_a_contradicted_cycle_nothing_is_told(assembler: Assembler, frames: Frames) -> None:
    feed(assembler, frames(1))
    part = frames(2)
    feed(assembler, [*part[:2], replace(part[1], data=bytes(8)), *part[2:]])
    feed(assembler, frames(3)[:1])
    assert assembler.counters.contradicted == 1
    assert assembler.missing == ()


def test_whole_cycles_are_counted_those_sent_again_included(
    assembler: Assembler, frames: Frames
) -> None:
    assert assembler.whole == 0
    for counter, whole in ((1, 1), (1, 2), (2, 3)):
        feed(assembler, frames(counter))
        assert assembler.whole == whole
    feed(assembler, frames(3), 1)
    assert assembler.whole == 3
