"""Parts of a recording in which what is needed was read in every cycle."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from hydro_ident.bag.grid import runs
from hydro_ident.bag.recording import Recording
from hydro_model.arrays import BoolArray
from hydro_model.robot import FloatArray

#: A sensor that is missing for this share of a recording is left out instead of all others.
LONG_LOSS = 0.2
#: ... and where it comes or goes for as long as this (s) the recording is cut: filters that settle
#: for 0.6 s at both ends of a part are worth its channels.
_LONG_RUN_S = 3.0


def _watched(recording: Recording) -> list[FloatArray]:
    """Readings, one column per sensor, without which forces and flows are not known."""
    every = (recording.p_a, recording.p_b, _used_efforts(recording))
    return [values for values in every if values is not None]


def borders_of(recording: Recording) -> list[int]:
    """Cycles at which a sensor comes or goes for long that is missing in much of the recording.

    Parameters
    ----------
    recording : Recording

    Returns
    -------
    list of int
        Ascending.
    """
    least, found = max(1, round(_LONG_RUN_S / recording.period_s)), set[int]()
    for column in (c for values in _watched(recording) for c in values.T):
        gone = np.isnan(column)
        if not LONG_LOSS <= gone.mean() < 1.0:
            continue
        off = [run for run in runs(gone) if run[1] - run[0] >= least]
        edges = [edge for run in off for edge in run if least <= edge <= gone.size - least]
        # Between two losses it has to be there as long.
        short = [k for k in range(len(edges) - 1) if edges[k + 1] - edges[k] < least]
        found |= {e for k, e in enumerate(edges) if k not in short and k - 1 not in short}
    return sorted(found)


def parts_of(recording: Recording, borders: Sequence[int]) -> list[slice]:
    """Contiguous stretches whose positions, pressures and torques are there in every cycle.

    A sensor that is missing for long takes its own channels away, not those of the others.

    Parameters
    ----------
    recording : Recording
    borders : sequence of int
        Of `borders_of`.

    Returns
    -------
    list of slice
        In order, of at least two cycles each.
    """
    known = np.isfinite(recording.q)
    usable: BoolArray = np.asarray(known[:, known.any(axis=0)].all(axis=1))
    parts = [slice(*ends) for ends in pairwise((0, *borders, len(recording)))]
    for values in _watched(recording):
        for part in parts:
            known = np.isfinite(values[part])
            usable[part] &= known[:, (~known).mean(axis=0) < LONG_LOSS].all(axis=1)
    cut = [
        slice(max(segment.start, part.start), min(segment.stop, part.stop))
        for segment in recording.segments
        for part in parts
        if segment.start < part.stop and part.start < segment.stop
    ]
    return [
        slice(one.start + begin, one.start + end)
        for one in cut
        for begin, end in runs(usable[one])
        if end - begin >= 2
    ]


def _used_efforts(recording: Recording) -> FloatArray | None:
    """Measured torques that an equation uses: those of joints without pressures."""
    if recording.effort is None or (recording.p_a is None and recording.p_b is None):
        return recording.effort
    return recording.effort[:, list(recording.robot.dry_joints)]
