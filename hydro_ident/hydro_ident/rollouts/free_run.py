"""Free-run validation: the robot rolled out from recorded voltages, against what it really did.

A one-step fit of forces says little about a simulation: errors add up. Here the model gets the
recorded valve voltages (and supply and tank pressure and the oil's temperature where recorded; the
joint torques of joints without cylinder) and the first sample's state, and nothing else. Both
without the errors that the model's effects say its sensors have, and what it does is compared with
those errors put back: what its sensors would show, against what they showed. Two figures per
joint: restarted every few seconds, and, on bags that were held out whole, over a whole run.

No window has a piston at a stop, which no model has. A robot that cannot be rolled out over what
is left is rejected; where that is one window in very many, it is left out for both robots. All of
it is said, and nothing replaced.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from hydro_ident.estimate.effects.held_effects import corrected, sensor_errors
from hydro_ident.estimate.flows.hydraulics import HydraulicFit
from hydro_ident.estimate.scoring.scores import HoldOut
from hydro_ident.estimate.signals.derivatives import FilterSettings, motion
from hydro_ident.estimate.signals.traces import Trace
from hydro_ident.rollouts.rollout_windows import (
    SHORTEST_S,
    Piece,
    at_stops,
    rolled_out,
    spread,
    usable_pieces,
    windows,
)
from hydro_model.arrays import BoolArray
from hydro_model.effects import ActiveEffect, Readings, read_with, resolve
from hydro_model.errors import SimulationError
from hydro_model.robot import FloatArray, Robot

if TYPE_CHECKING:
    from hydro_model.simulation.simulate import Rollout

#: Of more windows so many are rolled out, evenly spread; of longer runs the beginning.
MOST_WINDOWS, MOST_WHOLE_S = 200, 600.0
#: A robot that cannot be rolled out over more than this share of the windows is rejected: what is
#: left would flatter it.
MOST_LOST = 0.05


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
        That were rolled out.
    window_s : float
        Mean length of a window.
    rejected : tuple of str
        What could not be rolled out, and why.
    failed : str
        Why the identified robot was rejected over the windows; empty where it was not.
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
    stops = _stop_notes(given, traces)
    if not pieces:
        needed = (
            "valve voltages, pressures (or torques) and positions of every joint, held out for"
            f" {SHORTEST_S:g} s on end beside the filters' reach"
        )
        reason = f"no free run: it needs {needed}" if traces else "no free run: nothing held out"
        return FreeRun((), 0, 0, 0.0, (reason, *stops), "")
    robots = (given, None if why_not else identified)
    short = _both(robots, pieces, filters, "free run")
    runs = _both(robots, _beginnings(whole) if split.every == 0 else [], filters, "whole free run")
    not_run = [f"free run of the identified robot rejected: {why_not}"] if why_not else []
    kept = short.pieces
    return FreeRun(
        tuple(_joint(given, j, short, runs) for j in range(given.dof)),
        len(kept),
        len(runs.pieces),
        sum(p.seconds for p in kept) / max(len(kept), 1),
        (*stops, *short.notes, *not_run, *runs.notes),
        short.failed,
    )


def _stop_notes(robot: Robot, traces: Sequence[Trace]) -> list[str]:
    """For how long roll-outs were left out because a piston was at a stop."""
    seconds = sum(float(at_stops(robot, t).sum()) * t.step_s for t in traces)
    if not seconds:
        return []
    return [f"free run: {seconds:.1f} s about stops of a piston left out: no model has stops"]


def no_free_run(robot: Robot, hydraulic: HydraulicFit | None) -> str:
    """Why an identified robot is not to be rolled out; empty where it is."""
    fits = {c.cylinder: c for c in hydraulic.cylinders if not c.rejected} if hydraulic else {}
    bad = [c.name for c in robot.cylinders if c.name not in fits]
    half = [name for name, fit in fits.items() if fit.unfitted]
    said = [f"hydraulics of {', '.join(bad)} were not identified"] if bad else []
    if half:
        said.append(f"hydraulics of {', '.join(half)} were identified of one chamber alone")
    return "; ".join(said)


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


@dataclass(frozen=True, slots=True)
class _Rolled:
    """Pieces with what both robots make of them; None of one that is not rolled out."""

    pieces: Sequence[Piece]
    before: Sequence[FloatArray] | None
    after: Sequence[FloatArray] | None
    notes: tuple[str, ...]
    failed: str


def _both(
    robots: tuple[Robot, Robot | None],
    pieces: Sequence[Piece],
    filters: FilterSettings,
    what: str,
) -> _Rolled:
    """Both robots over those of the pieces over which neither of them fails.

    A robot that fails over more than few of them is rejected instead.
    """
    given, identified = robots
    sides = [_roll(given, pieces, filters)]
    if identified is not None:
        sides.append(sides[0] if identified is given else _roll(identified, pieces, filters))
    notes, failed, kept = list[str](), "", np.ones(len(pieces), dtype=np.bool_)
    rolled = list[list[FloatArray | None]]()
    for name, (found, why) in zip(("given", "identified"), sides, strict=False):
        done = np.array([q is not None for q in found], dtype=np.bool_)
        lost = int(np.sum(~done))
        if lost > MOST_LOST * len(pieces):
            notes.append(f"{what} of the {name} robot rejected: {why}")
            failed = notes[-1] if name == "identified" else ""
            found = []
        elif lost:
            notes.append(
                f"{what}: {lost} of {len(pieces)} windows left out, over which the {name} robot"
                f" cannot be rolled out; {why}"
            )
            kept &= done
        rolled.append(found)
    own = [p for p, keep in zip(pieces, kept, strict=True) if keep]
    before, after = (_kept(found, kept) for found in (*rolled, [])[:2])
    return _Rolled(own, before, after, tuple(notes), failed)


def _kept(found: Sequence[FloatArray | None], kept: BoolArray) -> list[FloatArray] | None:
    """Roll-outs of the windows that are kept; None where there are none."""
    if not found:
        return None
    return [q for q, keep in zip(found, kept, strict=True) if keep and q is not None]


def _roll(
    robot: Robot, pieces: Sequence[Piece], filters: FilterSettings
) -> tuple[list[FloatArray | None], str]:
    """Joint positions of every piece as the robot's sensors would show them.

    None where it cannot be integrated, with why not the first time.
    """
    errors, results, why = sensor_errors(resolve(robot)), list[FloatArray | None](), ""
    seen = fixed = None
    for piece in pieces:
        if fixed is None or seen is not piece.trace:
            seen, fixed = piece.trace, _corrected(robot, errors, piece, filters)
        fixed = replace(fixed, begin=piece.begin, end=piece.end, since=piece.since)
        try:
            out = rolled_out(robot, fixed)
        except SimulationError as error:
            results.append(None)
            why = why or f"{piece.where}: {error}"
            continue
        results.append(_shown(robot, fixed, out) if errors else out.q)
    return results, why


def _corrected(
    robot: Robot, errors: Sequence[ActiveEffect], piece: Piece, filters: FilterSettings
) -> Piece:
    """A piece without the errors of its sensors."""
    trace = corrected(robot, errors, piece.trace)
    if np.array_equal(trace.q, piece.trace.q, equal_nan=True):
        return replace(piece, trace=trace)
    _, velocity, _ = motion(trace.q, trace.step_s, filters.borne_at(trace.step_s))
    return replace(piece, trace=trace, velocity=velocity)


def _shown(robot: Robot, piece: Piece, out: Rollout) -> FloatArray:
    """Joint positions of a roll-out over a piece as the robot's encoders would show them."""
    trace, at = piece.trace, slice(piece.begin, piece.end)
    signals = (out.q, out.p_a, out.p_b, out.supply, out.tank)
    true = Readings(trace.step_s, *signals, trace.valve_signal[at], trace.joint_torque[at])
    return read_with(robot, true).q


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
    pieces = rolled.pieces
    if not pieces:
        return (np.zeros(0),) * 4
    time_s = np.concatenate([p.trace.time_s[p.begin : p.end] for p in pieces])
    measured = np.concatenate([p.trace.q[p.begin : p.end, joint] for p in pieces])
    sides = [
        np.full(time_s.size, np.nan) if run is None else np.concatenate([q[:, joint] for q in run])
        for run in (rolled.before, rolled.after)
    ]
    return time_s, measured, *sides


def _rmse(measured: FloatArray, predicted: FloatArray) -> float | None:
    if not measured.size or not np.isfinite(predicted).all():
        return None
    return float(np.sqrt(np.mean((measured - predicted) ** 2)))
