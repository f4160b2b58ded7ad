"""The compiled compensation against its readable twin: every effect, on random samples."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from hydro_control.compensation.compensation import Compensation, Motion
from hydro_control.compensation.compensation_plan import NOT_COMPENSATED, plan
from hydro_control.compensation.compensation_reference import ReadableCompensation
from hydro_control.compensation.signal_inverse import REACH
from hydro_control.state.axes import axes_of
from hydro_control.state.oil_columns import OilColumns
from hydro_model.effects import CATALOGUE
from hydro_model.effects.targets import targets
from hydro_model.robot import EffectSpec, FloatArray, Robot
from hydro_model.robot_files import load_robot

DT = 0.002
CRANE = load_robot("xs031")
#: Cylinders in another order than the joints, each with its own valve.
ROBOT = replace(CRANE, cylinders=CRANE.cylinders[::-1])
#: All whose laws are compensated.
NAMES = sorted(
    name
    for name, effect in CATALOGUE.items()
    if effect.terms and targets(ROBOT, effect) and name not in NOT_COMPENSATED
)


def listing(names: list[str], rng: np.random.Generator) -> Robot:
    """Effects at every place that they may be at, about as large as is typical."""
    effects = []
    for name in names:
        specs = CATALOGUE[name].parameters
        sizes = [spec.typical * rng.uniform(0.5, 1.5) for spec in specs]
        values = {
            spec.name: float(np.clip(size, spec.lower, spec.upper))
            for spec, size in zip(specs, sizes, strict=True)
        }
        effects.append(EffectSpec(name, "xs031", values))
    return replace(ROBOT, effects=tuple(effects))


def sample(k: int, rng: np.random.Generator) -> tuple[Motion, OilColumns]:
    """Anywhere, resting in every fifth sample, the supply weak in every seventh."""
    q, qdd = np.array([0.5, -1.4]) + rng.uniform(-0.4, 0.4, 2), rng.normal(size=2)
    qd = np.zeros(2) if k % 5 == 0 else rng.normal(size=2) * rng.choice([1e-3, 0.3])
    arm, x, length = rng.uniform(-0.5, 0.5, 2), rng.uniform(0.0, 0.6, 2), rng.uniform(0.1, 0.4, 2)
    pressures, force = rng.uniform(-1e5, 26e6, (2, 2)), rng.normal(size=2) * 1e5
    supply = 3e6 if k % 7 == 0 else 19e6
    motion = Motion(DT * k, q, qd, qdd, arm, x, pressures, supply, 1e6, force)
    return motion, OilColumns(length, 0.6 - length)


def pair(robot: Robot) -> tuple[Compensation, ReadableCompensation]:
    given = plan(robot).robot, plan(robot).active, axes_of(robot), DT
    return Compensation(*given), ReadableCompensation(*given)


def agree(found: FloatArray | None, expected: FloatArray | None) -> None:
    assert found is not None
    assert expected is not None
    assert np.all(np.isfinite(expected))
    # Internal states take the slope of their rate from a small difference, which rounding is in.
    np.testing.assert_allclose(found, expected, rtol=1e-8, atol=1e-12)


@pytest.mark.parametrize("names", [*([name] for name in NAMES), NAMES], ids=[*NAMES, "all"])
def test_every_effect_adds_what_its_law_says(names: list[str]) -> None:
    rng = np.random.default_rng(len(names[0]))
    robot, changed = listing(names, rng), False
    compiled, readable = pair(robot)
    for k in range(60):
        motion, plain = sample(k, rng)
        compiled.observe(motion)
        readable.observe(motion)
        found, expected = compiled.columns(plain), readable.columns(plain)
        agree(found.a_m, expected.a_m)
        agree(found.b_m, expected.b_m)
        agree(found.leak, expected.leak)
        agree(compiled.friction(), readable.friction())
        opening = rng.uniform(-1.2, 1.2, 2) * REACH * rng.choice([1e-3, 0.05, 1.0])
        signal = compiled.signals(opening, 1 + k % 3)
        agree(signal, readable.signals(opening, 1 + k % 3))
        added = np.concatenate([compiled.friction(), found.leak, found.a_m - plain.a_m])
        changed = changed or bool(np.any(added)) or not np.array_equal(signal, opening)
    assert changed or names in (["valve_spool_lag"], ["valve_rate_limit"])  # what looks ahead
    # None of it is left behind.
    _, anew = pair(robot)
    compiled.reset()
    motion, plain = sample(1, rng)
    compiled.observe(motion)
    anew.observe(motion)
    agree(compiled.friction(), anew.friction())
    agree(compiled.columns(plain).leak, anew.columns(plain).leak)
    agree(compiled.signals(opening), anew.signals(opening))


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1e300])
def test_an_opening_that_is_no_usable_number_gives_no_signal_that_is_one(value: float) -> None:
    compiled, _ = pair(listing(["valve_deadband"], np.random.default_rng(1)))
    signal = compiled.signals(np.array([value, 0.1]))
    assert not abs(signal[0]) < 1e100
    assert 0.1 < signal[1] < 0.2
