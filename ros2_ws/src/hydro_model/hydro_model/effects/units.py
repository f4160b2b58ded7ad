"""Units at a joint without cylinder, where the piston of laws and signals is the joint itself."""

from __future__ import annotations

import re

from hydro_model.effects.effect import Effect

#: What only a turning joint has; units with it are that joint's own already.
_OF_TURNING = re.compile(r"\brad\b|\bN m\b|\bkg\b")
_TO_TURNING = ((r"\bm\b(?!\^3)", "rad"), (r"\bN\b", "N m"))
_TO_SLIDING = ((r"\bkg m\^2", "kg"), (r"\bN m\b", "N"), (r"\brad\b", "m"))


def unit_at_joint(unit: str, prismatic: bool) -> str:
    """The unit of a joint for that of a piston, or of a joint of the other kind.

    Parameters
    ----------
    unit : str
        As the packages write it.
    prismatic : bool
        Whether the joint slides.

    Returns
    -------
    str
        E.g. N m s/rad for N s/m where the joint turns.
    """
    if not prismatic and _OF_TURNING.search(unit):
        return unit
    for pattern, own in _TO_SLIDING if prismatic else _TO_TURNING:
        unit = re.sub(pattern, own, unit)
    return unit


def effect_units(effect: Effect, prismatic: bool | None) -> tuple[str, ...]:
    """Units of an effect's parameters, in their order.

    Parameters
    ----------
    effect : Effect
    prismatic : bool or None
        Whether the joint that it acts on slides; None where it acts on none.

    Returns
    -------
    tuple of str
    """
    units = tuple(spec.unit for spec in effect.parameters)
    # What looks at the tip or at another joint is not in the joint's own units.
    if prismatic is None or effect.needs_tip or effect.needs_other_joint:
        return units
    return tuple(unit_at_joint(unit, prismatic) for unit in units)
