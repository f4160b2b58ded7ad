"""Which effects cannot stand side by side at a target."""

from __future__ import annotations

from hydro_ident.mismatch.rows.base_columns import DELAY
from hydro_model.effects.targets import ActiveEffect

SPOOL = "valve_spool_lag"
#: Laws that each hold the whole dry friction of a cylinder, or how much later than the others a
#: valve is: one of them at a target.
EXCLUSIVE = (
    frozenset({"coulomb_friction", "presliding_friction", "position_dependent_friction"}),
    frozenset({SPOOL, DELAY}),
)


def exclude(one: str, other: str) -> bool:
    """Whether two names cannot stand side by side at a target."""
    return one == other or any({one, other} <= some for some in EXCLUSIVE)


def shut_out(name: str) -> frozenset[str]:
    """Other names that cannot stand beside one at its target, and are not tried there."""
    return frozenset[str]().union(*(some for some in EXCLUSIVE if name in some)) - {name}


def rival(one: ActiveEffect, other: ActiveEffect) -> bool:
    """Whether two effects cannot stand side by side."""
    return one.target == other.target and exclude(one.effect.name, other.effect.name)
