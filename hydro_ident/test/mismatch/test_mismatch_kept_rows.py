"""Rows that are kept: the last ones, a few megabytes of them, only of what they follow from."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from hydro_ident.mismatch.rows.kept_rows import KeptRows
from hydro_ident.mismatch.rows.prediction import Model, Predictor
from hydro_model.effects.catalogue import resolve
from hydro_model.robot import EffectSpec, FloatArray

MEGABYTE = 1 << 17  # in numbers


def test_the_ones_asked_for_last_are_kept_and_no_more_than_a_few_megabytes() -> None:
    made = list[int]()

    def rows(key: int) -> FloatArray:
        made.append(key)
        return np.full(MEGABYTE, float(key))

    kept = KeptRows()
    for key in (0, 1, 2, 3, 4, 5, 6, 7, 0, 8, 0, 1):
        assert np.all(kept.of(key, lambda key=key: rows(key)) == key)
    # Eight are kept: 8 took the place of 1, which had been asked for longest ago.
    assert made == [0, 1, 2, 3, 4, 5, 6, 7, 8, 1]
    long = KeptRows()
    for _ in range(2):
        long.of(0, lambda: rows(0).repeat(20))
        long.of(1, lambda: rows(1).repeat(20))
    assert made[-4:] == [0, 1, 0, 1]


def test_a_friction_is_anothers_beside_another_sensor_or_number(
    true_model: tuple[Predictor, Model],
) -> None:
    predictor, model = true_model
    friction = EffectSpec("pressure_dependent_friction", "lift_cylinder", {"coefficient": 1e-4})
    bias = EffectSpec("pressure_sensor_bias", "lift_cylinder/a", {"bias": 5.0e5})
    one, off = resolve(replace(model.robot, effects=(friction, bias)))
    found = []
    for beside in (model, model.with_term(off), model):
        for own in (one, replace(one, parameters=2.0 * one.parameters)):
            found.append(predictor.contribution(beside, own))
            fresh = Predictor(predictor.material).contribution(beside, own)
            np.testing.assert_array_equal(found[-1], fresh)
    assert found[0].any()
    assert not np.allclose(found[0], found[2])
    assert not np.allclose(found[0], found[1])
