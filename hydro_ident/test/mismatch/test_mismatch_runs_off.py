"""Findings whose model rolls out worse than none are in doubt."""

from __future__ import annotations

import numpy as np
import pytest

from hydro_ident.mismatch.answer.runs_off import runs_off
from hydro_ident.rollouts.free_run import FreeRun, JointRollout

NONE = np.zeros(0)
Pair = tuple[float | None, float | None]


def _run(windows: Pair, whole: Pair) -> FreeRun:
    joint = JointRollout("lift", "rad", *windows, *whole, NONE, NONE, NONE, NONE)
    return FreeRun((joint,), 10, 1, 1.0, (), "")


@pytest.mark.parametrize(
    ("windows", "whole", "told"),
    [
        ((2.4e-4, 2.0e-4), (3.4e-4, 0.166), ["over whole runs"]),
        ((2.4e-4, 1.0e-2), (3.4e-4, 0.166), ["over windows", "over whole runs"]),
        # Better, hardly worse, or by less than anybody sees.
        ((2.4e-4, 2.0e-5), (3.4e-3, 3.4e-4), []),
        ((1.0e-3, 1.9e-3), (1.0e-3, 1.9e-3), []),
        ((1.0e-5, 4.0e-4), (1.0e-5, 4.0e-4), []),
        ((None, None), (None, 1.0), []),
    ],
)
def test_a_roll_out_that_runs_away_is_told(
    windows: Pair,
    whole: Pair,
    told: list[str],
) -> None:
    notes = runs_off(_run(windows, whole))
    assert [note.removeprefix("lift: ").partition(" the model")[0] for note in notes] == told
    assert all("0.166 rad off" in note for note in notes if "whole runs" in note)
