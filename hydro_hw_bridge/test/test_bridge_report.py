"""What the bridge says of itself in `/diagnostics`."""

from __future__ import annotations

from typing import Any

import pytest

from hydro_hw_bridge.node.bridge_report import inputs
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
