"""An assembler of the shipped layout, and the frames of any cycle."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from hydro_hw_bridge.protocol.assembler import Assembler
from hydro_hw_bridge.protocol.codec import Codec
from hydro_hw_bridge.protocol.frames import Frame, Readings

Make = Callable[..., Readings]


@pytest.fixture
def assembler(codec: Codec) -> Assembler:
    return Assembler(codec.cycle_frames, codec.sample_counter)


@pytest.fixture
def frames(codec: Codec, readings: Make) -> Callable[..., list[Frame]]:
    """The frames of a cycle; the lift pressure tells the cycles apart."""

    def make(counter: int) -> list[Frame]:
        mark = 500.0 * (counter % 1000)
        values = readings(
            counter,
            positions=(counter % 1000 * 1e-3, counter % 1000 * 1e-3),
            pressures_pa=(mark, mark, mark, mark, mark, mark),
        )
        received = [codec.receive(message) for message in codec.encode_cycle(values)]
        return [frame for frame in received if frame is not None]

    return make
