"""Effects that are named and confirmed, and make no recording's prediction any better to speak of.

A machine has a little of everything. In minutes of it the search tells one small thing after
another from chance; which of several alike it is, and of what size, nobody can use.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hydro_ident.mismatch.answer.outcome import ChannelResult, Finding
from hydro_ident.mismatch.split.residuals import Residuals

#: Shares of squares that a finding takes out at least: of held-out rows in one of its channels,
#: or of the training rows of all of them, where a slower motion is held out; beside all others.
_HELD_OUT, _TRAINING = 0.01, 0.05


def parted_hardly(
    work: Residuals, findings: Sequence[Finding], channels: Sequence[ChannelResult]
) -> tuple[list[Finding], list[Finding]]:
    """Findings, and those that hardly show.

    Parameters
    ----------
    work : Residuals
    findings : sequence of Finding
    channels : sequence of ChannelResult
        With everything that was found.

    Returns
    -------
    findings, hardly : list of Finding
    """
    quiet = {one.name for one in channels if one.at_noise}
    hardly = [f for f in findings if quiet.issuperset(f.channels) and _hardly_shows(work, f)]
    return [f for f in findings if f not in hardly], hardly


def _hardly_shows(work: Residuals, finding: Finding) -> bool:
    checked = finding.verification
    if checked.silent:
        return False
    for channel in finding.channels:
        before, after = checked.before.get(channel), checked.after.get(channel)
        if before is None or after is None or after**2 < (1.0 - _HELD_OUT) * before**2:
            return False
    material = work.training.predictor.material
    own = np.isin(material.channel, [material.channels.index(c) for c in finding.channels])
    return checked.gain < _TRAINING * int(np.sum(own & work.training.mask))


def hardly_notes(hardly: Sequence[Finding]) -> list[str]:
    """What they are, in words.

    Parameters
    ----------
    hardly : sequence of Finding
    """
    return [
        f"{f.named.term.effect.name} of {f.named.term.target} is there or something like it, but"
        f" takes less than {_HELD_OUT:.0%} out of the squares of held-out rows of"
        f" {', '.join(f.channels)}, which are at their sensors' noise: in the model, no finding"
        for f in hardly
    ]
