"""When a load is taken up, and over how long: to hundredths of a second, from seconds apart."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from hydro_ident.mismatch.rows.onset import (
    Sight,
    beginning,
    begins,
    ending,
    ends,
    settled,
    standing,
)
from hydro_model.effects.catalogue import acting_share, resolve
from hydro_model.effects.targets import ActiveEffect
from hydro_model.robot import EffectSpec, FloatArray
from hydro_model.robot_files import load_robot

TIMES_S, SPACING_S = np.arange(0.0, 60.0, 0.002), 2.0


def _load(**values: float) -> ActiveEffect:
    spec = EffectSpec("payload_change", "xs031", {"mass": 50.0, **values})
    (one,) = resolve(replace(load_robot("xs031"), effects=(spec,)))
    return one


def _times(one: ActiveEffect) -> tuple[float, float]:
    return float(one.parameters[1]), float(one.parameters[2])


@pytest.mark.parametrize("duration_s", [0.0, 0.02, 0.4, 1.5])
@pytest.mark.parametrize("start_s", [30.3, 31.0, 31.99])
def test_a_ramp_is_found_from_the_nearest_instant(start_s: float, duration_s: float) -> None:
    truth = acting_share(_load(start_s=start_s, duration_s=duration_s), TIMES_S)
    calls = []

    def left(at_s: float, over_s: float) -> float:
        calls.append((at_s, over_s))
        of = beginning(_load(), at_s, over_s)
        return float(np.sum((acting_share(of, TIMES_S) - truth) ** 2))

    at_s, over_s = settled(31.0, SPACING_S, left)
    assert at_s == pytest.approx(start_s, abs=0.02)
    assert over_s == pytest.approx(duration_s, abs=0.05 + 0.1 * duration_s)
    assert len(calls) == len(set(calls)) <= 60


def test_a_mistimed_step_costs_mass_and_a_timed_ramp_does_not() -> None:
    """Noise that weighs differences, as filters of forces do, makes of a spike a smaller load."""
    truth = np.diff(acting_share(_load(start_s=31.3, duration_s=0.4), TIMES_S))

    def size(of: ActiveEffect) -> float:
        column = np.diff(acting_share(of, TIMES_S))
        return float(column @ truth / (column @ column))

    step = _load(start_s=31.0)
    assert size(step) < 0.1
    sight = Sight(lambda of: np.diff(acting_share(of, TIMES_S)), truth, sized=False)
    timed = sight.placed(step, SPACING_S, ())
    assert size(timed) == pytest.approx(1.0, abs=0.1)


def test_what_always_acts_does_not_begin() -> None:
    assert begins(_load(start_s=4.0))
    assert not begins(_load())
    assert acting_share(_load(), TIMES_S).min() == 1.0
    (friction,) = resolve(
        replace(
            load_robot("xs031"),
            effects=(EffectSpec("coulomb_friction", "lift_cylinder", {"force": 1e3}),),
        )
    )
    assert not begins(friction)
    assert acting_share(friction, TIMES_S).min() == 1.0


def test_half_of_a_ramp_is_there_at_its_instant() -> None:
    one = beginning(_load(), 4.0, 2.0)
    at = acting_share(one, np.array([2.9, 3.0, 3.5, 4.0, 5.0, 6.0]))
    assert at == pytest.approx([0.0, 0.0, 0.25, 0.5, 1.0, 1.0])


def _shown(of: ActiveEffect) -> FloatArray:
    """A column that a load adds: what it weighs in a posture that changes, and noise of it."""
    return of.parameters[0] * acting_share(of, TIMES_S) * (1.0 + 0.3 * np.sin(TIMES_S))


@pytest.mark.parametrize("sized", [True, False])
@pytest.mark.parametrize(
    ("start_s", "end_s"), [(12.3, 31.9), (40.1, 46.2), (-1e9, 22.7), (18.8, 1e9), (-1e9, 1e9)]
)
def test_a_load_is_placed_where_it_is_taken_up_and_let_go(
    sized: bool, start_s: float, end_s: float
) -> None:
    truth = _load(start_s=start_s, duration_s=0.3, end_s=end_s, end_duration_s=0.2)
    noise = np.random.default_rng(3).normal(0.0, 5.0, TIMES_S.size)
    sight = Sight(_shown, _shown(truth) + noise, sized)
    instants_s = np.linspace(0.0, 60.0, 30)[1:-1].tolist()
    single = sight.first(_load(), instants_s)
    found = sight.placed(single, instants_s[1] - instants_s[0], np.linspace(0, 60, 9)[1:-1])
    assert begins(found) == begins(truth)
    assert ends(found) == ends(truth)
    share = np.abs(acting_share(found, TIMES_S) - acting_share(truth, TIMES_S))
    assert share.mean() < 2e-3


def test_what_goes_is_gone() -> None:
    one = ending(beginning(_load(), 4.0, 2.0), 10.0, 1.0)
    at = acting_share(one, np.array([2.9, 4.0, 6.0, 9.0, 10.0, 10.6]))
    assert at == pytest.approx([0.0, 0.5, 1.0, 1.0, 0.5, 0.0])
    assert acting_share(standing(one), TIMES_S).min() == 1.0
    # What goes before it comes was never there.
    assert acting_share(ending(beginning(_load(), 9.0, 0.0), 4.0, 0.0), TIMES_S).max() == 0.0
