"""Loads that differ between recordings: no effect of a machine, but the likeliest cause.

A model has one load in all recordings. Where another hangs at the tip in one of them, what is left
in the forces follows no variable that is the same in both. A load of each recording's own, beside
the base where that is fitted, tells how much of it that would explain.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from hydro_ident.estimate.rows import BoolArray
from hydro_ident.mismatch.check import Check
from hydro_ident.mismatch.fitting import Fitted
from hydro_ident.mismatch.instants import at_own_instants
from hydro_ident.mismatch.onset import standing
from hydro_ident.mismatch.prediction import Model, Predictor
from hydro_ident.mismatch.testable import untestable
from hydro_ident.mismatch.training import Training
from hydro_ident.mismatch.unknown import Unexplained
from hydro_model.effects.catalogue import CATALOGUE
from hydro_model.effects.targets import ActiveEffect
from hydro_model.robot import FloatArray

#: Share of what is left in the forces from which loads that differ are said to explain it.
_SHARE = 0.5


def with_loads(
    found: Sequence[Unexplained], training: Training, whole: Fitted, check: Check
) -> tuple[Unexplained, ...]:
    """What follows nothing in a force, with the loads that would explain it, where some would.

    Parameters
    ----------
    found : sequence of Unexplained
    training : Training
    whole : Fitted
        The final model.
    check : Check
        Rows to verify on.
    """
    material = training.predictor.material
    flows = {name for k, name in enumerate(material.channels) if material.is_flow(k)}
    asked = [u.depends_on == ("everywhere",) and u.channel not in flows for u in found]
    if not any(asked) or untestable(material, CATALOGUE["payload_change"]):
        return tuple(found)
    hint = _between(training, whole) or _beside(training, whole, check)
    return tuple(
        replace(one, text=one.text + hint) if own else one
        for one, own in zip(found, asked, strict=True)
    )


def loads_of_each(predictor: Predictor, model: Model) -> FloatArray:
    """What a load of 1 kg at the tip adds in each recording alone, (N, R).

    Parameters
    ----------
    predictor : Predictor
    model : Model
    """
    effect, material = CATALOGUE["payload_change"], predictor.material
    one = standing(ActiveEffect(effect, None, effect.typical.copy(), target=material.robot.name))
    values = one.parameters.copy()
    values[effect.sizes[0]] = 1.0
    column = predictor.contribution(model, replace(one, parameters=values))
    recordings = np.arange(len(material.recordings))
    return np.asarray(column[:, None] * (material.recording[:, None] == recordings))


def _between(training: Training, whole: Fitted) -> str:
    """Loads that differ among the recordings that were fitted."""
    material = training.predictor.material
    names = material.recordings
    if len(names) < 2:
        return ""
    bench, model = whole.bench, whole.model
    columns = bench.beyond(loads_of_each(training.predictor, model)[training.mask])
    forces = [k for k in range(len(material.channels)) if not material.is_flow(k)]
    rows = np.isin(bench.channel, forces)
    masses, share = _explained(columns[rows], bench.residual[rows])
    if share < _SHARE:
        return ""
    # A load that all have is the base's.
    told = ", ".join(f"{name} {m:+.3g}" for name, m in zip(names, masses, strict=True))
    return (
        f"; loads at the tip that differ by {np.ptp(masses):.3g} kg between the recordings would"
        f" take {share:.0%} of it (about their mean: {told} kg): fit recordings of one load"
    )


def _beside(training: Training, whole: Fitted, check: Check) -> str:
    """Other loads in the recordings to verify on."""
    predictor, material = check.predictor, check.predictor.material
    model, _ = at_own_instants(training, check, whole.model)
    left, columns = check.residual(model), loads_of_each(predictor, model)
    rows, weights = _force_rows(check, left)
    if not rows.any():
        return ""
    scaled = columns[rows] * weights[rows, None]
    masses, share = _explained(scaled, left[rows] * weights[rows])
    if share < _SHARE:
        return ""
    pairs = zip(material.recordings, masses, strict=True)
    told = ", ".join(f"{m:+.3g} kg in {name}" for name, m in pairs)
    return f"; another load at the tip would take {share:.0%} of it ({told}): verify with one load"


def _force_rows(check: Check, left: FloatArray) -> tuple[BoolArray, FloatArray]:
    """Rows of forces in motion, and their weights, (N,)."""
    material, moving = check.predictor.material, check.rows_in_motion
    rows, weights = np.zeros(material.size, dtype=np.bool_), np.ones(material.size)
    for k in range(len(material.channels)):
        own = moving & (material.channel == k)
        if own.any() and not material.is_flow(k):
            rows |= own
            weights[own] = 1.0 / max(float(np.sqrt(np.mean(left[own] ** 2))), 1e-300)
    return rows, weights


def _explained(columns: FloatArray, left: FloatArray) -> tuple[FloatArray, float]:
    """Sizes (R,) of columns that explain most, and the share of the squares that they do."""
    sizes: FloatArray = np.linalg.lstsq(columns, left, rcond=None)[0].astype(np.float64)
    whole = float(left @ left)
    rest = left - columns @ sizes
    return sizes, 1.0 - float(rest @ rest) / whole if whole > 0.0 else 0.0
