"""Whole recordings in memory, as traces without outliers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from hydro_ident.estimate.signals.traces import Trace, traces_of_piece
from hydro_ident.recordings.cleaning import Cleaner
from hydro_ident.recordings.sources import WHOLE_S, Source


def read_whole(
    sources: Sequence[Source], others: Sequence[Source], cleaner: Cleaner
) -> tuple[tuple[Trace, ...], tuple[Trace, ...], dict[str, int]]:
    """Traces to fit and to verify on, and how many samples of those to fit were outliers.

    Parameters
    ----------
    sources, others : sequence of Source
        To fit and select on; to verify on, which are left alone where there is nothing to fit.
    cleaner : Cleaner

    Returns
    -------
    whole, recorded : tuple of Trace
        Of the sources and of the others; all with the oil's temperature, or none.
    cleaned : dict of str to int
        Counts by sensor what was taken out of the sources.
    """
    cleaned = dict[str, int]()
    whole = whole_traces(sources, cleaner, cleaned)
    recorded = whole_traces(others, cleaner, dict[str, int]()) if whole else whole
    whole, recorded = _of_one_oil(whole, recorded)
    return whole, recorded, cleaned


def _of_one_oil(*sets: tuple[Trace, ...]) -> list[tuple[Trace, ...]]:
    """Without the oil's temperature where only some recordings know it: a law would be two."""
    if all(trace.oil_c is not None for traces in sets for trace in traces):
        return list(sets)
    return [tuple(replace(trace, oil_c=None) for trace in traces) for traces in sets]


def whole_traces(
    sources: Sequence[Source], cleaner: Cleaner, cleaned: dict[str, int]
) -> tuple[Trace, ...]:
    """The contiguous traces of whole recordings, in memory, without outliers.

    Parameters
    ----------
    sources : sequence of Source
    cleaner : Cleaner
    cleaned : dict of str to int
        Counts by sensor what was taken out.
    """
    return tuple(
        trace
        for source in sources
        for piece in source.pieces(WHOLE_S)
        for trace in traces_of_piece(cleaner.cleaned(piece, cleaned))
    )
