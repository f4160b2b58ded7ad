"""What the estimators work on: uniformly sampled arrays of one contiguous piece of recording."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from hydro_ident.bag.rails import between_readings, followed
from hydro_ident.bag.recording import Recording
from hydro_ident.bag.streaming import Piece
from hydro_ident.estimate.signals.bridging import joined, stretches
from hydro_ident.estimate.signals.parting import borders_of, parts_of
from hydro_model.arrays import BoolArray, IntArray
from hydro_model.hydraulics.cylinder import stroke
from hydro_model.robot import FloatArray, Robot


@dataclass(frozen=True, slots=True)
class Trace:
    """A contiguous, uniformly sampled piece of a recording.

    What was not measured is NaN, sample by sample; the estimators leave out the equations that
    would need it.

    Attributes
    ----------
    label : str
        Bag and piece, for messages and the report.
    step_s : float
    time_s : (N,) array
        From the start of the recording.
    q : (N, n) array
        Joint positions, rad or m.
    stroke : (N, m) array
        Piston displacements in m.
    p_a, p_b : (N, m) array
        Gauge chamber pressures in Pa.
    supply, tank : (N,) array
        Gauge pressures in Pa, recorded (straight between readings) or the robot file's.
    valve_signal : (N, m) array
        Normalised signal by cylinder, limited to [-1, 1], held from its sample on; NaN while
        latched or unknown, or while a rail was not read for long.
    joint_torque : (N, n) array
        Measured joint torque, N m or N, where the robot has no cylinder on the joint.
    cycle : int
        Number of the first sample in its recording.
    core : tuple of int or None
        Samples that this trace owns, begin and end; the others are for filters to settle on.
        None: all.
    q_ref : (N, n) array or None
        What the controller followed, where that was recorded throughout.
    oil_c : (N,) array or None
        Oil temperature in deg C, where it was recorded: straight from reading to reading.
    latched : (N,) bool array or None
        While every valve was held shut; None: never.
    bridged : int
        Samples of its own that nobody read: short holes, filled in between their neighbours.
    rails_read : pair of bool
        Whether supply and tank were recorded; else they are the robot file's constants.
    read_s : float
        From reading to reading of what came slowest, where that is more than `step_s`.
    """

    label: str
    step_s: float
    time_s: FloatArray
    q: FloatArray
    stroke: FloatArray
    p_a: FloatArray
    p_b: FloatArray
    supply: FloatArray
    tank: FloatArray
    valve_signal: FloatArray
    joint_torque: FloatArray
    cycle: int = 0
    core: tuple[int, int] | None = None
    q_ref: FloatArray | None = None
    oil_c: FloatArray | None = None
    latched: BoolArray | None = None
    bridged: int = 0
    rails_read: tuple[bool, bool] = (False, False)
    read_s: float = 0.0

    @property
    def samples(self) -> int:
        """Number of samples N."""
        return int(self.time_s.size)

    @property
    def owned(self) -> slice:
        """The samples that this trace owns."""
        return slice(0, self.samples) if self.core is None else slice(*self.core)

    @property
    def recording(self) -> str:
        """Name of the recording that the trace is from."""
        return self.label.rsplit("#", 1)[0]


def traces_of(recordings: Iterable[Recording]) -> tuple[Trace, ...]:
    """The contiguous pieces of recordings in which what was recorded has no holes.

    Parameters
    ----------
    recordings : iterable of Recording

    Returns
    -------
    tuple of Trace
        Labelled `<bag>#<piece>`, at least two samples each.
    """
    return tuple(trace for r in recordings for trace in traces_of_piece(Piece.whole(r)))


def traces_of_piece(piece: Piece) -> tuple[Trace, ...]:
    """The contiguous traces of a piece of recording; those that own no sample are left out."""
    traces = []
    read = _is_read(piece.recording.supply), _is_read(piece.recording.tank)
    recording, period_s = _with_rails(piece.recording), piece.recording.period_s
    borders = borders_of(recording)
    known = parts_of(recording, borders)
    for k, stretch in enumerate(stretches(known, recording.stamp_ns, period_s, borders)):
        core = stretch.core(piece.core)
        if core is not None:
            label = f"{recording.path.name}#{k}"
            parts = [_trace(recording, part, label, piece.start_ns) for part in stretch.parts]
            lost = core[1] - core[0] - stretch.cycles(piece.core)
            whole = joined(parts, stretch.holes)
            traces.append(replace(whole, core=core, bridged=lost, rails_read=read))
    return tuple(traces)


def last_known(signal: FloatArray) -> FloatArray:
    """A valve's signal with the last known sample in every hole, or the first before any; else 0.

    For laws that remember: a valve holds what it was told last, and a spool that were taken to 0
    in every hole would ring behind it. What comes of long holes is not used.

    Parameters
    ----------
    signal : (N,) array
    """
    known = np.isfinite(signal)
    if known.all():
        return signal
    if not known.any():
        return np.zeros_like(signal)
    at = np.maximum.accumulate(np.where(known, np.arange(signal.size), -1))
    return np.asarray(signal[np.where(at < 0, int(np.argmax(known)), at)])


def _with_rails(recording: Recording) -> Recording:
    """Rails that were recorded in every cycle; where one was not read for long, no valve signal.

    The equations of the edges' flows need supply and tank, those of forces do not.
    """
    robot, stamps, period_s = recording.robot, recording.stamp_ns, recording.period_s
    known = followed(recording.supply, len(recording), period_s)
    known &= followed(recording.tank, len(recording), period_s)
    valve_v = recording.valve_v
    if valve_v is not None and not known.all():
        valve_v = np.where(known[:, None], valve_v, np.nan)
    return replace(
        recording,
        supply=_rail(recording.supply, stamps, robot.supply_pressure_pa),
        tank=_rail(recording.tank, stamps, robot.tank_pressure_pa),
        valve_v=valve_v,
    )


def _rail(values: FloatArray | None, stamp_ns: IntArray, constant_pa: float) -> FloatArray:
    if values is None or not _is_read(values):
        return np.full(len(stamp_ns), constant_pa)
    return between_readings(values, stamp_ns)


def _is_read(values: FloatArray | None) -> bool:
    return values is not None and bool(np.isfinite(values).any())


def _trace(recording: Recording, piece: slice, label: str, start_ns: int) -> Trace:
    robot, count = recording.robot, piece.stop - piece.start
    cylinders = len(robot.cylinders)
    q = recording.q[piece]
    return Trace(
        label=label,
        step_s=recording.period_s,
        time_s=np.asarray((recording.stamp_ns[piece] - start_ns) * 1e-9, dtype=float),
        q=q,
        stroke=strokes(robot, q, _cut(recording.stroke, piece, (count, cylinders))),
        p_a=_cut(recording.p_a, piece, (count, cylinders)),
        p_b=_cut(recording.p_b, piece, (count, cylinders)),
        supply=_cut(recording.supply, piece, (count,)),
        tank=_cut(recording.tank, piece, (count,)),
        valve_signal=_signals(recording, piece, count),
        joint_torque=_cut(recording.effort, piece, q.shape),
        cycle=round((int(recording.stamp_ns[piece.start]) - start_ns) * 1e-9 / recording.period_s),
        q_ref=_complete(recording.q_ref, piece),
        oil_c=_oil_temperature(recording, piece),
        latched=recording.latched[piece] if recording.latched[piece].any() else None,
        read_s=recording.read_s,
    )


def _cut(values: FloatArray | None, piece: slice, shape: tuple[int, ...]) -> FloatArray:
    return np.full(shape, np.nan) if values is None else values[piece].copy()


def _complete(values: FloatArray | None, piece: slice) -> FloatArray | None:
    if values is None or not np.isfinite(values[piece]).all():
        return None
    return values[piece].copy()


def _oil_temperature(recording: Recording, piece: slice) -> FloatArray | None:
    if recording.temperature_c is None or recording.temperature_stamp_ns is None:
        return None
    known = np.isfinite(recording.temperature_c)
    if not known.any():
        return None
    begin = recording.stamp_ns[0]
    at, readings = recording.temperature_stamp_ns[known], recording.temperature_c[known]
    return np.asarray(np.interp(recording.stamp_ns[piece] - begin, at - begin, readings))


def strokes(robot: Robot, q: FloatArray, measured: FloatArray) -> FloatArray:
    """Strokes from the joint angles, or as measured where the angle is missing.

    Parameters
    ----------
    robot : Robot
    q : (N, n) array
    measured : (N, c) array
        Is changed.

    Returns
    -------
    (N, c) array
    """
    result = measured
    for i, cylinder in enumerate(robot.cylinders):
        computed = stroke(cylinder, q[:, robot.joint_index(cylinder.joint)])
        result[:, i] = np.where(np.isfinite(computed), computed, measured[:, i])
    return result


def _signals(recording: Recording, piece: slice, count: int) -> FloatArray:
    robot = recording.robot
    result = np.full((count, len(robot.cylinders)), np.nan)
    if recording.valve_v is None:
        return result
    at = {cylinder.name: i for i, cylinder in enumerate(robot.cylinders)}
    for k, valve in enumerate(robot.valves):
        signal = recording.valve_v[piece, k] / valve.rated_voltage_v
        # Clipped, a voltage that is no number would be a valve that is fully open.
        told = np.isfinite(signal) & ~recording.latched[piece]
        result[:, at[valve.cylinder]] = np.where(told, np.clip(signal, -1.0, 1.0), np.nan)
    if recording.updated_between:
        result[:-1] = 0.5 * (result[:-1] + result[1:])
    return result
