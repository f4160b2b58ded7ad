"""Chamber balances: an independent integration of eqs. 10 to 12 gives back what went in."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from hydro_ident.estimate.flows.chambers import WindowSettings, chamber_rows, chambers_of
from hydro_ident.estimate.flows.cylinder_fit import _checked, edges_off
from hydro_ident.estimate.flows.delay import fit_delay
from hydro_ident.estimate.flows.flow_moments import FlowGatherer
from hydro_ident.estimate.flows.hydraulics import fit_hydraulics
from hydro_ident.estimate.flows.shared_parameters import chambers_to_cylinder
from hydro_ident.identify.identified_robot import identified_robot
from hydro_ident.identify.verdict import _hydraulic_problems
from hydro_ident.parameters.parameters import cylinder_parameters, student_95
from hydro_ident.robots.robot_numbers import BULK_BOUNDS_PA
from hydro_model.robot import Robot


@pytest.mark.parametrize("delay", [0.0, 0.0007, 0.002])
def test_edges_bulk_modulus_and_delay_come_back(robot: Robot, bench: Any, delay: float) -> None:
    fit = bench.fit(robot, delay)
    (lift,) = fit.cylinders
    assert lift.rejected == ""
    assert fit.delay_s == pytest.approx(delay, abs=2e-5)
    assert lift.bulk_modulus()[0] == pytest.approx(bench.BULK, rel=5e-4)
    for name, value in bench.EDGES.items():
        assert lift.value(name)[0] == pytest.approx(value, rel=1e-4)


def test_each_chamber_alone_gives_the_same_bulk_modulus(robot: Robot, bench: Any) -> None:
    (lift,) = bench.fit(robot, 0.001).cylinders
    for chamber in lift.chambers:
        assert 1.0 / chamber.fit.theta[0] == pytest.approx(bench.BULK, rel=1e-3)


def test_what_a_chamber_has_alone_follows_its_rows(robot: Robot, bench: Any) -> None:
    """However sure its errors' covariance is of a direction: as least squares say."""
    time = np.arange(0.0, 6.0, bench.H)
    u = bench.signal(robot, time)
    # Later than a base may be: the two chambers do not agree on the oil.
    p_a, p_b = (bench.chamber(side, robot, time, u, 0.0035) for side in "ab")
    gathered = FlowGatherer(robot, "late", WindowSettings())
    gathered.add(bench.trace(robot, u, time, p_a, p_b))
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


def test_shared_parameters_of_any_size_are_averaged(robot: Robot, bench: Any) -> None:
    """A compliance of 1e-9 beside a share of one: either by its own information."""
    time = np.arange(0.0, 6.0, bench.H)
    u = bench.signal(robot, time)
    gathered = FlowGatherer(robot, "run", WindowSettings())
    pressures = (bench.chamber(side, robot, time, u, 0.001) for side in "ab")
    gathered.add(bench.trace(robot, u, time, *pressures))
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


def test_windows_that_touch_a_latched_span_are_left_out(robot: Robot, bench: Any) -> None:
    time = np.arange(0.0, 2.0, bench.H)
    u = bench.signal(robot, time)
    trace = bench.trace(robot, u, time, np.full(time.size, 9e6), np.full(time.size, 9e6))
    trace.valve_signal[400:600, 0] = np.nan
    rows = chamber_rows(chambers_of(robot)[0], trace, 0.001, WindowSettings())
    inside = (rows.time_s > 400 * bench.H - 0.04) & (rows.time_s < 600 * bench.H)
    assert rows.time_s.size > 70
    assert not inside.any()
    assert np.isfinite(rows.x).all()


def test_a_chamber_alone_tells_its_own_edges_and_the_oil(robot: Robot, bench: Any) -> None:
    (lift,) = bench.fit(robot, 0.001, p_b=np.nan).cylinders
    assert not lift.rejected
    assert lift.unfitted == "b"
    assert lift.names == ("inverse_bulk_modulus", "c_pa", "c_at")
    for name in lift.names[1:]:
        assert lift.value(name)[0] == pytest.approx(bench.EDGES[name], rel=1e-3)
    assert lift.bulk_modulus()[0] == pytest.approx(bench.BULK, rel=2e-3)


def test_oil_that_is_barely_told_is_not_identified(robot: Robot, bench: Any) -> None:
    """Positions so coarse that compliance is two deviations from none; the edges are known."""
    trace, rng = bench.run(robot), np.random.default_rng(1)
    noisy = replace(trace, stroke=trace.stroke + 0.009 * rng.normal(size=trace.stroke.shape))
    fit = fit_hydraulics(robot, [noisy])
    assert fit is not None
    [lift] = fit.cylinders
    bulk_ = lift.refused_bulk
    assert bulk_ is not None
    inverse, std = bulk_.inverse, bulk_.std
    assert 1.0 < inverse / std < 3.0
    assert bulk_.reason == "inverse_bulk_modulus cannot be told from these data"
    rows = {p.name: p for p in cylinder_parameters(robot, lift, {})}
    bulk = rows["lift_cylinder.bulk_modulus"]
    assert not bulk.identifiable
    # As stiff as oil can be fits as well; the other end is what compliance may be at most.
    half = student_95(bulk.dof) * std
    assert bulk.ci95 == pytest.approx((1.0 / (inverse + half), BULK_BOUNDS_PA[1]))


@pytest.mark.parametrize("given_pa", [1.1e9, 2.0e7])
def test_edges_are_known_beside_oil_that_is_not(robot: Robot, bench: Any, given_pa: float) -> None:
    """A modulus that the data allow goes with its edges; one that they refute bends none."""
    trace, rng = bench.run(robot), np.random.default_rng(1)
    stroke = trace.stroke + 0.008 * rng.normal(size=trace.stroke.shape)
    noisy = replace(trace, stroke=stroke, rails_read=(True, True))
    given = replace(
        robot,
        cylinders=tuple(replace(c, bulk_modulus_pa=given_pa) for c in robot.cylinders),
        valves=tuple(replace(v, **dict.fromkeys(bench.EDGES, 5e-07)) for v in robot.valves),
    )
    fit = fit_hydraulics(given, [noisy])
    assert fit is not None
    [lift] = fit.cylinders
    assert not lift.rejected
    assert lift.value("inverse_bulk_modulus") == (1.0 / given_pa, 0.0)
    found = identified_robot(given, None, fit)
    for name, true in bench.EDGES.items():
        value, std = lift.value(name)
        # Positions that coarse tell them to a tenth, beside files that are off by a third.
        assert std < 0.12 * true
        assert value == pytest.approx(true, abs=min(3.0 * std, 0.1 * true))
        assert getattr(found.valves[0], name) == value
    assert found.cylinders[0].bulk_modulus_pa == given_pa
    assert "lift_cylinder.bulk_modulus" not in found.standard_deviations
    assert "lift_valve.c_pa" in found.standard_deviations
    said = [text for text in _hydraulic_problems(given, None, fit) if "lift" in text]
    assert said == [
        "lift_cylinder.bulk_modulus rejected, the robot file's kept beside the edges as fitted:"
        " inverse_bulk_modulus cannot be told from these data; to tell them, reverse it quickly"
        " (chirps) as a run of `excite` does"
    ]


def test_the_interval_of_well_known_oil_is_as_good_as_symmetric(robot: Robot, bench: Any) -> None:
    trace, rng = bench.run(robot), np.random.default_rng(1)
    noisy = replace(trace, stroke=trace.stroke + 1e-4 * rng.normal(size=trace.stroke.shape))
    fit = fit_hydraulics(robot, [noisy])
    assert fit is not None
    [bulk, *_] = cylinder_parameters(robot, fit.cylinders[0], {})
    half = student_95(bulk.dof) * bulk.std
    assert half / bulk.value == pytest.approx(0.012, abs=0.002)
    assert bulk.ci95 is not None
    low, high = bulk.ci95
    assert (bulk.value - low, high - bulk.value) == pytest.approx((half, half), rel=0.02)


def test_a_signal_of_one_sign_leaves_two_edges_unknown(robot: Robot, bench: Any) -> None:
    time = np.arange(0.0, 6.0, bench.H)
    u = np.abs(bench.signal(robot, time)) + 0.01
    trace = bench.trace(
        robot,
        u,
        time,
        bench.chamber("a", robot, time, u, 0.0),
        bench.chamber("b", robot, time, u, 0.0),
    )
    fit = fit_hydraulics(robot, [trace])
    assert fit is not None
    assert "c_at" in fit.cylinders[0].rejected
    assert "c_pb" in fit.cylinders[0].rejected
    assert "cannot be told" in fit.cylinders[0].rejected
    rows = {p.name: p for p in cylinder_parameters(robot, fit.cylinders[0], {})}
    for name in ("lift_valve.c_at", "lift_valve.c_pb"):
        # Not 0 +- 0, as though they were known never to open.
        assert (rows[name].std, rows[name].ci95) == (np.inf, None)
    assert rows["lift_valve.c_pa"].ci95 is not None


def test_a_valve_wired_the_wrong_way_round_is_rejected_not_replaced(
    robot: Robot, bench: Any
) -> None:
    time = np.arange(0.0, 6.0, bench.H)
    fit = bench.fit(robot, 0.001, valve_signal=-bench.signal(robot, time))
    (lift,) = fit.cylinders
    assert "c_pa" in lift.rejected
    assert "the sign of lift_valve's signal is likely reversed" in lift.rejected
    # No other motion is asked for: what it would tell is of the wrong signal as well.
    said = [text for text in _hydraulic_problems(robot, None, fit) if "likely reversed" in text]
    assert said
    assert all("to tell them" not in text for text in said)
    # Whatever else the data do not tell.
    unknown = _checked(replace(lift, identifiable=(False, *lift.identifiable[1:])), 1.2e9)
    assert unknown.rejected == lift.rejected


@pytest.mark.parametrize(
    ("scale", "size", "said"),
    [
        (1e-3, "at least", "read too small (V read as mV), or time too short"),
        (1e3, "at most 0.0", "read too large (mV read as V), or time too long"),
    ],
)
def test_edges_of_a_voltage_in_another_unit_are_rejected(
    robot: Robot, bench: Any, scale: float, size: str, said: str
) -> None:
    """They had been taken: 46000 l/min of a valve of 60, and so small a fit's error."""
    signal = scale * bench.signal(robot, np.arange(0.0, 6.0, bench.H))
    (lift,) = bench.fit(robot, 0.001, valve_signal=signal).cylinders
    assert f"every edge is {size}" in lift.rejected
    assert said in lift.rejected
    assert edges_off(lift) == pytest.approx(0.8 / scale, rel=0.2)


def test_a_valve_of_another_size_than_the_files_is_found(robot: Robot, bench: Any) -> None:
    """Up to what no two valves of an arm differ by; and whatever a file says that no valve has."""
    for factor in (15.0, 0.05, 1e7):
        valves = tuple(
            replace(v, **{n: factor * getattr(v, n) for n in bench.EDGES}) for v in robot.valves
        )
        (lift,) = bench.fit(replace(robot, valves=valves), 0.001).cylinders
        assert (lift.rejected, edges_off(lift)) == ("", 1.0)


def test_edges_of_one_rail_below_zero_name_its_reading(robot: Robot, bench: Any) -> None:
    trace = bench.run(robot)
    fit = fit_hydraulics(
        robot, [replace(trace, supply=np.zeros(trace.samples), rails_read=(True, True))]
    )
    assert fit is not None
    (lift,) = fit.cylinders
    assert "c_pa" in lift.rejected
    assert "c_at" not in lift.rejected
    assert "those of the supply alone are below it: its reading is likely wrong" in lift.rejected


def test_no_pressures_no_hydraulics(robot: Robot, bench: Any) -> None:
    time = np.arange(0.0, 2.0, bench.H)
    nothing = np.full(time.size, np.nan)
    assert fit_hydraulics(robot, [bench.trace(robot, nothing, time, nothing, nothing)]) is None


def test_a_recorded_supply_may_vary(robot: Robot, bench: Any) -> None:
    trace = bench.run(robot, supply=bench.falling)
    constant = fit_hydraulics(robot, [trace])
    recorded = replace(trace, supply=np.array([bench.falling(t) for t in trace.time_s]))
    fit = fit_hydraulics(robot, [recorded])
    assert fit is not None
    assert constant is not None
    for name, value in bench.EDGES.items():
        assert fit.cylinders[0].value(name)[0] == pytest.approx(value, rel=1e-4)
    # Taken as constant, the edges that it feeds would come out wrong.
    assert constant.cylinders[0].value("c_pa")[0] != pytest.approx(bench.EDGES["c_pa"], rel=0.02)


@pytest.mark.thorough
def test_bags_of_different_rates_reach_the_same_delays(robot: Robot, bench: Any) -> None:
    """4 ms are two fifths of the slow bag's cycle, and four cycles of the fast one's."""
    fine_s, thin, late = 1e-3, 10, 4
    time = np.arange(0.0, 6.0, fine_s)
    runs = []
    for held in (1, thin):
        u = np.repeat(bench.signal(robot, time[::held]), held)
        acting = np.concatenate([np.full(late, u[0]), u])[: u.size]
        p_a, p_b = (bench.chamber(side, robot, time, acting, 0.0) for side in "ab")
        columns = [c[::held] for c in (u, time, p_a, p_b)]
        one = replace(bench.trace(robot, *columns), step_s=held * fine_s)
        runs.append(replace(one, label=f"every {held}"))
    wide = WindowSettings(max_delay_cycles=float(thin))
    alone, joint = fit_hydraulics(robot, runs[:1], wide), fit_hydraulics(robot, runs)
    assert alone is not None
    assert joint is not None
    assert alone.delay_s == pytest.approx(late * fine_s, abs=2e-5)
    assert joint.delay_s == pytest.approx(alone.delay_s, abs=1e-4)
    for name, value in bench.EDGES.items():
        assert alone.cylinders[0].value(name)[0] == pytest.approx(value, rel=1e-3)
        assert joint.cylinders[0].value(name)[0] == pytest.approx(value, rel=3e-4)
