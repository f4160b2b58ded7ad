"""Whether recordings that took no part give an effect the same size."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from hydro_ident.mismatch.fitting.bench import Bench
from hydro_ident.mismatch.fitting.fitted import Fitted
from hydro_ident.mismatch.fitting.fitting import fit
from hydro_ident.mismatch.fitting.prior import Prior
from hydro_ident.mismatch.fitting.training import Training, layout_of
from hydro_ident.mismatch.naming.instants import at_own_instants
from hydro_ident.mismatch.rows.modelled import same
from hydro_ident.mismatch.settings import BLOCK_S, FORM_TOLERANCE
from hydro_ident.mismatch.split.check import Check
from hydro_model.effects.targets import ActiveEffect

#: Two sizes differ beyond so many deviations and this share of the larger one: what a refit of the
#: base trades with an effect is another share of it in every motion.
DEVIATIONS, SHARE = 4.0, 0.67
#: Deviations from nothing from which a size is told.
_TOLD = 2.0
#: Passes of the fit to the other recordings, from the values found.
_PASSES = 3


@dataclass(frozen=True, slots=True)
class Agreement:
    """One parameter, fitted to the training rows and to others.

    Attributes
    ----------
    name, unit : str
        The name within the effect.
    training, held_out : float
    std : float
        Of their difference, with what a law's form is off by.
    """

    name: str
    unit: str
    training: float
    held_out: float
    std: float

    @property
    def agrees(self) -> bool:
        """Whether both may be the same."""
        apart = abs(self.training - self.held_out)
        larger = max(abs(self.training), abs(self.held_out))
        return apart <= max(DEVIATIONS * self.std, SHARE * larger)


def fitted_there(training: Training, check: Check, whole: Fitted) -> Fitted | None:
    """A model fitted anew to rows that took no part; None where they are too few."""
    rows = check.mask & check.moving
    if np.count_nonzero(rows) < 10 * whole.columns.shape[1]:
        return None
    there = check.training(training)
    return fit(there, at_own_instants(training, check, whole.model)[0], passes=_PASSES)


def agreements(
    whole: Fitted, there: Fitted | None, terms: Sequence[ActiveEffect]
) -> tuple[Agreement, ...]:
    """The sizes of some effects here and there.

    Parameters
    ----------
    whole : Fitted
        To the training rows.
    there : Fitted or None
        The same model, fitted to others.
    terms : sequence of ActiveEffect
        Of it. Shapes are left out, and whatever has its own history in every recording: what
        begins at an instant, and what follows the oil's temperature.
    """
    if there is None:
        return ()
    return tuple(
        one
        for term in terms
        if not (term.effect.start or term.effect.name == "temperature_drift")
        for one in _of_term(whole, there, term)
    )


def alike(check: Check, there: Fitted, term: ActiveEffect, prior: Prior | None = None) -> bool:
    """Whether an effect does much the same to other rows as it does when fitted to them.

    Stations of a curve, or a size and a slope, trade with each other; what they come to together
    is what has to agree.

    Parameters
    ----------
    check : Check
    there : Fitted
        As `fitted_there`.
    term : ActiveEffect
        As fitted to the training rows.
    prior : Prior, optional
        As `held_out`.
    """
    used, own = check.mask & check.moving, f"{term.target}.{term.effect.name}."
    others = [k for k, name in enumerate(there.names) if not name.startswith(own)]
    known = None
    if prior is not None:
        known = prior.rows(len(there.names))[:, others], np.zeros(prior.root.shape[0])
    layout, rest = layout_of(check.predictor).take(used), there.columns[used][:, others]
    bench = Bench(layout, there.bench.noise, there.residual[used], rest, BLOCK_S, known)
    fresh = next(t for t in there.model.terms if same(t, term))
    both = [check.predictor.contribution(there.model, t)[used] for t in (term, fresh)]
    left = bench.beyond(np.stack(both, axis=1))
    sizes = np.linalg.norm(left, axis=0)
    return bool(np.linalg.norm(left[:, 0] - left[:, 1]) <= SHARE * sizes.max())


def untold(whole: Fitted, terms: Sequence[ActiveEffect]) -> str:
    """Sizes that a fit does not tell from nothing; empty where it tells one of each effect.

    Parameters
    ----------
    whole : Fitted
    terms : sequence of ActiveEffect
        Of its model.
    """
    for term in terms:
        at = {
            f"{term.target}.{term.effect.name}.{term.effect.parameters[i].name}": i
            for i in term.effect.sizes
        }
        told = {
            name: (_value(whole, term, i), _std(whole, name))
            for name, i in at.items()
            if name in whole.names
        }
        if told and all(abs(value) < _TOLD * std for value, std in told.values()):
            return ", ".join(f"{n} is {v:.2g} +- {s:.2g}" for n, (v, s) in told.items())
    return ""


def _of_term(whole: Fitted, there: Fitted, term: ActiveEffect) -> Iterator[Agreement]:
    for i in term.effect.sizes:
        spec = term.effect.parameters[i]
        name = f"{term.target}.{term.effect.name}.{spec.name}"
        if name in whole.names and name in there.names:
            here, other = _value(whole, term, i), _value(there, term, i)
            form = FORM_TOLERANCE * max(abs(here), abs(other))
            std = math.hypot(_std(whole, name), _std(there, name), form)
            yield Agreement(spec.name, term.units[i], here, other, std)


def _value(one: Fitted, term: ActiveEffect, index: int) -> float:
    return next(float(t.parameters[index]) for t in one.model.terms if same(t, term))


def _std(one: Fitted, name: str) -> float:
    k = one.names.index(name)
    variance = float(one.bench.covariance[k, k])
    return math.sqrt(max(variance, 0.0)) if math.isfinite(variance) else math.inf
