"""The valley of spools' lags and of their valves' delays, and a better place to start in it.

A lag and its valve's own delay go together along a bent valley, and a fit that starts beside it
stays where it comes down to the floor. As all valves hear one bus, the delay of those that do not
lag is a better place to start from.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from hydro_ident.mismatch.fitting.fitted import Fitted
from hydro_ident.mismatch.fitting.fitting import NEAR, fit, settled
from hydro_ident.mismatch.fitting.training import Training
from hydro_ident.mismatch.naming.lags import lag_s
from hydro_ident.mismatch.rows.prediction import Model
from hydro_ident.mismatch.trials.exclusion import SPOOL
from hydro_model.effects.targets import ActiveEffect

#: Passes of the fit of a lag that is begun anew: the valley is long.
_ANEW = 12


def from_one_delay(training: Training, current: Fitted) -> Fitted:
    """A fit with the lags of spools begun anew from the delay of the other valves.

    Parameters
    ----------
    training : Training
    current : Fitted

    Returns
    -------
    Fitted
        The one given where the other valley is no deeper, or no spool lags.
    """
    fresh = begun_anew(training, current)
    if fresh is current:
        return current
    return settled(training, fit(training, fresh.model, passes=NEAR))


def begun_anew(training: Training, current: Fitted) -> Fitted:
    """As `from_one_delay`, weighed by the noise that it was weighed by.

    Parameters
    ----------
    training : Training
    current : Fitted
    """
    model, columns = current.model, training.predictor.delay_columns
    lagging = [
        t
        for t in model.terms
        if t.effect.name == SPOOL and t.cylinder in columns and not training.keeps(t)
    ]
    if not lagging:
        return current
    own = {t.cylinder for t in lagging}
    others = [model.delays_s[i] for i in columns if i not in own]
    # Where all lag, what is the bus's is told by none: it may be as much less as more.
    all_lag_s = 0.5 * min(model.delays_s[i] for i in columns)
    delay_s = float(np.median(others)) if others else all_lag_s
    terms = tuple(
        _longer(t, model, delay_s) if any(t is one for one in lagging) else t for t in model.terms
    )
    delays_s = tuple(delay_s if i in own else d for i, d in enumerate(model.delays_s))
    start = replace(model, terms=terms, delays_s=delays_s)
    fresh = fit(training, start, current.bench.noise, _ANEW)
    return current if fresh.start_squares >= current.start_squares else fresh


def _longer(term: ActiveEffect, model: Model, delay_s: float) -> ActiveEffect:
    """A spool's lag with what its valve is later than a delay."""
    names = [spec.name for spec in term.effect.parameters]
    at, damped = names.index("frequency"), names.index("damping")
    parameters = term.parameters.copy()
    late_s = lag_s(term) + model.delays_s[int(term.cylinder or 0)] - delay_s
    parameters[damped] = term.effect.parameters[damped].typical
    spec = term.effect.parameters[at]
    hz = parameters[damped] / (np.pi * max(late_s, 1.0e-6))
    parameters[at] = min(max(hz, spec.lower), spec.upper)
    return replace(term, parameters=parameters)
