"""Findings put to recordings, or whole blocks, that took no part in anything.

A finding stands where the model without it, refitted on the training rows, predicts these rows
worse by more than sign flips of whole blocks explain, and where a placebo of equal freedom, the
same contribution at other times, does not do as well. The finding itself is taken as it was found;
rows are looked at as they are predicted, and with base and other effects refitted to them on
either side, so that what other motions make of their small errors speaks neither for nor against.
Rows that do not exercise a finding are silent: then its own recording has to leave no doubt.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from hydro_ident.mismatch.fitting.fitted import Fitted
from hydro_ident.mismatch.fitting.fitting import NEAR, fit_without
from hydro_ident.mismatch.fitting.training import Training
from hydro_ident.mismatch.fitting.whitening import Noise
from hydro_ident.mismatch.naming.instants import at_own_instants
from hydro_ident.mismatch.naming.named import Named, untold_by_few
from hydro_ident.mismatch.naming.placebos import placebo_residuals
from hydro_ident.mismatch.rows.modelled import same
from hydro_ident.mismatch.rows.prediction import Model, Predictor
from hydro_ident.mismatch.split.check import Check, noise_there
from hydro_ident.mismatch.split.held_out import STANDS, held_out
from hydro_ident.mismatch.trials.constancy import COMES_AND_GOES, COMES_AND_GOES_FLOW, inconstancy
from hydro_ident.mismatch.trials.contender import at_a_bound
from hydro_ident.mismatch.verifying.agreement import Agreement, agreements, alike, untold
from hydro_ident.mismatch.verifying.judging import (
    FURTHER,
    PLAIN,
    exercised,
    judged,
    meets,
    paid_for,
    unpredicted,
    vague,
)
from hydro_ident.mismatch.verifying.looks import looked
from hydro_model.effects.targets import ActiveEffect
from hydro_model.robot import FloatArray


@dataclass(frozen=True, slots=True)
class Verification:
    """How a finding did on rows that it never saw.

    Attributes
    ----------
    p_value : float
    before, after : dict of str to float
        Rmse by channel without and with it, as predicted or all else refitted to these rows:
        whichever tells more.
    placebo : float
        Improvement by the median placebo over the finding's own.
    stands : bool
    reason : str
        Why it does not.
    agreement : tuple of Agreement
        Its sizes here and there.
    silent : bool
        These rows do not exercise the finding: they speak neither for nor against it.
    comes_and_goes : bool
        Its size is not the same all along: something else resembles it on the average.
    idle : bool
        Beside the other findings it does not stand out on the training rows either.
    gain : float
        What it takes out of the training rows' squares beside the others, in units of the noise's
        variance.
    """

    p_value: float
    before: dict[str, float]
    after: dict[str, float]
    placebo: float
    stands: bool
    reason: str
    agreement: tuple[Agreement, ...] = ()
    silent: bool = False
    comes_and_goes: bool = False
    idle: bool = False
    gain: float = 0.0

    def by_base(self, channel: str) -> bool:
        """Whether rows that do not exercise it are predicted better by the base that it frees.

        Without it the base had taken up what the training rows have of it. That speaks for
        something there, but not for its name.

        Parameters
        ----------
        channel : str
            In which it shows.
        """
        before, after = self.before.get(channel, 0.0), self.after.get(channel, np.inf)
        return self.silent and self.p_value <= STANDS and after < before


def verify(
    training: Training,
    whole: Fitted,
    named: Named,
    check: Check,
    there: Fitted | None = None,
    tried: int = 1,
    shown: Sequence[str] = (),
    passes: int = NEAR,
) -> Verification:
    """Put one finding to the check.

    Parameters
    ----------
    training : Training
    whole : Fitted
        The final model.
    named : Named
    check : Check
    there : Fitted or None
        The final model, fitted anew to the check's rows.
    tried : int
        How many candidates it was chosen from.
    shown : sequence of str
        Channels in which it shows, none of which it may make worse; by default all it acts on.
    passes : int
        Of the fit without the finding.
    """
    mine, narrow = named.term, check
    rest = tuple(t for t in whole.model.terms if not same(t, mine))
    terms = [t for t in whole.model.terms if same(t, mine)]
    acting = shown or _acting(check.predictor, whole.model, mine)
    check = narrow.reaching(mine, acting)
    without = fit_without(training, whole, rest, passes)
    material = training.predictor.material
    noise = noise_there(whole.bench.noise, material.channels, check.predictor.material.channels)
    model, tried_instants = at_own_instants(training, check, whole.model)
    lacking = replace(without, model=at_own_instants(training, check, without.model)[0])
    plain, with_it = check.residual(lacking.model), check.residual(model)
    # What comes and goes does on either rows when it does there.
    here = _column(training.predictor, whole.model, mine)
    elsewhere = _column(check.predictor, model, mine)
    placebos = placebo_residuals(training, without, check, plain, here, elsewhere)
    prior = check.known(training)
    behind, ahead = held_out(check, lacking, noise, prior)
    ahead = ahead.doubted(behind, with_it)
    instants = tried_instants.get((mine.effect.name, mine.target), 1)
    # Its instants are paid for, and what was refused before it: so far down chance has to be told.
    dear = instants / FURTHER**named.refused
    looks = [looked(one, plain, with_it, placebos, acting, dear) for one in (ahead, behind)]
    looks = paid_for(looks, instants)
    plainly, own = PLAIN * max(named.spread, 1.0), _whitened(training, whole.bench.noise, here)
    met = meets(check, acting) and exercised((ahead, behind), own, elsewhere, plainly)
    best, silent, against = judged(looks, named, met)
    against = against or unpredicted(looks[0], acting, silent)
    against = against or vague(best, silent, acting, untold(whole, terms))
    agreement = () if silent else agreements(whole, there, terms)
    gain = without.squares - whole.squares
    idle = _idle(gain, named, tried)
    reason = _bound(mine, *terms) or untold_by_few(named, mine) or idle or against
    if not silent and there is not None:
        alien = not all(alike(narrow, there, term, prior) for term in terms)
        reason = reason or (_apart(agreement) if alien else "")
    # In few motions a stretch of time is a stretch of the law: its form and its size are one.
    going = "" if reason or named.few > 1.0 else _comes_and_goes(training, without, here)
    reason = reason or going
    # What a refit to these rows leaves is no prediction of them, whatever it says of the finding.
    sides = best.paid, *looks[0].sides, best.placebo
    quiet = bool(idle) and reason == idle
    return Verification(*sides, not reason, reason, agreement, silent, bool(going), quiet, gain)


def _bound(*terms: ActiveEffect) -> str:
    """Why a finding as it was named, or as it is beside the others, is none; empty for nothing."""
    return next((why for term in terms if (why := at_a_bound(term))), "")


def _whitened(training: Training, noise: Noise, column: FloatArray) -> FloatArray:
    """A column (N,) of all rows on the training rows, in units of their noise."""
    white = noise.whitened(training.layout, column[training.mask])
    return white[noise.settled(training.layout)]


def _comes_and_goes(training: Training, without: Fitted, column: FloatArray) -> str:
    """What speaks against a finding whose size is not the same all along; empty for nothing.

    `column` (N,) is what it does to the training rows.
    """
    changes = inconstancy(without.bench, column[training.mask])
    material = training.predictor.material
    flow = all(material.is_flow(int(k)) for k in np.unique(material.channel[column != 0.0]))
    if changes < (COMES_AND_GOES_FLOW if flow else COMES_AND_GOES):
        return ""
    return (
        f"it comes and goes: from one stretch of the recordings to another its size changes by"
        f" {changes:.2g} times itself (standard deviation)"
    )


def _idle(gain: float, named: Named, tried: int) -> str:
    """Whether a finding no longer stands out on the training rows themselves.

    What it was found beside may have been withdrawn since: its parameters have to pay still, for
    its choice among so many as well.
    """
    least = 2.0 * named.spread * (named.modelled.cost + math.log(max(tried, 1)))
    if gain >= least:
        return ""
    return (
        "beside the other findings it no longer stands out on the training rows"
        f" (gain {gain:.3g}, at least {least:.3g})"
    )


def _apart(agreement: Sequence[Agreement]) -> str:
    """Which size differs from that on the training rows."""
    for one in agreement:
        if not one.agrees:
            return (
                f"its {one.name} is {one.training:.3g} {one.unit} on the training rows and"
                f" {one.held_out:.3g} +- {one.std:.2g} on held-out ones"
            )
    return ""


def _acting(predictor: Predictor, model: Model, mine: ActiveEffect) -> list[str]:
    """Channels whose prediction a model's effect changes; all where it changes none."""
    material, column = predictor.material, _column(predictor, model, mine)
    names = [n for k, n in enumerate(material.channels) if column[material.channel == k].any()]
    return names or list(material.channels)


def _column(predictor: Predictor, model: Model, mine: ActiveEffect) -> FloatArray:
    """What a model's effect does to all rows of a material, (N,)."""
    own = [predictor.contribution(model, t) for t in model.terms if same(t, mine)]
    return np.asarray(sum(own, np.zeros(predictor.material.size)))
