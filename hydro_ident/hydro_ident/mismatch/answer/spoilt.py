"""What all findings together make of held-out rows, as the model is handed over."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from hydro_ident.mismatch.answer.outcome import Finding
from hydro_ident.mismatch.fitting.fitted import Fitted
from hydro_ident.mismatch.naming.instants import both_at_own_instants
from hydro_ident.mismatch.split.held_out import rms
from hydro_ident.mismatch.split.residuals import Residuals

#: Rmse of a channel's held-out rows with all findings, over that without any, from which some go.
_CLEARLY_WORSE = 1.2
#: The same for what acts in no channel that it leaves better.
_NOWHERE_BETTER = 1.02

#: Rmse of held-out rows without findings and with all of them, by channel.
Sides = Mapping[str, tuple[float, float]]


def made_worse(work: Residuals, whole: Fitted, findings: Sequence[Finding]) -> list[Finding]:
    """The weakest of those with which, all together, a channel is predicted clearly worse.

    Behind a refit each may have gained: what is handed over is the model as it is. A name that
    leaves no channel of its own better than no name would has mended what another one spoilt. One
    that takes more out of its other channels than comes into one, in units of their sensors'
    noise, has spoilt nothing: a base that was fitted beside it is another one.

    Parameters
    ----------
    work : Residuals
    whole : Fitted
        With all findings.
    findings : sequence of Finding

    Returns
    -------
    list of Finding
        None or one, with the reason.
    """
    sides = sides_of(work, whole)
    worse = {n for n, (before, after) in sides.items() if after > _NOWHERE_BETTER * before}
    clearly = {n for n in worse if sides[n][1] > _CLEARLY_WORSE * sides[n][0]}
    floors = work.noise_floors() if clearly else {}
    acting = [
        f
        for f in findings
        if (clearly.intersection(f.channels) and _spoils(sides, floors, f.channels))
        or (worse.issuperset(f.channels) and not f.verification.silent)
    ]
    if not acting:
        return []
    weakest = min(acting, key=lambda f: f.named.gain)
    channel = next(n for n in weakest.channels if n in worse)
    before, after = sides[channel]
    reason = (
        f"with all findings together held-out rows of {channel} are predicted worse (RMSE"
        f" {before:.3g} to {after:.3g})"
    )
    verification = replace(weakest.verification, stands=False, reason=reason)
    return [replace(weakest, verification=verification)]


def _spoils(sides: Sides, floors: Mapping[str, float], channels: Sequence[str]) -> bool:
    """Whether some channels together are predicted worse, in units of their sensors' noise."""
    own = [(*sides[n], floors[n]) for n in channels if n in sides and floors[n] > 0.0]
    return sum((after**2 - before**2) / floor**2 for before, after, floor in own) > 0.0


def sides_of(work: Residuals, whole: Fitted) -> Sides:
    """Rmse of held-out rows as the base and as a model predicts them, by channel.

    Parameters
    ----------
    work : Residuals
    whole : Fitted
    """
    check = work.check
    models = both_at_own_instants(work.training, check, work.base.model, whole.model)
    both = [check.residual(model) for model in models]
    rows = {
        name: check.rows(k, name) & check.mask & check.moving
        for k, name in enumerate(check.predictor.material.channels)
    }
    return {
        name: (rms(both[0][own]), rms(both[1][own])) for name, own in rows.items() if own.any()
    }
