"""Laws of the flow through a valve, one behind the other, as in a roll-out.

Restrictions in series multiply: each law sees the valve's flow as those before it have left it
(`hydro_model.effects.effect.Effect.needs_valve`).
"""

from __future__ import annotations

from collections.abc import Sequence

from hydro_model.effects.catalogue import CATALOGUE
from hydro_model.effects.law import FLOW
from hydro_model.effects.targets import ActiveEffect

_ORDER = {name: k for k, name in enumerate(CATALOGUE)}


def valve_laws(terms: Sequence[ActiveEffect], index: int, side: str) -> list[ActiveEffect]:
    """Effects with a law of the flow between a chamber and its valve, in the order they act.

    Parameters
    ----------
    terms : sequence of ActiveEffect
        Of a model.
    index : int
        Of the cylinder.
    side : str
        Of the chamber, ``a`` or ``b``.
    """
    found = [
        one
        for one in terms
        if one.effect.needs_valve
        and one.cylinder in (None, index)
        and one.side in ("", side)
        and FLOW[side] in one.effect.stages
    ]
    return sorted(found, key=lambda one: _ORDER[one.effect.name])


def before(laws: Sequence[ActiveEffect], one: ActiveEffect) -> list[ActiveEffect]:
    """Those of some laws that act before another."""
    return [law for law in laws if _ORDER[law.effect.name] < _ORDER[one.effect.name]]
