"""The physics catalogue: what a first model leaves out, an `Effect` per name.

Adding an effect is adding an `Effect` to the module of its family (or a new module) and its
tuple to `hydro_model.effects.catalogue`.
"""

from hydro_model.effects.catalogue import CATALOGUE, ActiveEffect, resolve
from hydro_model.effects.effect import (
    Effect,
    InternalState,
    Law,
    ParameterSpec,
    Row,
    Stage,
    Term,
)

__all__ = [
    "CATALOGUE",
    "ActiveEffect",
    "Effect",
    "InternalState",
    "Law",
    "ParameterSpec",
    "Row",
    "Stage",
    "Term",
    "resolve",
]
