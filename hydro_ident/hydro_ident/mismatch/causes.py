"""One finding per cause: what shows at several joints and is one thing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from hydro_ident.mismatch.outcome import Finding

#: A ground under the tip presses on every joint, and is fitted at each cylinder by itself.
_GROUND = "external_contact"
#: Fits of one ground agree within this factor of stiffness and this difference of height, m.
_STIFFNESS, _HEIGHT_M = 2.0, 0.1


def one_per_cause(findings: Sequence[Finding]) -> list[Finding]:
    """Findings with those that are one ground put together, in their order.

    Parameters
    ----------
    findings : sequence of Finding

    Returns
    -------
    list of Finding
        The strongest of each ground stands for it and has the channels of all.
    """
    kept: list[Finding] = []
    for one in sorted(findings, key=lambda f: -f.named.gain):
        same = next((k for k, other in enumerate(kept) if _one_ground(one, other)), None)
        if same is None:
            kept.append(one)
            continue
        further = [n for n in one.channels if n not in kept[same].channels]
        kept[same] = replace(kept[same], channels=(*kept[same].channels, *further))
    order = {id(f.named): k for k, f in enumerate(findings)}
    return sorted(kept, key=lambda f: order[id(f.named)])


def _one_ground(one: Finding, other: Finding) -> bool:
    terms = one.named.term, other.named.term
    if any(t.effect.name != _GROUND for t in terms):
        return False
    (k, z, way), (k_other, z_other, other_way) = (t.parameters for t in terms)
    if way != 0.0 or other_way != 0.0:
        # What one joint runs against is no other's.
        return False
    alike = max(k, k_other) <= _STIFFNESS * min(k, k_other)
    return bool(alike and abs(z - z_other) <= _HEIGHT_M)
