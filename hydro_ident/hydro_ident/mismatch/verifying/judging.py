"""What held-out rows say for a finding and against it, all ways of looking taken together.

Whether they exercise it at all, which of the looks speaks for it, and the words for what is
against it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from hydro_ident.mismatch.naming.named import Named
from hydro_ident.mismatch.settings import FAMILY_ERROR_UNNAMED
from hydro_ident.mismatch.split.check import Check
from hydro_ident.mismatch.split.held_out import STANDS, HeldOut
from hydro_ident.mismatch.trials.products import paid
from hydro_ident.mismatch.verifying.looks import SHOWN, Look, missed, objection
from hydro_model.robot import FloatArray

#: What the next effect of a set has to be better by where one was refused: it is another question.
FURTHER = 0.1
#: ... and what goes with rows that it should hardly change: that takes luck, or more than found.
_LUCK = 0.1
#: Chance on held-out rows from which on they show a finding but faintly.
FAINTLY = 1.0e-3
#: Share of an effect's mean square on the training rows below which held-out rows miss it, unless
#: what a refit leaves of it there is this many of the noise's variances, times overdispersion.
_EXERCISED, PLAIN = 0.02, 100.0
#: What a true finding would gain in a look, per unit of overdispersion, that plainly denies it
#: where more than this share of chance does as well: five deviations.
_PLAINLY, _NEVER = 25.0, 0.5
#: Rise of rmse in every channel in which a finding shows with which it predicts nothing.
_WORSENED = 0.01
#: Log-likelihood by which its own recording has to pay for a finding that no other one exercises:
#: odds of twenty to one.
_NO_DOUBT = 3.0


def paid_for(looks: Sequence[Look], instants: int) -> list[Look]:
    """Ways of looking, any of which may tell, with that and the instants tried paid for.

    Parameters
    ----------
    looks : sequence of Look
    instants : int
        From how many the finding had to choose on these rows.
    """
    shared = paid([one.p_value for one in looks])
    return [
        replace(one, p_value=p, instants=instants) for one, p in zip(looks, shared, strict=True)
    ]


def vague(best: Look, silent: bool, acting: Sequence[str], size: str) -> str:
    """What speaks against a finding whose size is not told: held-out rows that hardly show it.

    Parameters
    ----------
    best : Look
    silent : bool
        They do not exercise it.
    acting : sequence of str
        Channels that it acts on.
    size : str
        As `untold`.
    """
    before, after = best.sides
    gains = any(after[n] < before[n] for n in acting if n in after)
    if not size or (not silent and gains and best.paid <= FAINTLY):
        return ""
    little = "hardly exercise it" if silent else "show it but faintly"
    little = little if silent or gains else "gain nothing by it"
    return f"held-out rows {little}, and its size is not told: {size}"


def unpredicted(ahead: Look, acting: Sequence[str], silent: bool) -> str:
    """What speaks against a finding by which rows are predicted no better wherever it shows.

    A refit to these rows may gain by it still: that is a fit, and no prediction.

    Parameters
    ----------
    ahead : Look
        At held-out rows as they are predicted.
    acting : sequence of str
        Channels in which it shows.
    silent : bool
        They do not exercise it: what its base makes of them may be a little worse.
    """
    before, after = ahead.sides
    known = [name for name in acting if name in after]
    if ahead.unseen and not silent:
        return f"held-out rows of {', '.join(known or after)} are predicted no better with it"
    if not known or any(after[n] <= (1.0 + _WORSENED) * before[n] for n in known):
        return ""
    rise = min(after[n] / max(before[n], 1e-300) for n in known) - 1.0
    return f"held-out rows of {', '.join(known)} are predicted worse with it (rmse +{rise:.1%})"


def judged(looks: Sequence[Look], named: Named, met: bool) -> tuple[Look, bool, str]:
    """The look that speaks for a finding, whether there is nothing to see, and what is against it.

    What shows on held-out rows but faintly they are not bound to confirm: they are to give a true
    finding's share of chance, and its own recording the rest. No look may deny it plainly. Either
    is of the rows as they are: what a finding pays for its instants does not speak against it.

    Parameters
    ----------
    looks : sequence of Look
        Paid for.
    named : Named
        The finding.
    met : bool
        Whether it is at work on these rows: `meets` and `exercised`.
    """
    least, spread = STANDS * FURTHER**named.refused, max(named.spread, 1.0)
    best = min(looks, key=lambda one: (bool(objection(one, least)), one.p_value))
    against = objection(best, least)
    plain = not against and best.paid <= _LUCK * least
    if met and not plain and max(one.shown for one in looks) < SHOWN * spread:
        # It acts there, and as it should: what only its own recording tells was fitted to that,
        # unless more of it is there, and plainly: its size came out too small, or acts more.
        return best, False, against or "held-out rows exercise it and cannot tell it from nothing"
    denied = any(one.shown >= _PLAINLY * spread and one.p_value > _NEVER for one in looks)
    unpaid = replace(best, instants=1)
    faint = against and not objection(unpaid, missed(best.shown / spread))
    silent = not met or (bool(faint) and not denied)
    return best, silent, _unexercised(best, named) if silent else against


def meets(check: Check, acting: Sequence[str]) -> bool:
    """Whether there are rows of any channel that a finding acts on.

    What the base makes of other channels without it is no evidence of it.

    Parameters
    ----------
    check : Check
    acting : sequence of str
        Channels that it acts on.
    """
    used = check.mask & check.moving
    channels = enumerate(check.predictor.material.channels)
    return any((check.rows(k, n) & used).any() for k, n in channels if n in acting)


def exercised(
    looks: tuple[HeldOut, HeldOut], own: FloatArray, there: FloatArray, plainly: float
) -> bool:
    """Whether an effect itself, whatever the base does, is at work on held-out rows, too.

    Parameters
    ----------
    looks : tuple of HeldOut
        As predicted, and behind a refit.
    own : (M,) array
        What it does to the whitened training rows.
    there : (N,) array
        What it does to all rows of the check's material.
    plainly : float
        Sum of squares behind a refit from which it is at work whatever its share.
    """
    ahead, behind = looks
    shared = float(np.mean(ahead.left(there) ** 2)) >= _EXERCISED * float(np.mean(own**2))
    return shared or float(np.sum(behind.left(there) ** 2)) >= plainly


def _unexercised(look: Look, named: Named) -> str:
    """What speaks against a finding that held-out rows do not exercise.

    Its own recording has to leave no doubt then: held-out blocks of it, and no flip of signs. Of
    few motions no blocks are independent, and none can leave none.
    """
    if look.worse:
        return look.worse
    if named.few > 1.0:
        return "held-out rows hardly exercise it, and there are too few motions to do without them"
    if named.p_value > FAMILY_ERROR_UNNAMED or named.margin < _NO_DOUBT or named.refused:
        return "held-out rows hardly exercise it, and the training rows leave doubts"
    return ""
