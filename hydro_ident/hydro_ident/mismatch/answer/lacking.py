"""Channels that lack something, whatever it follows, here or elsewhere, or are read apart."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from hydro_ident.mismatch.answer.outcome import ChannelResult
from hydro_ident.mismatch.fitting.fitted import Fitted
from hydro_ident.mismatch.fitting.training import Training
from hydro_ident.mismatch.locating.dependence import Dependence
from hydro_ident.mismatch.rows.skew import TORQUES, is_unnamed
from hydro_ident.mismatch.settings import FAR, FAR_SHARE, GROSS, GROSS_SHARE
from hydro_ident.mismatch.split.held_out import rms
from hydro_ident.mismatch.unnamed.unknown import Unexplained

#: A channel is contradicted where so many times as much is left as where it was fitted.
_MORE = 3.0


def lacking(
    here: Sequence[ChannelResult], there: Sequence[ChannelResult], least: Mapping[str, float]
) -> dict[str, float]:
    """Channels that lack something here and (if known) there, and over what their noise leaves.

    Parameters
    ----------
    here, there : sequence of ChannelResult
        On rows that were fitted, and on those to verify on.
    least : mapping of str to float
        What their sensors may make of them.
    """
    fitted, held_out = (
        {c.name: distance(c, least[c.name]) for c in channels} for channels in (here, there)
    )
    # Where no row to verify on knows a channel, those that were fitted have to do.
    found = fitted | held_out
    return {n: d for n, d in found.items() if d > 0.0 and fitted.get(n, 0.0) > 0.0}


def distance(one: ChannelResult, least: float) -> float:
    """What is left of a channel in units of its noise; 0 of what is little beside either.

    Parameters
    ----------
    one : ChannelResult
    least : float
        What its sensors may make of it.
    """
    left = rms(one.measured - one.after)
    if one.noise_floor <= 0.0 or left <= least:
        return 0.0
    times = left / one.noise_floor
    far = _is_far(one)
    gross = times > GROSS and left >= GROSS_SHARE * rms(one.measured - one.measured.mean())
    return times if far or gross else 0.0


def _is_far(one: ChannelResult, floor: float | None = None) -> bool:
    """Whether far more is left than noise leaves, and not little beside what is measured."""
    left, floor = rms(one.measured - one.after), one.noise_floor if floor is None else floor
    return left > FAR * floor > 0.0 and left >= FAR_SHARE * rms(one.measured)


def lacking_elsewhere(
    here: Sequence[ChannelResult],
    there: Sequence[ChannelResult],
    least: Mapping[str, float],
    floors: Mapping[str, float],
) -> dict[str, str]:
    """Channels that lack something far beyond noise on rows to verify on alone, in words.

    A model that other recordings contradict matches nothing: the machine was another then, or
    their motion shows what those to fit did not.

    Parameters
    ----------
    here, there : sequence of ChannelResult
        On rows that were fitted, and on those to verify on; in motion.
    least : mapping of str to float
        What their sensors may make of them.
    floors : mapping of str to float
        What the noise of the sensors leaves where it is verified.
    """
    fitted = {c.name: rms(c.measured - c.after) for c in here}
    result = {}
    for one in there:
        left, floor = (
            rms(one.measured - one.after),
            max(one.noise_floor, floors.get(one.name, 0.0)),
        )
        known = one.name in fitted and one.name in least
        if not known or left <= max(least[one.name], _MORE * fitted[one.name]):
            continue
        if _is_far(one, floor):
            result[one.name] = (
                f"what is left in {one.name} is {left / floor:.2g} times what the sensors' noise"
                f" leaves where it is verified, {left / max(fitted[one.name], 1e-300):.2g} times"
                " what is left where it was fitted: the machine was another then (another load),"
                " or its motion there shows what is missing; diagnose the other way round, or"
                " with more of such motion to fit"
            )
    return result


def readings_apart(training: Training, whole: Fitted) -> dict[str, str]:
    """Channels whose readings come so far from the positions' instants that it is no base's.

    A pressure that is late beyond what a base takes is a finding. Positions that are, or torques,
    are none: no effect of the catalogue stands for them.

    Parameters
    ----------
    training : Training
    whole : Fitted
        The final model.
    """
    predictor, skews_s = training.predictor, whole.model.skews_s
    material, robot = predictor.material, predictor.material.robot
    result = dict[str, str]()
    for reading in _apart(training, whole):
        joints, what = predictor.torque_joints, "torques"
        if reading != TORQUES:
            cylinder = robot.cylinders[reading // 2]
            joints, what = (robot.joint_index(cylinder.joint),), f"pressures of {cylinder.name}"
        for k, name in enumerate(material.channels):
            if not material.is_flow(k) and material.joint_of(k) in joints and name not in result:
                result[name] = _apart_text(what, name, skews_s[reading])
    return result


def cylinders_apart(training: Training, whole: Fitted) -> set[int]:
    """Cylinders whose positions are read so late, as `readings_apart` has it.

    Parameters
    ----------
    training : Training
    whole : Fitted
        The final model.
    """
    return {reading // 2 for reading in _apart(training, whole) if reading != TORQUES}


def _apart(training: Training, whole: Fitted) -> list[int]:
    """Readings that come so far from the positions' instants that it is no base's."""
    predictor, skews_s = training.predictor, whole.model.skews_s
    columns, result = predictor.skew_columns, list[int]()
    if not skews_s:
        return result
    for reading in (r for r, at in columns.items() if predictor.names[at] in whole.held):
        # Late positions make both chambers early: of one alone it is something else.
        both = [skews_s[r] for r in (reading, reading ^ 1) if r in columns and reading != TORQUES]
        if is_unnamed(reading, skews_s[reading]) and all(s < 0.0 for s in both):
            result.append(reading)
    return result


def _apart_text(what: str, channel: str, skew_s: float) -> str:
    early = skew_s < 0.0
    late = "positions are read late" if early else "torques are those of commands"
    return (
        f"the {what} in {channel} are read {1e3 * abs(skew_s):.2g} ms or more"
        f" {'before' if early else 'after'} the positions, as if {late} (a filter, a bus): no"
        " effect of the catalogue stands for it, and what else is found there may be what it"
        " does; record both with one clock and alike filters, or shift the log's columns"
    )


def with_more(
    found: Sequence[Unexplained],
    more: Mapping[str, str],
    left: Sequence[Dependence],
    *,
    confirmed: bool = False,
) -> tuple[Unexplained, ...]:
    """What has no name, with further channels in words, where nothing is said of them yet.

    Parameters
    ----------
    found : sequence of Unexplained
    more : mapping of str to str
        Texts by channel.
    left : sequence of Dependence
        Strongest first.
    confirmed : bool
        Rows that took no part say so.
    """
    told, result = {one.channel for one in found}, list(found)
    for channel, text in more.items():
        best = next((d for d in left if d.name == channel), None)
        if best is not None and channel not in told:
            on = ("everywhere",)
            result.append(Unexplained(channel, on, 1.0, None, text, best, confirmed=confirmed))
    return tuple(result)
