"""A valve that is later than the others, where nothing else says why.

A base has a delay for every valve, as all valves lag a little. One that is clearly later than the
others has physics of its own, and the base's delay hides it: a spool that slews too slowly, lags,
or hears its commands late looks like a delay of some tenths of a cycle. So that valve is held to
what the others have, and what it is later by is searched for as any effect is.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

import numpy as np

from hydro_ident.mismatch.base_columns import DELAY
from hydro_ident.mismatch.fitted import Fitted
from hydro_ident.mismatch.fitting import fit
from hydro_ident.mismatch.lags import OF_VALVES
from hydro_ident.mismatch.residuals import Residuals
from hydro_ident.mismatch.settings import LEAST_EXCESS
from hydro_ident.mismatch.slopes import linearised
from hydro_ident.mismatch.training import Training
from hydro_model.robot import FloatArray

#: Deviations by which a valve is surely later than the next one.
_SURE = 3.0


def odd_valve(training: Training, whole: Fitted) -> int | None:
    """The cylinder of the one valve whose delay is surely beyond the others'.

    Parameters
    ----------
    training : Training
    whole : Fitted
        With all that was found.

    Returns
    -------
    int or None
        None where none is, or what was found says already what makes valves late.
    """
    columns = training.predictor.delay_columns
    told = [t for t in whole.model.terms if t.effect.name in OF_VALVES]
    if len(columns) < 2 or any(t.effect.name == DELAY and t.cylinder is None for t in told):
        return None
    lagging = {t.cylinder for t in told}
    free = sorted((i for i in columns if i not in lagging), key=lambda i: -whole.model.delays_s[i])
    if len(free) < 2:
        return None
    latest, next_one = free[:2]
    later_s = whole.model.delays_s[latest] - whole.model.delays_s[next_one]
    variances = _variances(training, whole)[[columns[latest], columns[next_one]]]
    doubt_s = _SURE * float(np.sqrt(np.maximum(variances, 0.0).sum()))
    return latest if later_s - doubt_s > LEAST_EXCESS * training.cycle_s else None


def _variances(training: Training, whole: Fitted) -> FloatArray:
    """Of the numbers by `Fitted.names`, (p,); of delays at a bound as though none held them."""
    variances = np.diag(whole.covariance).copy()
    at = [k for k in training.predictor.delay_columns.values() if whole.names[k] in whole.held]
    if at:
        _, slopes, _ = linearised(training.predictor, whole.model)
        columns = whole.columns.copy()
        columns[:, at] = slopes[:, at]
        free = training.bench(whole.bench.noise, whole.residual, columns, whole.offset)
        variances[at] = np.diag(free.covariance())[at]
    return variances


def held_to_others(work: Residuals, whole: Fitted, index: int) -> Residuals:
    """The rows with a base in which one valve is no later than the others are.

    Parameters
    ----------
    work : Residuals
    whole : Fitted
        As `odd_valve`.
    index : int
        Of its cylinder.
    """
    delays_s = whole.model.delays_s
    others = [delays_s[i] for i in work.training.predictor.delay_columns if i != index]
    latest_s = {index: float(np.median(others))}
    training, scan = (replace(t, latest_s=latest_s) for t in (work.training, work.scan))
    fresh = list(work.base.model.delays_s)
    fresh[index] = min(fresh[index], latest_s[index])
    base = fit(training, replace(work.base.model, delays_s=tuple(fresh)))
    same = work.scan is work.training
    return replace(work, training=training, scan=training if same else scan, base=base)


def explains(names: Collection[tuple[str, int | None]], index: int) -> bool:
    """Whether any of some effects, by name and cylinder, makes one cylinder's valve late.

    `names` are these pairs.
    """
    return any(name in OF_VALVES and cylinder == index for name, cylinder in names)
