"""Blocks that are held out of long recordings, of which parts are looked at alone."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from hydro_ident.estimate.scoring.scores import HoldOut
from hydro_ident.estimate.signals.traces import Trace
from hydro_ident.estimate.statistics.rows import Rows
from hydro_ident.mismatch.rows.choices import Choices
from hydro_ident.mismatch.settings import LONGEST_S, LONGEST_SCAN_S
from hydro_ident.mismatch.split.parts import hardly_held, split_of, spread_parts
from hydro_ident.mismatch.split.residuals import Residuals
from hydro_ident.rollouts.rollout_windows import Piece, windows

STEP_S = 0.02
#: What filters take off both ends of a part.
EDGE_S = 0.6
#: The defects' own lengths, and many others between them and beyond.
LENGTHS_S = (475.0, 478.0, 480.0, 482.0, 720.0, 960.0, 1200.0, *np.linspace(241.0, 3600.0, 60))


def _trace(seconds: float, name: str = "bag", begin_s: float = 0.0) -> Trace:
    time_s = begin_s + STEP_S * np.arange(round(seconds / STEP_S))
    one, two = np.zeros(time_s.size), np.zeros((time_s.size, 2))
    return Trace(f"{name}#0", STEP_S, time_s, two, two, two, two, one, one, two, two)


def _split(whole: tuple[Trace, ...], parts: tuple[Trace, ...]) -> HoldOut:
    names = dict.fromkeys(t.recording for t in whole)
    surveys: list[Any] = [
        SimpleNamespace(
            name=n, duration_s=max(t.time_s[-1] + STEP_S for t in whole if t.recording == n)
        )
        for n in names
    ]
    return split_of(surveys, 5, Choices(), whole, parts)


def _times(split: HoldOut, parts: tuple[Trace, ...]) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Times of the rows to fit and of those to verify on, by part."""
    fitted, held = [], []
    for part in parts:
        inner = part.time_s[round(EDGE_S / STEP_S) : -round(EDGE_S / STEP_S)]
        rows = Rows(inner[:, None], np.zeros((inner.size, 1, 0)), inner, part.label)
        fitted.append(split.training(rows).time_s)
        held.append(split.held_out(rows).time_s)
    return fitted, held


def _share(split: HoldOut, parts: tuple[Trace, ...]) -> float:
    """Held-out share of the rows that are left of parts."""
    rows = sum(p.samples - 2 * round(EDGE_S / STEP_S) for p in parts)
    return sum(t.size for t in _times(split, parts)[1]) / rows


@pytest.mark.parametrize("seconds", LENGTHS_S)
def test_a_fifth_of_the_parts_is_held_out_at_any_length(seconds: float) -> None:
    whole = (_trace(float(seconds)),)
    parts = spread_parts(whole, LONGEST_S)
    assert parts is not whole
    split = _split(whole, parts)
    assert 0.15 < _share(split, parts) < 0.23
    for fitted, held in zip(*_times(split, parts), strict=True):
        if held.size and fitted.size:
            apart = np.abs(fitted[:, None] - held[None, ::5]).min()
            # Every fifth held-out row is looked at, of rows a step apart.
            assert apart > split.guard_s - 5.0 * STEP_S


@pytest.mark.parametrize(
    "lengths_s", [(480.0,), (240.0, 240.0), (60.0,) * 16, (300.0, 15.0, 700.0)]
)
def test_of_several_recordings_each_has_its_own(lengths_s: tuple[float, ...]) -> None:
    whole = tuple(_trace(s, f"bag{k}") for k, s in enumerate(lengths_s))
    parts = spread_parts(whole, LONGEST_S)
    split = _split(whole, parts)
    assert 0.13 < _share(split, parts) < 0.23
    for name in {p.recording for p in parts}:
        assert _share(split, tuple(p for p in parts if p.recording == name)) > 0.1


def test_what_is_searched_meets_no_row_that_is_held_out() -> None:
    """Searched parts lie elsewhere: the blocks are those of the fitted ones, on the same clock."""
    whole = (_trace(700.0),)
    fitted, searched = (spread_parts(whole, s) for s in (LONGEST_S, LONGEST_SCAN_S))
    split = _split(whole, fitted)
    held = np.concatenate(_times(split, fitted)[1])
    rows = np.concatenate(_times(split, searched)[0])
    assert rows.size > 0.5 * LONGEST_SCAN_S / STEP_S
    assert not np.intersect1d(np.round(rows / STEP_S), np.round(held / STEP_S)).size


def test_recordings_of_usual_length_keep_the_blocks_of_the_clock() -> None:
    whole = (_trace(200.0),)
    split = _split(whole, whole)
    time_s = whole[0].time_s
    block = np.floor(time_s / 4.0).astype(int)
    # One of every five, each time another.
    clock = np.isin(block, [4, 7, 10, 18, 21, 29, 32, 35, 43, 46])
    np.testing.assert_array_equal(split.holds("bag", time_s), clock)


def test_roll_outs_are_of_the_held_out_blocks_of_parts() -> None:
    whole = (_trace(480.0),)
    parts = spread_parts(whole, LONGEST_S)
    split = _split(whole, parts)
    seconds = 0.0
    for part in parts:
        piece = Piece(part, 0, part.samples, np.zeros((part.samples, 2)), since=0)
        for one in windows(piece, split):
            assert split.holds("bag", part.time_s[one.begin : one.end]).all()
            seconds += one.seconds
    assert seconds == pytest.approx(LONGEST_S / 5.0, rel=0.05)


def test_channels_that_are_hardly_held_out_are_told(laid_crane: Residuals) -> None:
    work = laid_crane
    material = work.training.predictor.material
    fit, held = material.masks(work.split)
    assert hardly_held(material, fit, held) == ()
    assert not any("are held out, where" in note for note in work.notes)
    force = material.channel == material.channels.index("lift/force")
    (note,) = hardly_held(material, fit, held & ~force)
    assert note.startswith("of lift/force 0 % of the rows are held out, where a fifth is usual")
