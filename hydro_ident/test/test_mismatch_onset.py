"""When a load is taken up, and over how long: to hundredths of a second, from seconds apart."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from hydro_ident.mismatch.onset import beginning, begins, settled
from hydro_model.effects.catalogue import acting_share, resolve
from hydro_model.effects.targets import ActiveEffect
from hydro_model.robot import EffectSpec
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

    def left(of: ActiveEffect) -> float:
        calls.append(_times(of))
        return float(np.sum((acting_share(of, TIMES_S) - truth) ** 2))

    found = settled(_load(start_s=31.0), SPACING_S, left)
    assert _times(found)[0] == pytest.approx(start_s, abs=0.02)
    assert _times(found)[1] == pytest.approx(duration_s, abs=0.05 + 0.1 * duration_s)
    assert len(calls) == len(set(calls)) <= 60


def test_a_mistimed_step_costs_mass_and_a_timed_ramp_does_not() -> None:
    """Noise that weighs differences, as filters of forces do, makes of a spike a smaller load."""
    truth = np.diff(acting_share(_load(start_s=31.3, duration_s=0.4), TIMES_S))

    def size(of: ActiveEffect) -> float:
        column = np.diff(acting_share(of, TIMES_S))
        return float(column @ truth / (column @ column))

    step = _load(start_s=31.0)
    assert size(step) < 0.1
    timed = settled(
        step,
        SPACING_S,
        lambda of: float(np.sum((truth - size(of) * np.diff(acting_share(of, TIMES_S))) ** 2)),
    )
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
