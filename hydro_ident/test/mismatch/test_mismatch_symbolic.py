"""Short forms of a dependence, on rows whose truth is known."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from hydro_ident.mismatch.fitting.bench import Bench
from hydro_ident.mismatch.fitting.whitening import Layout, Noise
from hydro_ident.mismatch.rows.state_space import knots_of
from hydro_ident.mismatch.unnamed.fit_form import Rows
from hydro_ident.mismatch.unnamed.symbolic import Curve, Told, told_forms

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


@pytest.mark.parametrize("name", list(TRUTHS))
def test_the_form_that_rows_are_made_of_is_told(name: str) -> None:
    told = _told(TRUTHS[name])
    assert name in {one.fitted.kind.name for one in told}
    for one in told:
        assert one.share > 0.9
        assert one.held_share > 0.9
        assert one.held_p_value < 0.01


def test_coefficients_and_shapes_are_those_of_the_truth() -> None:
    odd = next(t.fitted for t in _told(TRUTHS["odd_square"]) if t.fitted.kind.name == "odd_square")
    assert odd.theta[0] == pytest.approx(2.0, abs=3.0 * np.sqrt(odd.covariance[0, 0]))
    assert odd.covariance[0, 0] < 0.15**2
    (bell,) = _told(TRUTHS["bell"])
    assert bell.fitted.shape == pytest.approx(0.2, rel=0.05)
    (wave,) = _told(TRUTHS["cosine"])
    assert wave.fitted.shape == pytest.approx(0.9, rel=0.01)
    assert float(np.hypot(*wave.fitted.theta[:2])) == pytest.approx(0.7, rel=0.05)
    assert float(np.arctan2(-wave.fitted.theta[1], wave.fitted.theta[0])) == pytest.approx(
        0.6, abs=0.05
    )


def _steps(v: np.ndarray) -> np.ndarray:
    """Nothing short: up, down and up again at uneven places."""
    return np.interp(v, [-1.2, -0.8, -0.3, -0.2, 0.1, 0.5, 0.6, 1.2], [0, 1, -1, 1, 1, -1, 0.5, 0])


def test_what_is_none_of_the_forms_is_not_forced_into_one() -> None:
    assert not _told(_steps)


def test_a_mixture_is_told_only_by_what_predicts_it() -> None:
    """Two forms at once: whatever is told says most of what the free curve says."""
    for one in _told(lambda v: 1.0 * v**2 + 0.5 * np.cos(2.0 * np.pi * v / 0.7)):
        assert one.share > 0.9
        assert one.held_share > 0.8


def test_noise_has_no_form() -> None:
    for seed in range(3, 11):
        train = _rows(seed, np.zeros_like)
        held = _rows(seed + 100, np.zeros_like)
        assert not told_forms(train, held, Curve(knots_of(train.at, 9))), seed


@pytest.mark.parametrize("share", [0.0, -1.0, 0.3])
def test_what_held_out_rows_do_not_repeat_is_not_told(share: float) -> None:
    """Gone, reversed, or of another size there."""
    truth = TRUTHS["square"]
    assert not _told(truth, lambda v: share * truth(v))


def test_few_held_out_rows_confirm_nothing() -> None:
    train, held = _rows(1, TRUTHS["square"]), _rows(2, TRUTHS["square"])
    short = replace(held.bench.layout, time_s=held.bench.layout.time_s * 0.2)
    base = np.stack([np.ones(ROWS), held.at], axis=1)
    y = TRUTHS["square"](held.at)
    few = replace(held, bench=Bench(short, held.bench.noise, y, base, 1.0))
    assert few.bench.blocks < 20
    assert not told_forms(train, few, Curve(knots_of(train.at, 9)))


def _hum(seed: int, size: float, phase: float, period: float = 0.731) -> Rows:
    """Rows over time in which something hums."""
    rng = np.random.default_rng(seed)
    plain = _rows(seed, np.zeros_like)
    times = plain.bench.layout.time_s
    y = size * np.cos(2.0 * np.pi * times / period + phase) + NOISE * rng.normal(size=ROWS)
    bench = Bench(plain.bench.layout, plain.bench.noise, y, np.ones((ROWS, 1)), 1.0)
    return Rows(bench, times, np.ones(ROWS), plain.recording, "time")


def test_a_hum_is_told_of_other_recordings_at_any_phase_of_its_own_size() -> None:
    train, line = _hum(1, 0.1, 0.5), Curve(np.linspace(0.0, 0.73, 9), 0.73, True)
    (told,) = told_forms(train, _hum(2, 0.1, 2.5), line)
    assert told.fitted.shape == pytest.approx(0.731, abs=3.0 * told.fitted.covariance[2, 2] ** 0.5)
    assert told.fitted.shape == pytest.approx(0.731, rel=2.0e-4)
    assert not told_forms(train, _hum(3, 0.0, 0.0), line)
    assert not told_forms(train, _hum(4, 0.04, 1.0), line)
    # On rows of the same recording its phase is its own, too.
    same = replace(line, any_phase=False)
    assert told_forms(train, _hum(5, 0.1, 0.5), same)
    assert not told_forms(train, _hum(5, 0.1, 0.5 + np.pi), same)


def test_what_repeats_is_told_over_the_variable_over_which_it_does() -> None:
    def truth(v: np.ndarray) -> np.ndarray:
        return 0.7 * np.cos(2.0 * np.pi * (v + 0.25 * v**2) / 0.3)

    train, held = _rows(1, truth), _rows(2, truth)
    twins = [replace(r, at=r.at + 0.25 * r.at**2, variable="joint_angle") for r in (train, held)]
    curve = Curve(knots_of(train.at, 9))
    (told,) = told_forms(train, held, curve, [(twins[0], twins[1])])
    assert told.variable == "joint_angle"
    assert told.fitted.shape == pytest.approx(0.3, rel=0.01)
