"""Listed effects of an identified model that are too unsure to be compensated.

A compensation of the wrong sign or of several times the size does more harm than none. Effects
that a person lists are taken at their word; a fitted one says how sure it is, by the standard
deviations `<target>.<effect>.<parameter>` of its model file.
"""

from __future__ import annotations

import math
from dataclasses import replace

from hydro_model.effects import ActiveEffect, Effect, ParameterSpec, resolve
from hydro_model.robot import EffectSpec, Robot

#: Half width of a 95 % interval in standard deviations.
_INTERVAL = 2.0
#: A value this near to a bound, as a share of it, has run to it.
_AT_BOUND = 1.0e-6
#: Lags below this frequency (Hz) ask for more lead than noise and rated voltage leave.
_SLOWEST_HZ = {"valve_spool_lag": 5.0}


def doubt(robot: Robot, listed: EffectSpec) -> str:
    """Why a listed effect should be left alone.

    The sizes of an effect are its linear parameters, or those that can be 0 where it has none.
    Laws without either lag behind: by the first parameter's lower bound they are at their slowest.

    Parameters
    ----------
    robot : Robot
    listed : EffectSpec
        One of its effects.

    Returns
    -------
    str
        Empty where nothing speaks against it: no deviation is stated for it, or its sizes keep
        away from zero and from their bounds.

    Raises
    ------
    RobotError
        The effect does not resolve.
    """
    reasons = [_doubt(robot, one) for one in resolve(replace(robot, effects=(listed,)))]
    return next((reason for reason in reasons if reason), "")


def _doubt(robot: Robot, one: ActiveEffect) -> str:
    effect, deviations = one.effect, robot.standard_deviations
    stated = [f"{one.target}.{effect.name}.{p.name}" in deviations for p in effect.parameters]
    if not any(stated):
        return ""
    sizes = _sizes(effect)
    near_zero = []
    for index in sizes or (0,):
        spec, value = effect.parameters[index], float(one.parameters[index])
        bounds = (spec.lower, spec.upper) if sizes else (spec.lower,)
        if _at_bound(spec, value, bounds):
            return f"{spec.name} of {one.target} ran to its bound of {value:g} {spec.unit}"
        if value <= _SLOWEST_HZ.get(effect.name, -math.inf):
            return (
                f"{spec.name} of {one.target} is too low to be made up for ({value:g} {spec.unit})"
            )
        std = deviations.get(f"{one.target}.{effect.name}.{spec.name}")
        if sizes and std is not None:
            near_zero.append(abs(value) <= _INTERVAL * std)
    if near_zero and all(near_zero):
        return f"its size at {one.target} may as well be zero"
    return ""


def _sizes(effect: Effect) -> tuple[int, ...]:
    """Indices of the parameters that are 0 where there is no effect."""
    spanning = (i for i, p in enumerate(effect.parameters) if p.lower <= 0.0 <= p.upper)
    return effect.linear or tuple(spanning)


def _at_bound(spec: ParameterSpec, value: float, bounds: tuple[float, ...]) -> bool:
    """Whether a value stands at a bound that is neither 0, no effect at all, nor usual."""
    return any(
        bound not in (0.0, spec.typical) and abs(value - bound) <= _AT_BOUND * abs(bound)
        for bound in bounds
    )
