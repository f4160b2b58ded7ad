"""Effects that recordings could not have shown, and why."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hydro_ident.mismatch.fitting.training import Training
from hydro_ident.mismatch.rows.testable import untestable
from hydro_ident.mismatch.trials.scoring import SWALLOWED, Score
from hydro_model.effects.catalogue import CATALOGUE

#: Deviations at which a candidate's size is as good as always found.
_SURE = 5.0
#: Usual sizes beyond which a motion cannot show an effect at all.
_NEVER = 1000.0


@dataclass(frozen=True, slots=True)
class NotTestable:
    """An effect that these recordings could not have shown.

    Attributes
    ----------
    name, why : str
    """

    name: str
    why: str


def not_testable(
    training: Training, scanned: Sequence[Score], found: Sequence[str]
) -> tuple[NotTestable, ...]:
    """Effects that these recordings could not have shown, and why.

    Parameters
    ----------
    training : Training
    scanned : sequence of Score
        Of every trial, on the final model.
    found : sequence of str
        Names that were found: they were testable.
    """
    material = training.predictor.material
    result = []
    for name, effect in CATALOGUE.items():
        if name in found:
            continue
        # Whatever goes by the name: it could show if one form of it could.
        reasons = [untestable(material, form) for form in effect.forms]
        why = "" if "" in reasons else reasons[0]
        if not why:
            why = _too_small(name, [s for s in scanned if s.entry.trial.name == name])
        if why:
            result.append(NotTestable(name, why))
    return tuple(result)


def _too_small(name: str, own: Sequence[Score]) -> str:
    """Why an effect of its typical size would not have stood out; empty where it would."""
    if not own:
        return "nothing in these recordings changes with it, or a refit of the base swallows it"
    smallest = min(_detectable(s) for s in own)
    if smallest > _NEVER:
        return "nothing of it is left in this motion that a refit of the base does not swallow"
    if smallest > 1.0:
        times = f"{smallest:.2g}"
        size = "a little over its usual size" if times == "1" else f"{times} times its usual size"
        return f"in this motion it would have to be {size} to stand out"
    return ""


def _detectable(one: Score) -> float:
    """Size that would be found, in units of the trial's own."""
    gram, plain = np.diag(one.partial.gram), one.partial.plain
    told = gram > SWALLOWED * plain
    return float(_SURE / np.sqrt(np.max(gram[told]))) if told.any() else np.inf
