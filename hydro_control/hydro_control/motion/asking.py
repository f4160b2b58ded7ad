"""What is asked of the reference beside the thread of the samples: checked, then handed over.

A check takes up to seconds. It ends as soon as a stop is asked for, or the reference is set anew:
what was checked would not be played any more, and the next one waits for it.
`hydro_control.motion.reference_run.Standing` tells where it was asked for from.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Literal

from hydro_control.errors import ControlError
from hydro_control.motion.reference_run import Asked, ReferenceRun, Standing
from hydro_control.motion.trajectory import Waypoint
from hydro_model.errors import HydroError, in_short
from hydro_model.motion.paths import JointPath, TipPath

#: A trajectory may ask to begin this long after the newest sample, s: long enough for several
#: machines to begin together. More is a stamp of another clock, or of one that was put forward:
#: the arm would begin by itself when everybody has forgotten.
MOST_AHEAD_S = 10.0
#: Longest trajectory, and its most points: no other is heard while it is checked.
LONGEST_S, MOST_POINTS = 600.0, 5000


def ask_path(run: ReferenceRun, path: TipPath | JointPath, delay_s: float) -> None:
    """Check the path that waits, and have it played from the next sample on.

    Where the reference was set anew meanwhile nothing happens, and the path may still wait; nor
    does it where a stop was asked for, which ends the path's waiting.

    Parameters
    ----------
    run : ReferenceRun
    path : TipPath or JointPath
    delay_s : float
        Hold before it.

    Raises
    ------
    ControlError
        It is refused from where the reference stands still: why.
    """
    standing = run.standing
    if not run.path_waits or run.pending is not None:
        return
    go_on = partial(_refuse_overtaken, standing)
    try:
        plan = run.player.plan_path(path, run.now_s, run.q, delay_s, go_on=go_on)
    # Whatever it is, the arm is held on: a path that waits on would be checked for ever.
    except Exception as error:
        if standing.overtaken:
            return
        run.path_waits = False
        raise ControlError(_why(error)) from error
    if run.path_waits and not standing.overtaken:
        run.pending = Asked(plan, standing.epoch, standing.stops, of_path=True)


def ask_trajectory(
    standing: Standing,
    space: Literal["tip", "joint"],
    names: Sequence[str],
    waypoints: Sequence[Waypoint],
    start_ns: int,
) -> None:
    """Have a trajectory played from the next sample on.

    Parameters
    ----------
    standing : Standing
        When it was asked for, which may be before its turn to be checked came.
    space : {"tip", "joint"}
    names : sequence of str
    waypoints : sequence of Waypoint
    start_ns : int
        Stamp to start at, up to `MOST_AHEAD_S` after the newest sample's; 0 for now. An
        approach to the first point ends there.

    Raises
    ------
    ControlError, RobotError
        It is refused: why.
    """
    run = standing.run
    _refuse_occupied(run)
    start_s = run.since_first_s(start_ns) if start_ns else None
    wait_s = 0.0 if start_s is None else start_s - run.now_s
    _refuse_long(waypoints)
    _refuse_start(wait_s)
    at, go_on = (run.now_s, run.q, start_s), partial(_refuse_overtaken, standing)
    plan = run.player.plan_trajectory(space, names, waypoints, *at, go_on)
    if plan.start_s is not None and plan.start_s < run.now_s:
        raise ControlError(
            f"it should have begun {run.now_s - plan.start_s:.3f} s ago, as it took so long"
            " to check it: ask for it earlier"
        )
    asked = run.pending = Asked(plan, standing.epoch, standing.stops)
    # Looked at after it was handed over: what comes later finds it, and drops it. Or a sample has
    # played it since, and may have stopped it again: that overtakes its check, and not it.
    if standing.overtaken and run.played is not asked:
        if run.pending is asked:
            run.pending = None  # refused here: no sample has to say that it is not played
        _refuse_overtaken(standing)


def _refuse_overtaken(standing: Standing) -> None:
    """Refuse what would not be played any more, however far its check has come."""
    if not standing.overtaken:
        return
    if standing.run.over:
        raise ControlError("the controller began anew while it was checked: ask again")
    if standing.run.stops != standing.stops:
        raise ControlError("a stop was asked for while it was checked")
    raise ControlError("the reference was set anew while it was checked: ask again")


def _refuse_occupied(run: ReferenceRun) -> None:
    """Refuse where nothing is driven, or another motion comes first."""
    if run.following:
        raise ControlError(run.following)
    if run.path_waits:
        raise ControlError(
            "the controller's own path is being checked: wait, or stop it with an empty"
            " trajectory (send_path --stop)"
        )
    waiting = run.pending
    if waiting is not None and run.is_playable(waiting):
        raise ControlError(
            "another motion was accepted and begins with the next sample: wait, or stop it"
            " with an empty trajectory (send_path --stop)"
        )


def _refuse_long(waypoints: Sequence[Waypoint]) -> None:
    if len(waypoints) > MOST_POINTS or waypoints[-1].time_s > LONGEST_S:
        raise ControlError(
            f"expected at most {MOST_POINTS} points over {LONGEST_S:g} s, found"
            f" {len(waypoints)} over {waypoints[-1].time_s:g} s: send it in parts, or give it"
            " as the controller's path"
        )


def _refuse_start(wait_s: float) -> None:
    """Refuse to start in the past, or when everybody has forgotten."""
    if wait_s < 0.0:
        raise ControlError(f"it should start now or later, found {-wait_s:.3f} s ago")
    if wait_s > MOST_AHEAD_S:
        raise ControlError(
            f"it should start within {MOST_AHEAD_S:g} s of the newest sample, found"
            f" {wait_s:.3f} s ahead: give the time of a sample's stamp, or 0 for now"
        )


def _why(error: Exception) -> str:
    """What was raised on purpose in its own words, anything else in short."""
    return str(error) if isinstance(error, HydroError) else in_short(error)
