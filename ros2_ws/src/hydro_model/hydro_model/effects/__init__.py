"""The physics catalogue: what a first model leaves out, an `Effect` per name.

Adding an effect is adding an `Effect` to the module of its family (or a new module) and its
tuple to `hydro_model.effects.catalogue`.
"""

from hydro_model.effects.applied import read_with, with_changes
from hydro_model.effects.catalogue import CATALOGUE, resolve
from hydro_model.effects.effect import Effect, ReadingChange, RobotChange
from hydro_model.effects.law import InternalState, Law, ParameterSpec, Row, Stage, Term
from hydro_model.effects.readings import Readings
from hydro_model.effects.targets import ActiveEffect, targets

__all__ = [
    "CATALOGUE",
    "ActiveEffect",
    "Effect",
    "InternalState",
    "Law",
    "ParameterSpec",
    "ReadingChange",
    "Readings",
    "RobotChange",
    "Row",
    "Stage",
    "Term",
    "read_with",
    "resolve",
    "targets",
    "with_changes",
]
