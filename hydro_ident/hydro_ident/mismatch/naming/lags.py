"""What makes valves late, and whether it is more than the delay that a base has anyway."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hydro_ident.mismatch.fitting.fitted import Fitted
from hydro_ident.mismatch.fitting.handover import late_valves
from hydro_ident.mismatch.fitting.training import Training
from hydro_ident.mismatch.rows.base_columns import DELAY
from hydro_ident.mismatch.rows.skew import PRESSURE_DELAY, least_skew
from hydro_ident.mismatch.settings import LEAST_CYCLES, LEAST_EXCESS
from hydro_ident.mismatch.trials.contender import Contender
from hydro_model.effects.targets import ActiveEffect

#: Effects that, where small, are a delay of a valve's signal or of its flow.
LAGS = ("valve_spool_lag", "valve_rate_limit", "valve_hysteresis", "line_dynamics")
#: What makes one valve later than others.
OF_VALVES = (*LAGS, DELAY)
#: Share of an effect's gain from which a mere delay says the same.
SAME_AS_DELAY = 0.9


def resolved(training: Training, without: Fitted, one: Contender) -> bool:
    """Whether a contender is more than a shift in time that sampling cannot tell.

    Parameters
    ----------
    training : Training
    without : Fitted
        The model that it was added to.
    one : Contender
    """
    cycle_s, term = training.cycle_s, one.term
    if term.effect.name == PRESSURE_DELAY:
        # What the base has of it goes over to the effect.
        columns, skews_s = training.predictor.skew_columns, one.fitted.model.skews_s
        late_s = term.parameters[0] + least_skew(term, columns, skews_s)
        return bool(late_s >= LEAST_CYCLES * cycle_s)
    if term.effect.name == DELAY:
        delays_s = one.fitted.model.delays_s
        # Of a valve without a balance no delay was fitted.
        own_s = min(delays_s[i] for i in late_valves(term, training.predictor.delay_columns))
        excess = term.parameters[0] + own_s - training.own_delay_of(term.cylinder)
        return bool(excess >= LEAST_EXCESS * cycle_s)
    if term.effect.name not in LAGS:
        return True
    channel = training.predictor.material.channel
    column = training.predictor.contribution(without.model, term)
    acting = [k for k in np.unique(channel).tolist() if column[channel == k].any()]
    gain, shift_s = mere_delay(training, without, acting)
    late_s = shift_s
    if term.cylinder is not None:
        late_s += without.model.delays_s[term.cylinder] - training.own_delay_of(term.cylinder)
    excess_s = max(abs(shift_s), late_s)
    return gain < SAME_AS_DELAY * one.gain or excess_s >= LEAST_EXCESS * cycle_s


def lag_s(spool: ActiveEffect) -> float:
    """How late a spool of second order is in slow motion, 2 zeta / omega, in s.

    Parameters
    ----------
    spool : ActiveEffect
    """
    frequency, damping = _of_spool(spool)
    return damping / (np.pi * frequency)


def lag_slopes(spool: ActiveEffect) -> dict[str, float]:
    """Slopes of `lag_s` in a spool's own numbers, by their names.

    Parameters
    ----------
    spool : ActiveEffect
    """
    frequency, damping = _of_spool(spool)
    of_frequency = -damping / (np.pi * frequency**2)
    return {"frequency": of_frequency, "damping": 1.0 / (np.pi * frequency)}


def _of_spool(spool: ActiveEffect) -> tuple[float, float]:
    numbers = dict(zip((p.name for p in spool.effect.parameters), spool.parameters, strict=True))
    return float(numbers["frequency"]), float(numbers["damping"])


def base_delay(training: Training, without: Fitted, term: ActiveEffect) -> float:
    """Sum of squares, in units of the noise, of the delay that a base has where a lag is tried.

    What a lag adds to it is a part of one and the same: laws of it differ by their forms as a
    whole.

    Parameters
    ----------
    training : Training
    without : Fitted
        The model that the lag is added to.
    term : ActiveEffect
    """
    predictor = training.predictor
    if term.effect.name not in LAGS or term.cylinder not in predictor.delay_columns:
        return 0.0
    at = predictor.delay_columns[term.cylinder]
    _, base = predictor.base(without.model)
    late = base[:, at] * without.model.delays_s[term.cylinder]
    rest = without.columns.copy()
    rest[:, at] = 0.0
    return float(np.sum(training.bench(without.bench.noise, late, rest).residual ** 2))


def mere_delay(
    training: Training, without: Fitted, channels: Sequence[int]
) -> tuple[float, float]:
    """What a mere delay of all that commands do in some channels gains, and the delay in s.

    Parameters
    ----------
    training : Training
    without : Fitted
    channels : sequence of int
    """
    predictor, mask = training.predictor, training.mask
    _, base = predictor.base(without.model)
    slopes = base[:, list(predictor.delay_columns.values())].sum(axis=1)
    slope = slopes * np.isin(predictor.material.channel, channels)
    own = without.bench.beyond(slope[mask][:, None])[:, 0]
    square, product = float(own @ own), float(own @ without.bench.residual)
    return (product**2 / square, product / square) if square > 0.0 else (0.0, 0.0)
