"""Joints that stand still throughout recordings: which do, and what of them is held.

A joint that hardly moves tells nothing of its own force, as friction hides the rest. What it does
all the same the others feel: a closed cylinder is a spring of oil, on which its joint swings by
milliradians as the arm moves, and inertia makes of that a good part of their forces. So positions
are held, for noise not to pass for motion, only where there is nothing but noise.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from hydro_ident.estimate.signals.signal_survey import SignalSurvey
from hydro_model.robot import FloatArray, Robot

#: A joint that never leaves a band of this many encoder counts stands still, unless it moves more
#: than `MOVING_RANGE` by an encoder that coarse (two neighbours of a count are its flicker); so
#: does one that moves less than `STILL_RANGE`, where friction hides everything else.
STILL_COUNTS, FLICKER_COUNTS = 200.0, 3.0
STILL_RANGE, MOVING_RANGE = 0.01, 0.05
#: What bends no further (`SignalSurvey.largest_bend`) than so many deviations of its encoder's
#: noise shows that, or a drift, alone: white noise bends by six, a flicker between two counts by
#: seven. Beyond, noise is less than a tenth of the squares of a swing.
NOISE_BENDS = 12.0


@dataclass(frozen=True, slots=True)
class Rest:
    """How a joint stands that is still throughout a recording.

    Attributes
    ----------
    at : float
        Its mean position.
    held : bool
        It shows its encoder's noise or a drift alone and is held there, so that this cannot pass
        for motion. Otherwise it gives way, by its oil as a rule: as it does all other joints feel,
        and what its own force then tells is hidden by friction.
    """

    at: float
    held: bool = True


def still_joints(robot: Robot, signals: SignalSurvey) -> tuple[int, ...]:
    """Joints that do not move in anything that was looked at.

    Parameters
    ----------
    robot : Robot
    signals : SignalSurvey

    Returns
    -------
    tuple of int
    """
    travel: FloatArray = signals.high - signals.low
    return tuple(int(i) for i in np.flatnonzero(~(travel >= least_travel(robot))))


def rests_of(signals: SignalSurvey, still: Sequence[int]) -> dict[int, Rest]:
    """How joints stand that are still.

    A closed cylinder is a spring of oil: its joint swings by milliradians as the others move it,
    and their forces are those of an arm that does. Where nothing moves there is no such force.

    Parameters
    ----------
    signals : SignalSurvey
        Of one recording.
    still : sequence of int
        Joints that are still there; all of the robot's where nothing moves.

    Returns
    -------
    dict of int to Rest
    """
    alone, result = len(still) == signals.robot.dof, dict[int, Rest]()
    for joint in still:
        sensor = signals.q[joint]
        noise = sensor.noise(sensor.smallest_change)
        swings = signals.largest_bend(joint) > NOISE_BENDS * noise
        result[joint] = Rest(sensor.mean, alone or not swings)
    return result


def least_travel(robot: Robot) -> FloatArray:
    """Travel of each joint, rad or m, below which it stands still, (n,).

    Parameters
    ----------
    robot : Robot
    """
    steps = robot.encoder_steps
    flickers = np.maximum(MOVING_RANGE, FLICKER_COUNTS * steps)
    return np.maximum(STILL_RANGE, np.minimum(STILL_COUNTS * steps, flickers))


def held_still(q: FloatArray, still: Mapping[int, Rest]) -> FloatArray:
    """Positions with joints that show nothing but noise held where they are.

    Parameters
    ----------
    q : (N, n) array
    still : mapping of int to Rest
        By joint.

    Returns
    -------
    (N, n) array
    """
    q = q.copy()
    for joint, rest in still.items():
        if rest.held:
            q[:, joint] = rest.at
    return q


def giving_way(still: Mapping[int, Rest]) -> list[int]:
    """Joints that stand still, but show more than their encoders' noise.

    Parameters
    ----------
    still : mapping of int to Rest
        By joint.

    Returns
    -------
    list of int
    """
    return [joint for joint, rest in still.items() if not rest.held]
