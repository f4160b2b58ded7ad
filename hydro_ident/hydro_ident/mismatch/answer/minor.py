"""Effects that are there and that no machine is without: told in a note, and no finding.

Minutes of a quiet machine tell a transducer's gain to some 0.01 %. That it is 0.05 % off is true
and in its data sheet's tolerance; who is told it as the physics that was left out looks for what
is missing in the wrong place. Such an effect stays in the model, where it keeps others from
taking its part.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType

import numpy as np

from hydro_ident.mismatch.answer.outcome import ChannelResult, Finding
from hydro_ident.mismatch.unnamed.unknown import Unexplained
from hydro_ident.transducers import ZERO, zero_pa
from hydro_model.effects.targets import ActiveEffect
from hydro_model.effects.valve_effects import KNEE
from hydro_model.robot import Robot

#: Step of a converter of twelve bits, as a share of the valve's signal either way.
_STEP = 2.0**-11
#: What rounded edges, and flow that is laminar where a valve hardly opens, take of its signal.
_EDGE = 1.0e-3
_BENT, _BIAS, _VOLUME = "valve_gain_nonlinearity", "pressure_sensor_bias", "dead_volume"
#: Largest sizes that are within what sensors, drawings, seals and converters are good for: the
#: accuracy of a good transducer and of setting a joint's zero, a fitting's oil, what rounding and
#: cutting off of a valve's signal leave. A balance tells the gains of a cylinder's two transducers
#: by their difference: two of 0.1 % each are up to 0.2 % apart. Zeros are shares of the range.
_TOLERATED: Mapping[str, tuple[str | tuple[str, ...], float]] = {
    "pressure_sensor_gain": ("error", 2.0e-3),
    _BIAS: ("bias", ZERO),
    "encoder_offset": ("offset", 5.0e-4),
    _VOLUME: ("volume", 1.0e-5),
    "valve_null_bias": ("bias", 0.5 * _STEP),
    "valve_hysteresis": ("half_width", 0.5 * _STEP),
    "valve_deadband": ("width", _EDGE),
    "valve_underlap": ("width", _EDGE),
    # An orifice's coefficient falls where its flow turns laminar.
    "pressure_compensation": (("share", "outflow"), 1.5e-2),
}
#: Of these what a set holds beside others counts: what valves have, a base's delay swallows.
_OF_ALL = frozenset(
    {
        "pressure_sensor_gain", "pressure_sensor_bias", "encoder_offset", "coulomb_friction",
        "presliding_friction", "stribeck_friction", "asymmetric_friction",
    }
)  # fmt: skip
#: What a small machine has is less: this share of its cylinder's oil, and of its supply, which a
#: range that no file states may be far beyond.
_OIL_SHARE, _SUPPLY_SHARE = 0.03, 5.0e-4
#: Dry friction of so small a share of what the cylinder can push, at this velocity, is any seal's.
_FRICTION = frozenset(
    {"coulomb_friction", "presliding_friction", "stribeck_friction", "asymmetric_friction"}
)
_FRICTION_SHARE, _FRICTION_M_S = 2.0e-4, 0.05
#: Share of a channel's standard deviation below which what has no name is no unknown either: a
#: good transducer's linearity.
UNKNOWN_SHARE = 1.0e-3
#: Nor is what makes so little of what is left (of its squares) in a channel at its sensors' noise.
_HARDLY = 0.03
#: Deviations by which a size has to be beyond what is tolerated, and the share of itself that they
#: are at most.
_SURE, _DOUBT = 2.0, 1.0 / 3.0


def is_minor(
    robot: Robot, term: ActiveEffect, deviations: Mapping[str, float] = MappingProxyType({})
) -> bool:
    """Whether an effect is not surely larger than what is tolerated of every machine.

    Parameters
    ----------
    robot : Robot
    term : ActiveEffect
        As fitted.
    deviations : mapping of str to float
        Of its parameters, as `Fitted.names` has them, where they are known.
    """
    name = term.effect.name
    if name in _TOLERATED:
        begin, most = _TOLERATED[name][0], _most(robot, term)
        own = f"{term.target}.{name}."
        sizes = [(n, abs(v)) for n, v in _values(term) if n.startswith(begin)]
        doubts = [min(_SURE * deviations.get(own + n, 0.0), _DOUBT * v) for n, v in sizes]
        return all(v - d < most for (_, v), d in zip(sizes, doubts, strict=True))
    if name == _BENT:
        # A corner next to closed is an offset of the signal further on, where the edges' fit
        # makes the slope one.
        values = dict(_values(term))
        bend = values["progression"]
        return 0.0 < abs(bend) / (1.0 + bend) * values[KNEE.name] < _EDGE
    if name == "constant_force_offset" and term.cylinder is not None:
        # What a transducer's zero that is tolerated makes of the force.
        push = _most_zero_pa(robot) * robot.cylinders[term.cylinder].area_a_m2
        return bool(abs(term.parameters[0]) < push)
    if name in _FRICTION and term.cylinder is not None:
        push = robot.cylinders[term.cylinder].area_a_m2 * robot.supply_pressure_pa
        values = dict(_values(term))
        size = abs(values["force"]) + _FRICTION_M_S * abs(values.get("viscous", 0.0))
        return size < _FRICTION_SHARE * push
    return False


def _most(robot: Robot, term: ActiveEffect) -> float:
    """The size of an effect that is tolerated on this machine."""
    name = term.effect.name
    if name == _BIAS:
        return _most_zero_pa(robot)
    most = _TOLERATED[name][1]
    if name == _VOLUME and term.cylinder is not None:
        cylinder = robot.cylinders[term.cylinder]
        most = min(most, _OIL_SHARE * cylinder.area_a_m2 * cylinder.stroke_m)
    return most


def _most_zero_pa(robot: Robot) -> float:
    """Error of a transducer's zero that is tolerated; intervals of `identify` hold as much."""
    return min(zero_pa(robot), _SUPPLY_SHARE * (robot.supply_pressure_pa or np.inf))


def parted(
    robot: Robot, findings: Sequence[Finding], deviations: Mapping[str, float]
) -> tuple[list[Finding], list[Finding]]:
    """Findings, and those that are minor.

    Parameters
    ----------
    robot : Robot
    findings : sequence of Finding
    deviations : mapping of str to float
        As `is_minor`.

    Returns
    -------
    findings, minor : list of Finding
    """
    minor = [f for f in findings if _minor_of(robot, f, deviations) is not None]
    return [f for f in findings if f not in minor], minor


def _minor_of(
    robot: Robot, finding: Finding, deviations: Mapping[str, float]
) -> ActiveEffect | None:
    """What of a finding's set is minor: what may be no more than every machine has is no finding.

    Deviations are known of what is in the model alone.
    """
    own = finding.named.term
    if is_minor(robot, own, deviations):
        return own
    others = (c.term for c in finding.named.contenders if c.term.effect.name in _OF_ALL)
    return next((term for term in others if is_minor(robot, term)), None)


def parted_unknown(
    unknown: Sequence[Unexplained], channels: Sequence[ChannelResult]
) -> tuple[tuple[Unexplained, ...], list[str]]:
    """What has no name, and notes on what of it is no larger than sensors are good for.

    Parameters
    ----------
    unknown : sequence of Unexplained
    channels : sequence of ChannelResult

    Returns
    -------
    kept : tuple of Unexplained
    notes : list of str
    """
    of = {c.name: c for c in channels}
    why = [_why_none(one, of.get(one.channel)) for one in unknown]
    kept = tuple(one for one, reason in zip(unknown, why, strict=True) if not reason)
    notes = [f"{u.text}: {w}: no unknown" for u, w in zip(unknown, why, strict=True) if w]
    return kept, notes


def _why_none(one: Unexplained, channel: ChannelResult | None) -> str:
    """Why what has no name is no unknown; empty where it is."""
    if channel is None or one.taken_out is not None:
        return ""
    share = one.size / max(float(np.std(channel.measured)), 1e-300)
    if share < UNKNOWN_SHARE:
        return f"{1e2 * share:.2g} % of {one.channel} itself, no more than sensors are good for"
    if one.share < _HARDLY and channel.at_noise:
        return f"{1e2 * one.share:.2g} % of what is left at the noise of {one.channel}'s sensors"
    return ""


def minor_notes(
    robot: Robot, minor: Sequence[Finding], deviations: Mapping[str, float]
) -> list[str]:
    """What they are, in words.

    Parameters
    ----------
    robot : Robot
    minor : sequence of Finding
    deviations : mapping of str to float
        As `parted`.
    """
    notes = []
    for finding in minor:
        own = finding.named.term
        term = _minor_of(robot, finding, deviations) or own
        units, values = term.units, _values(term)
        told = ", ".join(
            f"{values[i][0]} {values[i][1]:.3g}{'' if units[i] == '1' else f' {units[i]}'}"
            for i in sorted(term.effect.sizes)
        )
        there = f"{own.effect.name} of {own.target} is there, but"
        if term is not own:
            there += f" it may as well be {term.effect.name} of {term.target},"
        notes.append(
            f"{there} not surely larger than every machine has ({told}): in the model, no finding"
        )
    return notes


def _values(term: ActiveEffect) -> list[tuple[str, float]]:
    names = [p.name for p in term.effect.parameters]
    return [(n, float(v)) for n, v in zip(names, term.parameters, strict=True)]
