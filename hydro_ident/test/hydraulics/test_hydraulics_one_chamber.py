"""What is said of a cylinder of which one chamber gave enough windows, and the other did not."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from hydro_ident.estimate.flows.hydraulics import HydraulicFit, fit_hydraulics
from hydro_ident.identify.verdict import judge
from hydro_ident.rollouts.free_run import no_free_run
from hydro_model.robot import Robot
from hydro_model.robot_files import load_robot


@pytest.fixture
def robot() -> Robot:
    return load_robot("xs031")


def _fit(robot: Robot, bench: Any, known: int, noise_m: float = 0.0) -> HydraulicFit:
    """With the first `known` readings of the lift's chamber b; the tilt as good as it can be."""
    trace, rng = bench.run(robot), np.random.default_rng(1)
    p_b = trace.p_b.copy()
    p_b[known:, 0] = np.nan
    stroke = trace.stroke + noise_m * rng.normal(size=trace.stroke.shape)
    fit = fit_hydraulics(robot, [replace(trace, p_b=p_b, stroke=stroke)])
    whole = fit_hydraulics(robot, [trace])
    assert fit is not None
    assert whole is not None
    tilt = replace(whole.cylinders[0], cylinder="tilt_cylinder", valve="tilt_valve")
    return replace(fit, cylinders=(*fit.cylinders, tilt))


def _said(robot: Robot, fit: HydraulicFit) -> str:
    [text] = [p for p in judge(robot, [], None, fit).problems if "stay the robot" in p]
    return text


def test_a_chamber_with_few_windows_is_not_called_unrecorded(robot: Robot, bench: Any) -> None:
    fit = _fit(robot, bench, 300)
    assert _said(robot, fit) == (
        "lift/flow_b gave no or too few windows: lift_valve.c_bt and lift_valve.c_pb stay the"
        " robot file's; lift_cylinder.bulk_modulus and the other edges are of one chamber alone"
    )
    assert no_free_run(robot, fit) == (
        "hydraulics of lift_cylinder were identified of one chamber alone"
    )


def test_a_modulus_that_stays_the_files_is_of_no_chamber(robot: Robot, bench: Any) -> None:
    fit = _fit(robot, bench, 0, noise_m=0.009)
    assert fit.cylinders[0].refused_bulk is not None
    assert _said(robot, fit).endswith(
        "stay the robot file's; the other edges are of one chamber alone"
    )
