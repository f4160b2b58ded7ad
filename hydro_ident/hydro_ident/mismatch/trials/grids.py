"""Values that are tried of a law's shape parameters: usual ones, and what was recorded."""

from __future__ import annotations

from dataclasses import replace

from hydro_ident.mismatch.rows.material import Material
from hydro_ident.mismatch.rows.prediction import Model, Predictor
from hydro_ident.mismatch.trials.places import (
    FURTHER_FACTORS,
    QUANTILES,
    instant_spacing,
    instants_of,
    mean_oil_c,
    quantiles,
    rubbing,
)
from hydro_model.effects.effect import Effect
from hydro_model.effects.flexibility import CARRIED
from hydro_model.effects.friction import BEND
from hydro_model.effects.law import ParameterSpec
from hydro_model.effects.mechanics import ABOUT
from hydro_model.effects.signals import (
    PISTON_FORCE,
    PISTON_POSITION,
    VALVE_RATE,
    VALVE_SIGNAL,
)
from hydro_model.effects.targets import ActiveEffect
from hydro_model.effects.valve_edges import SHIFT
from hydro_model.effects.valve_effects import KNEE, TRAVEL

#: Torque over which the flanks of a drive's play come to bear.
FLANK = "contact_torque"
#: Shapes tried around the typical value: of the first needed parameter, of further ones, and of
#: those optional ones that a fit from the typical value alone would not find.
FIRST_FACTORS = (0.25, 0.5, 1.0, 2.0, 4.0)
#: Sizes tried of effects that do not grow like their size.
SIZE_FACTORS = (0.04, 0.12, 0.35, 1.0, 3.0)
SCANNED_FACTORS = (0.25, 1.0, 4.0)
SCANNED = ("velocity_scale", "time_constant", "contact_force")
#: Effects whose optional shapes of these names are all scanned.
_SCANNED_WHOLE = ("temperature_drift", "backlash")
#: Shapes that no small one leads to: overlaps of proportional valves swallow whole signals, those
#: of valves driven by a current a third of it and more.
_WIDE = {("valve_deadband", "width"): (10.0, 20.0, 40.0)}
#: Slew limits tried, of the rate that the command exceeds for a tenth of the time, either way.
_OF_COMMAND = tuple(0.5 * 1.35**k for k in range(8))
#: Torques over which a gear's flanks come to bear, of the largest that the drive had.
_CONTACT_SHARES = (0.02, 0.05, 0.1, 0.25)
#: A mode that is hardly damped answers to a few percent around its own frequency alone; one whose
#: frequency goes with the posture is, over a recording, like one that is damped more.
_FINE = {
    ("structural_flexibility", "frequency"): tuple(2.0 ** (k / 3.0) for k in range(-6, 7)),
    ("structural_flexibility", "damping"): (1.0, 6.0),
}
#: Factors of such a frequency between those tried, half of the way to the next ones.
_BETWEEN = tuple(2.0 ** (k / 18.0) for k in range(-3, 4))
#: Of late pressures: what lateness does to quick reversals is no multiple of a shorter one.
_LATE_FACTORS = (1.0, 2.0, 4.0)


def between_tried(one: ActiveEffect) -> list[ActiveEffect]:
    """An effect at values of its finely tried shape between those tried, and itself.

    Parameters
    ----------
    one : ActiveEffect

    Returns
    -------
    list of ActiveEffect
        Empty where it has no such shape.
    """
    names = [spec.name for spec in one.effect.parameters]
    if (one.effect.name, "frequency") not in _FINE:
        return []
    at = names.index("frequency")
    result = []
    for factor in _BETWEEN:
        values = one.parameters.copy()
        values[at] *= factor
        result.append(replace(one, parameters=values))
    return result


def tried_at(
    predictor: Predictor, model: Model, one: ActiveEffect, spec: ParameterSpec
) -> list[float]:
    """Values at which one shape parameter of an effect is tried.

    Parameters
    ----------
    predictor : Predictor
    model : Model
    one : ActiveEffect
    spec : ParameterSpec
        Of the effect's.

    Returns
    -------
    list of float
        Empty where nothing that was recorded says where to try.
    """
    for found in (
        _of_time(predictor.material, one.effect, spec),
        _of_recording(predictor, model, one, spec),
        _single(one.effect, spec),
    ):
        if found is not None:
            return found
    return _around(one.effect, spec)


def is_signed(effect: Effect) -> bool:
    """Whether the number that is an effect's size may be negative."""
    return effect.parameters[effect.sizes[0]].lower < 0.0


def _of_time(material: Material, effect: Effect, spec: ParameterSpec) -> list[float] | None:
    """Instants, and what a drift with time or temperature has; None for other parameters."""
    if spec.name == effect.start:
        # From before the recording on, too: a refit of the base swallows that, a fixed one not.
        always = [] if spec.default is None else [spec.default]
        return always + instants_of(material)
    if spec.name == effect.end:
        # With the instants at which it comes it stays; `passages` go again.
        return [spec.upper]
    if spec.name == effect.duration:
        # Over what lies between two instants: whenever it begins, one of them is near.
        return [instant_spacing(material)]
    if spec.name == effect.head_start:
        # What it has done before, the base has taken up; others' own is looked for there.
        return [0.0]
    if effect.name == "temperature_drift" and (mean_c := mean_oil_c(material)) is not None:
        # A temperature that is known needs no rise with time; roll-outs without are at the mean.
        known = {
            "reference": [mean_c],
            "rise": [0.0],
            "time_constant": [spec.typical],
            "halving_temperature": [f * spec.typical for f in (0.5, 1.0, 2.0)],
        }
        return known.get(spec.name)
    return None


def _of_recording(
    predictor: Predictor, model: Model, one: ActiveEffect, spec: ParameterSpec
) -> list[float] | None:
    """Values along what was recorded; None for parameters that are tried at usual ones alone."""
    name = one.effect.name
    if spec is ABOUT and one.cylinder is None:
        return [0.0]  # what acts on the joint itself acts along itself
    if name == "end_cushion" and spec.name == "length":
        return _lengths(predictor, model, one, spec)
    if name == "valve_rate_limit" and spec.name == "rate":
        # A slow spool saturates at what the command's own rate is, whatever is usual.
        asked = max(abs(rate) for rate in quantiles(predictor, model, one, (VALVE_RATE,)))
        rates = [f * spec.typical for f in SIZE_FACTORS] + [f * asked for f in _OF_COMMAND]
        return list(dict.fromkeys(min(max(r, spec.lower), spec.upper) for r in rates))
    if spec is KNEE:
        # At the ends of the middle fifths of the openings, whichever way.
        at = quantiles(predictor, model, one, (VALVE_SIGNAL,))
        ends = [0.5 * (abs(low) + abs(high)) for low, high in zip(at, at[::-1], strict=True)]
        return [0.0, *(w for w in ends[: len(at) // 2] if 0.0 < w < spec.upper)]
    if name == "backlash" and spec.name == FLANK:
        loads = quantiles(predictor, model, one, (PISTON_FORCE,))
        largest = max(abs(load) for load in loads)
        return [max(share * largest, spec.lower) for share in _CONTACT_SHARES]
    if name == "backlash" and spec.name == "drag":
        return [rubbing(predictor, model, one)]
    return None


def _lengths(
    predictor: Predictor, model: Model, one: ActiveEffect, spec: ParameterSpec
) -> list[float]:
    """Lengths of a cushion: also as far from the stops as the piston has been, real ones vary."""
    at = quantiles(predictor, model, one, (PISTON_POSITION,))
    if len(at) < len(QUANTILES):
        return []  # nothing is known of where the piston was
    stroke_m = 0.0 if one.cylinder is None else model.robot.cylinders[one.cylinder].stroke_m
    lengths = [f * spec.typical for f in FIRST_FACTORS]
    lengths += [near for x in (at[0], at[2], at[-3], at[-1]) for near in (x, stroke_m - x)]
    return [x for x in lengths if spec.lower <= x <= 0.5 * stroke_m]


def _single(effect: Effect, spec: ParameterSpec) -> list[float] | None:
    """The one value, or the few, of parameters that no factors are tried of; None for others."""
    if spec in (BEND, TRAVEL, SHIFT, CARRIED, ABOUT):
        return [0.0, spec.typical]
    if spec.typical == 0.0:
        return [0.0]
    if not effect.linear and spec is effect.parameters[effect.sizes[0]] and is_signed(effect):
        return [spec.typical]
    if effect.name == "pressure_delay":
        return [f * spec.typical for f in _LATE_FACTORS]
    if effect.name == "command_delay" or effect.reading is not None:
        return [spec.typical]
    return None


def _around(effect: Effect, spec: ParameterSpec) -> list[float]:
    """Factors of the usual value, within bounds."""
    if spec.optional:
        factors: tuple[float, ...] = (1.0,)
        if spec.name == "velocity_scale" or effect.name in _SCANNED_WHOLE:
            factors = _scanned(spec)
    else:
        needed = [p for p in effect.parameters if not (p.linear or p.optional)]
        first = FIRST_FACTORS if effect.linear else SIZE_FACTORS
        factors = first if spec is needed[0] else FURTHER_FACTORS
    factors = _FINE.get((effect.name, spec.name), factors)
    factors += _WIDE.get((effect.name, spec.name), ())
    values = [min(max(f * spec.typical, spec.lower), spec.upper) for f in factors]
    return list(dict.fromkeys(values))


def _scanned(spec: ParameterSpec) -> tuple[float, ...]:
    if spec.name == "rise":
        return (-1.0, 1.0)
    return SCANNED_FACTORS if spec.name in SCANNED else (1.0,)
