"""A valve that is later than the others, where nothing else says why.

A base has a delay for every valve that was moved, as all valves lag a little. One that is clearly
later than the others has physics of its own, and the base's delay hides it: a spool that slews too
slowly, lags, or hears its commands late looks like a delay of some tenths of a cycle. So that
valve is held to what the others have, and what it is later by is searched for as any effect is.

A spool that the robot file lists hides it as well, by a frequency lower than listed: what such a
valve is later by than its file says counts. To be held all spools are put back as listed, with the
usual numbers of what the file leaves out: a damping makes a valve as late as a frequency does, or
as early where one delay of all commands is tried.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import replace

import numpy as np

from hydro_ident.mismatch.fitting.as_listed import (
    as_in_file,
    key_of,
    listed_effects,
    shapes_of,
)
from hydro_ident.mismatch.fitting.fitted import Fitted, fitted
from hydro_ident.mismatch.fitting.fitting import fit
from hydro_ident.mismatch.fitting.slopes import linearised
from hydro_ident.mismatch.fitting.stepping import said_columns
from hydro_ident.mismatch.fitting.training import Training
from hydro_ident.mismatch.naming.lags import OF_VALVES, lag_s, lag_slopes
from hydro_ident.mismatch.rows.base_columns import DELAY
from hydro_ident.mismatch.settings import LEAST_EXCESS
from hydro_ident.mismatch.split.residuals import Residuals
from hydro_ident.mismatch.trials.exclusion import SPOOL
from hydro_model.effects.targets import ActiveEffect
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
    columns, listed = _told(training, whole), listed_effects(training)
    late = [t for t in whole.model.terms if t.effect.name in OF_VALVES]
    told = [t for t in late if key_of(t) not in listed]
    if len(columns) < 2 or any(t.effect.name == DELAY and t.cylinder is None for t in told):
        return None
    lagging = {t.cylinder for t in told}
    delays_s = {i: _later_s(whole, listed, i) for i in columns if i not in lagging}
    if len(delays_s) < 2:
        return None
    latest, next_one = sorted(delays_s, key=lambda i: -delays_s[i])[:2]
    covariance = _covariance(training, whole)
    slopes = [_slope(training, whole, i) for i in (latest, next_one)]
    variances = [max(float(slope @ covariance @ slope), 0.0) for slope in slopes]
    doubt_s = _SURE * float(np.sqrt(sum(variances)))
    excess_s = delays_s[latest] - delays_s[next_one] - doubt_s
    return latest if excess_s > LEAST_EXCESS * training.cycle_s else None


def _told(training: Training, whole: Fitted) -> dict[int, int]:
    """Columns of delays by cylinder, of those that the rows tell anything of.

    One that hardly a row knows has no deviation, but stays at what the robot file says: no valve
    is later than that. Beside a delay of all commands the quickest valve's stays, too, as the
    others' are told by it.
    """
    sizes, said = np.diag(_covariance(training, whole)), said_columns(training, whole.model)
    columns = training.predictor.delay_columns
    return {i: at for i, at in columns.items() if sizes[at] > 0.0 or at in said}


def _spool(whole: Fitted, index: int) -> ActiveEffect | None:
    """The spool's lag that a model has at a cylinder's valve."""
    spools = (t for t in whole.model.terms if t.effect.name == SPOOL and t.cylinder == index)
    return next(spools, None)


def _later_s(whole: Fitted, listed: Mapping[tuple[str, str], ActiveEffect], index: int) -> float:
    """What a valve is late by, beyond what the robot file says of its spool."""
    spool, late_s = _spool(whole, index), whole.model.delays_s[index]
    if spool is None or (as_given := listed.get(key_of(spool))) is None:
        return late_s
    return late_s + lag_s(spool) - lag_s(as_given)


def _slope(training: Training, whole: Fitted, index: int) -> FloatArray:
    """Of `_later_s` in the numbers by `Fitted.names`, (p,)."""
    slope, spool = np.zeros(len(whole.names)), _spool(whole, index)
    slope[training.predictor.delay_columns[index]] = 1.0
    if spool is None:
        return slope
    for name, value in lag_slopes(spool).items():
        if (*key_of(spool), name) not in training.as_listed:
            slope[whole.names.index(f"{spool.target}.{spool.effect.name}.{name}")] = value
    return slope


def _covariance(training: Training, whole: Fitted) -> FloatArray:
    """Of the numbers by `Fitted.names`, (p, p); of delays at a bound as though none held them."""
    covariance = whole.covariance.copy()
    at = [k for k in training.predictor.delay_columns.values() if whole.names[k] in whole.held]
    if at:
        _, slopes, _ = linearised(training.predictor, whole.model)
        columns = whole.columns.copy()
        columns[:, at] = slopes[:, at]
        free = training.bench(whole.bench.noise, whole.residual, columns, whole.offset)
        covariance[at], covariance[:, at] = free.covariance[at], free.covariance[:, at]
    return covariance


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
    others = [delays_s[i] for i in _told(work.training, whole) if i != index]
    latest_s = {index: float(np.median(others))}
    listed = listed_effects(work.training)
    # Of all valves: what one has to be late by, the others' spools may not make up for.
    spools = [one for one in listed.values() if one.effect.name == SPOOL]
    own = frozenset[tuple[str, str, str]]().union(*(shapes_of(one) for one in spools))
    training, scan = (
        replace(t, latest_s=latest_s, as_listed=t.as_listed | own)
        for t in (work.training, work.scan)
    )
    fresh = list(work.base.model.delays_s)
    fresh[index] = min(fresh[index], latest_s[index])
    start = replace(work.base.model, delays_s=tuple(fresh))
    for spool in spools:
        start = as_in_file(start, spool, shapes_of(spool))
    base = fit(training, start)
    same = work.scan is work.training
    return replace(work, training=training, scan=training if same else scan, base=base)


def slower_spool(work: Residuals, free: Fitted, held: Fitted, index: int) -> float:
    """How well a listed spool of other numbers explains a late valve, over what was found.

    Parameters
    ----------
    work : Residuals
        As `held_to_others` gives it.
    free, held : Fitted
        Final models, in which the spool is slower than listed, and as listed.
    index : int
        Of its cylinder.

    Returns
    -------
    float
        Twice the log-likelihood; minus infinity where the file lists no spool there.
    """
    spool = _spool(free, index)
    if spool is None or key_of(spool) not in listed_effects(work.training):
        return -np.inf
    return fitted(work.training, held.model, free.bench.noise).squares - free.squares


def explains(names: Collection[tuple[str, int | None]], index: int) -> bool:
    """Whether any of some effects, by name and cylinder, makes one cylinder's valve late.

    `names` are these pairs.
    """
    return any(name in OF_VALVES and cylinder == index for name, cylinder in names)
