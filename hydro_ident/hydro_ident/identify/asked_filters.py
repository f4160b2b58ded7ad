"""Filters that were asked for, beside what the recordings bear."""

from __future__ import annotations

from collections.abc import Mapping

from hydro_ident.estimate.signals.derivatives import FilterSettings


def slowed_notes(asked: FilterSettings, used: Mapping[str, FilterSettings]) -> list[str]:
    """That the recordings are too slow for the filters that were asked for.

    Parameters
    ----------
    asked : FilterSettings
    used : mapping of str to FilterSettings
        As they were borne, by recording.

    Returns
    -------
    list of str
        One that names none where all recordings have the same; of those that bear what was asked
        for there is nothing to say.
    """
    said = {name: _slowed(asked, own) for name, own in used.items()}
    if len(set(said.values())) == 1:
        return [text for text in list(said.values())[:1] if text]
    return [f"{name}: {text}" for name, text in said.items() if text]


def _slowed(asked: FilterSettings, used: FilterSettings) -> str:
    if used == asked:
        return ""
    return (
        f"few samples a second: motion is looked at below {used.differentiation_hz:.3g} Hz, forces"
        f" below {used.parallel_hz:.3g} Hz (asked for: {asked.differentiation_hz:g} and"
        f" {asked.parallel_hz:g} Hz)"
    )


def usable_filters(asked: FilterSettings, step_s: float) -> str:
    """What to ask for where a recording is too short for slow filters that were asked for.

    Parameters
    ----------
    asked : FilterSettings
    step_s : float
        Sampling interval of the slowest recording that is fitted.

    Returns
    -------
    str
        The option, why, and a value; empty where the filters are no slower than those by default.
    """
    used, usual = asked.borne_at(step_s), FilterSettings().borne_at(step_s)
    if used.parallel_hz >= usual.parallel_hz:
        return ""
    if used.differentiation_hz < asked.differentiation_hz:
        return (
            f"--differentiation-cutoff {asked.differentiation_hz:g} is more than"
            f" {1.0 / step_s:.3g} samples a second bear, and brings --parallel-cutoff down to"
            f" {used.parallel_hz:.3g} Hz: give {used.differentiation_hz:.3g} or less"
        )
    return (
        f"--parallel-cutoff {asked.parallel_hz:g} leaves out"
        f" {used.edge_samples(step_s) * step_s:.2g} s at both ends of a stretch: give"
        f" {usual.parallel_hz:.3g}"
    )
