"""What the bridge says of itself in `/diagnostics`."""

from __future__ import annotations

from typing import Any

import pytest

from hydro_hw_bridge.core.bridge_turns import SILENT_S
from hydro_hw_bridge.node.bridge_report import ERROR, inputs, summary
from hydro_hw_bridge.protocol.mapping import PERMISSIVES


@pytest.mark.parametrize("bit", PERMISSIVES)
def test_a_switch_is_seen_before_anything_drives(real_time: Any, bit: str) -> None:
    assert set(inputs(real_time.core).values()) == {None}
    real_time.cycle(3)
    assert {inputs(real_time.core)[f"input_{name}"] for name in PERMISSIVES} == {"on"}
    real_time.cycle(4, **{bit: False})
    found = inputs(real_time.core)
    assert [name for name in PERMISSIVES if found[f"input_{name}"] == "off"] == [bit]
    assert found["input_amplifier_watchdog"] == "off"


@pytest.mark.parametrize(
    ("lost", "said"),
    [((1,), "frame ENCODERS missing"), ((1, 3), "frames ENCODERS, PRESSURES_2 missing")],
)
def test_a_device_of_which_no_cycle_is_whole_is_an_error_that_says_what_is_missing(
    real_time: Any, lost: tuple[int, ...], said: str
) -> None:
    core, codec = real_time.core, real_time.codec
    for counter in range(1, 4):
        for k, message in enumerate(codec.encode_cycle(real_time.readings(counter))):
            if k not in lost:
                core.receive(codec.receive(message), 0)
    text = f"no whole cycle for {SILENT_S:g} s: {said}"
    for _ in range(2):  # inactive and active
        assert summary(core, [], silent=False, lacking=True) == (ERROR, text)
        assert summary(core, [], silent=False)[0] != ERROR
        core.activate(ready=True)
    core.gate.trip("test")
    assert summary(core, [], silent=False, lacking=True) == (ERROR, "tripped: test")


def test_nothing_is_said_of_frames_where_none_was_missing(real_time: Any) -> None:
    real_time.cycle(1)
    text = f"no whole cycle for {SILENT_S:g} s"
    assert summary(real_time.core, [], silent=False, lacking=True) == (ERROR, text)
