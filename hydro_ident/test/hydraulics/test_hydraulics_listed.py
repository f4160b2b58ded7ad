"""Hydraulics with listed laws, and the summed form of eq. 14 beside the chambers."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.signal import lsim

from hydro_ident.estimate.effects.listed_effects import ListedEffects
from hydro_ident.estimate.effects.listed_steps import stepped
from hydro_ident.estimate.flows.chambers import WindowSettings
from hydro_ident.estimate.flows.hydraulics import fit_hydraulics
from hydro_ident.estimate.flows.summed_flow import SummedComparison, SummedFlow, summed_dict
from hydro_ident.estimate.signals.traces import Trace, traces_of
from hydro_model.robot import EffectSpec, Robot


def test_listed_external_leakage_is_fitted(robot: Robot, bench: Any) -> None:
    coefficients = {"coefficient_a": 1e-13, "coefficient_b": 1e-13}
    effect = EffectSpec("external_leakage", "lift_cylinder", coefficients)
    effects = ListedEffects.of(replace(robot, effects=(effect,)))
    fit = fit_hydraulics(robot, [bench.run(robot, leakage=6e-13)], None, effects.chamber_columns)
    assert fit is not None
    for side in "ab":
        name = f"external_leakage.coefficient_{side}"
        assert fit.cylinders[0].value(name)[0] == pytest.approx(6e-13, rel=1e-3)
    assert fit.cylinders[0].bulk_modulus()[0] == pytest.approx(bench.BULK, rel=1e-3)


def test_a_listed_spool_lag_does_not_shift_the_delay(robot: Robot, bench: Any) -> None:
    """The spool by its exact response; the mean opening of a cycle is what the chamber sees."""
    fine, frequency, damping = 20, 2.0 * np.pi * 40.0, 0.8
    time = np.arange(0.0, 3.0, bench.H)
    u = bench.signal(robot, time)
    quick = np.arange(0, time.size * fine) * bench.H / fine
    late = np.repeat(np.append(0.0, u[:-1]), fine)
    soon = np.repeat(u, fine)
    # A delay of 0.6 cycles: the command of the cycle before holds until then.
    held = np.where(np.arange(quick.size) % fine < 0.6 * fine, late, soon)
    model = ([frequency**2], [1.0, 2.0 * damping * frequency, frequency**2])
    spool = lsim(model, held, quick, interp=False)[1]
    middle = 0.5 * (spool[1:] + spool[:-1])
    p_a, p_b = (bench.chamber(s, robot, quick, np.append(middle, 0.0), 0.0)[::fine] for s in "ab")
    parameters = {"frequency": 40.0, "damping": damping}
    effect = EffectSpec("valve_spool_lag", "lift_valve", parameters)
    effects = ListedEffects.of(replace(robot, effects=(effect,)))
    trace = effects.with_signal_laws(bench.trace(robot, u, time, p_a, p_b))
    settled = slice(50, None)
    columns = {n: getattr(trace, n)[settled] for n in ("time_s", "q", "stroke", "p_a", "p_b")}
    columns |= {n: getattr(trace, n)[settled] for n in ("supply", "tank", "valve_signal")}
    cut = replace(trace, joint_torque=trace.joint_torque[settled], **columns)
    fit = fit_hydraulics(robot, [cut])
    assert fit is not None
    assert fit.delay_s == pytest.approx(0.6 * bench.H, abs=2e-5)
    for name, value in bench.EDGES.items():
        assert fit.cylinders[0].value(name)[0] == pytest.approx(value, rel=1e-3)


@pytest.mark.thorough
def test_air_is_in_the_dead_volume_too(make_run: Any) -> None:
    """Listed a fifth off, both come to what the machine has."""
    true_crane, simulated_run = make_run
    volumes = {"volume_a": 1.0e-3, "volume_b": 1.0e-3}
    air = {"fraction": 0.02, "polytropic_exponent": 1.4}

    def listed(scale: float) -> tuple[EffectSpec, ...]:
        hose = EffectSpec(
            "dead_volume", "lift_cylinder", {k: scale * v for k, v in volumes.items()}
        )
        return hose, EffectSpec("entrained_air", "lift_cylinder", air | {"fraction": scale * 0.02})

    truth = replace(true_crane(), effects=listed(1.0))
    traces = traces_of([simulated_run(truth, 12.0, noisy=False).recording()])
    robot = replace(truth, effects=listed(0.8))
    effects, step = ListedEffects.of(robot), 1.0
    assert effects.iterated
    for _ in range(8):
        fit = fit_hydraulics(robot, traces, None, effects.chamber_columns)
        assert fit is not None
        effects, step = stepped(effects, fit)
    assert step < 1e-6
    [lift] = [c for c in fit.cylinders if c.cylinder == "lift_cylinder"]
    assert lift.value("entrained_air.fraction")[0] == pytest.approx(0.02, rel=0.01)
    assert lift.bulk_modulus()[0] == pytest.approx(truth.cylinders[0].bulk_modulus_pa, rel=0.01)
    [hose] = [o for o in effects.active if o.effect.name == "dead_volume"]
    assert hose.parameters == pytest.approx([1.0e-3, 1.0e-3], rel=0.02)


@pytest.mark.parametrize(
    ("law", "parameters"),
    [
        ("valve_spool_lag", {"frequency": 40.0, "damping": 0.8}),
        ("valve_rate_limit", {"rate": 5.0}),
        ("valve_hysteresis", {"half_width": 0.02}),
    ],
)
def test_laws_that_remember_hold_through_lost_messages(
    robot: Robot, bench: Any, law: str, parameters: dict[str, float]
) -> None:
    effects = ListedEffects.of(
        replace(robot, effects=(EffectSpec(law, "lift_valve", parameters),))
    )
    time = np.arange(0.0, 2.0, bench.H)
    whole = 0.3 * np.sin(5.0 * time)
    told = whole.copy()
    told[50::50] = np.nan
    behind, without = (
        effects.with_signal_laws(bench.trace(robot, u, time, time, time)).valve_signal[:, 0]
        for u in (told, whole)
    )
    known = np.isfinite(told)
    assert np.isfinite(behind[known]).all()
    # What the command does in a cycle is not known: 0.003 at most.
    assert np.abs(behind - without)[known].max() < 0.003


def test_a_latched_valve_shuts_and_a_lost_message_does_not(robot: Robot, bench: Any) -> None:
    """What a spool does behind either: from 0, or from where it was."""
    time = np.arange(0.0, 1.0, bench.H)
    parameters = {"frequency": 40.0, "damping": 0.8}
    effect = EffectSpec("valve_spool_lag", "lift_valve", parameters)
    effects = ListedEffects.of(replace(robot, effects=(effect,)))
    signal = np.full(time.size, 0.5)
    signal[200:400] = np.nan
    lost = bench.trace(robot, signal, time, time, time)
    latched = replace(lost, latched=~np.isfinite(signal))
    held, shut = (effects.with_signal_laws(t).valve_signal[:, 0] for t in (lost, latched))
    assert np.isnan(held[200:400]).all()
    assert np.isnan(shut[200:400]).all()
    assert held[400:] == pytest.approx(0.5, rel=1e-6)
    assert shut[400] < 0.1


def _compared(robot: Robot, trace: Trace) -> SummedComparison:
    summed = SummedFlow(robot, lambda _: 0.001, WindowSettings())
    half = trace.samples // 2
    for piece in (slice(0, half), slice(half, None)):
        arrays = ("time_s", "q", "stroke", "p_a", "p_b", "supply", "tank", "valve_signal")
        columns = {name: getattr(trace, name)[piece] for name in arrays}
        summed.add(replace(trace, joint_torque=trace.joint_torque[piece], **columns))
    (found,) = summed.result()
    return found


def test_the_summed_form_of_eq_14_agrees_on_exact_data(robot: Robot, bench: Any) -> None:
    found = _compared(robot, bench.run(robot))
    summed = dict(zip(found.summed.names, found.summed.theta, strict=True))
    assert 1.0 / summed.pop("inverse_bulk_modulus") == pytest.approx(bench.BULK, rel=2e-3)
    assert summed == pytest.approx(bench.EDGES, rel=2e-3)
    data = summed_dict(found)
    assert set(data["parameters"]["c_pa"]["separate"]) == {"a"}
    assert set(data["parameters"]["inverse_bulk_modulus"]["separate"]) == {"a", "b"}
    assert data["windows"] == found.rows > 200


def test_separate_chambers_are_better_conditioned_and_less_wrong_in_noise(
    robot: Robot, bench: Any
) -> None:
    exact, rng = bench.run(robot), np.random.default_rng(4)
    errors: dict[str, list[list[float]]] = {"summed": [], "separate": []}
    for _ in range(20):
        noise = 4e3 * rng.normal(size=(2, *exact.p_a.shape))
        stroke = exact.stroke + 2e-6 * rng.normal(size=exact.stroke.shape)
        noisy = replace(exact, p_a=exact.p_a + noise[0], p_b=exact.p_b + noise[1], stroke=stroke)
        found = _compared(robot, noisy)
        chambers = (found.chamber_a, found.chamber_b)
        assert found.summed.condition_number > max(c.condition_number for c in chambers)
        apart = {n: v for c in chambers for n, v in zip(c.names, c.theta, strict=True)}
        whole = dict(zip(found.summed.names, found.summed.theta, strict=True))
        errors["summed"].append([whole[n] / v - 1.0 for n, v in bench.EDGES.items()])
        errors["separate"].append([apart[n] / v - 1.0 for n, v in bench.EDGES.items()])
    rms = {k: np.sqrt(np.mean(np.square(v), axis=0)) for k, v in errors.items()}
    assert (rms["separate"] < rms["summed"]).all()


def test_no_comparison_where_a_chamber_is_missing(robot: Robot, bench: Any) -> None:
    trace = bench.run(robot, 2.0)
    summed = SummedFlow(robot, lambda _: 0.001, WindowSettings())
    summed.add(replace(trace, p_b=np.full_like(trace.p_b, np.nan)))
    assert summed.result() == ()
    summed.add(replace(trace, p_b=np.full_like(trace.p_b, np.nan)))
    assert summed.result() == ()
