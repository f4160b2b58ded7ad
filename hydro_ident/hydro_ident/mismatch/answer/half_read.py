"""Names beside a finding that one pressure alone could not tell from it.

Where one of a cylinder's two pressures was not read, laws of both could not be tried. One that
adds to the same chamber's flow as what was found, and looks like it, may be meant as well.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from hydro_ident.estimate.flows.chambers import Chamber
from hydro_ident.mismatch.answer.outcome import Finding
from hydro_ident.mismatch.rows.law_signals import looks_across
from hydro_ident.mismatch.rows.material import Material
from hydro_model.effects.catalogue import CATALOGUE
from hydro_model.effects.targets import ActiveEffect


def beside_half_read(material: Material, findings: Sequence[Finding]) -> tuple[Finding, ...]:
    """Findings with the names in their sets that only the other pressure could have told apart.

    Nothing was weighed, so each is as likely as what was found.

    Parameters
    ----------
    material : Material
    findings : sequence of Finding
    """
    half_read = {c.channel: c for c in material.chambers if c.channel in material.unpaired}
    result = []
    for one in findings:
        if all(name in half_read for name in one.channels):
            chamber = half_read[one.channels[0]]
            alike = dict.fromkeys(_alike(one.named.modelled.term, chamber), 1.0)
            one = replace(one, named=one.named.beside(alike))
        result.append(one)
    return tuple(result)


def _alike(term: ActiveEffect, chamber: Chamber) -> list[str]:
    """Effects that look like one, act where it does and could not be tried."""
    stages = set(term.effect.stages)
    others = [CATALOGUE[name] for name in term.effect.looks_like if name in CATALOGUE]
    return [
        other.name
        for other in others
        if set(other.stages) == stages
        and looks_across(replace(term, effect=other, parameters=other.typical), chamber)
    ]
