"""Angles that were recorded within a turn, as in (-pi, pi], run on across its ends.

A joint that passes the end of the turn leaps by 2 pi: no motion, though derivatives would take it
for one. Gravity and levers know no whole turns, so that it does not matter which of them an angle
is in. What happened in long holes is not known; nothing is undone across them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from hydro_model.arrays import FloatArray, IntArray
from hydro_model.robot import Robot

TURN = 2.0 * math.pi
#: A leap is one of a turn where it misses 2 pi by no more than this share.
_MISSES = 0.15
#: Longest time between two readings that tell of a leap: no joint of a crane goes so far in it.
_LONGEST_NS = 250_000_000

#: By joint: stamps from which on it has passed the end of the turn, and by which way, (K, 2).
Turns = Mapping[str, IntArray]


def without_turns(
    robot: Robot, stamp_ns: IntArray, q: FloatArray, earlier: Turns
) -> tuple[FloatArray, Turns]:
    """Joint positions that run on where joints pass the end of the turn.

    Parameters
    ----------
    robot : Robot
    stamp_ns : (N,) int array
    q : (N, n) array
        As recorded, NaN where nothing was read.
    earlier : mapping of str to (K, 2) int array
        What was found in earlier pieces of the bag, which may overlap this one.

    Returns
    -------
    q : (N, n) array
    turns : mapping of str to (K, 2) int array
        Those of the earlier pieces and of this one.
    """
    result, found = q, dict(earlier)
    for i, joint in enumerate(robot.joints):
        if joint.prismatic:
            continue
        before = found.get(joint.name, np.zeros((0, 2), dtype=np.int64))
        # What came late may have changed what was found behind the first of these stamps.
        before = before[before[:, 0] <= stamp_ns[0]]
        turns = np.concatenate([before, _leaps(stamp_ns, q[:, i])])
        found.pop(joint.name, None)
        if len(turns):
            found[joint.name] = turns
            result = q.copy() if result is q else result
            sums = np.concatenate([[0], np.cumsum(turns[:, 1])])
            result[:, i] += TURN * sums[np.searchsorted(turns[:, 0], stamp_ns, side="right")]
    return result, found


def _leaps(stamp_ns: IntArray, q: FloatArray) -> IntArray:
    known = np.flatnonzero(np.isfinite(q))
    step, apart = np.diff(q[known]), np.diff(stamp_ns[known])
    leaps = (np.abs(np.abs(step) - TURN) <= _MISSES * TURN) & (apart <= _LONGEST_NS)
    # Up by a turn is on downwards.
    ways = -np.sign(step[leaps]).astype(np.int64)
    return np.stack([stamp_ns[known[1:][leaps]], ways], axis=1)


def nearest_turn(
    robot: Robot, q: FloatArray, q_ref: FloatArray | None, turns: Turns
) -> FloatArray | None:
    """References by the whole turns that bring them to where their joint is.

    Parameters
    ----------
    robot : Robot
    q : (N, n) array
        Without leaps.
    q_ref : (N, n) array or None
    turns : mapping of str to (K, 2) int array
        Of joints that were recorded within a turn; the references of others stay.
    """
    columns = [robot.joint_index(joint) for joint in turns]
    if q_ref is None or not columns:
        return q_ref
    result = q_ref.copy()
    apart = np.nan_to_num(q[:, columns] - q_ref[:, columns])
    result[:, columns] += TURN * np.round(apart / TURN)
    return result


def turn_notes(turns: Turns) -> list[str]:
    """In words, where angles were recorded within a turn."""
    return [
        f"{joint} was recorded within a turn: {len(found)} leaps by 2 pi taken out"
        for joint, found in turns.items()
    ]
