"""What a base hands over to an effect that takes its place."""

from __future__ import annotations

from dataclasses import replace

import pytest

from hydro_ident.mismatch.fitting.handover import handed_over
from hydro_ident.mismatch.rows.prediction import Model, Predictor
from hydro_ident.mismatch.rows.skew import least_skew
from hydro_model.effects.catalogue import resolve
from hydro_model.robot import EffectSpec


def test_what_a_late_pressure_takes_over_is_its_own_chambers(
    true_model: tuple[Predictor, Model],
) -> None:
    predictor, model = true_model
    skews_s = (1e-4, 2e-4, 3e-4, 4e-4)
    spec = EffectSpec("pressure_delay", "tilt_cylinder/a", {"delay": 0.004})
    (late,) = resolve(replace(model.robot, effects=(spec,)))
    later = handed_over(predictor, replace(model, terms=(late,), skews_s=skews_s), 0.002, {})
    assert later.skews_s == (1e-4, 2e-4, 0.0, 4e-4)
    assert later.terms[0].parameters[0] == pytest.approx(0.0043)
    assert least_skew(late, predictor.skew_columns, skews_s) == 3e-4
    # Where the first cylinder was not recorded, the chamber is still the same one.
    assert least_skew(late, (2, 3), skews_s) == 3e-4
    assert least_skew(late, (2, 3), ()) == 0.0


@pytest.mark.parametrize(
    ("delays_s", "handed_s", "late_s"),
    [
        ((0.0030, 0.0026), (0.0024, 0.0020), 0.0046),
        # A valve that another law has made quick makes no other later than a step may.
        ((0.0025, 0.0011), (0.0025, 0.0011), 0.0040),
        ((0.0022, 0.0011), (0.0025, 0.0014), 0.0037),
    ],
)
def test_no_valve_is_handed_more_than_a_base_may_have(
    true_model: tuple[Predictor, Model],
    delays_s: tuple[float, float],
    handed_s: tuple[float, float],
    late_s: float,
) -> None:
    predictor, model = true_model
    spec = EffectSpec("command_delay", "xs031", {"delay": 0.004})
    (late,) = resolve(replace(model.robot, effects=(spec,)))
    longest_s = dict.fromkeys(predictor.delay_columns, 0.0025)
    given = replace(model, terms=(late,), delays_s=delays_s)
    handed = handed_over(predictor, given, 0.002, longest_s)
    assert handed.delays_s == pytest.approx(handed_s)
    assert handed.terms[0].parameters[0] == pytest.approx(late_s)


def test_a_late_valve_whose_flows_were_not_recorded_takes_nothing_over(
    true_model: tuple[Predictor, Model],
) -> None:
    predictor, model = true_model
    (late,) = resolve(
        replace(model.robot, effects=(EffectSpec("command_delay", "tilt_valve", {"delay": 0.02}),))
    )
    lacking = replace(predictor)
    lacking.delay_columns = {0: predictor.delay_columns[0]}
    given = replace(model, terms=(late,))
    assert handed_over(lacking, given, 0.002, {0: 0.0025}) is given


@pytest.mark.parametrize("target", ["xs031", "lift_valve"])
@pytest.mark.parametrize(
    ("late_s", "delays_s"),
    [(0.004, (0.003, 0.0026)), (0.001, (0.0002, 0.0004)), (0.0999, (0.0025, 0.0024))],
)
def test_valves_are_as_late_after_a_handover_as_before(
    true_model: tuple[Predictor, Model], target: str, late_s: float, delays_s: tuple[float, float]
) -> None:
    """Also where the effect comes to an end of its range: the base keeps what it cannot take."""
    predictor, model = true_model
    spec = EffectSpec("command_delay", target, {"delay": late_s})
    (late,) = resolve(replace(model.robot, effects=(spec,)))
    longest_s = dict.fromkeys(predictor.delay_columns, 0.0025)
    given = replace(model, terms=(late,), delays_s=delays_s)
    handed = handed_over(predictor, given, 0.002, longest_s)
    for i in predictor.delay_columns if target == "xs031" else (0,):
        before, after = (m.delays_s[i] + m.terms[0].parameters[0] for m in (given, handed))
        assert after == pytest.approx(before, abs=1e-12)
