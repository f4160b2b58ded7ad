"""Chance of what a finding and held-out rows have in common: as said, however few blocks it is."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.stats import norm

from hydro_ident.mismatch.split.held_out import STANDS
from hydro_ident.mismatch.trials.products import (
    _beyond_flips,
    chance,
    chance_beside,
    left_variance,
    paid,
)

#: 40 s of rows, in blocks of 1 s and of 0.2 s.
ROWS, EACH, SHORT = 2000, 50, 10
BLOCK, SHORT_BLOCK = np.arange(ROWS) // EACH, np.arange(ROWS) // SHORT
DRAWS = 150


def _slow(rng: np.random.Generator, pole: float) -> np.ndarray:
    """Noise of unit variance that goes together from row to row."""
    return np.asarray(np.sqrt(1.0 - pole**2) * lfilter([1.0], [1.0, -pole], rng.normal(size=ROWS)))


def _change(rng: np.random.Generator, blocks: int, size: float, pole: float) -> np.ndarray:
    """What a finding does in its first blocks, of a size in deviations of the noise."""
    course = _slow(rng, pole) * (blocks > BLOCK)
    return np.asarray(size * course / np.linalg.norm(course))


def _chance(change: np.ndarray, before: np.ndarray) -> float:
    return chance_beside(change, before, before - change, BLOCK, SHORT_BLOCK)


def _share(
    seed: int, blocks: int, size: float, true: float, residual: str = "white", pole: float = 0.9
) -> float:
    """How often so much of an effect is confirmed."""
    rng, confirmed = np.random.default_rng(seed), 0
    for _ in range(DRAWS):
        change = _change(rng, blocks, size, pole)
        left = {
            "white": lambda: rng.normal(size=ROWS),
            "slow": lambda: _slow(rng, 0.6),
            "large there": lambda: rng.normal(size=ROWS) * np.where(blocks > BLOCK, 20.0, 1.0),
        }[residual]()
        confirmed += _chance(change, left + true * change) <= STANDS
    return confirmed / DRAWS


@pytest.mark.parametrize("residual", ["white", "slow", "large there"])
@pytest.mark.parametrize(("blocks", "size"), [(1, 2.0), (1, 30.0), (3, 5.0), (40, 2.0)])
def test_a_false_effect_is_confirmed_no_more_often_than_said(
    residual: str, blocks: int, size: float
) -> None:
    most = STANDS + 3.0 * np.sqrt(STANDS * (1.0 - STANDS) / DRAWS)
    assert _share(27, blocks, size, 0.0, residual) <= most


@pytest.mark.parametrize(("blocks", "size"), [(1, 10.0), (2, 7.0), (5, 5.0), (40, 5.0)])
def test_a_true_effect_is_confirmed_however_few_blocks_it_acts_in(
    blocks: int, size: float
) -> None:
    assert _share(22, blocks, size, 1.0) >= 0.85


def test_signs_of_what_an_effect_explains_take_it_for_its_own_chance() -> None:
    """Of three blocks all signs agree once in eight, though 900 variances are explained."""
    rng = np.random.default_rng(23)
    change = _change(rng, 3, 30.0, 0.9)
    before = rng.normal(size=ROWS) + change
    sums = np.bincount(BLOCK, weights=change * before)
    assert chance(sums[sums != 0.0]) > 0.1
    assert _chance(change, before) < 0.001


def test_a_size_more_than_twice_too_large_has_to_be_seen_in_many_blocks() -> None:
    """What such a size leaves has the same blocks as the product, and is larger."""
    rng = np.random.default_rng(24)
    few, many = (_change(rng, blocks, 30.0, 0.0) for blocks in (2, 40))
    noise = rng.normal(size=ROWS)
    assert _chance(few, noise + 0.4 * few) > STANDS
    assert _chance(few, noise + 0.8 * few) < STANDS
    assert _chance(many, noise + 0.4 * many) < STANDS


def test_what_does_not_go_together_has_no_chance_of_standing() -> None:
    rng = np.random.default_rng(25)
    change = _change(rng, 40, 10.0, 0.0)
    assert _chance(change, -change) == 1.0
    assert _chance(change, 0.0 * change) == 1.0
    assert chance(np.zeros(0)) == 1.0


def test_the_variance_is_never_less_than_white_noise_makes() -> None:
    rng = np.random.default_rng(26)
    change = _change(rng, 40, 3.0, 0.9)
    for scale, least, most in ((0.1, 9.0, 9.0), (1.0, 9.0, 16.0), (4.0, 80.0, 300.0)):
        after = scale * rng.normal(size=ROWS)
        assert least <= left_variance(change, after, BLOCK, SHORT_BLOCK) * 1.0000001
        assert left_variance(change, after, BLOCK, SHORT_BLOCK) <= most * 1.0000001


# What flips cannot resolve ----------------------------------------------------------------------

#: Rows of a short block, and short blocks of a block.
_FEW_ROWS, _SHORTS = 2, 5


def _noise(rng: np.random.Generator, kind: str, draws: int, blocks: int) -> np.ndarray:
    """Rows of noise, (draws, M): of unit size, of heavy tails, or more alike than modelled."""
    each = _SHORTS * _FEW_ROWS
    white = rng.normal(size=(draws, blocks * each))
    if kind == "heavy":
        return np.asarray(rng.standard_t(2.5, size=white.shape))
    by_block = {
        "uneven": np.abs(rng.standard_t(3.0, size=(draws, blocks))),
        "alike": 0.7 * rng.normal(size=(draws, blocks)),
    }
    if kind not in by_block:
        return white
    own = np.repeat(by_block[kind], each, axis=1)
    return np.asarray(white * own if kind == "uneven" else white + own)


@pytest.mark.parametrize(
    "blocks",
    [
        8,
        pytest.param(20, marks=pytest.mark.thorough),
        pytest.param(60, marks=pytest.mark.thorough),
    ],
)
@pytest.mark.parametrize("kind", ["white", "heavy", "uneven", "alike"])
def test_what_was_tried_often_is_confirmed_by_chance_as_seldom_as_said(
    kind: str, blocks: int
) -> None:
    """Where rows go together all over a block, this is of what no flip reaches: of so few blocks
    flips themselves are a little too rare (at 0.001, 0.002)."""
    rng, draws = np.random.default_rng(29), 20000
    rows = np.arange(blocks * _SHORTS * _FEW_ROWS)
    block, short = rows // (_SHORTS * _FEW_ROWS), rows // _FEW_ROWS
    change = np.ones(rows.size) * 4.5 / np.sqrt(rows.size)
    noise = _noise(rng, kind, draws, blocks)
    # Nothing below three deviations of noise of unit size is rarer than 0.001.
    tried = [
        chance_beside(change, before, before - change, block, short, 1000.0)
        for before in noise[noise @ change > 3.0 * np.linalg.norm(change)]
    ]
    for level in (4e-5, 1e-5) if kind == "alike" else (1e-3, 1e-4, 4e-5, 1e-5):
        most = level * draws + 3.0 * np.sqrt(level * draws)
        assert np.count_nonzero(np.array(tried) <= level) <= most


@pytest.mark.parametrize("kind", ["equal", "normal", "heavy"])
def test_what_no_flip_reaches_is_told_no_rarer_than_all_signs_make_it(kind: str) -> None:
    """Of 18 blocks all 262144 signs can be looked at."""
    rng = np.random.default_rng(30)
    drawn = {"equal": np.ones(18), "normal": rng.normal(size=18), "heavy": rng.standard_t(2, 18)}
    left = drawn[kind]
    every = np.array(list(itertools.product((-1.0, 1.0), repeat=left.size))) @ left
    for level in (1e-5, 2e-5, 4e-5):
        total = float(np.quantile(every, 1.0 - level))
        share = float(np.mean(every >= total - 1e-9))
        assert _beyond_flips(total, left, 1e9, 1e9) >= min(share, 5e-5)


def test_what_was_tried_often_can_still_be_rare_enough() -> None:
    """An effect of twelve deviations in forty blocks, the best of a hundred; and no rarer."""
    rng = np.random.default_rng(31)
    change = _change(rng, 40, 12.0, 0.0)
    before = rng.normal(size=ROWS) + change
    once, often = (
        chance_beside(change, before, before - change, BLOCK, SHORT_BLOCK, tried)
        for tried in (1.0, 100.0)
    )
    assert once == pytest.approx(5e-5)
    assert often == pytest.approx(5e-7)


def test_two_views_that_say_the_same_are_one() -> None:
    assert paid([0.02, 0.02])[0] == pytest.approx(0.02)
    assert paid([1.0, 1e-4]) == pytest.approx([1.0, 2e-4], rel=1e-3)
    assert paid([0.03, 0.01]) == pytest.approx([0.06, 0.015])
    assert paid([0.3]) == pytest.approx([0.3])


@pytest.mark.parametrize("alike", [0.0, 0.5, 0.9])
def test_views_are_paid_for_however_alike_they_are(alike: float) -> None:
    """Of two normal deviates with any correlation, under nothing, at the level that is asked."""
    draws, rng = 40000, np.random.default_rng(7)
    own = rng.normal(size=(draws, 2))
    views = np.sqrt(alike) * rng.normal(size=(draws, 1)) + np.sqrt(1.0 - alike) * own
    chances = norm.sf(views)
    met = sum(min(paid(pair)) <= STANDS for pair in chances.tolist()) / draws
    assert met <= STANDS + 3.0 * np.sqrt(STANDS / draws)
