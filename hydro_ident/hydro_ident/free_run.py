"""Free-run validation: the robot rolled out from recorded voltages, against what it really did.

A one-step fit of forces says little about a simulation: errors add up. Here the model gets the
recorded valve voltages (and supply and tank pressure where recorded; the joint torques of joints
without cylinder) and the first sample's state, and nothing else. Both without the errors that the
model's effects say its sensors have, and what it does is compared with those errors put back: what
its sensors would show, against what they showed. Two figures per joint: restarted
every few seconds, and, on bags that were held out whole, over a whole run.

A roll-out that cannot be integrated is rejected and said, never replaced.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from hydro_ident.estimate.derivatives import FilterSettings, motion
from hydro_ident.estimate.held_effects import corrected, sensor_errors
from hydro_ident.estimate.hydraulics import HydraulicFit
from hydro_ident.estimate.scores import HoldOut
from hydro_ident.estimate.traces import Trace
from hydro_ident.rollout_windows import (
    SHORTEST_S,
    Piece,
    rolled_out,
    spread,
    usable_pieces,
    windows,
)
from hydro_model.effects import ActiveEffect, Readings, read_with, resolve
from hydro_model.errors import SimulationError
from hydro_model.robot import FloatArray, Robot

if TYPE_CHECKING:
    from hydro_model.simulate import Rollout

#: Of more windows so many are rolled out, evenly spread; of longer runs the beginning.
MOST_WINDOWS, MOST_WHOLE_S = 200, 600.0


@dataclass(frozen=True, slots=True)
class JointRollout:
    """Roll-out errors of one joint.

    Attributes
    ----------
    joint, unit : str
        `rad` or `m`.
    rmse_before, rmse_after : float or None
        Of the given and of the identified robot over the windows; None where rejected.
    whole_before, whole_after : float or None
        Over whole runs; None where there is none or it was rejected.
    time_s, measured, before, after : (T,) array
        The windows one after the other; NaN where rejected.
    """

    joint: str
    unit: str
    rmse_before: float | None
    rmse_after: float | None
    whole_before: float | None
    whole_after: float | None
    time_s: FloatArray
    measured: FloatArray
    before: FloatArray
    after: FloatArray


@dataclass(frozen=True, slots=True)
class FreeRun:
    """Free-run validation of a robot.

    Attributes
    ----------
    joints : tuple of JointRollout
        Empty where no window could be simulated.
    windows, whole_runs : int
    window_s : float
        Mean length of a window.
    rejected : tuple of str
        What could not be rolled out, and why.
    failed : str
        Why the windows of the identified robot were rejected; empty where they were not.
    """

    joints: tuple[JointRollout, ...]
    windows: int
    whole_runs: int
    window_s: float
    rejected: tuple[str, ...]
    failed: str


def free_run(
    given: Robot,
    identified: Robot | None,
    traces: Sequence[Trace],
    split: HoldOut,
    filters: FilterSettings | None = None,
    why_not: str = "",
) -> FreeRun:
    """Roll both robots out from recorded voltages.

    Parameters
    ----------
    given : Robot
    identified : Robot or None
    traces : sequence of Trace
        As recorded, without signal laws. Of held-out bags, or of the training's own.
    split : HoldOut
        Which blocks of the traces took no part in the fit.
    filters : FilterSettings, optional
        For the velocities at the starts.
    why_not : str
        Why the identified robot is not to be rolled out; empty where it is.

    Returns
    -------
    FreeRun
    """
    filters = filters or FilterSettings()
    whole = [p for t in traces for p in usable_pieces(given, t, filters)]
    pieces = spread([w for piece in whole for w in windows(piece, split)], MOST_WINDOWS)
    if not pieces:
        needed = "valve voltages, pressures (or torques) and positions of every joint"
        reason = f"no free run: it needs {needed}" if traces else "no free run: nothing held out"
        return FreeRun((), 0, 0, 0.0, (reason,), "")
    rejected: list[str] = []
    before, lost = _roll(given, pieces, filters)
    rejected += [f"free run of the given robot rejected: {lost}"] if lost else []
    same = identified is given
    after, failed = (None, why_not)
    if identified is not None and not why_not:
        after, failed = (before, lost) if same else _roll(identified, pieces, filters)
    rejected += [f"free run of the identified robot rejected: {failed}"] if failed else []
    runs = _beginnings(whole) if split.every == 0 else []
    long_before, note = _roll(given, runs, filters)
    rejected += [f"whole free run of the given robot rejected: {note}"] if note else []
    long_after = None
    if identified is not None and not why_not:
        long_after, note = (long_before, note) if same else _roll(identified, runs, filters)
        rejected += [f"whole free run of the identified robot rejected: {note}"] if note else []
    joints = tuple(
        _joint(given, j, (pieces, before, after), (runs, long_before, long_after))
        for j in range(given.dof)
    )
    seconds = sum(p.seconds for p in pieces) / len(pieces)
    hard = f"free run of the identified robot rejected: {failed}" if failed != why_not else ""
    return FreeRun(joints, len(pieces), len(runs), seconds, tuple(rejected), hard)


def no_free_run(robot: Robot, hydraulic: HydraulicFit | None) -> str:
    """Why an identified robot is not to be rolled out; empty where it is."""
    good = {c.cylinder for c in hydraulic.cylinders if not c.rejected} if hydraulic else set()
    bad = [c.name for c in robot.cylinders if c.name not in good]
    return f"hydraulics of {', '.join(bad)} were not identified" if bad else ""


def _beginnings(pieces: Sequence[Piece]) -> list[Piece]:
    """The first `MOST_WHOLE_S` of the pieces, the last one of them cut."""
    kept, left = [], MOST_WHOLE_S
    for piece in pieces:
        length = min(piece.end - piece.begin, round(left / piece.trace.step_s))
        if length < round(SHORTEST_S / piece.trace.step_s):
            break
        kept.append(replace(piece, end=piece.begin + length))
        left -= length * piece.trace.step_s
    return kept


def _roll(
    robot: Robot, pieces: Sequence[Piece], filters: FilterSettings
) -> tuple[list[FloatArray] | None, str]:
    """Joint positions of every piece as the robot's sensors would show them.

    Or why one of the pieces could not be integrated.
    """
    errors, results = sensor_errors(resolve(robot)), list[FloatArray]()
    seen = fixed = None
    for piece in pieces:
        if fixed is None or seen is not piece.trace:
            seen, fixed = piece.trace, _corrected(robot, errors, piece, filters)
        fixed = replace(fixed, begin=piece.begin, end=piece.end, since=piece.since)
        try:
            out = rolled_out(robot, fixed)
        except SimulationError as error:
            return None, f"{piece.where}: {error}"
        results.append(_shown(robot, fixed, out) if errors else out.q)
    return results, ""


def _corrected(
    robot: Robot, errors: Sequence[ActiveEffect], piece: Piece, filters: FilterSettings
) -> Piece:
    """A piece without the errors of its sensors."""
    trace = corrected(robot, errors, piece.trace)
    if np.array_equal(trace.q, piece.trace.q, equal_nan=True):
        return replace(piece, trace=trace)
    _, velocity, _ = motion(trace.q, trace.step_s, filters)
    return replace(piece, trace=trace, velocity=velocity)


def _shown(robot: Robot, piece: Piece, out: Rollout) -> FloatArray:
    """Joint positions of a roll-out over a piece as the robot's encoders would show them."""
    trace, at = piece.trace, slice(piece.begin, piece.end)
    signals = (out.q, out.p_a, out.p_b, out.supply, out.tank)
    true = Readings(trace.step_s, *signals, trace.valve_signal[at], trace.joint_torque[at])
    return read_with(robot, true).q


_Rolled = tuple[Sequence[Piece], list[FloatArray] | None, list[FloatArray] | None]


def _joint(robot: Robot, joint: int, windows: _Rolled, whole: _Rolled) -> JointRollout:
    time_s, measured, before, after = _columns(joint, windows)
    _, real, long_before, long_after = _columns(joint, whole)
    return JointRollout(
        joint=robot.joint_names[joint],
        unit="m" if robot.joints[joint].prismatic else "rad",
        rmse_before=_rmse(measured, before),
        rmse_after=_rmse(measured, after),
        whole_before=_rmse(real, long_before),
        whole_after=_rmse(real, long_after),
        time_s=time_s,
        measured=measured,
        before=before,
        after=after,
    )


def _columns(joint: int, rolled: _Rolled) -> tuple[FloatArray, ...]:
    pieces, before, after = rolled
    if not pieces:
        return (np.zeros(0),) * 4
    time_s = np.concatenate([p.trace.time_s[p.begin : p.end] for p in pieces])
    measured = np.concatenate([p.trace.q[p.begin : p.end, joint] for p in pieces])
    sides = [
        np.full(time_s.size, np.nan) if run is None else np.concatenate([q[:, joint] for q in run])
        for run in (before, after)
    ]
    return time_s, measured, *sides


def _rmse(measured: FloatArray, predicted: FloatArray) -> float | None:
    if not measured.size or not np.isfinite(predicted).all():
        return None
    return float(np.sqrt(np.mean((measured - predicted) ** 2)))
