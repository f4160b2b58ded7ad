"""Findings against the model that was written: which law stands in it, what was not to be seen."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from hydro_ident.mismatch.outcome import Diagnosis
from hydro_ident.mismatch.unknown import NotTestable


def law_in_model(data: Mapping[str, Any]) -> str:
    """The law that stands in model.yaml for a finding, where it is not the one it is named after.

    Parameters
    ----------
    data : mapping
        The finding as the result file has it.

    Returns
    -------
    str
        An effect's identifier, or empty.
    """
    modelled = str(data["modelled_as"])
    return "" if modelled == data["names"][0] else modelled


def not_shown(found: Diagnosis) -> list[NotTestable]:
    """What recordings could not have shown, without the laws that the model has.

    A law may stand in the model for a finding that bears another one's name, or have been in the
    robot's file.

    Parameters
    ----------
    found : Diagnosis
    """
    modelled = {one.named.term.effect.name for one in found.findings}
    modelled |= {effect.name for effect in found.given.effects}
    return [one for one in found.not_testable if one.name not in modelled]
