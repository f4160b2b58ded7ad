"""Chamber balances: an independent integration of eqs. 10 to 12 gives back what went in."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lsim

from hydro_ident.estimate.chambers import WindowSettings, chamber_rows, chambers_of
from hydro_ident.estimate.delay import fit_delay
from hydro_ident.estimate.flow_moments import FlowGatherer
from hydro_ident.estimate.hydraulics import BULK_BOUNDS_PA, HydraulicFit, fit_hydraulics
from hydro_ident.estimate.listed_effects import ListedEffects
from hydro_ident.estimate.shared_parameters import chambers_to_cylinder
from hydro_ident.estimate.summed_flow import SummedComparison, SummedFlow, summed_dict
from hydro_ident.estimate.traces import Trace
from hydro_ident.parameters import cylinder_parameters, student_95
from hydro_model.robot import EffectSpec, Robot

H = 0.002
EDGES = {"c_pa": 7.2e-7, "c_at": 6.9e-7, "c_pb": 7.5e-7, "c_bt": 8.3e-7}
BULK = 7.3e8
SUPPLY, TANK = 18.0e6, 0.8e6


def _steady(t: float) -> float:
    return SUPPLY


def _falling(t: float) -> float:
    return SUPPLY - 1.5e6 * (1.0 - np.cos(3.0 * t))


def _chamber(
    side: str,
    robot: Robot,
    time: np.ndarray,
    u: np.ndarray,
    delay: float,
    supply: Callable[[float], float] = _steady,
    leakage: float = 0.0,
) -> np.ndarray:
    """Pressure of one chamber on a piston that moves as x = 0.3 + 0.1 sin: written out anew."""
    cylinder = robot.cylinders[0]
    area = np.pi / 4 * (cylinder.bore_m**2 - (cylinder.rod_m**2 if side == "b" else 0.0))

    def rate(t: float, p: float, command: float) -> float:
        x, v = 0.3 + 0.1 * np.sin(2.0 * t), 0.2 * np.cos(2.0 * t)
        if side == "a":
            edge = EDGES["c_pa"] if command > 0 else EDGES["c_at"]
            drop = supply(t) - p if command > 0 else p - TANK
            volume, swept = area * x, area * v
        else:
            edge = EDGES["c_bt"] if command > 0 else EDGES["c_pb"]
            drop = p - TANK if command > 0 else supply(t) - p
            command = -command
            volume, swept = area * (cylinder.stroke_m - x), -area * v
        flow = edge * command * np.sign(drop) * np.sqrt(abs(drop))
        return BULK / volume * (flow - swept - leakage * p)

    pressure, p = [9.0e6], 9.0e6
    step = float(time[1] - time[0])
    for k, t in enumerate(time[:-1]):
        # From switch to switch: the signal is constant in between, so Runge-Kutta keeps order 4.
        for begin, length, command in (
            (t, delay, u[max(k - 1, 0)]),
            (t + delay, step - delay, u[k]),
        ):
            k1 = rate(begin, p, command)
            k2 = rate(begin + length / 2, p + length / 2 * k1, command)
            k3 = rate(begin + length / 2, p + length / 2 * k2, command)
            k4 = rate(begin + length, p + length * k3, command)
            p += length / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        pressure.append(p)
    return np.array(pressure)


def _signal(robot: Robot, time: np.ndarray) -> np.ndarray:
    """About the flow that the piston's motion takes, with steps and a ripple on it."""
    wanted = robot.cylinders[0].area_a_m2 * 0.2 * np.cos(2.0 * time) / (7.5e-7 * 3000.0)
    ripple = 0.06 * np.sign(np.sin(31.0 * time)) + 0.05 * np.sin(17.0 * time)
    return wanted + ripple


def _trace(
    robot: Robot, u: np.ndarray, time: np.ndarray, p_a: np.ndarray, p_b: np.ndarray
) -> Trace:
    count, nan = time.size, np.full((time.size, 2), np.nan)
    columns = [nan.copy() for _ in range(4)]
    columns[0][:, 0] = 0.3 + 0.1 * np.sin(2.0 * time)
    for column, values in zip(columns[1:], (p_a, p_b, u), strict=True):
        column[:, 0] = values
    return Trace(
        "synthetic",
        H,
        time,
        nan,
        columns[0],
        columns[1],
        columns[2],
        np.full(count, SUPPLY),
        np.full(count, TANK),
        columns[3],
        nan,
    )


def _fit(robot: Robot, delay: float, seconds: float = 6.0, **changes: np.ndarray) -> HydraulicFit:
    time = np.arange(0.0, seconds, H)
    u = _signal(robot, time)
    pressures = {side: _chamber(side, robot, time, u, delay) for side in "ab"}
    trace = _trace(robot, u, time, pressures["a"], pressures["b"])
    for name, values in changes.items():
        getattr(trace, name)[:, 0] = values
    fit = fit_hydraulics(robot, [trace])
    assert fit is not None
    return fit


@pytest.mark.parametrize("delay", [0.0, 0.0007, 0.002])
def test_edges_bulk_modulus_and_delay_come_back(robot: Robot, delay: float) -> None:
    fit = _fit(robot, delay)
    (lift,) = fit.cylinders
    assert lift.rejected == ""
    assert fit.delay_s == pytest.approx(delay, abs=2e-5)
    assert lift.bulk_modulus()[0] == pytest.approx(BULK, rel=5e-4)
    for name, value in EDGES.items():
        assert lift.value(name)[0] == pytest.approx(value, rel=1e-4)


def test_each_chamber_alone_gives_the_same_bulk_modulus(robot: Robot) -> None:
    (lift,) = _fit(robot, 0.001).cylinders
    for chamber in lift.chambers:
        assert 1.0 / chamber.fit.theta[0] == pytest.approx(BULK, rel=1e-3)


def test_what_a_chamber_has_alone_follows_its_rows(robot: Robot) -> None:
    """However sure its errors' covariance is of a direction: as least squares say."""
    time = np.arange(0.0, 6.0, H)
    u = _signal(robot, time)
    # Later than a base may be: the two chambers do not agree on the oil.
    p_a, p_b = (_chamber(side, robot, time, u, 0.0035) for side in "ab")
    gathered = FlowGatherer(robot, "late", WindowSettings())
    gathered.add(_trace(robot, u, time, p_a, p_b))
    found = fit_delay(robot, [gathered])
    assert found is not None
    order = ["inverse_bulk_modulus", "c_pa", "c_at", "c_bt", "c_pb"]
    chambers = []
    for one in found.chambers.values():
        along = one.fit.theta * np.array([1.0, -0.5, 0.5])
        covariance = one.fit.covariance + np.outer(along, along) * 0.01
        chambers.append(replace(one, fit=replace(one.fit, covariance=covariance)))
    path = chambers_to_cylinder(chambers, order)
    both = path @ np.concatenate([one.fit.theta for one in chambers])
    alone = sorted(one.fit.theta[0] for one in chambers)
    assert alone[0] < both[0] < alone[1]
    for one in chambers:
        x, y = (rows[0] for rows in one.blocks.rows)
        size = np.linalg.norm(x, axis=0)
        expected = np.linalg.lstsq(x[:, 1:] / size[1:], y - both[0] * x[:, 0])[0] / size[1:]
        edges = [both[order.index(name)] for name in one.names[1:]]
        np.testing.assert_allclose(edges, expected, rtol=1e-9)


def test_shared_parameters_of_any_size_are_averaged(robot: Robot) -> None:
    """A compliance of 1e-9 beside a share of one: either by its own information."""
    time = np.arange(0.0, 6.0, H)
    u = _signal(robot, time)
    gathered = FlowGatherer(robot, "run", WindowSettings())
    pressures = (_chamber(side, robot, time, u, 0.001) for side in "ab")
    gathered.add(_trace(robot, u, time, *pressures))
    found = fit_delay(robot, [gathered])
    assert found is not None
    stds = np.array([[1e-13, 1e-3, 1e-9], [2e-13, 3e-3, 1e-9]])
    thetas = np.array([[1.3e-9, 0.010, 7e-7], [1.4e-9, 0.014, 8e-7]])
    chambers = [
        replace(
            one,
            names=("inverse_bulk_modulus", "bias", f"edge_{k}"),
            fit=replace(one.fit, theta=thetas[k], covariance=np.diag(stds[k] ** 2)),
        )
        for k, one in enumerate(found.chambers.values())
    ]
    order = ["inverse_bulk_modulus", "bias", "edge_0", "edge_1"]
    both = chambers_to_cylinder(chambers, order) @ thetas.ravel()
    weights = 1.0 / stds[:, :2] ** 2
    expected = (weights * thetas[:, :2]).sum(axis=0) / weights.sum(axis=0)
    np.testing.assert_allclose(both[:2], expected, rtol=1e-9)


def test_windows_that_touch_a_latched_span_are_left_out(robot: Robot) -> None:
    time = np.arange(0.0, 2.0, H)
    u = _signal(robot, time)
    trace = _trace(robot, u, time, np.full(time.size, 9e6), np.full(time.size, 9e6))
    trace.valve_signal[400:600, 0] = np.nan
    rows = chamber_rows(chambers_of(robot)[0], trace, 0.001, WindowSettings())
    inside = (rows.time_s > 400 * H - 0.04) & (rows.time_s < 600 * H)
    assert rows.time_s.size > 70
    assert not inside.any()
    assert np.isfinite(rows.x).all()


def test_a_cylinder_with_one_chamber_is_rejected_and_said(robot: Robot) -> None:
    (lift,) = _fit(robot, 0.001, p_b=np.nan).cylinders
    assert lift.rejected == "only one of its two chambers was recorded"


def test_oil_that_is_barely_told_is_not_identified(robot: Robot) -> None:
    """Positions so coarse that compliance is two deviations from none; the edges are known."""
    trace, rng = _run(robot), np.random.default_rng(1)
    noisy = replace(trace, stroke=trace.stroke + 0.008 * rng.normal(size=trace.stroke.shape))
    fit = fit_hydraulics(robot, [noisy])
    assert fit is not None
    [lift] = fit.cylinders
    inverse, std = lift.value("inverse_bulk_modulus")
    assert 1.0 < inverse / std < 3.0
    assert lift.rejected == "inverse_bulk_modulus cannot be told from these data"
    rows = {p.name: p for p in cylinder_parameters(robot, lift, {})}
    bulk = rows["lift_cylinder.bulk_modulus"]
    assert not bulk.identifiable
    # As stiff as oil can be fits as well; the other end is what compliance may be at most.
    half = student_95(bulk.dof) * std
    assert bulk.ci95 == pytest.approx((1.0 / (inverse + half), BULK_BOUNDS_PA[1]))


def test_the_interval_of_well_known_oil_is_as_good_as_symmetric(robot: Robot) -> None:
    trace, rng = _run(robot), np.random.default_rng(1)
    noisy = replace(trace, stroke=trace.stroke + 1e-4 * rng.normal(size=trace.stroke.shape))
    fit = fit_hydraulics(robot, [noisy])
    assert fit is not None
    [bulk, *_] = cylinder_parameters(robot, fit.cylinders[0], {})
    half = student_95(bulk.dof) * bulk.std
    assert half / bulk.value == pytest.approx(0.012, abs=0.002)
    assert bulk.ci95 is not None
    low, high = bulk.ci95
    assert (bulk.value - low, high - bulk.value) == pytest.approx((half, half), rel=0.02)


def test_a_signal_of_one_sign_leaves_two_edges_unknown(robot: Robot) -> None:
    time = np.arange(0.0, 6.0, H)
    u = np.abs(_signal(robot, time)) + 0.01
    trace = _trace(
        robot, u, time, _chamber("a", robot, time, u, 0.0), _chamber("b", robot, time, u, 0.0)
    )
    fit = fit_hydraulics(robot, [trace])
    assert fit is not None
    assert "c_at" in fit.cylinders[0].rejected
    assert "c_pb" in fit.cylinders[0].rejected
    assert "cannot be told" in fit.cylinders[0].rejected


def test_a_valve_wired_the_wrong_way_round_is_rejected_not_replaced(robot: Robot) -> None:
    time = np.arange(0.0, 6.0, H)
    (lift,) = _fit(robot, 0.001, valve_signal=-_signal(robot, time)).cylinders
    assert "c_pa" in lift.rejected


def test_no_pressures_no_hydraulics(robot: Robot) -> None:
    time = np.arange(0.0, 2.0, H)
    nothing = np.full(time.size, np.nan)
    assert fit_hydraulics(robot, [_trace(robot, nothing, time, nothing, nothing)]) is None


def _run(robot: Robot, seconds: float = 6.0, **laws: object) -> Trace:
    time = np.arange(0.0, seconds, H)
    u = _signal(robot, time)
    p_a, p_b = (_chamber(side, robot, time, u, 0.001, **laws) for side in "ab")  # type: ignore[arg-type]
    return _trace(robot, u, time, p_a, p_b)


def test_a_recorded_supply_may_vary(robot: Robot) -> None:
    trace = _run(robot, supply=_falling)
    constant = fit_hydraulics(robot, [trace])
    recorded = replace(trace, supply=np.array([_falling(t) for t in trace.time_s]))
    fit = fit_hydraulics(robot, [recorded])
    assert fit is not None
    assert constant is not None
    for name, value in EDGES.items():
        assert fit.cylinders[0].value(name)[0] == pytest.approx(value, rel=1e-4)
    # Taken as constant, the edges that it feeds would come out wrong.
    assert constant.cylinders[0].value("c_pa")[0] != pytest.approx(EDGES["c_pa"], rel=0.02)


def test_listed_external_leakage_is_fitted(robot: Robot) -> None:
    coefficients = {"coefficient_a": 1e-13, "coefficient_b": 1e-13}
    effect = EffectSpec("external_leakage", "lift_cylinder", coefficients)
    effects = ListedEffects.of(replace(robot, effects=(effect,)))
    fit = fit_hydraulics(robot, [_run(robot, leakage=6e-13)], None, effects.chamber_columns)
    assert fit is not None
    for side in "ab":
        name = f"external_leakage.coefficient_{side}"
        assert fit.cylinders[0].value(name)[0] == pytest.approx(6e-13, rel=1e-3)
    assert fit.cylinders[0].bulk_modulus()[0] == pytest.approx(BULK, rel=1e-3)


def test_a_listed_spool_lag_does_not_shift_the_delay(robot: Robot) -> None:
    """The spool by its exact response; the mean opening of a cycle is what the chamber sees."""
    fine, frequency, damping = 20, 2.0 * np.pi * 40.0, 0.8
    time = np.arange(0.0, 3.0, H)
    u = _signal(robot, time)
    quick = np.arange(0, time.size * fine) * H / fine
    late = np.repeat(np.append(0.0, u[:-1]), fine)
    soon = np.repeat(u, fine)
    # A delay of 0.6 cycles: the command of the cycle before holds until then.
    held = np.where(np.arange(quick.size) % fine < 0.6 * fine, late, soon)
    model = ([frequency**2], [1.0, 2.0 * damping * frequency, frequency**2])
    spool = lsim(model, held, quick, interp=False)[1]
    middle = 0.5 * (spool[1:] + spool[:-1])
    p_a, p_b = (_chamber(s, robot, quick, np.append(middle, 0.0), 0.0)[::fine] for s in "ab")
    parameters = {"frequency": 40.0, "damping": damping}
    effect = EffectSpec("valve_spool_lag", "lift_valve", parameters)
    effects = ListedEffects.of(replace(robot, effects=(effect,)))
    trace = effects.with_signal_laws(_trace(robot, u, time, p_a, p_b))
    settled = slice(50, None)
    columns = {n: getattr(trace, n)[settled] for n in ("time_s", "q", "stroke", "p_a", "p_b")}
    columns |= {n: getattr(trace, n)[settled] for n in ("supply", "tank", "valve_signal")}
    cut = replace(trace, joint_torque=trace.joint_torque[settled], **columns)
    fit = fit_hydraulics(robot, [cut])
    assert fit is not None
    assert fit.delay_s == pytest.approx(0.6 * H, abs=2e-5)
    for name, value in EDGES.items():
        assert fit.cylinders[0].value(name)[0] == pytest.approx(value, rel=1e-3)


@pytest.mark.parametrize(
    ("law", "parameters"),
    [
        ("valve_spool_lag", {"frequency": 40.0, "damping": 0.8}),
        ("valve_rate_limit", {"rate": 5.0}),
        ("valve_hysteresis", {"half_width": 0.02}),
    ],
)
def test_laws_that_remember_hold_through_lost_messages(
    robot: Robot, law: str, parameters: dict[str, float]
) -> None:
    effects = ListedEffects.of(
        replace(robot, effects=(EffectSpec(law, "lift_valve", parameters),))
    )
    time = np.arange(0.0, 2.0, H)
    whole = 0.3 * np.sin(5.0 * time)
    told = whole.copy()
    told[50::50] = np.nan
    behind, without = (
        effects.with_signal_laws(_trace(robot, u, time, time, time)).valve_signal[:, 0]
        for u in (told, whole)
    )
    known = np.isfinite(told)
    assert np.isfinite(behind[known]).all()
    # What the command does in a cycle is not known: 0.003 at most.
    assert np.abs(behind - without)[known].max() < 0.003


def test_a_latched_valve_shuts_and_a_lost_message_does_not(robot: Robot) -> None:
    """What a spool does behind either: from 0, or from where it was."""
    time = np.arange(0.0, 1.0, H)
    parameters = {"frequency": 40.0, "damping": 0.8}
    effect = EffectSpec("valve_spool_lag", "lift_valve", parameters)
    effects = ListedEffects.of(replace(robot, effects=(effect,)))
    signal = np.full(time.size, 0.5)
    signal[200:400] = np.nan
    lost = _trace(robot, signal, time, time, time)
    latched = replace(lost, latched=~np.isfinite(signal))
    held, shut = (effects.with_signal_laws(t).valve_signal[:, 0] for t in (lost, latched))
    assert np.isnan(held[200:400]).all()
    assert np.isnan(shut[200:400]).all()
    assert held[400:] == pytest.approx(0.5, rel=1e-6)
    assert shut[400] < 0.1


def _compared(robot: Robot, trace: Trace) -> SummedComparison:
    summed = SummedFlow(robot, 0.001, WindowSettings())
    half = trace.samples // 2
    for piece in (slice(0, half), slice(half, None)):
        arrays = ("time_s", "q", "stroke", "p_a", "p_b", "supply", "tank", "valve_signal")
        columns = {name: getattr(trace, name)[piece] for name in arrays}
        summed.add(replace(trace, joint_torque=trace.joint_torque[piece], **columns))
    (found,) = summed.result()
    return found


def test_the_summed_form_of_eq_14_agrees_on_exact_data(robot: Robot) -> None:
    found = _compared(robot, _run(robot))
    summed = dict(zip(found.summed.names, found.summed.theta, strict=True))
    assert 1.0 / summed.pop("inverse_bulk_modulus") == pytest.approx(BULK, rel=2e-3)
    assert summed == pytest.approx(EDGES, rel=2e-3)
    data = summed_dict(found)
    assert set(data["parameters"]["c_pa"]["separate"]) == {"a"}
    assert set(data["parameters"]["inverse_bulk_modulus"]["separate"]) == {"a", "b"}
    assert data["windows"] == found.rows > 200


def test_separate_chambers_are_better_conditioned_and_less_wrong_in_noise(robot: Robot) -> None:
    exact, rng = _run(robot), np.random.default_rng(4)
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
        errors["summed"].append([whole[n] / v - 1.0 for n, v in EDGES.items()])
        errors["separate"].append([apart[n] / v - 1.0 for n, v in EDGES.items()])
    rms = {k: np.sqrt(np.mean(np.square(v), axis=0)) for k, v in errors.items()}
    assert (rms["separate"] < rms["summed"]).all()


def test_no_comparison_where_a_chamber_is_missing(robot: Robot) -> None:
    trace = _run(robot, 2.0)
    summed = SummedFlow(robot, 0.001, WindowSettings())
    summed.add(replace(trace, p_b=np.full_like(trace.p_b, np.nan)))
    assert summed.result() == ()
    summed.add(replace(trace, p_b=np.full_like(trace.p_b, np.nan)))
    assert summed.result() == ()


def test_bags_of_different_rates_reach_the_same_delays(robot: Robot) -> None:
    """4 ms are two fifths of the slow bag's cycle, and four cycles of the fast one's."""
    fine_s, thin, late = 1e-3, 10, 4
    time = np.arange(0.0, 6.0, fine_s)
    runs = []
    for held in (1, thin):
        u = np.repeat(_signal(robot, time[::held]), held)
        acting = np.concatenate([np.full(late, u[0]), u])[: u.size]
        p_a, p_b = (_chamber(side, robot, time, acting, 0.0) for side in "ab")
        columns = [c[::held] for c in (u, time, p_a, p_b)]
        one = replace(_trace(robot, *columns), step_s=held * fine_s)
        runs.append(replace(one, label=f"every {held}"))
    wide = WindowSettings(max_delay_cycles=float(thin))
    alone, joint = fit_hydraulics(robot, runs[:1], wide), fit_hydraulics(robot, runs)
    assert alone is not None
    assert joint is not None
    assert alone.delay_s == pytest.approx(late * fine_s, abs=2e-5)
    assert joint.delay_s == pytest.approx(alone.delay_s, abs=1e-4)
    for name, value in EDGES.items():
        assert alone.cylinders[0].value(name)[0] == pytest.approx(value, rel=1e-3)
        assert joint.cylinders[0].value(name)[0] == pytest.approx(value, rel=3e-4)
