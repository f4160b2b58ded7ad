"""Why what was found may be something else, whatever held-out rows say of it.

A diagnosis with such a doubt is `partly_explained`, though nothing may be told as unknown: each
doubt says what it is, so that nobody has to guess what the verdict's reservation rests on.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from hydro_ident.mismatch.answer.outcome import ChannelResult, Finding
from hydro_ident.mismatch.rows.rests import motions_in
from hydro_ident.mismatch.settings import FAR, FEW_MOTIONS
from hydro_ident.mismatch.split.held_out import rms
from hydro_ident.mismatch.split.residuals import Residuals

#: Share of the error (rms) that findings leave at most where it is far above the sensors' noise.
_HARDLY = 0.25


def doubts(
    work: Residuals,
    findings: Sequence[Finding],
    channels: Sequence[ChannelResult],
    ratios: Mapping[str, float],
) -> tuple[str, ...]:
    """Every doubt about the findings, in words.

    Parameters
    ----------
    work : Residuals
    findings : sequence of Finding
    channels : sequence of ChannelResult
        On the rows to verify on, in motion.
    ratios : mapping of str to float
        Channels of which other recordings know more, as `notes.apart` returns them.

    Returns
    -------
    tuple of str
        Empty without findings.
    """
    if not findings:
        return ()
    return (
        *_few(work, findings),
        *_unpaired(work, findings),
        *_elsewhere(findings, ratios),
        *hardly_better(findings, channels),
    )


def _few(work: Residuals, findings: Sequence[Finding]) -> list[str]:
    motions = motions_in(work.training.predictor.material)
    if motions < FEW_MOTIONS:
        return [f"the joints move {motions} times in all"]
    few = [f"{f.named.names[0]} of {f.named.term.target}" for f in findings if f.named.few > 1.0]
    return [f"few motions of its joint show {name}" for name in few]


def _unpaired(work: Residuals, findings: Sequence[Finding]) -> list[str]:
    """Where one pressure is not known, another law may look like what was found."""
    shown = {name for f in findings for name in f.channels}
    unpaired = [n for n in work.training.predictor.material.unpaired if n in shown]
    return [f"{name}: the cylinder's other pressure was not recorded" for name in unpaired]


def _elsewhere(findings: Sequence[Finding], ratios: Mapping[str, float]) -> list[str]:
    first = dict.fromkeys(f.channels[0] for f in findings)
    return [
        f"{name}: rows to verify on are predicted {ratios[name]:.2g} times worse than by the same"
        " model fitted to them: sizes or forms found there do not carry over"
        for name in first
        if name in ratios
    ]


def hardly_better(findings: Sequence[Finding], channels: Sequence[ChannelResult]) -> list[str]:
    """Where much of the error is left though something was found, far above the sensors.

    Parameters
    ----------
    findings : sequence of Finding
    channels : sequence of ChannelResult

    Returns
    -------
    list of str
        A line for every such channel.
    """
    named = {name for finding in findings for name in finding.channels}
    sizes = [
        (c.name, rms(c.measured - c.before), rms(c.measured - c.after), c.noise_floor)
        for c in channels
        if c.name in named
    ]
    return [
        f"{name}: {_much(before, after, floor)}"
        for name, before, after, floor in sizes
        if after > max(_HARDLY * before, FAR * floor)
    ]


def _much(before: float, after: float, floor: float) -> str:
    """How much is left; of exact data there is no share, nor any noise."""
    share = f"{after / before:.0%} of the error is left" if before > 0.0 else "an error is left"
    return f"{share}, {after / floor:.0f} times what the sensors' noise makes" if floor else share
