"""What is left: dependence that no effect of the catalogue explains."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from hydro_ident.mismatch.fitting.fitted import Fitted
from hydro_ident.mismatch.fitting.training import Training
from hydro_ident.mismatch.locating.dependence import Dependence
from hydro_ident.mismatch.locating.encoders import Encoders
from hydro_ident.mismatch.locating.few_periods import POSITIONS
from hydro_ident.mismatch.locating.flaws import Flaws
from hydro_ident.mismatch.locating.precision import drift_of, least_unconfirmed
from hydro_ident.mismatch.naming.lags import SAME_AS_DELAY, mere_delay
from hydro_ident.mismatch.rows.channel_words import ChannelWords
from hydro_ident.mismatch.rows.state_space import OF_READINGS
from hydro_ident.mismatch.settings import (
    FAMILY_ERROR_UNNAMED,
    LEAST_EXCESS,
    LEAST_SHARE,
    LEAST_SHARE_UNCONFIRMED,
)
from hydro_ident.mismatch.unnamed.describe import Form
from hydro_ident.mismatch.unnamed.wavering import Wavering

_WORDS = {
    "": "",
    "direction": " times the direction of motion",
    "valve_signal": " times the valve signal",
    "compression": " times the compression of the chamber",
    "velocity": " times the {part}'s velocity",
    "velocity_squared": " times the square of the {part}'s velocity",
}
#: Periods of time from which a mere offset repeats: fewer are a drift that came and went.
_REPEATS = 5.0
#: Share of a drift that may seem to repeat over a place.
_DRIFT_REPEATS = 0.5
#: What is said of what repeats as a reading's error does.
HINT = "a position sensor off its centre, whose error repeats, acts so"
#: Share of a channel's residual up to which a dependence leaves it to be told that all of it lacks
#: something: most of that is elsewhere.
_LITTLE = 0.5
#: Variables that a factor is of, where it is one.
_OF_VELOCITY = ("direction", "velocity", "velocity_squared")


@dataclass(frozen=True, slots=True)
class TakenOut:
    """What explains a dependence though no model has it.

    Attributes
    ----------
    text : str
    before, after : float
        Root mean square of what is left on held-out rows with it in the recordings and without
        it, in the channel's unit; NaN where no such row has the channel.
    """

    text: str
    before: float
    after: float


@dataclass(frozen=True, slots=True)
class Unexplained:
    """A dependence that has no name.

    Attributes
    ----------
    channel : str
    depends_on : tuple of str
    share : float
        Of the residual's variance.
    p_value : float or None
        Chance that nothing depends on it; None of what is told by its size alone.
    text : str
    dependence : Dependence
        For what follows no variable, of the one that comes nearest.
    form : Form or None
        A short form of it that held-out rows confirm.
    confirmed : bool
        It is there on rows that took no part, too; else these could not say.
    size : float
        Rms of the dependence, in the channel's unit; infinite where none says how large.
    taken_out : TakenOut or None
        What it comes from, where that is taken out of the recordings.
    """

    channel: str
    depends_on: tuple[str, ...]
    share: float
    p_value: float | None
    text: str
    dependence: Dependence
    form: Form | None = None
    confirmed: bool = False
    size: float = math.inf
    taken_out: TakenOut | None = None


def wanders(one: Dependence, longest_s: float) -> bool:
    """Whether a dependence is one on time that does not repeat, or hardly.

    What wanders with time does so otherwise in other recordings: they cannot confirm it.

    Parameters
    ----------
    one : Dependence
    longest_s : float
        Of the recordings.
    """
    slow = not one.times and one.period > longest_s / _REPEATS
    return one.variable == "time" and (slow or not one.period)


def unexplained(
    training: Training,
    fitted: Fitted,
    found: Sequence[Dependence],
    holds: Callable[[Dependence], bool | None],
    far: Mapping[str, float] = MappingProxyType({}),
    going: Mapping[str, str] = MappingProxyType({}),
    wavers: Mapping[str, Wavering] = MappingProxyType({}),
) -> tuple[Unexplained, ...]:
    """Significant dependence, and what is left far beyond the sensors: one entry per channel.

    Two where a dependence holds little of what is left far beyond them: that, then the rest.

    Parameters
    ----------
    training : Training
    fitted : Fitted
        With all findings.
    found : sequence of Dependence
        Of its residual, strongest first.
    holds : callable
        Whether a dependence is there on rows that took no part.
    far : mapping of str to float
        Channels that lack something whatever it follows: what is left on held-out rows over what
        the sensors' noise leaves.
    going : mapping of str to str
        Channels in which something comes and goes, and the effect that it resembles.
    wavers : mapping of str to Wavering
        Channels in which a force against the motion does.
    """
    material = training.predictor.material
    longest_s = float(np.ptp(material.time_s)) if material.size else 0.0
    flaws, encoders = Flaws.of(training, fitted), Encoders(training)
    result = dict[int, Unexplained]()
    for one in found:
        if one.p_value > FAMILY_ERROR_UNNAMED or one.channel in result or _by_place(one, found):
            continue
        slow = wanders(one, longest_s)
        least_share = LEAST_SHARE_UNCONFIRMED if slow else LEAST_SHARE
        if one.share < least_share or one.size < _least_size(training, fitted, flaws, one, slow):
            continue
        if _mere_delay(training, fitted, one):
            continue
        name, unit = material.channels[one.channel], material.units[one.channel]
        there = holds(one)
        unheard = there is None and one.variable != "time"
        if there is False or (unheard and one.share < LEAST_SHARE_UNCONFIRMED):
            continue
        if encoders.makes(fitted, one):
            continue
        words = ChannelWords(material.robot, name)
        text = (
            f"{one.share:.0%} of what is left in {name} follows {_what(words, one)}"
            f" ({one.size:.3g} {unit} rms, {_shape(words, one)}); no effect of the"
            f" catalogue stands for it{_hint(one)}"
        )
        on = (one.variable, *(("piston_velocity",) if one.times in _OF_VELOCITY else ()))
        result[one.channel] = Unexplained(
            name, tuple(dict.fromkeys(on)), one.share, one.p_value, text, one,
            confirmed=bool(there), size=one.size,
        )  # fmt: skip
    rest = _without_variable(training, found, holds, result, (far, going, wavers))
    both = sorted({*result, *rest})
    return tuple(of[k] for k in both for of in (result, rest) if k in of)


def _without_variable(
    training: Training,
    found: Sequence[Dependence],
    holds: Callable[[Dependence], bool | None],
    known: Mapping[int, Unexplained],
    others: tuple[Mapping[str, float], Mapping[str, str], Mapping[str, Wavering]],
) -> dict[int, Unexplained]:
    """What is told by its size or by its coming and going, by channel.

    `known` are the dependences that are told, `others` what `unexplained` is given of channels.
    """
    material, (far, going, wavers) = training.predictor.material, others
    result = dict[int, Unexplained]()
    for one in found:
        name, told = material.channels[one.channel], known.get(one.channel)
        if one.channel in result:
            continue
        words = ChannelWords(material.robot, name)
        if name in far and (told is None or told.share < _LITTLE):
            verified = holds(one) is not None
            result[one.channel] = (
                _at_large(words, one, far[name], verified)
                if told is None
                else _beside(told, far[name], verified)
            )
        elif name in wavers and told is None:
            result[one.channel] = _wavers(words, _over_time(one, found), wavers[name])
        elif name in going and told is None:
            result[one.channel] = _going(name, _over_time(one, found), going[name])
    return result


def _beside(told: Unexplained, times: float, verified: bool) -> Unexplained:
    """What is left far beyond the sensors beside the little of it that follows a variable."""
    share = 1.0 - told.share
    text = (
        f"what is left in {told.channel} is {times:.2g} times what the sensors' noise leaves, and"
        f" {share:.0%} of it does not follow {told.dependence.variable}: most of what is missing"
        " there is something else"
    )
    on = ("everywhere",)
    return Unexplained(
        told.channel, on, share, None, text, told.dependence, confirmed=verified
    )  # fmt: skip


def _at_large(words: ChannelWords, best: Dependence, times: float, verified: bool) -> Unexplained:
    """What is left far beyond the sensors and follows no variable, or comes and goes.

    `verified`: rows that took no part say so, too.
    """
    channel = words.channel
    text = (
        f"what is left in {channel} is {times:.2g} times what the sensors' noise leaves and"
        f" nothing that was recorded tells why; {_what(words, best)} comes nearest,"
        f" with {best.share:.0%} of it: something that comes and goes, that no sensor here sees,"
        " or that differs between recordings, as a load does"
    )
    return Unexplained(channel, ("everywhere",), 1.0, None, text, best, confirmed=verified)


def _over_time(one: Dependence, found: Sequence[Dependence]) -> Dependence:
    """What a channel's direction of motion does over time, as smoothly as it is looked at."""
    smooth = (d for d in found if d.channel == one.channel and d.variable == "time")
    return next((d for d in smooth if d.times == "direction" and not d.period), one)


def _wavers(words: ChannelWords, best: Dependence, one: Wavering) -> Unexplained:
    """A force against the motion that comes and goes."""
    unit = words.unit("piston_force")
    text = (
        f"a force against the motion in {words.channel} comes and goes: {one.mean:.3g} {unit} on"
        f" the average, from one stretch of time to another by {one.deviation:.3g} {unit} more or"
        " less (standard deviation); no effect of the catalogue does"
    )
    on = "time", "piston_velocity"
    return Unexplained(
        words.channel, on, best.share, one.p_value, text, best,
        confirmed=one.confirmed, size=one.deviation,
    )  # fmt: skip


def _going(channel: str, best: Dependence, name: str) -> Unexplained:
    """What resembles an effect in some stretches of a recording and is not there in others."""
    text = (
        f"something in {channel} comes and goes: {name} resembles it on the average, but its size"
        " is not the same all along"
    )
    return Unexplained(channel, ("time",), best.share, None, text, best)


def _drift_share(one: Dependence) -> float:
    """How much of what drifting transducers make of a force a dependence has to exceed.

    They drift over tens of seconds, in which a machine comes back to few places: whatever varies
    with the motion follows a part of it, what repeats over a place less, what swings in time none.
    """
    if not one.period:
        return 1.0
    return 0.0 if one.variable == "time" else _DRIFT_REPEATS


def _mere_delay(training: Training, fitted: Fitted, one: Dependence) -> bool:
    """Whether a delay of the commands that is too small to be a finding explains as much."""
    if not training.predictor.material.is_flow(one.channel):
        return False
    gain, shift_s = mere_delay(training, fitted, [one.channel])
    return gain >= SAME_AS_DELAY * one.gain and abs(shift_s) < LEAST_EXCESS * training.cycle_s


def _by_place(one: Dependence, found: Sequence[Dependence]) -> bool:
    """Whether what repeats in time rather repeats over a place that a motion comes back to."""
    return one.variable == "time" and any(
        other.channel == one.channel
        and other.variable in POSITIONS
        and other.period
        and other.p_value <= FAMILY_ERROR_UNNAMED
        and other.share > one.share
        for other in (found if one.period else ())
    )


def _hint(one: Dependence) -> str:
    return f"; {HINT}" if one.period and one.times in OF_READINGS else ""


def _what(words: ChannelWords, one: Dependence) -> str:
    """What is followed, in words."""
    return words.name(one.variable) + _WORDS[one.times].format(part=words.part)


def _shape(words: ChannelWords, one: Dependence) -> str:
    """Over what range, or how often, in words."""
    unit = words.unit(one.variable)
    if one.period:
        return f"repeats every {one.period:.3g} {unit}"
    return f"{words.name(one.variable)} in {unit} from {one.knots[0]:.3g} to {one.knots[-1]:.3g}"


def _least_size(
    training: Training, fitted: Fitted, flaws: Flaws, one: Dependence, wandering: bool
) -> float:
    """Rms below which a function is no more than sensors and the model's form may make of it."""
    drift = _drift_share(one) * drift_of(training.predictor.material, one.channel)
    if wandering:
        drift = max(drift, least_unconfirmed(training, fitted.model, one.channel))
    return max(drift, flaws.of_form(one, wandering=wandering))
