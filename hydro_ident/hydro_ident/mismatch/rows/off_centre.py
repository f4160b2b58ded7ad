"""Position sensors off their centre: a reading whose error repeats along the joint.

A disc, ring or magnet that sits off its shaft by e at a radius r reads an angle that is off by
(e / r) sin of the angle, once per turn; behind a gear or a wheel as often as these turn:

    q_read = q + s sin(2 pi q / P) + c cos(2 pi q / P).

It is an error of an instrument and no physics of the machine: like pressures that are read late it
is taken out of the recordings, and stands in no model file.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from hydro_ident.estimate.forces.standstill import Rest
from hydro_ident.estimate.signals.traces import Trace, strokes
from hydro_model.effects.effect import Effect
from hydro_model.effects.law import ParameterSpec
from hydro_model.effects.readings import Readings
from hydro_model.effects.targets import ActiveEffect, at_work, places
from hydro_model.robot import FloatArray, Robot

#: An error of a position that is larger is no sensor's.
_LARGEST_RAD = 0.1
#: Steps of Newton's to the position that is read so, and the least slope that is believed.
_STEPS, _LEAST_SLOPE = 6, 0.1


@dataclass(frozen=True, slots=True)
class OffCentre:
    """The error of one position sensor.

    Attributes
    ----------
    joint : int
        Index in `Robot.joints`.
    sine, cosine : float
        rad, or m where the joint slides.
    period : float
        Of the joint's position, rad or m.
    std : float
        Standard deviation of its amplitude.
    """

    joint: int
    sine: float
    cosine: float
    period: float
    std: float = 0.0

    @property
    def amplitude(self) -> float:
        """Half of what it swings by, rad or m."""
        return float(np.hypot(self.sine, self.cosine))

    def read(self, q: FloatArray) -> FloatArray:
        """What is read at a position.

        Parameters
        ----------
        q : array
            rad or m.

        Returns
        -------
        array
            Of the same shape.
        """
        phase = (2.0 * np.pi / self.period) * q
        return np.asarray(q + self.sine * np.sin(phase) + self.cosine * np.cos(phase))

    def position(self, seen: FloatArray) -> FloatArray:
        """The position at which that is read.

        Parameters
        ----------
        seen : array
            rad or m.

        Returns
        -------
        array
            Of the same shape.
        """
        turns, q = 2.0 * np.pi / self.period, seen
        for _ in range(_STEPS):
            sine, cosine = np.sin(turns * q), np.cos(turns * q)
            slope = 1.0 + turns * (self.sine * cosine - self.cosine * sine)
            beyond = q + self.sine * sine + self.cosine * cosine - seen
            q = q - beyond / np.maximum(slope, _LEAST_SLOPE)
        return np.asarray(q)


def _read(r: Readings, joint: int, p: FloatArray) -> Readings:
    q = r.q.copy()
    q[:, joint] = OffCentre(joint, *p.tolist()).read(q[:, joint])
    return replace(r, q=q)


def _there(r: Readings, joint: int, p: FloatArray) -> Readings:
    q = r.q.copy()
    q[:, joint] = OffCentre(joint, *p.tolist()).position(q[:, joint])
    return replace(r, q=q)


#: As a fit needs it. It is in no catalogue: whoever finds it takes it out of the recordings.
OFF_CENTRE = Effect(
    name="off_centre",
    channel="force",
    equation="q_read = q + s sin(2 pi q / P) + c cos(2 pi q / P)",
    source="eccentric discs, rings and magnets, of data sheets of rotary encoders",
    parameters=(
        ParameterSpec("sine", "rad", "s", -_LARGEST_RAD, _LARGEST_RAD, 1.0e-3),
        ParameterSpec("cosine", "rad", "c", -_LARGEST_RAD, _LARGEST_RAD, 1.0e-3),
        ParameterSpec("period", "rad", "P", 1.0e-3, 20.0, 2.0 * np.pi),
    ),
    terms=(),
    channels=("force", "flow_a", "flow_b"),
    acts_on="joint",
    reading=_read,
    undo=_there,
    looks_like=("encoder_offset", "position_dependent_friction"),
    separating_experiment="read a second sensor of that joint beside it, all along its range",
)


def term_of(robot: Robot, one: OffCentre, effect: Effect = OFF_CENTRE) -> ActiveEffect:
    """A position sensor's error as a fit takes it.

    Parameters
    ----------
    robot : Robot
    one : OffCentre
    effect : Effect
        `OFF_CENTRE`, or that with its period held.
    """
    [place] = places(robot, effect, robot.joint_names[one.joint], robot.name)
    return at_work(robot, effect, place, np.array([one.sine, one.cosine, one.period]))


def without_errors(
    robot: Robot, traces: Sequence[Trace], errors: Sequence[OffCentre]
) -> tuple[Trace, ...]:
    """Traces as sensors on their centres would have read them, strokes with them.

    Parameters
    ----------
    robot : Robot
    traces : sequence of Trace
    errors : sequence of OffCentre
        Taken out one after the other, each of what the ones before it leave.
    """
    if not errors:
        return tuple(traces)
    result = []
    for trace in traces:
        q = trace.q.copy()
        for one in errors:
            q[:, one.joint] = one.position(q[:, one.joint])
        own = replace(trace, q=q, stroke=strokes(robot, q, trace.stroke.copy()))
        result.append(own)
    return tuple(result)


def read_rightly(
    still: Mapping[str, Mapping[int, Rest]], errors: Sequence[OffCentre]
) -> Mapping[str, Mapping[int, Rest]]:
    """How joints stand that are still, as sensors on their centres would have read them.

    Parameters
    ----------
    still : mapping of str to mapping of int to Rest
        By recording and joint.
    errors : sequence of OffCentre
        As `without_errors`.
    """
    result = {name: dict(rests) for name, rests in still.items()}
    for one in errors:
        for rests in result.values():
            if one.joint in rests:
                at = float(one.position(np.array(rests[one.joint].at)))
                rests[one.joint] = replace(rests[one.joint], at=at)
    return result
