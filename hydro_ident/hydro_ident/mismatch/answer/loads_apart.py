"""Loads that differ between recordings: no effect of a machine, but the likeliest cause.

A model has one load in all recordings. Where another hangs at the tip in one of them, what is left
in the forces follows no variable that is the same in both. A load of each recording's own, beside
the base where that is fitted, tells how much of it that would explain.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from hydro_ident.mismatch.fitting.fitted import Fitted
from hydro_ident.mismatch.fitting.training import Training
from hydro_ident.mismatch.naming.instants import at_own_instants
from hydro_ident.mismatch.rows.onset import standing
from hydro_ident.mismatch.rows.prediction import Model, Predictor
from hydro_ident.mismatch.rows.testable import untestable
from hydro_ident.mismatch.split.check import Check
from hydro_ident.mismatch.unnamed.unknown import Unexplained
from hydro_model.arrays import BoolArray
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
    asked = {u.channel for u in found if u.depends_on == ("everywhere",)}
    asked -= {c for c in asked if "/flow_" in c}
    material = training.predictor.material
    if not asked or untestable(material, CATALOGUE["payload_change"]):
        return tuple(found)
    hints = _between(training, whole) or _beside(training, whole, check)
    return tuple(
        replace(one, text=one.text + hints[one.channel])
        if one.channel in asked and one.channel in hints
        else one
        for one in found
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


def _between(training: Training, whole: Fitted) -> dict[str, str]:
    """Loads that differ among the recordings that were fitted, in words by channel."""
    material, bench = training.predictor.material, whole.bench
    names = material.recordings
    if len(names) < 2:
        return {}
    columns = bench.beyond(loads_of_each(training.predictor, whole.model)[training.mask])
    rows = {
        name: bench.channel == k
        for k, name in enumerate(material.channels)
        if not material.is_flow(k)
    }
    masses, shares = _explained(columns, bench.residual, rows)
    # A load that all have is the base's.
    if np.ptp(masses) < float(np.abs(masses).max()):
        return {}
    told = ", ".join(f"{name} {m:+.3g}" for name, m in zip(names, masses, strict=True))
    return {
        channel: (
            f"; loads at the tip that differ by {np.ptp(masses):.3g} kg between the recordings"
            f" would take {share:.0%} of it (about their mean: {told} kg): fit recordings of one"
            " load"
        )
        for channel, share in shares.items()
        if share >= _SHARE
    }


def _beside(training: Training, whole: Fitted, check: Check) -> dict[str, str]:
    """Other loads in the recordings to verify on, in words by channel."""
    predictor, material = check.predictor, check.predictor.material
    model, _ = at_own_instants(training, check, whole.model)
    left, columns = check.residual(model), loads_of_each(predictor, model)
    rows = {
        name: check.rows_in_motion & (material.channel == k)
        for k, name in enumerate(material.channels)
        if not material.is_flow(k)
    }
    rows = {name: own for name, own in rows.items() if own.any()}
    weights = np.zeros(material.size)
    for own in rows.values():
        weights[own] = 1.0 / max(float(np.sqrt(np.mean(left[own] ** 2))), 1e-300)
    masses, shares = _explained(columns * weights[:, None], left * weights, rows)
    pairs = zip(material.recordings, masses, strict=True)
    told = ", ".join(f"{m:+.3g} kg in {name}" for name, m in pairs)
    return {
        channel: (
            f"; another load at the tip would take {share:.0%} of it ({told}): verify with one"
            " load"
        )
        for channel, share in shares.items()
        if share >= _SHARE
    }


def _explained(
    columns: FloatArray, left: FloatArray, rows: Mapping[str, BoolArray]
) -> tuple[FloatArray, dict[str, float]]:
    """Sizes (R,) of columns that explain most of some rows, and their share in each channel."""
    if not rows:
        return np.zeros(columns.shape[1]), {}
    every = np.any(list(rows.values()), axis=0)
    sizes: FloatArray = np.linalg.lstsq(columns[every], left[every], rcond=None)[0].astype(float)
    rest = left - columns @ sizes
    return sizes, {
        name: 1.0 - float(rest[own] @ rest[own]) / max(float(left[own] @ left[own]), 1e-300)
        for name, own in rows.items()
    }
