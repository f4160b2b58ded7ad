"""Free-run validation: the robot rolled out from recorded voltages, against what it really did.

A one-step fit of forces says little about a simulation: errors add up. Here the model gets the
recorded valve voltages (and supply and tank pressure where recorded; the joint torques of joints
without cylinder) and the first sample's state, and nothing else. Two figures per joint: restarted
every few seconds, and, on bags that were held out whole, over a whole run.

A roll-out that cannot be integrated is rejected and said, never replaced.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from hydro_ident.estimate.derivatives import FilterSettings, motion
from hydro_ident.estimate.hydraulics import HydraulicFit
from hydro_ident.estimate.rows import BoolArray
from hydro_ident.estimate.scores import HoldOut
from hydro_ident.estimate.traces import Trace
from hydro_model.errors import SimulationError
from hydro_model.robot import FloatArray, Robot

#: A roll-out is restarted after at most this long; shorter pieces than `SHORTEST_S` say nothing.
WINDOW_S, SHORTEST_S = 3.0, 0.5
#: Of more windows so many are rolled out, evenly spread; of longer runs the beginning.
MOST_WINDOWS, MOST_WHOLE_S = 200, 600.0
#: Samples at the ends of a trace whose velocity the filter does not know well.
_EDGE_S = 0.1


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


@dataclass(frozen=True, slots=True)
class _Piece:
    """Samples of a trace to roll out from the first on."""

    trace: Trace
    begin: int
    end: int
    velocity: FloatArray

    @property
    def where(self) -> str:
        name = self.trace.label.rsplit("#", 1)[0]
        return f"{name} from {self.trace.time_s[self.begin]:.2f} s on"


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
    whole = [p for t in traces for p in _usable(given, t, filters)]
    pieces = _spread([w for piece in whole for w in _windows(piece, split)])
    if not pieces:
        needed = "valve voltages, pressures (or torques) and positions of every joint"
        reason = f"no free run: it needs {needed}" if traces else "no free run: nothing held out"
        return FreeRun((), 0, 0, 0.0, (reason,), "")
    rejected: list[str] = []
    before, lost = _roll(given, pieces)
    rejected += [f"free run of the given robot rejected: {lost}"] if lost else []
    same = identified is given
    after, failed = (None, why_not)
    if identified is not None and not why_not:
        after, failed = (before, lost) if same else _roll(identified, pieces)
    rejected += [f"free run of the identified robot rejected: {failed}"] if failed else []
    runs = _beginnings(whole) if split.every == 0 else []
    long_before, note = _roll(given, runs)
    rejected += [f"whole free run of the given robot rejected: {note}"] if note else []
    long_after = None
    if identified is not None and not why_not:
        long_after, note = (long_before, note) if same else _roll(identified, runs)
        rejected += [f"whole free run of the identified robot rejected: {note}"] if note else []
    joints = tuple(
        _joint(given, j, (pieces, before, after), (runs, long_before, long_after))
        for j in range(given.dof)
    )
    seconds = sum((p.end - p.begin) * p.trace.step_s for p in pieces) / len(pieces)
    hard = f"free run of the identified robot rejected: {failed}" if failed != why_not else ""
    return FreeRun(joints, len(pieces), len(runs), seconds, tuple(rejected), hard)


def no_free_run(robot: Robot, hydraulic: HydraulicFit | None) -> str:
    """Why an identified robot is not to be rolled out; empty where it is."""
    good = {c.cylinder for c in hydraulic.cylinders if not c.rejected} if hydraulic else set()
    bad = [c.name for c in robot.cylinders if c.name not in good]
    return f"hydraulics of {', '.join(bad)} were not identified" if bad else ""


def _usable(robot: Robot, trace: Trace, filters: FilterSettings) -> list[_Piece]:
    """Stretches of a trace in which everything that a roll-out needs was recorded."""
    from hydro_ident.bag.grid import runs

    known: BoolArray = np.asarray(np.isfinite(trace.q).all(axis=1))
    for values in (trace.valve_signal, trace.p_a, trace.p_b):
        known = np.asarray(known & np.isfinite(values).all(axis=1))
    dry = trace.joint_torque[:, list(robot.dry_joints)]
    known = np.asarray(known & np.isfinite(dry).all(axis=1))
    if not known.any() or not np.isfinite(trace.q).all():
        return []
    if trace.samples * trace.step_s < SHORTEST_S + 2.0 * _EDGE_S:
        return []
    _, velocity, _ = motion(trace.q, trace.step_s, filters)
    edge = math.ceil(_EDGE_S / trace.step_s)
    known[:edge] = known[trace.samples - edge :] = False
    least = round(SHORTEST_S / trace.step_s)
    return [_Piece(trace, a, b, velocity) for a, b in runs(known) if b - a >= least]


def _windows(piece: _Piece, split: HoldOut) -> list[_Piece]:
    """Held-out stretches of a piece in equal parts of at most `WINDOW_S`."""
    from hydro_ident.bag.grid import runs

    trace = piece.trace
    mask = np.ones(piece.end - piece.begin, dtype=bool)
    if split.every:
        block = split.block_s[trace.label.rsplit("#", 1)[0]]
        index = np.floor(trace.time_s[piece.begin : piece.end] / block).astype(int)
        mask = np.asarray(index % split.every == split.every - 1)
    least = round(SHORTEST_S / trace.step_s)
    found = []
    for a, b in runs(mask):
        count = max(1, math.ceil((b - a) * trace.step_s / WINDOW_S))
        ends = np.linspace(a, b, count + 1).round().astype(int) + piece.begin
        found += [
            _Piece(trace, int(s), int(e), piece.velocity)
            for s, e in pairwise(ends)
            if e - s >= least
        ]
    return found


def _spread(pieces: Sequence[_Piece]) -> list[_Piece]:
    """At most `MOST_WINDOWS` of the windows, evenly spread: a day's bag needs no more."""
    if len(pieces) <= MOST_WINDOWS:
        return list(pieces)
    return [pieces[k * len(pieces) // MOST_WINDOWS] for k in range(MOST_WINDOWS)]


def _beginnings(pieces: Sequence[_Piece]) -> list[_Piece]:
    """The first `MOST_WHOLE_S` of the pieces, the last one of them cut."""
    kept, left = [], MOST_WHOLE_S
    for piece in pieces:
        length = min(piece.end - piece.begin, round(left / piece.trace.step_s))
        if length < round(SHORTEST_S / piece.trace.step_s):
            break
        kept.append(replace(piece, end=piece.begin + length))
        left -= length * piece.trace.step_s
    return kept


def _roll(robot: Robot, pieces: Sequence[_Piece]) -> tuple[list[FloatArray] | None, str]:
    """Joint positions of every piece, or why one of them could not be integrated."""
    results = []
    for piece in pieces:
        try:
            results.append(_simulated(robot, piece))
        except SimulationError as error:
            return None, f"{piece.where}: {error}"
    return results, ""


def _simulated(robot: Robot, piece: _Piece) -> FloatArray:
    from hydro_model.simulate import simulate

    trace, at = piece.trace, slice(piece.begin, piece.end)
    rated = [robot.valve_of(c.name).rated_voltage_v for c in robot.cylinders]
    torque = np.zeros((at.stop - at.start, robot.dof))
    dry = list(robot.dry_joints)
    torque[:, dry] = trace.joint_torque[at, dry]
    out = simulate(
        robot,
        trace.time_s[at],
        trace.valve_signal[at] * np.array(rated),
        trace.q[piece.begin],
        piece.velocity[piece.begin],
        np.stack([trace.p_a[piece.begin], trace.p_b[piece.begin]], axis=1),
        supply=_measured(trace.supply[at], robot.supply_pressure_pa),
        tank=_measured(trace.tank[at], robot.tank_pressure_pa),
        torque=torque,
    )
    return out.q


def _measured(pressure: FloatArray, constant_pa: float) -> FloatArray | None:
    """A rail as recorded; None where it is the robot file's constant, on which effects act."""
    return None if bool(np.all(pressure == constant_pa)) else pressure


_Rolled = tuple[Sequence[_Piece], list[FloatArray] | None, list[FloatArray] | None]


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
