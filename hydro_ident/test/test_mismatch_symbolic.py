"""Short forms of a dependence, on rows whose truth is known."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.signal import lfilter

from hydro_ident.mismatch.bench import Bench
from hydro_ident.mismatch.fit_form import Rows
from hydro_ident.mismatch.state_space import knots_of
from hydro_ident.mismatch.symbolic import Curve, Told, told_forms
from hydro_ident.mismatch.whitening import Layout, Noise

ROWS, STEP_S, NOISE = 4000, 0.02, 0.2
Function = Callable[[np.ndarray], np.ndarray]


def _variable(rng: np.random.Generator) -> np.ndarray:
    """Smooth, within about one of zero."""
    white = rng.normal(size=ROWS + 500)
    found = np.asarray(lfilter([1.0], [1.0, -1.9, 0.905], white)[500:])
    return np.tanh(found / (1.5 * found.std())) * 1.2


def _rows(seed: int, truth: Function, noise: float = NOISE, shift: float = 0.0) -> Rows:
    """Rows whose base knows a constant and the variable's slope."""
    rng = np.random.default_rng(seed)
    at = _variable(rng) + shift
    linked = np.ones(ROWS, dtype=bool)
    linked[0] = False
    recording = np.zeros(ROWS, dtype=np.intp)
    layout = Layout(recording, recording, np.arange(ROWS) * STEP_S, linked)
    y = truth(at) + noise * rng.normal(size=ROWS)
    base = np.stack([np.ones(ROWS), at], axis=1)
    bench = Bench(layout, Noise((np.zeros(0),), np.array([noise])), y, base, 1.0)
    return Rows(bench, at, np.ones(ROWS), recording, "piston_velocity")


def _told(truth: Function, held: Function | None = None, **options: float) -> tuple[Told, ...]:
    train, other = _rows(1, truth, **options), _rows(2, held or truth, **options)
    return told_forms(train, other, Curve(knots_of(train.at, 9)))


TRUTHS: dict[str, Function] = {
    "magnitude": lambda v: 1.5 * np.abs(v),
    "square": lambda v: -1.5 * v**2,
    "odd_square": lambda v: 2.0 * v * np.abs(v),
    "cube": lambda v: 1.5 * v**3,
    "root": lambda v: 2.0 * np.sign(v) * np.sqrt(np.abs(v)),
    "sign": lambda v: 0.8 * np.tanh(v / 0.08),
    "bell": lambda v: 1.2 * np.exp(-((v / 0.2) ** 2)),
    "odd_bell": lambda v: 1.2 * np.sign(v) * np.exp(-((v / 0.3) ** 2)),
    "decay": lambda v: 1.5 / (1.0 + np.abs(v) / 0.1),
    "beyond": lambda v: 2.0 * np.maximum(v - 0.4, 0.0),
    "below": lambda v: 2.0 * np.maximum(-0.5 - v, 0.0),
    "cosine": lambda v: 0.7 * np.cos(2.0 * np.pi * v / 0.9 + 0.6),
}
