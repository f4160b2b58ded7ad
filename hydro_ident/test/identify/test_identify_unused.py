"""What of the recordings is not used is said: holes in them, and recordings that give nothing."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hydro_ident.bag.recording import Recording
from hydro_ident.bag.streaming import map_columns
from hydro_ident.identify.identification import identify
from hydro_model.robot_files import load_robot

pytestmark = pytest.mark.needs("clarabel")


def short(recording: Recording, seconds: float) -> Recording:
    """The start of a recording, as another one."""
    count = round(seconds / recording.period_s)
    return replace(map_columns(recording, lambda values: values[:count]), path=Path("short"))


@pytest.mark.parametrize(("cycles", "said"), [(2, False), (500, True)])
def test_time_without_readings_is_said_with_the_sensor(
    clean: Any, cycles: int, said: bool
) -> None:
    """A second is left out; two cycles are filled in."""
    whole = clean.recording()
    q = whole.q.copy()
    q[4000 : 4000 + cycles, 0] = np.nan
    found = identify(load_robot("xs031"), [replace(whole, q=q)])
    text = f"1 s are left out, for want of readings (lift position in {cycles} cycles)"
    assert any(note.endswith(text) for note in found.notes) == said
    assert any("are left out, for want" in note for note in found.notes) == said


@pytest.mark.parametrize("seconds", [0.002, 0.5])
def test_a_bag_that_gives_nothing_is_said_with_its_channels(clean: Any, seconds: float) -> None:
    whole = clean.recording()
    found = identify(load_robot("xs031"), [whole, short(whole, seconds)])
    assert found.verdict == "identified"
    [note] = [note for note in found.notes if "nothing of it is fitted in" in note]
    assert note.startswith("short: ")
    for channel in (f"{j}/{k}" for j in ("lift", "tilt") for k in ("force", "flow_a", "flow_b")):
        assert channel in note
    alone = identify(load_robot("xs031"), [whole])
    assert not any("nothing of it is fitted in" in note for note in alone.notes)


def test_a_bag_too_short_for_a_free_run_is_told_how_long_it_takes(clean: Any) -> None:
    """It has voltages, pressures and positions."""
    whole = clean.recording()
    found = identify(load_robot("xs031"), [whole], [short(whole, 0.6)])
    assert found.free_run is not None
    [text] = found.free_run.rejected
    assert text.startswith("no free run: it needs valve voltages")
    assert "held out for 0.5 s on end" in text
