"""Inspections of bags in which topics, names or stamps come later or elsewhere than usual."""

from __future__ import annotations

import numpy as np
import pytest

from hydro_ident.bag.recording import read_recording
from hydro_ident.inspection_reading import inspect_bag
from hydro_msgs_docs.topics import CHAMBER_PRESSURES, VALVE_COMMAND, VALVE_STATE

N = 600
START_NS, PERIOD_NS = 1_700_000_000_000_000_000, 2_000_000


def _behind(columns: dict, topic: str) -> tuple[dict, np.ndarray]:
    """All of a topic after everything else, with the stamps of the others."""
    moved = {}
    for name, (names, fields) in columns.items():
        nothing = {n: np.full_like(v, np.nan) for n, v in fields.items()}
        order = (nothing, fields) if name == topic else (fields, nothing)
        moved[name] = names, {n: np.concatenate([o[n] for o in order]) for n in fields}
    stamps = START_NS + PERIOD_NS * np.arange(N)
    return moved, np.concatenate([stamps, stamps])


@pytest.mark.parametrize("topic", [CHAMBER_PRESSURES, VALVE_STATE, VALVE_COMMAND])
def test_a_topic_that_comes_behind_all_others_within_one_stretch(
    write_bag, run_columns, robot, small_blocks, known, topic: str
) -> None:
    """Its first messages are the ones that are older than what was given away."""
    small_blocks(60)
    moved, stamps = _behind(run_columns(N), topic)
    path = write_bag(moved, stamps=stamps, metadata={"robot": "xs031"})
    whole = inspect_bag(path, rows=1 << 40)
    known.clear()
    cut = inspect_bag(path, rows=N + 200, late_s=0.02)
    assert known[-1].whole
    assert repr(cut.as_dict()) == repr(whole.as_dict())
    assert cut.cycles == len(read_recording(path, robot)) == N
