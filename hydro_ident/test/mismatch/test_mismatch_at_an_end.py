"""What is said of a law's shapes that ran to the end of their range."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from hydro_ident.mismatch.answer.diagnosis_file import covariance_of, parameters_of
from hydro_model.effects.catalogue import resolve
from hydro_model.effects.targets import ActiveEffect
from hydro_model.robot import EffectSpec, Robot

NAME = "counterbalance_valve"


def _law(robot: Robot, range_pa: float) -> ActiveEffect:
    numbers = {"restriction": 1.2, "setting": 0.0, "range": range_pa, "pilot_ratio": 4.0}
    (law,) = resolve(replace(robot, effects=(EffectSpec(NAME, "lift_cylinder/a", numbers),)))
    return law


@pytest.mark.parametrize(("range_pa", "told"), [(1.0e5, False), (2.0e6, True)])
def test_a_shape_at_the_end_of_its_range_has_no_deviation(
    robot: Robot, range_pa: float, told: bool
) -> None:
    law = _law(robot, range_pa)
    names = [f"{law.target}.{NAME}.{spec.name}" for spec in law.effect.parameters]
    fitted: Any = SimpleNamespace(names=names, covariance=np.diag([1e-4, 1.0, 1e8, 1e-2]))
    found = {p["name"].split(".")[1]: p["std"] for p in parameters_of(fitted, law)}
    assert found["restriction"] == pytest.approx(np.hypot(0.01, 0.05 * 1.2))
    assert found["pilot_ratio"] == pytest.approx(np.hypot(0.1, 0.05 * 4.0))
    assert found["setting"] is None
    assert (found["range"] is not None) == told
    kept = [f"{NAME}.{name}" for name, std in found.items() if std is not None]
    assert covariance_of(fitted, law)["names"] == kept
