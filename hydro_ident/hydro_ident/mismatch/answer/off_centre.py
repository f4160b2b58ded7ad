"""Position sensors off their centre: what of something without a name would be one's error.

An error that repeats along the joint acts in the force and in both flows of that joint, the more
the faster it moves, and hides whatever is smaller there. One that hardly repeats where the joint
has been looks like a function of time, or of all that goes with the position. A wave along the
reading is fitted with everything that was found, and put to the rows that took no part: a wrong
length of the machine bends the flows as well, but no wave of the reading sets the forces right.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from hydro_ident.mismatch.answer.answering import Answer
from hydro_ident.mismatch.fitting.as_listed import LISTED_GAIN
from hydro_ident.mismatch.fitting.fitted import Fitted
from hydro_ident.mismatch.fitting.fitting import NEAR, fit
from hydro_ident.mismatch.fitting.training import Training
from hydro_ident.mismatch.naming.instants import at_own_instants
from hydro_ident.mismatch.rows.modelled import Model
from hydro_ident.mismatch.rows.off_centre import OFF_CENTRE, OffCentre, term_of
from hydro_ident.mismatch.rows.prediction import Predictor
from hydro_ident.mismatch.split.check import Check
from hydro_ident.mismatch.split.held_out import rms
from hydro_ident.mismatch.unnamed.unknown import Unexplained
from hydro_model.effects.effect import Effect
from hydro_model.robot import FloatArray

#: What an unknown follows that may be a position's error, and times what.
_ALONG = ("joint_angle", "piston_position")
_TIMES = ("velocity", "velocity_squared", "valve_signal")
#: Periods that are tried beside those that were told: shares of where the joint has been, and one
#: and two per turn. No sensor's error takes longer than a turn, or on a slide than the last share.
_OF_RANGE, _TURN = (0.25, 0.4, 0.6, 1.0, 1.6), 2.0 * math.pi
#: Steps of the last fit at most: phase and period go together, and it ends where none is left.
_PASSES = 12
#: Deviations that an error is large, and the share of what moves by which it may misread.
_DEVIATIONS, _STEEPEST = 5.0, 0.5
#: On held-out rows no channel keeps more than this share of what was left, and one of those that
#: it was seen in no more than the second. An error that does not repeat leaves of all of these
#: half, or little more than their sensors' noise.
_NO_MORE, _LESS, _HALF, _AT_NOISE = 1.02, 0.95, 0.5, 1.25


@dataclass(frozen=True, slots=True)
class Evidence:
    """Errors of position sensors, and what is left of channels with them and without.

    Attributes
    ----------
    errors : tuple of OffCentre
        One per joint at most.
    sizes : mapping of str to (float, float)
        Root mean square on held-out rows, by channel, with the errors in the recordings and
        without.
    """

    errors: tuple[OffCentre, ...]
    sizes: Mapping[str, tuple[float, float]]


def off_centre(answer: Answer) -> Evidence:
    """Errors of position sensors by which what has no name comes out.

    Parameters
    ----------
    answer : Answer
    """
    along = _told_along(answer.work.training, answer.unknown)
    if not along:
        return Evidence((), {})
    sight, whole = _Sight.of(answer), answer.whole
    model, first = whole.model, sight.left(whole.model)
    errors, now = list[OffCentre](), first
    for start, told in _starts(sight, whole, along):
        best = _freed(sight, whole, model, start)
        error = _error_of(best)
        then = sight.left(best.model)
        seen = {one.channel for one in told}
        if _believable(sight, error) and _takes_out(sight, error, now, then, seen):
            errors, model, now = [*errors, error], best.model, then
    return Evidence(
        tuple(errors), {name: (first[name], now.get(name, math.nan)) for name in first}
    )


@dataclass(frozen=True, slots=True)
class _Sight:
    """Rows of an answer, laid out for looks whose columns nobody keeps.

    Attributes
    ----------
    training : Training
    check : Check
    floors : mapping of str to float
        What the sensors' noise leaves of the held-out rows, by channel.
    """

    training: Training
    check: Check
    floors: Mapping[str, float]

    @staticmethod
    def of(answer: Answer) -> _Sight:
        work = answer.work
        training = replace(work.training, predictor=Predictor(work.training.predictor.material))
        same = work.check.predictor is work.training.predictor
        there = training.predictor if same else Predictor(work.check.predictor.material)
        check = replace(work.check, predictor=there)
        return _Sight(training, check, work.noise_floors(work.check_traces))

    def left(self, model: Model) -> dict[str, float]:
        """What a model leaves of every channel on held-out rows, root mean square."""
        there, _ = at_own_instants(self.training, self.check, model)
        residual = self.check.residual(there)
        rows = {
            name: self.check.rows(k, name)
            for k, name in enumerate(self.check.predictor.material.channels)
        }
        return {name: rms(residual[own]) for name, own in rows.items() if own.any()}

    def span(self, joint: int) -> float:
        """Where a joint has been on the fitted rows, rad or m; 0 where it was not read."""
        return _span(s.trace.q[:, joint] for s in self.training.predictor.material.stretches)

    def longest(self, joint: int) -> float:
        """Longest period of an error of a joint's sensor, rad or m."""
        slides = self.training.predictor.material.robot.joints[joint].prismatic
        return _OF_RANGE[-1] * self.span(joint) if slides else _TURN


def _starts(
    sight: _Sight, whole: Fitted, along: Mapping[int, list[Unexplained]]
) -> list[tuple[OffCentre, list[Unexplained]]]:
    """The best wave of every joint that may have one, and what was seen of it; the best first."""
    found = list[tuple[float, OffCentre, list[Unexplained]]]()
    for joint, told in along.items():
        tried = [_tried(sight, whole, joint, period) for period in _periods(sight, joint, told)]
        squares, error = min(tried, key=lambda one: one[0], default=(math.inf, None))
        if error is not None and whole.squares - squares > LISTED_GAIN:
            found.append((squares, error, told))
    return [(error, told) for _, error, told in sorted(found, key=lambda one: one[0])]


def _told_along(
    training: Training, unknown: Iterable[Unexplained]
) -> dict[int, list[Unexplained]]:
    """What may follow a joint's position as a reading's error does, by joint.

    What repeats more seldom than where a joint has been follows other things as well: it shows in
    both of its flows.
    """
    material, by_joint = training.predictor.material, dict[int, list[Unexplained]]()
    for one in unknown:
        by_joint.setdefault(material.joint_of(one.dependence.channel), []).append(one)
    return {
        joint: told
        for joint, told in by_joint.items()
        if any(d.variable in _ALONG and d.times in _TIMES for d in (u.dependence for u in told))
        or sum(material.is_flow(u.dependence.channel) for u in told) > 1
    }


def _periods(sight: _Sight, joint: int, told: Sequence[Unexplained]) -> Iterator[float]:
    """Periods of the position that are tried, rad or m; none of what was not read or stood."""
    material = sight.training.predictor.material
    robot, traces = material.robot, [s.trace for s in material.stretches]
    span = sight.span(joint)
    if span <= 0.0:
        return
    spans = {"joint_angle": span}
    for index, cylinder in enumerate(robot.cylinders):
        if robot.joint_index(cylinder.joint) == joint:
            spans["piston_position"] = _span(trace.stroke[:, index] for trace in traces)
    seen = [d for d in (one.dependence for one in told) if spans.get(d.variable, 0.0) > 0.0]
    periods = [d.period * span / spans[d.variable] for d in seen if d.period > 0.0]
    periods += [share * span for share in _OF_RANGE]
    if not robot.joints[joint].prismatic:
        periods += [_TURN, 0.5 * _TURN]
    ends = OFF_CENTRE.parameters[2]
    for period in dict.fromkeys(periods):
        if ends.lower <= period <= sight.longest(joint):
            yield period


def _span(signals: Iterable[FloatArray]) -> float:
    """Range of what was read of signals; 0 where nothing was."""
    seen = np.concatenate(list(signals))
    known = seen[np.isfinite(seen)]
    return float(np.ptp(known)) if known.size else 0.0


def _tried(
    sight: _Sight, whole: Fitted, joint: int, period: float
) -> tuple[float, OffCentre | None]:
    """Squares that a wave of one period along a joint's position leaves, and the wave.

    The fit, as `whole` is weighed, is as large as the next one, and not kept.
    """
    robot = sight.training.predictor.material.robot
    term = term_of(robot, OffCentre(joint, 0.0, 0.0, period), _of_periods(period, period))
    one = fit(sight.training, whole.model.with_term(term), whole.bench.noise, passes=NEAR)
    return one.squares, _error_of(one)


def _freed(sight: _Sight, whole: Fitted, model: Model, start: OffCentre) -> Fitted:
    """A wave fitted with its period, beside what is in a model."""
    robot = sight.training.predictor.material.robot
    ends = OFF_CENTRE.parameters[2].lower, sight.longest(start.joint)
    term = term_of(robot, start, _of_periods(*ends))
    return fit(sight.training, model.with_term(term), whole.bench.noise, passes=_PASSES)


def _of_periods(lower: float, upper: float) -> Effect:
    """A position sensor's error whose period is within two ends."""
    spec = replace(OFF_CENTRE.parameters[2], lower=lower, upper=upper)
    return replace(OFF_CENTRE, parameters=(*OFF_CENTRE.parameters[:2], spec))


def _error_of(one: Fitted) -> OffCentre:
    """The last term of a fit as the error that it is, with its amplitude's deviation."""
    term = one.model.terms[-1]
    sine, cosine, period = term.parameters.tolist()
    names = [f"{term.target}.{term.effect.name}.{part}" for part in ("sine", "cosine")]
    at = [one.names.index(name) for name in names]
    along = term.parameters[:2] / max(float(np.hypot(sine, cosine)), 1e-300)
    variance = float(along @ one.covariance[np.ix_(at, at)] @ along)
    return OffCentre(term.index, sine, cosine, period, float(np.sqrt(max(variance, 0.0))))


def _believable(sight: _Sight, one: OffCentre) -> bool:
    """Whether the rows tell an error that a sensor can have."""
    told = 0.0 < _DEVIATIONS * one.std <= one.amplitude
    return told and 2.0 * math.pi * one.amplitude <= _STEEPEST * one.period


def _takes_out(
    sight: _Sight,
    one: OffCentre,
    before: Mapping[str, float],
    after: Mapping[str, float],
    seen: Collection[str],
) -> bool:
    """Whether held-out rows keep less of the channels that it was seen in, and of none more."""
    if any(after.get(name, math.inf) > _NO_MORE * size for name, size in before.items()):
        return False
    shares = {name: after[name] / max(before[name], 1e-300) for name in seen if name in before}
    if not shares or min(shares.values()) > _LESS:
        return False
    if one.period <= sight.span(one.joint):
        return True
    return all(
        share <= _HALF or after[name] <= _AT_NOISE * sight.floors.get(name, 0.0)
        for name, share in shares.items()
    )
