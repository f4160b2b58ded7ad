"""Position sensors off their centre: told as unknown, and taken out of what else is looked for.

An error that repeats along the joint acts in the force and in both flows of that joint, the more
the faster it moves, and hides whatever is smaller there. The contract has no name for it, so that
it stays unexplained; but where one wave along the reading takes it out of all of these channels,
the recordings are looked at once more without it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import replace

import numpy as np

from hydro_ident.mismatch.answer.answering import Answer, answered, base_to_search
from hydro_ident.mismatch.answer.channel_results import channels_of
from hydro_ident.mismatch.fitting.as_listed import LISTED_GAIN
from hydro_ident.mismatch.fitting.fitted import Fitted
from hydro_ident.mismatch.fitting.fitting import NEAR, fit
from hydro_ident.mismatch.fitting.training import Training
from hydro_ident.mismatch.rows.off_centre import OFF_CENTRE, OffCentre, term_of
from hydro_ident.mismatch.split.held_out import rms
from hydro_ident.mismatch.split.residuals import Residuals
from hydro_ident.mismatch.unnamed.unknown import HINT, TakenOut, Unexplained
from hydro_model.robot import FloatArray, Robot

#: What an unknown follows that may be a position's error, and times what.
_ALONG = ("joint_angle", "piston_position")
_TIMES = ("velocity", "velocity_squared", "valve_signal")
#: What a reading's error depends on, whatever it had been seen to follow.
_DEPENDS_ON = ("joint_angle", "piston_velocity")
#: Periods that are tried beside those that were told, as shares of where the joint has been; and
#: those of a sensor on the joint itself, one and two per turn. Longer ones than this share of
#: where it has been are gravity's and the lever arm's.
_OF_RANGE, _OF_TURN, _LONGEST = (0.25, 0.4, 0.6, 1.0, 1.6), (2.0 * np.pi, np.pi), 8.0
#: Waves that are taken out of one sensor at most, one after the other.
_ROUNDS = 3
#: Share of what was left on held-out rows that one channel keeps at most; none keeps more than
#: was. As little as the second where most of these channels are as unknown as before.
_LESS, _FAR_LESS = 0.95, 0.5


def off_centre(answer: Answer) -> tuple[OffCentre, ...]:
    """Errors of position sensors that would explain what has no name.

    Parameters
    ----------
    answer : Answer

    Returns
    -------
    tuple of OffCentre
        One per joint at most; empty where nothing looks like one.
    """
    training, whole, found = answer.work.training, answer.whole, list[OffCentre]()
    for joint, told in _told_along(training, answer.unknown).items():
        periods = _periods(training, joint, told)
        fits = [_with_wave(training, whole, joint, period) for period in periods]
        best = min(fits, key=lambda one: one.squares, default=whole)
        if whole.squares - best.squares > LISTED_GAIN:
            found.append(_freed(training, best))
    return tuple(found)


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


def _periods(training: Training, joint: int, told: Sequence[Unexplained]) -> list[float]:
    """Periods of the reading that are tried, rad or m."""
    material = training.predictor.material
    robot, traces = material.robot, [s.trace for s in material.stretches]
    span = _span(trace.q[:, joint] for trace in traces)
    spans = {"joint_angle": span}
    for index, cylinder in enumerate(robot.cylinders):
        if robot.joint_index(cylinder.joint) == joint:
            spans["piston_position"] = _span(trace.stroke[:, index] for trace in traces)
    dependences = [one.dependence for one in told if one.dependence.variable in spans]
    own = [d.period * span / spans[d.variable] for d in dependences]
    periods = [period for period in own if period > 0.0] + [share * span for share in _OF_RANGE]
    if not robot.joints[joint].prismatic:
        periods += [period for period in _OF_TURN if period <= _LONGEST * span]
    ends = OFF_CENTRE.parameters[2]
    return [period for period in dict.fromkeys(periods) if ends.lower <= period <= ends.upper]


def _span(signals: Iterable[FloatArray]) -> float:
    """Range of what was read of signals."""
    seen = np.concatenate(list(signals))
    return float(np.ptp(seen[np.isfinite(seen)]))


def _with_wave(training: Training, whole: Fitted, joint: int, period: float) -> Fitted:
    """The fit with a wave of one period along a joint's reading, as `whole` is weighed."""
    robot = training.predictor.material.robot
    spec = replace(OFF_CENTRE.parameters[2], lower=period, upper=period)
    effect = replace(OFF_CENTRE, parameters=(*OFF_CENTRE.parameters[:2], spec))
    term = term_of(robot, OffCentre(joint, 0.0, 0.0, period), effect)
    return fit(training, whole.model.with_term(term), whole.bench.noise, passes=NEAR)


def _freed(training: Training, best: Fitted) -> OffCentre:
    """The wave of a fit with its period fitted as well."""
    held = best.model.terms[-1]
    free = replace(held, effect=OFF_CENTRE)
    model = replace(best.model, terms=(*best.model.terms[:-1], free))
    fresh = fit(training, model, best.bench.noise)
    return _error_of(fresh if fresh.squares < best.squares else best)


def _error_of(one: Fitted) -> OffCentre:
    """The last term of a fit as the error that it is, with its amplitude's deviation."""
    term = one.model.terms[-1]
    sine, cosine, period = term.parameters.tolist()
    names = [f"{term.target}.{term.effect.name}.{part}" for part in ("sine", "cosine")]
    at = [one.names.index(name) for name in names]
    along = term.parameters[:2] / max(float(np.hypot(sine, cosine)), 1e-300)
    variance = float(along @ one.covariance[np.ix_(at, at)] @ along)
    return OffCentre(term.index, sine, cosine, period, float(np.sqrt(max(variance, 0.0))))


def without_off_centre(
    first: Answer, lay: Callable[[Sequence[OffCentre]], Residuals | None]
) -> Answer:
    """What is found without the errors of position sensors, or the first answer.

    Parameters
    ----------
    first : Answer
    lay : callable
        Rows and base of the same recordings without such errors.

    Returns
    -------
    Answer
        With what has no name in the first as well, and that a sensor's error explains it.
    """
    best = first
    for _ in range(_ROUNDS):
        more = off_centre(best)
        work = lay((*best.work.off, *more)) if more else None
        again = None if work is None else answered(work, base_to_search(work))
        if again is None or not _better(best, again, {one.joint for one in more}):
            break
        best = again
    return best if best is first else replace(best, unknown=_explained(first, best))


def _explained(first: Answer, best: Answer) -> tuple[Unexplained, ...]:
    """What has no name, and what had none until errors of sensors were taken out."""
    material, robot = first.work.training.predictor.material, first.work.robot
    left, errors = {one.channel for one in best.unknown}, best.work.off
    told, then, now = list(best.unknown), _held_out(first), _held_out(best)
    for one in first.unknown:
        own = [e for e in errors if e.joint == material.joint_of(one.dependence.channel)]
        if own and one.channel not in left:
            sizes = (rows.get(one.channel, math.nan) for rows in (then, now))
            because = TakenOut(off_words(robot, own), *sizes)
            text = f"{one.text.removesuffix(HINT)}; {because.text}, which explains it"
            told.append(replace(one, depends_on=_DEPENDS_ON, text=text, taken_out=because))
    order = list(material.channels)
    return tuple(sorted(told, key=lambda one: order.index(one.channel)))


def _better(before: Answer, after: Answer, joints: Collection[int]) -> bool:
    """Whether held-out rows of some joints keep less, nothing more is unknown, no name is lost.

    A name may go where its channels are explained as well without it.
    """
    material = before.work.training.predictor.material
    told = {u.channel for u in before.unknown if material.joint_of(u.dependence.channel) in joints}
    then, now = _held_out(before), _held_out(after)
    ratios = [now[name] / max(then[name], 1e-300) for name in told & set(then)]
    if not ratios or max(ratios) > 1.0 or min(ratios) > _LESS:
        return False
    left = told & {one.channel for one in after.unknown}
    if 2 * len(left) > len(told) and min(ratios) > _FAR_LESS:
        return False
    lost = [
        name
        for finding in before.findings
        if (finding.named.term.effect.name, finding.named.term.cylinder) not in after.names
        for name in finding.channels
    ]
    kept = all(now[name] <= then[name] for name in lost if name in then)
    return kept and len(after.unknown) <= len(before.unknown)


def _held_out(one: Answer) -> dict[str, float]:
    """What an answer leaves of every channel on rows that took no part."""
    results = channels_of(one.work, one.whole, one.work.check)
    return {result.name: rms(result.measured - result.after) for result in results}


def off_words(robot: Robot, errors: Sequence[OffCentre]) -> str:
    """The errors of one position sensor, in words.

    Parameters
    ----------
    robot : Robot
    errors : sequence of OffCentre
        Of one joint.
    """
    joint = robot.joints[errors[0].joint]
    unit = "m" if joint.prismatic else "rad"
    sizes = [
        f"{1e3 * one.amplitude:.3g} +- {1e3 * one.std:.2g} m{unit} either way every"
        f" {one.period:.4g} {unit}"
        for one in errors
    ]
    return f"the position sensor of {joint.name} is off its centre ({' and '.join(sizes)})"


def off_notes(work: Residuals) -> list[str]:
    """What was taken out of the recordings, in words.

    Parameters
    ----------
    work : Residuals
    """
    joints = dict.fromkeys(one.joint for one in work.off)
    return [
        f"{off_words(work.robot, [one for one in work.off if one.joint == joint])}: taken out of"
        " the recordings, before and after alike; not in the model"
        for joint in joints
    ]
