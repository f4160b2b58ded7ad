"""What a diagnosis notes beside its verdict, in words."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hydro_ident.mismatch.fitting import Fitted
from hydro_ident.mismatch.held_out import rms
from hydro_ident.mismatch.instants import at_own_instants
from hydro_ident.mismatch.model import summary_of
from hydro_ident.mismatch.name import Search
from hydro_ident.mismatch.outcome import ChannelResult, Finding
from hydro_ident.mismatch.residuals import Residuals
from hydro_ident.mismatch.settings import FEW_MOTIONS

_FEW = (
    "motions of the joints in all: {}. What is held out is of the same ones, so that findings are"
    " confirmed within them alone, and position, pressures and time are hard to tell apart"
)

#: What is left in a channel over its sensors' noise from which a note says so.
_MUCH = 3.0


def data_notes(work: Residuals) -> list[str]:
    """What is to be known of the recordings; `work` holds their rows."""
    motions = work.training.predictor.material.motions
    return [*([_FEW.format(motions)] if motions < FEW_MOTIONS else []), *work.notes]


def search_notes(
    search: Search, whole: Fitted, rejected: Sequence[Finding], taken: Sequence[Finding]
) -> list[str]:
    """What became of names that are no findings, and the model in a line.

    Parameters
    ----------
    search : Search
    whole : Fitted
        The final model.
    rejected, taken : sequence of Finding
        That were not confirmed, and that were taken back.
    """
    notes = [
        f"{f.named.term.effect.name} of {f.named.term.target} was named on the training rows and"
        f" not confirmed: {f.verification.reason}"
        for f in rejected
    ]
    notes += [
        f"{f.named.term.effect.name} of {f.named.term.target} explains too little of what depends"
        " on the same channel to be its name: withdrawn"
        for f in taken
    ]
    notes += [f"not taken: {name} of {at}: {why}" for name, at, why in search.impossible]
    if search.small is not None:
        trial = search.small.entry.trial
        notes.append(
            f"{trial.name} of {trial.target} would explain something still, but too little beside"
            " what is in its channel to be told from what the laws there may be off by"
        )
    return [*notes, f"model: {summary_of(whole.model.terms)}"]


def left_notes(channels: Sequence[ChannelResult]) -> list[str]:
    """Those of the `channels` in which much more is left than sensors make, in any case."""
    left = [(c.name, rms(c.measured - c.after) / c.noise_floor) for c in channels]
    much = [f"{name} {ratio:.3g}" for name, ratio in left if ratio > _MUCH]
    if not much:
        return []
    return [
        "left on held-out rows, rest included, in units of what the sensors' noise alone leaves:"
        f" {', '.join(much)}"
    ]


def silent_notes(findings: Sequence[Finding]) -> list[str]:
    """Those of the `findings` that no held-out row could speak for or against."""
    return [
        f"{f.named.term.effect.name} of {f.named.term.target}: the rows to verify on do not"
        " exercise it; only cross-validation within the training rows speaks for it"
        for f in findings
        if f.verification.silent
    ]


def instant_notes(work: Residuals, whole: Fitted) -> list[str]:
    """What begins at another instant in the recordings to verify on.

    Parameters
    ----------
    work : Residuals
    whole : Fitted
        The final model.
    """
    there, _ = at_own_instants(work.training, work.check, whole.model)
    notes = []
    for here, other in zip(whole.model.terms, there.terms, strict=True):
        start = here.effect.start
        if start and not np.array_equal(here.parameters, other.parameters):
            at = [p.name for p in here.effect.parameters].index(start)
            notes.append(
                f"{here.effect.name} of {here.target} begins at {here.parameters[at]:.4g} s where"
                f" it was fitted, and at {other.parameters[at]:.4g} s (looked for) where it is"
                " verified"
            )
    return notes
