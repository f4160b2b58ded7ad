"""Sensors that read the same throughout while their joint moves: nothing was measured there.

Many drivers fill `effort` with zeros, and a transducer that is not connected stands at an end of
its scale. The noise of such a reading is none, so that its equations would outweigh all others. A
chamber's pressure that stands still in between may be so: of a cylinder whose other side drives
it, vented or under a constant counter-pressure. `health` tells it all the same.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from hydro_ident.bag.recorded_run import BoolArray, Recording
from hydro_model.joint_ranges import limits
from hydro_msgs_docs.cdr import FloatArray

#: A joint that goes through this share of its range changes what gravity and friction ask for by
#: far more than a torque's or a pressure's resolution.
_MOVES = 0.01


def without_dead(recording: Recording, known: Mapping[str, float]) -> Recording:
    """A recording in which the readings of dead sensors are missing.

    Parameters
    ----------
    recording : Recording
    known : mapping of str to float
        Sensors that were found dead in earlier pieces, and their readings: a sensor that still
        reads so is dead although its joint stands still now.

    Returns
    -------
    Recording
        With the columns NaN, None where no other column of a field has a reading, and with what
        is dead in `dead`.
    """
    dead, fields = dict(known), dict[str, FloatArray]()
    for name, field, column, joint in _sensors(recording):
        values = getattr(recording, field)[:, column]
        there = np.isfinite(values)
        if not there.any() or np.ptp(values[there]) > 0.0:
            continue
        reading = float(values[there][0])
        if field != "effort" and not _at_an_end(recording, reading):
            continue
        if known.get(name) != reading and not _moves(recording, joint, there):
            continue
        dead[name] = reading
        fields.setdefault(field, getattr(recording, field).copy())[:, column] = np.nan
    left: dict[str, Any] = {
        f: None if np.isnan(values).all() else values for f, values in fields.items()
    }
    changed: Recording = replace(recording, dead=dead, **left)
    return changed


def _sensors(recording: Recording) -> Iterator[tuple[str, str, int, int]]:
    """Name, field and column of every sensor of force, and the joint that changes it."""
    robot = recording.robot
    if recording.effort is not None:
        for i, joint in enumerate(robot.joint_names):
            yield f"{joint} effort", "effort", i, i
    for side in "ab":
        if getattr(recording, f"p_{side}") is not None:
            for i, cylinder in enumerate(robot.cylinders):
                at = robot.joint_index(cylinder.joint)
                yield f"{cylinder.name}/{side}", f"p_{side}", i, at


def _at_an_end(recording: Recording, gauge_pa: float) -> bool:
    """Whether a pressure is none, or all that its transducer can show."""
    robot = recording.robot
    nothing = gauge_pa + robot.atmospheric_pressure_pa <= 0.0
    return nothing or gauge_pa >= robot.sensors.pressure_range_pa


def _moves(recording: Recording, joint: int, there: BoolArray) -> bool:
    q = recording.q[there, joint]
    q = q[np.isfinite(q)]
    lower, upper = limits(recording.robot)[joint]
    return q.size > 1 and float(np.ptp(q)) > _MOVES * float(upper - lower)
