"""Pairs of effects that hide each other, on columns whose products are known."""

from __future__ import annotations

import numpy as np
import pytest

from hydro_ident.mismatch.fitting.bench import Bench
from hydro_ident.mismatch.fitting.whitening import Layout, Noise
from hydro_ident.mismatch.naming.pairs import best_pair
from hydro_ident.mismatch.trials.candidates import Trial
from hydro_ident.mismatch.trials.chance import chance_of, p_value, signs
from hydro_ident.mismatch.trials.scoring import Entry, Score, score
from hydro_model.effects.catalogue import CATALOGUE
from hydro_model.effects.targets import ActiveEffect
from hydro_model.robot import FloatArray

ROWS = 4000
MASK = np.ones(ROWS, dtype=bool)
NAMES = ("constant_force_offset", "asymmetric_friction", "counterbalance_spring", "pin_friction")


def _bench(y: FloatArray, extra: FloatArray) -> Bench:
    zeros, linked = np.zeros(ROWS, dtype=np.intp), np.ones(ROWS, dtype=bool)
    layout = Layout(zeros, zeros, 0.01 * np.arange(ROWS), linked)
    return Bench(layout, Noise((np.zeros(0),), np.ones(1)), y, extra, 1.0)


def _trial(name: str, signed: bool) -> Trial:
    effect = CATALOGUE[name]
    active = ActiveEffect(effect, 0, effect.typical.copy(), target="lift_cylinder")
    return Trial(active, (effect.typical.copy(),), (effect.sizes[0],), (signed,))


def _scores(bench: Bench, columns: FloatArray, signed: bool = True) -> list[Score]:
    entries = [
        Entry(_trial(name, signed), MASK, column[:, None])
        for name, column in zip(NAMES, columns.T, strict=True)
    ]
    found = [score(bench, entry, MASK) for entry in entries]
    assert all(found)
    return [one for one in found if one is not None]


@pytest.fixture
def columns() -> FloatArray:
    """Four columns, the first two much alike."""
    random = np.random.default_rng(3)
    drawn = random.standard_normal((ROWS, 4))
    drawn[:, 1] = 0.9 * drawn[:, 0] + np.sqrt(1.0 - 0.9**2) * drawn[:, 1]
    return drawn


def _noise(seed: int) -> FloatArray:
    return np.random.default_rng(seed).standard_normal(ROWS)


def test_two_that_cancel_are_found_together_and_neither_alone(columns: FloatArray) -> None:
    y = _noise(5) + 0.3 * (columns[:, 0] - columns[:, 1])
    bench = _bench(y, np.ones((ROWS, 1)))
    scores = _scores(bench, columns)
    chance = chance_of(scores, signs(bench.blocks))
    assert min(p_value(s.value, chance) for s in scores) > 0.005
    pair = best_pair(bench, scores, MASK)
    assert pair is not None
    assert pair.p_value < 0.001
    assert {one.effect.name for one in pair.effects} == set(NAMES[:2])
    # What they gain together beyond both alone, by least squares.
    both = np.column_stack([np.ones(ROWS), columns[:, :2]])
    left = [
        float(np.sum((y - a @ np.linalg.lstsq(a, y, rcond=None)[0]) ** 2))
        for a in (both[:, :1], both, both[:, [0, 1]], both[:, [0, 2]])
    ]
    beyond = (left[0] - left[1]) - (left[0] - left[2]) - (left[0] - left[3])
    assert pair.gain == pytest.approx(beyond, rel=1e-3)


def test_sizes_are_those_beside_each_other(columns: FloatArray) -> None:
    y = 0.2 * columns[:, 0] - 0.3 * columns[:, 1] + 0.1 * _noise(7)
    bench = _bench(y, np.zeros((ROWS, 1)))
    pair = best_pair(bench, _scores(bench, columns), MASK)
    assert pair is not None
    sizes = {}
    for one in pair.effects:
        k = one.effect.sizes[0]
        sizes[one.effect.name] = one.parameters[k] / one.effect.typical[k]
    assert sizes[NAMES[0]] == pytest.approx(0.2, abs=0.02)
    assert sizes[NAMES[1]] == pytest.approx(-0.3, abs=0.02)


def test_noise_has_no_pair(columns: FloatArray) -> None:
    found = 0
    for seed in range(20):
        bench = _bench(_noise(100 + seed), np.ones((ROWS, 1)))
        pair = best_pair(bench, _scores(bench, columns), MASK)
        found += pair is not None and pair.p_value < 0.01
    # 20 draws at 1 %: more than two has a chance of 0.1 %.
    assert found <= 2


def test_what_cannot_be_negative_cancels_nothing(columns: FloatArray) -> None:
    y = _noise(5) + 0.3 * (columns[:, 0] - columns[:, 1])
    bench = _bench(y, np.ones((ROWS, 1)))
    pair = best_pair(bench, _scores(bench, columns, signed=False), MASK)
    names = set() if pair is None else {one.effect.name for one in pair.effects}
    assert pair is None or pair.p_value > 0.001 or names != set(NAMES[:2])


def test_copies_are_no_pair(columns: FloatArray) -> None:
    columns[:, 1] = 0.999 * columns[:, 0] + 0.01 * columns[:, 2]
    y = _noise(5) + 50.0 * (columns[:, 0] - columns[:, 1])
    bench = _bench(y, np.ones((ROWS, 1)))
    pair = best_pair(bench, _scores(bench, columns), MASK)
    assert pair is None or {one.effect.name for one in pair.effects} != set(NAMES[:2])
