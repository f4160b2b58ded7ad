"""When joints rest, how fast they usually go when they do not, and how often they move."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hydro_ident.bag.grid import runs
from hydro_ident.estimate.signals.derivatives import FilterSettings, low_pass, motion
from hydro_ident.estimate.signals.traces import Trace
from hydro_ident.mismatch.rows.material import Material, Stretch
from hydro_model.arrays import BoolArray
from hydro_model.robot import FloatArray

#: A rest is at least this long, s; so is a motion.
REST_S = 0.1
#: Share of sizes that are not exceeded by the usual one; and which they are taken of: those
#: beyond so much of what a thousandth of all exceeds.
_HARDLY, _SOME, _TOP = 0.95, 0.1, 0.999
#: A joint rests where it is slower than this share of its usual fast speed for so long; the
#: filters smear what it does there into some rows before and after, at least so many seconds.
REST_SPEED, REST_REACH_S = 0.01, 0.1
#: A valve's signal below this share of its usual large one does nothing on purpose; of a joint
#: that stands still, of its rated one.
IDLE_SIGNAL = 0.1
#: A motion is one beyond this share of the usual fast speed.
MOTION_SPEED = 0.1


def usual_size(sizes: Sequence[FloatArray], share: float = _HARDLY) -> float | None:
    """Size that is hardly exceeded while there is something; None where none is known.

    Of a joint that moves now and then, most speeds are a rest's noise: what hardly any of them
    exceeds would be noise as well, and nothing a rest.

    Parameters
    ----------
    sizes : sequence of (T,) array
        Speeds or other sizes, 0 or more. Unknown ones are NaN.
    share : float
        Of those beyond a rest, which is not exceeded.

    Returns
    -------
    float or None
        0 where nothing ever is.
    """
    known = np.concatenate([np.zeros(0), *sizes])
    known = known[np.isfinite(known)]
    if not known.size:
        return None
    beyond = known[known > _SOME * float(np.quantile(known, _TOP))]
    return float(np.quantile(beyond, share)) if beyond.size else 0.0


def known_velocities(trace: Trace, filters: FilterSettings) -> FloatArray | None:
    """Velocities (T, n) of joints known throughout, NaN of others; None where none is.

    Parameters
    ----------
    trace : Trace
    filters : FilterSettings
    """
    known = np.isfinite(trace.q).all(axis=0)
    if not known.any() or trace.samples <= 3 * filters.order:
        return None
    result = np.full(trace.q.shape, np.nan)
    result[:, known] = motion(trace.q[:, known], trace.step_s, filters)[1]
    return result


def lasting(slow: BoolArray, step_s: float, reach_s: float) -> BoolArray:
    """Samples in rests of some length, and around them as far as the filters reach.

    Parameters
    ----------
    slow : (T,) bool array
    step_s : float
        Sampling interval.
    reach_s : float
    """
    result = np.zeros(slow.size, dtype=np.bool_)
    reach = round(reach_s / step_s)
    for begin, end in runs(slow):
        if (end - begin) * step_s >= REST_S:
            result[max(begin - reach, 0) : end + reach] = True
    return result


def directions(velocity: FloatArray, least: float, step_s: float) -> list[int]:
    """Directions of motions one after the other, 1 or -1; the same ones repeat.

    Parameters
    ----------
    velocity : (T,) array
    least : float
        Speed beyond which a joint moves.
    step_s : float
        Sampling interval.
    """
    found = [
        (begin, way)
        for way in (1, -1)
        for begin, end in runs(way * velocity > least)
        if (end - begin) * step_s >= REST_S
    ]
    return [way for _, way in sorted(found)]


def moving_rows(material: Material) -> BoolArray:
    """Rows whose joint moves.

    At rest dry friction is whatever holds the load: no law of velocity says anything about
    it, and every one that is asked is wrong in its own way. And a small valve signal is then
    what the controller makes of the disturbances in the same row: held against it, they look
    like a law of the valve near its middle. A larger one that moves nothing is not; nor is one
    that stays what it is, as that of a closed valve: what flows there is a leak.
    """
    result = np.ones(material.size, dtype=np.bool_)
    reach_s = max(REST_REACH_S, 1.0 / material.filters.parallel_hz)
    speeds = [_speed(material, s) for s in material.stretches]
    for k, _ in enumerate(material.channels):
        joint, places = material.joint_of(k), material.of_channels([k])
        own = [v[:, joint] for p in places if (v := speeds[p.stretch]) is not None]
        usual = usual_size(own)
        if usual is None:
            continue
        for place in places:
            speed, stretch = speeds[place.stretch], material.stretches[place.stretch]
            if speed is not None:
                noise = 0.0 if material.rest_speed is None else material.rest_speed[joint]
                # What never moves has no usual speed, and rests throughout, as does what sways.
                slow = speed[:, joint] <= max(REST_SPEED * usual, noise)
                slow |= joint in stretch.still
                resting = lasting(slow, stretch.trace.step_s, reach_s)
                if material.is_flow(k):
                    resting &= _idle(
                        material, stretch, material.chambers[material.chamber_index(k)].index
                    )
                result[place.rows] = ~material.on_rows(stretch, k, resting)
    return result


def _idle(material: Material, stretch: Stretch, cylinder: int) -> BoolArray:
    """Samples whose valve signal is small beside what is usual, and answers to something.

    Where a joint stands still what is usual is a loop's answer to noise: small is it by its range.
    """
    if cylinder not in material.commanded():
        return np.zeros(stretch.trace.samples, dtype=np.bool_)
    signals = [np.abs(s.trace.valve_signal[:, cylinder]) for s in material.stretches]
    joint = material.robot.joint_index(material.robot.cylinders[cylinder].joint)
    usual = 1.0 if joint in stretch.still else usual_size(signals) or 0.0
    return np.asarray(np.abs(stretch.trace.valve_signal[:, cylinder]) < IDLE_SIGNAL * usual)


def motions_in(material: Material) -> int:
    """How often the joint that turns most often moves, one way and then the other.

    Steps one way are one motion, as they are of one curve over the position: friction is told
    from gravity, and time from position, by a joint that comes back.
    """
    return max((motions_of(material, j) for j in range(material.robot.dof)), default=0)


def motions_of(material: Material, joint: int) -> int:
    """How often a joint moves, one way and then the other.

    Parameters
    ----------
    material : Material
    joint : int
    """
    speeds = []
    for s in material.stretches:
        if joint not in s.still and (v := _velocity(material, s)) is not None:
            # What the filters make of a recording's ends is no motion.
            edge = material.filters.edge_samples(s.trace.step_s)
            speeds.append((s, v[edge : len(v) - edge, joint]))
    usual = usual_size([np.abs(v) for _, v in speeds])
    if usual is None:
        return 0
    noise = 0.0 if material.rest_speed is None else material.rest_speed[joint]
    least = max(MOTION_SPEED * usual, noise)
    if not least > 0.0:
        return 0
    ways = [w for s, v in speeds for w in directions(v, least, s.trace.step_s)]
    return sum(way != before for way, before in zip(ways, [0, *ways], strict=False))


def _speed(material: Material, stretch: Stretch) -> FloatArray | None:
    """Speeds of the joints, behind the parallel filter where they are noisy."""
    velocity = _velocity(material, stretch)
    return None if velocity is None else np.abs(velocity)


def _velocity(material: Material, stretch: Stretch) -> FloatArray | None:
    """Velocities (T, n), unknown ones NaN; None where no joint's is known."""
    filters, step_s = material.filters, stretch.trace.step_s
    moved = stretch.moved
    qd = known_velocities(stretch.trace, filters) if moved is None else moved.qd
    if qd is None or material.rest_speed is None:
        return qd
    return low_pass(qd, step_s, filters.parallel_hz, filters.order)
