"""What is named and takes next to nothing out of what is left at the sensors' noise."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from hydro_ident.mismatch.answer.hardly_shows import hardly_notes, parted_hardly

FLOW_A, FLOW_B = "lift/flow_a", "lift/flow_b"
ROWS = 1500


def _work() -> Any:
    channel = np.repeat([0, 1], ROWS)
    material = SimpleNamespace(channel=channel, channels=(FLOW_A, FLOW_B))
    predictor = SimpleNamespace(material=material)
    mask = np.ones(2 * ROWS, dtype=bool)
    return SimpleNamespace(training=SimpleNamespace(predictor=predictor, mask=mask))


def _finding(gain: float, *after: float, silent: bool = False) -> Any:
    names = (FLOW_A, FLOW_B)[: len(after)]
    term = SimpleNamespace(effect=SimpleNamespace(name="supply_droop"), target="xs031")
    checked = SimpleNamespace(
        silent=silent,
        before=dict.fromkeys(names, 1.0),
        after=dict(zip(names, after, strict=True)),
        gain=gain,
    )
    # What it gained when it was named, before the others were, is another thing.
    named = SimpleNamespace(gain=4000.0, term=term)
    return SimpleNamespace(named=named, verification=checked, channels=names)


def _channels(*at_noise: bool) -> Any:
    return [
        SimpleNamespace(name=name, at_noise=quiet)
        for name, quiet in zip((FLOW_A, FLOW_B), at_noise, strict=True)
    ]


@pytest.mark.parametrize(
    ("finding", "quiet", "shows"),
    [
        (_finding(60.0, 0.999, 0.998), (True, True), False),
        # In one of its channels it does.
        (_finding(60.0, 0.999, 0.98), (True, True), True),
        # Held-out rows move too slowly for what training rows tell by far.
        (_finding(400.0, 0.999, 0.998), (True, True), True),
        # The same gain, of half as many rows.
        (_finding(100.0, 0.999), (True, True), True),
        (_finding(60.0, 0.999), (True, True), False),
        # What is left there is more than noise: something else may hide it.
        (_finding(60.0, 0.999, 0.998), (True, False), True),
        (_finding(60.0, 1.001, 1.0, silent=True), (True, True), True),
    ],
)
def test_what_takes_hardly_anything_out_is_a_note(
    finding: Any, quiet: tuple[bool, bool], shows: bool
) -> None:
    kept, hardly = parted_hardly(_work(), [finding], _channels(*quiet))
    assert (kept, hardly) == (([finding], []) if shows else ([], [finding]))


def test_the_note_says_where() -> None:
    (note,) = hardly_notes([_finding(60.0, 0.999)])
    assert note.startswith("supply_droop of xs031 is there or something like it, but takes less")
    assert FLOW_A in note
    assert FLOW_B not in note
