"""Rows of a long recording of many joints fill gigabytes: what is in memory how often."""

from __future__ import annotations

import tracemalloc
from collections.abc import Callable
from dataclasses import replace
from typing import Any
from weakref import WeakSet

import numpy as np
import pytest

from hydro_ident.mismatch.fitting.bench import Bench
from hydro_ident.mismatch.fitting.fitted import fitted
from hydro_ident.mismatch.fitting.fitting import fit
from hydro_ident.mismatch.fitting.whitening import Layout, Noise
from hydro_model.robot import Robot

ROWS, COLUMNS = 60_000, 40
Prior = tuple[np.ndarray, np.ndarray]


def a_bench(rows: int, prior: Prior | None = None) -> tuple[Bench, Callable[[], Bench]]:
    """Of some rows, given as a mask; and what makes it of those rows alone."""
    rng = np.random.default_rng(1)
    x, y = rng.normal(size=(rows, COLUMNS)), rng.normal(size=rows)
    mask = np.arange(rows) < 0.8 * rows
    none = np.zeros(rows, dtype=np.intp)
    whole = Layout(none, none, 0.002 * np.arange(rows), np.ones(rows, dtype=bool))
    layout, noise = whole.take(mask), Noise((np.array([0.5]),), np.ones(1))
    tracemalloc.start()
    bench = Bench(layout, noise, y, x, 1.0, prior, mask)
    return bench, lambda: Bench(layout, noise, y[mask], x[mask], 1.0, prior)


def test_a_bench_is_made_with_hardly_a_copy_beside_what_it_keeps() -> None:
    """It keeps its columns, scaled, and a basis of them."""
    a_bench(100)  # whatever is compiled takes memory once
    tracemalloc.stop()
    bench, _ = a_bench(ROWS)
    kept, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    columns = 8 * COLUMNS * bench.count
    assert 2.0 * columns < kept < 2.3 * columns
    assert peak < 2.6 * columns


def test_a_bench_of_some_rows_is_that_of_the_rows_alone() -> None:
    some, alone = a_bench(500, (np.eye(COLUMNS), np.ones(COLUMNS)))
    tracemalloc.stop()
    np.testing.assert_array_equal(some.residual, alone().residual)
    np.testing.assert_array_equal(some.solve(), alone().solve())


@pytest.fixture
def beside(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """How many benches there were beside each that was made."""
    there: WeakSet[Bench] = WeakSet()
    counts: list[int] = []
    make = Bench.__init__

    def noted(self: Bench, *arguments: Any, **named: Any) -> None:
        counts.append(len(there))
        make(self, *arguments, **named)
        there.add(self)

    monkeypatch.setattr(Bench, "__init__", noted)
    return counts


def test_a_fit_has_no_rows_but_those_it_goes_on_from(
    make_run: tuple[Callable[..., Robot], Callable[..., Any]],
    lay_out: Callable[..., Any],
    beside: list[int],
) -> None:
    true_crane, simulated_run = make_run
    # Later than a base may make it: what is at its bound is fitted once more without it.
    work = lay_out(simulated_run(replace(true_crane(), command_delay_s=0.007), 12.0))
    training, model, noise = work.training, work.base.model, work.base.bench.noise
    beside.clear()
    known = fitted(training, model, noise)
    own = beside[0]
    assert known.held
    assert beside == [own, own]
    del known
    beside.clear()
    fit(training, model, noise, passes=2)
    assert len(beside) >= 3
    # A step that is held to its range needs no rows of its own.
    assert max(beside) == own
    beside.clear()
    fit(training, model, passes=2)
    assert max(beside) == own + 1
