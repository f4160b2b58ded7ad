"""Channels that lack something, whatever it follows, here or elsewhere, or are read apart."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from hydro_ident.mismatch.dependence import Dependence
from hydro_ident.mismatch.fitting import Fitted
from hydro_ident.mismatch.held_out import rms
from hydro_ident.mismatch.outcome import ChannelResult
from hydro_ident.mismatch.settings import FAR, FAR_SHARE, GROSS, GROSS_SHARE
from hydro_ident.mismatch.skew import TORQUES, is_unnamed
from hydro_ident.mismatch.training import Training
from hydro_ident.mismatch.unknown import Unexplained


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


def _is_far(one: ChannelResult) -> bool:
    """Whether far more is left than noise leaves, and not little beside what is measured."""
    left = rms(one.measured - one.after)
    return left > FAR * one.noise_floor > 0.0 and left >= FAR_SHARE * rms(one.measured)


def lacking_elsewhere(
    here: Sequence[ChannelResult], there: Sequence[ChannelResult], least: Mapping[str, float]
) -> dict[str, str]:
    """Channels that lack something far beyond noise on rows to verify on alone, in words.

    A model that other recordings contradict matches nothing: the machine was another then, or
    their motion shows what those to fit did not.

    Parameters
    ----------
    here, there, least
        As `lacking`; rows to verify on are those in motion.
    """
    known = {c.name for c in here if distance(c, least[c.name]) > 0.0}
    far = [c for c in there if c.name in least and _is_far(c) and c.name not in known]
    return {
        c.name: (
            f"what is left in {c.name} is {rms(c.measured - c.after) / c.noise_floor:.2g} times"
            " what the sensors' noise leaves where it is verified, and nothing like it where it"
            " was fitted: the machine was another then (another load), or its motion there shows"
            " what is missing; diagnose the other way round, or with more of such motion to fit"
        )
        for c in far
        if rms(c.measured - c.after) > least[c.name]
    }


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
    if not skews_s:
        return {}
    columns, result = predictor.skew_columns, dict[str, str]()
    held = {r: skews_s[r] for r, at in columns.items() if predictor.names[at] in whole.held}
    forces = [k for k in range(len(material.channels)) if not material.is_flow(k)]
    for reading, skew_s in held.items():
        if not is_unnamed(reading, skew_s):
            continue
        cylinder = None if reading == TORQUES else robot.cylinders[reading // 2]
        for k in forces:
            own = cylinder is None or material.joint_of(k) == robot.joint_index(cylinder.joint)
            if own and material.channels[k] not in result:
                what = "torques" if cylinder is None else f"pressures of {cylinder.name}"
                result[material.channels[k]] = _apart_text(what, material.channels[k], skew_s)
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
    found: Sequence[Unexplained], more: Mapping[str, str], left: Sequence[Dependence]
) -> tuple[Unexplained, ...]:
    """What has no name, with further channels in words, where nothing is said of them yet.

    Parameters
    ----------
    found : sequence of Unexplained
    more : mapping of str to str
        Texts by channel.
    left : sequence of Dependence
        Strongest first.
    """
    told, result = {one.channel for one in found}, list(found)
    for channel, text in more.items():
        best = next((d for d in left if d.name == channel), None)
        if best is not None and channel not in told:
            result.append(Unexplained(channel, ("everywhere",), 1.0, None, text, best))
    return tuple(result)
