"""Lags of valves whose cylinder's positions are read late: time is all that either is.

Positions that are late beyond any base's skew make a valve seem late or early against them, and no
effect stands for it. A lag or a delay none of whose numbers is told is that lateness then, however
well it predicts other recordings that were read the same way.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from hydro_ident.mismatch.answer.contributing import without_these
from hydro_ident.mismatch.answer.lacking import cylinders_apart
from hydro_ident.mismatch.answer.outcome import Finding
from hydro_ident.mismatch.fitting.fitted import Fitted
from hydro_ident.mismatch.naming.lags import OF_VALVES
from hydro_ident.mismatch.split.residuals import Residuals
from hydro_ident.mismatch.trials.contender import sizes_told

_REASON = (
    "positions of its cylinder are read late, which may be what it does, and none of its numbers"
    " is told"
)


def without_late(
    work: Residuals, whole: Fitted, findings: Sequence[Finding]
) -> tuple[Fitted, list[Finding], list[Finding]]:
    """Refuse lags and delays that are told by nothing, beside positions that are read late.

    Parameters
    ----------
    work : Residuals
    whole : Fitted
        With all findings.
    findings : sequence of Finding

    Returns
    -------
    whole : Fitted
        Without those.
    findings, refused : list of Finding
    """
    late = [f for f in findings if _untold(whole, f)]
    doubted = {f.named.term.cylinder for f in late} & cylinders_apart(work.training, whole)
    refused = [f for f in late if f.named.term.cylinder in doubted]
    if not refused:
        return whole, list(findings), []
    less = without_these(work, whole, [f.named for f in refused])
    if not doubted <= cylinders_apart(work.training, less):
        return whole, list(findings), []
    kept = [f for f in findings if f not in refused]
    return less, kept, [_refused(f) for f in refused]


def _untold(whole: Fitted, one: Finding) -> bool:
    """Whether a finding is a valve's lag or delay none of whose numbers the rows tell."""
    mine = one.named.term
    terms = (t for t in whole.model.terms if t.effect.name == mine.effect.name)
    fitted = next((t for t in terms if t.target == mine.target), mine)
    return mine.effect.name in OF_VALVES and not any(sizes_told(fitted, whole.deviations))


def _refused(one: Finding) -> Finding:
    said = replace(one.verification, stands=False, reason=_REASON)
    return replace(one, verification=said)
