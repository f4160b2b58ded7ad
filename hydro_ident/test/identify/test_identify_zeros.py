"""Zeros of pressure transducers that are off: intervals of the forces hold the truth still."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from hydro_ident.identify.identification import identify
from hydro_ident.transducers import zero_pa
from hydro_model.multibody.base_parameters import base_map
from hydro_model.robot import Robot
from hydro_model.robot_files import load_robot

pytestmark = pytest.mark.needs("clarabel")


def test_usual_zeros_leave_the_truth_in_the_intervals(clean: Any, robot: Robot) -> None:
    truth = base_map(clean.robot).combination @ clean.robot.parameter_vector
    noise = np.random.default_rng(3).normal(0.0, 2e3, (2, *clean.p_a.shape))
    off = zero_pa(robot) * np.array([[1.0, -0.9], [-0.9, 1.0]])
    p_a, p_b = (p + n + z for p, n, z in zip((clean.p_a, clean.p_b), noise, off, strict=True))
    found = identify(load_robot("xs031"), [clean.recording(p_a=p_a, p_b=p_b)])
    assert found.robot is not None
    assert found.robot.base_covariance is not None
    rows, held = {p.name: p for p in found.parameters}, 0
    for i, base in enumerate(found.robot.base_parameters):
        row = rows[base.name]
        if row.ci95 is None or not row.identifiable:
            continue
        low, high = row.ci95
        assert low <= truth[i] <= high, base.name
        # One covariance: what is printed is what the model file has.
        assert row.std == pytest.approx(found.robot.base_covariance[i, i] ** 0.5)
        held += 1
    assert held >= 4
