"""Signals that open a valve as wanted, through the laws of the catalogue."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from hydro_control.compensation.signal_inverse import SMOOTHING, SignalInverse, lag_s
from hydro_control.errors import ControlError
from hydro_model.effects import ActiveEffect, resolve
from hydro_model.robot import EffectSpec
from hydro_model.robot_files import load_robot

ROBOT = load_robot("xs031")
DEADBAND = ("valve_deadband", {"width": 0.02})
BIAS = ("valve_null_bias", {"bias": 0.006})


def effects(*listed: tuple[str, dict[str, float]]) -> tuple[ActiveEffect, ...]:
    specs = tuple(EffectSpec(name, "lift_valve", values) for name, values in listed)
    return resolve(replace(ROBOT, effects=specs))


def test_overlap_and_bias_are_added_and_taken_off() -> None:
    inverse = SignalInverse(effects(DEADBAND, BIAS), "lift_valve")
    for wanted in (-0.8, -0.1, -2.0 * SMOOTHING, 2.0 * SMOOTHING, 0.1, 0.8):
        expected = wanted + np.copysign(0.02, wanted) - 0.006
        assert inverse.signal(wanted) == pytest.approx(expected, abs=1e-6)


def test_zero_is_crossed_in_a_ramp_and_not_in_a_leap() -> None:
    inverse = SignalInverse(effects(DEADBAND, BIAS), "lift_valve")
    wanted = np.linspace(-SMOOTHING, SMOOTHING, 101)
    given = np.array([inverse.signal(u) for u in wanted])
    np.testing.assert_allclose(given, wanted * (1.0 + 0.02 / SMOOTHING) - 0.006, atol=2e-4)


@pytest.mark.parametrize("knee", [0.0, 0.1])
@pytest.mark.parametrize("progression", [-0.9, -0.4, 0.3, 0.9])
def test_a_bent_curve_is_met_over_the_whole_range(progression: float, knee: float) -> None:
    bend = {"progression": progression, "knee": knee}
    listed = effects(DEADBAND, ("valve_gain_nonlinearity", bend))
    inverse = SignalInverse(listed, "lift_valve")
    full = inverse.opening(1.0)
    for wanted in np.linspace(-full, full, 41):
        if abs(wanted) > 2.0 * SMOOTHING:
            # Where the curve is steepest its mean over the smoothing is a little off it.
            assert inverse.opening(inverse.signal(wanted)) == pytest.approx(wanted, abs=3e-4)


def test_every_wider_opening_asks_for_more() -> None:
    listed = effects(DEADBAND, BIAS, ("valve_gain_nonlinearity", {"progression": -0.9}))
    inverse = SignalInverse(listed, "lift_valve")
    given = [inverse.signal(u) for u in np.linspace(-2.0, 2.0, 4001)]
    assert np.diff(given).min() > 0.0


def test_a_valve_that_never_opens_is_refused() -> None:
    listed = tuple(
        replace(a, parameters=np.array([2.0])) for a in effects(("valve_deadband", {"width": 0.3}))
    )
    with pytest.raises(ControlError, match="a curve that falls or never opens"):
        SignalInverse(listed, "lift_valve")


@pytest.mark.parametrize(
    ("name", "values", "expected_s"),
    [
        # A second-order spool trails a ramp by 2 zeta / w.
        ("valve_spool_lag", {"frequency": 90.0, "damping": 0.7}, 1.4 / (2.0 * np.pi * 90.0)),
        ("valve_rate_limit", {"rate": 70.0, "time_constant": 0.003}, 0.003),
        # A play trails by its width at any slope, and in time only by what takes it up.
        ("valve_hysteresis", {"half_width": 0.05, "time_constant": 0.002}, 0.002),
    ],
)
def test_the_lag_of_a_law_with_states(
    name: str, values: dict[str, float], expected_s: float
) -> None:
    (one,) = effects((name, values))
    assert lag_s(one) == pytest.approx(expected_s, rel=0.01)
