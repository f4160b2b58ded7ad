"""In few motions many laws are alike, and a shape at its end tells of none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from hydro_ident.mismatch.fitting.weighed import Weighed
from hydro_ident.mismatch.naming.named import named_of, untold_by_few
from hydro_ident.mismatch.trials.contender import Contender, shape_at_a_bound
from hydro_model.effects.catalogue import CATALOGUE, resolve
from hydro_model.effects.targets import ActiveEffect
from hydro_model.robot import EffectSpec
from hydro_model.robot_files import load_robot

#: A fit of nothing: no number of it has a deviation.
UNFITTED = Weighed(None, (), np.zeros((0, 0)), np.zeros(0))  # type: ignore[arg-type]


def test_in_few_motions_a_shape_at_its_end_tells_of_no_law() -> None:
    robot = load_robot("xs031")
    for margin_pa, told in ((1.0e5, True), (7.0e5, False), (1.0e7, True)):
        values = {"share": 1.0, "margin": margin_pa, "outflow": 1.0}
        spec = EffectSpec("pressure_compensation", "lift_valve", values)
        (one,) = resolve(replace(robot, effects=(spec,)))
        assert bool(shape_at_a_bound(one)) is told


@pytest.mark.parametrize(
    ("laws", "few", "told"), [(5, 8.0, True), (5, 1.0, False), (4, 8.0, False)]
)
def test_in_few_motions_many_laws_alike_are_none(laws: int, few: float, told: bool) -> None:
    """Each of five has a chance of a fifth; where motions are many, the set stands."""
    names = (
        "valve_deadband", "valve_null_bias", "valve_hysteresis", "internal_leakage",
        "valve_gain_nonlinearity",
    )  # fmt: skip
    effects = [CATALOGUE[name] for name in names[:laws]]
    terms = [ActiveEffect(one, 0, one.typical) for one in effects]
    alike = [Contender(t, UNFITTED, 100.0, 100.0, 4.0) for t in terms]
    found = named_of(alike, 0.001, 1.0, few)
    reason = untold_by_few(found, found.term)
    assert bool(reason) is told
    assert not told or f"{laws} effects fit alike" in reason
