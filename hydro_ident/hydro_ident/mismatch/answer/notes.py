"""What a diagnosis notes beside its verdict, in words."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from hydro_ident.mismatch.answer.outcome import ChannelResult, Finding
from hydro_ident.mismatch.fitting.fitted import Fitted
from hydro_ident.mismatch.modelling.model import summary_of
from hydro_ident.mismatch.naming.instants import at_own_instants
from hydro_ident.mismatch.naming.name import Search
from hydro_ident.mismatch.rows.onset import begins, ends
from hydro_ident.mismatch.rows.rests import motions_in
from hydro_ident.mismatch.settings import FEW_MOTIONS
from hydro_ident.mismatch.split.check import Check
from hydro_ident.mismatch.split.held_out import rms
from hydro_ident.mismatch.split.residuals import Residuals
from hydro_ident.mismatch.verifying.agreement import fitted_there
from hydro_model.effects.catalogue import end_s, resolve, start_s
from hydro_model.effects.targets import ActiveEffect
from hydro_model.robot import Robot

_FEW = (
    "motions of the joints in all: {}. What is held out is of the same ones, so that findings are"
    " confirmed within them alone, and position, pressures and time are hard to tell apart"
)

_UNPAIRED = (
    "{}: the cylinder's other pressure was not recorded. Laws that look at both, such as a leak"
    " past the piston, cannot be tried there, and what they do may go by another name"
)

#: What is left in a channel over its sensors' noise from which a note says so.
_MUCH = 3.0
#: The same of the error with which rows to verify on are predicted, over that of a fit to them.
_APART = 2.0
#: A number of a listed effect is told to be another one than the file's beyond so many deviations,
#: and beyond this share of the larger of the two.
_ELSEWHERE, _ELSEWHERE_SHARE = 5.0, 1.0 / 3.0


def data_notes(work: Residuals) -> list[str]:
    """What is to be known of the recordings; `work` holds their rows."""
    material = work.training.predictor.material
    few = [_FEW.format(motions_in(material))] if motions_in(material) < FEW_MOTIONS else []
    unpaired = [_UNPAIRED.format(", ".join(material.unpaired))] if material.unpaired else []
    return [*few, *unpaired, *work.notes]


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
    known = [c for c in channels if c.noise_floor > 0.0]
    left = [(c.name, rms(c.measured - c.after) / c.noise_floor) for c in known]
    much = [f"{name} {ratio:.3g}" for name, ratio in left if ratio > _MUCH]
    if not much:
        return []
    return [
        "left on held-out rows, rest included, in units of what the sensors' noise alone leaves:"
        f" {', '.join(much)}"
    ]


def unverified_notes(work: Residuals, channels: Sequence[ChannelResult]) -> list[str]:
    """Fitted channels of which no row to verify on can tell anything.

    Parameters
    ----------
    work : Residuals
    channels : sequence of ChannelResult
        On the rows to verify on.
    """
    seen, material = {c.name for c in channels}, work.training.predictor.material
    missing = ", ".join(name for name in material.channels if name not in seen)
    if not missing:
        return []
    return [
        f"{missing}: nothing is verified there, as no row to verify on knows it within the"
        " positions that were fitted"
    ]


def beyond_notes(check: Check, seen: Check) -> list[str]:
    """Channels whose numbers are of positions that were not fitted.

    Parameters
    ----------
    check, seen : Check
        Rows to verify on, and those that numbers are told of.
    """
    material = check.predictor.material
    further = seen.mask & ~check.mask
    names = [
        n for k, n in enumerate(material.channels) if (further & (material.channel == k)).any()
    ]
    if not names:
        return []
    return [
        f"{', '.join(names)}: verified on rows beyond the positions that were fitted, as hardly"
        " any lie within: a chamber's balance is the same there"
    ]


def apart(work: Residuals, whole: Fitted, channels: Sequence[ChannelResult]) -> dict[str, float]:
    """Channels of which the recordings to verify on know what those to fit did not show.

    A base takes up what its own recordings show in one motion alone, as a slow one does a mode;
    another motion is then predicted far worse than the same model could.

    Parameters
    ----------
    work : Residuals
    whole : Fitted
        The final model.
    channels : sequence of ChannelResult
        On the rows to verify on.

    Returns
    -------
    dict of str to float
        Error with which those rows are predicted, over that of the same model fitted to them.
    """
    far = [c.name for c in channels if rms(c.measured - c.after) > _MUCH * c.noise_floor]
    there = fitted_there(work.training, work.check, whole) if far else None
    if there is None:
        return {}
    check, result = work.check, dict[str, float]()
    now = check.residual(at_own_instants(work.training, check, whole.model)[0])
    own = there.residual - there.columns @ there.bench.solve()
    for k, name in enumerate(check.predictor.material.channels):
        rows = check.rows(k, name) & check.moving
        if name in far and rows.any() and rms(now[rows]) > _APART * rms(own[rows]):
            result[name] = rms(now[rows]) / rms(own[rows])
    return result


def apart_notes(ratios: Mapping[str, float]) -> list[str]:
    """Those of channels of which other recordings know more.

    Parameters
    ----------
    ratios : mapping of str to float
        As `apart` returns them.
    """
    return [
        f"{name}: rows to verify on are predicted {ratio:.2g} times worse than by the same model"
        " fitted to them: what is missing shows in their motion, or the machine was another then"
        " (another load); diagnose the other way round, or with more of such motion to fit"
        for name, ratio in ratios.items()
    ]


def silent_notes(findings: Sequence[Finding]) -> list[str]:
    """Those of the `findings` that no held-out row could speak for or against."""
    return [
        f"{f.named.term.effect.name} of {f.named.term.target}: the rows to verify on do not"
        f" exercise it{_unheard(f)}"
        for f in findings
        if f.verification.silent
    ]


def _unheard(one: Finding) -> str:
    """What speaks for a finding that held-out rows do not exercise."""
    if one.verification.by_base(one.channels[0]):
        return (
            " themselves, but the base that it frees predicts them better; for its name and size"
            " only cross-validation within the training rows speaks"
        )
    return "; only cross-validation within the training rows speaks for it"


def instant_notes(work: Residuals, whole: Fitted) -> list[str]:
    """What begins at another instant in the recordings to verify on.

    Parameters
    ----------
    work : Residuals
    whole : Fitted
        The final model.
    """
    there, _ = at_own_instants(work.training, work.check, whole.model)
    return [
        f"{here.effect.name} of {here.target} {_when(here)} where it was fitted, and"
        f" {_when(other)} (looked for) where it is verified"
        for here, other in zip(whole.model.terms, there.terms, strict=True)
        if here.effect.edges and not np.array_equal(here.parameters, other.parameters)
    ]


def listed_notes(robot: Robot, whole: Fitted) -> list[str]:
    """Effects of the robot file with numbers that came out far from the file's.

    They are fitted along with the base, and no finding however far they move.

    Parameters
    ----------
    robot : Robot
        As given.
    whole : Fitted
        The final model.
    """
    notes, now = [], {(t.effect.name, t.target): t for t in whole.model.terms}
    for listed in resolve(robot):
        fitted = now.get((listed.effect.name, listed.target))
        far = [] if fitted is None else _elsewhere(listed, fitted, whole.deviations)
        if far:
            notes.append(
                f"{listed.effect.name} of {listed.target} is in the robot file with other numbers"
                f" than these recordings give: {'; '.join(far)}"
            )
    return notes


def _elsewhere(
    listed: ActiveEffect, fitted: ActiveEffect, deviations: Mapping[str, float]
) -> list[str]:
    """Numbers of an effect that are far from those listed, both in words."""
    own, found = f"{listed.target}.{listed.effect.name}.", []
    names = [spec.name for spec in listed.effect.parameters]
    rows = zip(names, listed.parameters, fitted.parameters, listed.units, strict=True)
    for spec, (name, old, new, unit) in zip(listed.effect.parameters, rows, strict=True):
        # When it comes and goes is each recording's own; of what is left out a file says nothing.
        if name in listed.effect.edges or spec.left_out(old):
            continue
        if not (std := deviations.get(own + name, 0.0)) > 0.0:
            continue
        least = max(_ELSEWHERE * std, _ELSEWHERE_SHARE * max(abs(old), abs(new)))
        if abs(new - old) > least:
            unit = "" if unit == "1" else f" {unit}"
            found.append(f"{name} {new:.4g} +- {std:.2g}{unit}, listed {old:.4g}{unit}")
    return found


def _when(one: ActiveEffect) -> str:
    if one.effect.head_start:
        at = [spec.name for spec in one.effect.parameters].index(one.effect.head_start)
        return f"has been under way for {one.parameters[at]:.3g} s"
    since = f"begins at {start_s(one):.4g} s" if begins(one) else "is there from the start"
    return f"{since} and ends at {end_s(one):.4g} s" if ends(one) else since
