"""Filters and windows of the rows: as quick as noise allows and the commands ask for.

A velocity is a difference of positions, an acceleration one of velocities. Where their noise is
not small beside what moves, the sign of the velocity is the noise's, the inertia's force is noise,
and every law of friction or flow is asked about noise. Slower filters and longer windows then see
less, but what they see is motion.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.signal import welch

from hydro_ident.estimate.flows.chambers import WindowSettings
from hydro_ident.estimate.forces.force_rows import ForceModel, measured_force
from hydro_ident.estimate.forces.standstill import giving_way, rests_of, still_joints
from hydro_ident.estimate.signals.derivatives import QUICKEST, FilterSettings
from hydro_ident.estimate.signals.signal_survey import SignalSurvey
from hydro_ident.estimate.signals.traces import Trace
from hydro_ident.mismatch.rows.rests import usual_size
from hydro_ident.mismatch.settings import LONGEST_DELAY_S
from hydro_model.hydraulics.cylinder import lever
from hydro_model.multibody.rigid_body import mass_matrix
from hydro_model.robot import FloatArray

#: Noise that is borne: of a velocity, as a share of the usual speed of its joint; of inertia's
#: force, as a share of the measured force's spread.
SPEED_SHARE, FORCE_SHARE = 0.2, 0.1
#: Time over which the usual speed is taken, and which share of a motion's speeds it exceeds.
_SPEED_S, _USUAL = 0.5, 0.9
#: A joint moves where its usual speed is beyond so many deviations of noise in it.
_MOVES = 5.0
#: A joint rests within so many deviations of the noise in its speed.
_REST = 3.0
#: Share of the commands' rate that is the motion's own, the time over which their spectrum is
#: taken, windows per period at the frequency below which it lies, and the longest of them.
_OWN, _SPECTRUM_S, _PER_PERIOD, _LONGEST_S = 0.9, 8.0, 10.0, 0.1
#: Share of a valve's samples that has to be known for its commands to be looked at.
_MOSTLY = 0.5
#: Recordings whose sampling intervals differ by no more than this share have one rate.
_SAME_RATE = 1.0e-3
#: Slowest differentiation.
_SLOWEST_HZ = 1.0


@dataclass(frozen=True, slots=True)
class Choices:
    """Filters and windows of the rows.

    Attributes
    ----------
    filters : FilterSettings
    windows_s : tuple of float
        Length and hop of the balances' windows.
    rest_speed : (n,) array or None
        Speeds that the positions' noise alone makes of a resting joint; None: none to speak of.
    notes : tuple of str
        Why they are slower than usual.
    """

    filters: FilterSettings = field(default_factory=FilterSettings)
    windows_s: tuple[float, float] = (0.04, 0.02)
    rest_speed: FloatArray | None = None
    notes: tuple[str, ...] = ()

    def windows(self, step_s: float) -> WindowSettings:
        """Windows whose rows are the same for every delay that is tried.

        `step_s` is the sampling interval of the quickest recording.
        """
        return WindowSettings(*self.windows_s, max_delay_cycles=LONGEST_DELAY_S / step_s)


def choices_of(
    forces: ForceModel,
    signals: SignalSurvey,
    traces: Sequence[Trace],
    others: Sequence[Trace] = (),
) -> Choices:
    """Filters and windows that the recordings' noise and rate can bear.

    White noise of deviation s at an interval h, differentiated below f, has the variance
    ``(2 pi s)^2 2 h f^3 / 3``, twice differentiated ``(2 pi)^4 s^2 2 h f^5 / 5``; the difference
    over a window of length T has ``2 s^2 / T^2``.

    Parameters
    ----------
    forces : ForceModel
    signals : SignalSurvey
        Noise of the positions.
    traces : sequence of Trace
    others : sequence of Trace
        To verify on: their rates have to bear the filters, too.

    Returns
    -------
    Choices
        The usual ones wherever these will do.
    """
    usual, step_s = Choices(), max(max(t.step_s, t.read_s) for t in (*traces, *others))
    quickest = usual.filters.differentiation_hz
    shortest = max(usual.windows_s[0], _command_window(traces))
    window_s = shortest
    band = usual.filters.parallel_hz
    noise = np.array([sensor.noise(sensor.smallest_change) for sensor in signals.q])
    speeds = _usual_speeds(traces)
    moving = (noise > 0.0) & (speeds > _MOVES * math.sqrt(2.0) * noise / _SPEED_S)
    still = still_joints(signals.robot, signals)
    giving = giving_way(rests_of(signals, still))
    # Of what stands still the own rows are none, and the noise of what is held there is in no row.
    moving[[joint for joint in still if joint not in giving]] = False
    worst = ""
    for joint in [j for j in np.flatnonzero(moving).tolist() if j not in giving]:
        borne = SPEED_SHARE * speeds[joint] / noise[joint]
        limit = (1.5 * (borne / (2.0 * math.pi)) ** 2 / step_s) ** (1.0 / 3.0)
        window_s = max(window_s, math.sqrt(2.0) / borne)
        if limit < quickest:
            quickest, worst = max(limit, _SLOWEST_HZ), signals.robot.joint_names[joint]
    limit = _inertia_limit(forces, signals, traces, noise * moving)
    if limit < band:
        band, worst = max(limit, _SLOWEST_HZ), worst or "the joints"
    quickest = min(quickest, QUICKEST / step_s)
    ratio = usual.filters.parallel_hz / usual.filters.differentiation_hz
    band = min(band, ratio * quickest)
    # Windows of whole samples, twice as long as the hop between them.
    hop_s = math.ceil(0.5 * window_s / step_s - 1e-9) * step_s
    if band >= usual.filters.parallel_hz and window_s <= shortest:
        return usual if shortest <= usual.windows_s[0] else Choices(windows_s=(2.0 * hop_s, hop_s))
    filters = FilterSettings(quickest, band)
    slow = _REST * 2.0 * math.pi * noise * math.sqrt(2.0 * step_s * band**3 / 3.0)
    return Choices(filters, (2.0 * hop_s, hop_s), slow, (_text(worst, filters, 2.0 * hop_s),))


def _command_window(traces: Sequence[Trace]) -> float:
    """Length of windows in which a command is more than the answer to its own valve's noise; s.

    A tenth of the period below which the commands' rate has most of its power; 0 where it is not
    known.
    """
    step_s = max(traces, key=lambda t: t.samples * t.step_s).step_s
    count, power = round(_SPECTRUM_S / step_s), np.zeros(0)
    for trace in traces:
        signals = _mostly_known(trace.valve_signal)
        alike = abs(trace.step_s - step_s) <= _SAME_RATE * step_s
        if alike and trace.samples > count and signals.size:
            rate = np.diff(signals, axis=0) / step_s
            hz, own = welch(rate, 1.0 / step_s, nperseg=count, axis=0)
            power = trace.samples * own.sum(axis=1) + (power if power.size else 0.0)
    if not power.any():
        return 0.0
    share = np.cumsum(power) / power.sum()
    quickest = float(hz[max(int(np.searchsorted(share, _OWN)), 1)])
    return min(1.0 / (_PER_PERIOD * quickest), _LONGEST_S)


def _mostly_known(signals: FloatArray) -> FloatArray:
    """Columns of signals (N, m) of which half or more are known, straight over what is not.

    As slow as they are: held over a hole they would leap behind it.
    """
    known, at = np.isfinite(signals), np.arange(len(signals))
    columns = [
        np.interp(at, at[k], u[k])
        for u, k in zip(signals.T, known.T, strict=True)
        if k.size and np.mean(k) >= _MOSTLY
    ]
    return np.stack(columns, axis=1) if columns else np.zeros((len(signals), 0))


def _inertia_limit(
    forces: ForceModel, signals: SignalSurvey, traces: Sequence[Trace], noise: FloatArray
) -> float:
    """Frequency below which the positions' noise makes little force of inertia; Hz."""
    robot, pose, limit = forces.robot, signals.pose, math.inf
    step_s = max(t.step_s for t in traces)
    measured = np.concatenate([measured_force(forces, t) for t in traces])
    # Per unit of acceleration noise, as forces of the channels.
    swing = np.linalg.norm(np.asarray(mass_matrix(robot, pose)) * noise, axis=1)
    for cylinder in () if forces.torque else robot.cylinders:
        joint = robot.joint_index(cylinder.joint)
        swing[joint] /= max(abs(float(lever(cylinder, pose[joint]))), 1e-3)
    for joint, size in enumerate(swing.tolist()):
        own = measured[np.isfinite(measured[:, joint]), joint]
        if own.size and size > 0.0 and np.std(own) > 0.0:
            borne = FORCE_SHARE * float(np.std(own)) / size
            limit = min(limit, (2.5 * borne**2 / ((2.0 * math.pi) ** 4 * step_s)) ** 0.2)
    return limit


def _usual_speeds(traces: Sequence[Trace]) -> FloatArray:
    """Usual speed of every joint while it moves, (n,); 0 where none is known."""
    moves = []
    for trace in traces:
        span = round(_SPEED_S / trace.step_s)
        if trace.samples > span:
            moves.append(np.abs(trace.q[span:] - trace.q[:-span]) / _SPEED_S)
    joints = range(traces[0].q.shape[1])
    return np.array([usual_size([m[:, j] for m in moves], _USUAL) or 0.0 for j in joints])


def _text(joint: str, filters: FilterSettings, window_s: float) -> str:
    why = (
        f"the position of {joint} is noisy beside its motion" if joint else "few samples a second"
    )
    return (
        f"{why}: motion is looked at below {filters.differentiation_hz:.3g} Hz, forces below"
        f" {filters.parallel_hz:.3g} Hz and flows over {window_s:.2g} s; nothing quicker can be"
        " told"
    )
