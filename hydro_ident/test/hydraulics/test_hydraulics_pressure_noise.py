"""Noise and rounding of the pressures do not stiffen oil: its column has an instrument."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from hydro_ident.bag.recording import Recording
from hydro_ident.estimate.flows.chambers import WindowSettings
from hydro_ident.estimate.flows.delay import fit_delay
from hydro_ident.estimate.flows.delay_steps import delay_step, gathered_chambers
from hydro_ident.estimate.flows.flow_moments import FlowGatherer
from hydro_ident.estimate.signals.neighbours import neighbour_mean
from hydro_ident.estimate.statistics.regression import solve_ols
from hydro_ident.identify.identification import Settings, identify
from hydro_ident.study.pressure_coverage import pressure_case, read, recorded, table
from hydro_model.robot import Robot

#: Where pressures hardly move: the fourth of the usual pace.
PACE = 0.25


@pytest.fixture(scope="module")
def slow(robot: Robot) -> Recording:
    return recorded(robot, PACE, 24.0)


@pytest.mark.thorough
@pytest.mark.parametrize("kind", ["20 kPa", "12 bits, 5 kPa"])
def test_moduli_are_as_their_intervals_say(slow: Recording, kind: str) -> None:
    """16 moduli: fewer than 12 in their intervals, or a mean off by a percent, are no chance."""
    case = pressure_case(slow, kind, PACE, 8, seed=5)
    assert case.bulk >= 12 / 16
    assert abs(case.off) < 0.01
    assert case.edges >= 0.85
    assert case.refused == 0
    assert f"| {kind} | 0.25 |" in table([case])


@pytest.mark.needs("clarabel")
@pytest.mark.parametrize("estimator", ["wls", pytest.param("robust", marks=pytest.mark.thorough)])
def test_moduli_of_either_estimator_hold_the_truth(slow: Recording, estimator: str) -> None:
    found = identify(
        slow.robot,
        [read(slow, "20 kPa", 1)],
        settings=Settings(estimator=estimator),  # type: ignore[arg-type]
    )
    rows = {p.name: p for p in found.parameters}
    for cylinder in slow.robot.cylinders:
        row = rows[f"{cylinder.name}.bulk_modulus"]
        assert row.ci95 is not None
        low, high = row.ci95
        assert low < cylinder.bulk_modulus_pa < high
        assert row.value == pytest.approx(cylinder.bulk_modulus_pa, rel=0.04)


def test_neighbours_are_those_of_five_to_ten_milliseconds() -> None:
    values = np.zeros(41)
    values[20] = 1.0
    values[0] = np.nan
    found = neighbour_mean(values, 0.002, 20)
    assert np.flatnonzero(found).tolist() == [15, 16, 17, 23, 24, 25]
    assert found[15] == pytest.approx(1.0 / 6.0)
    assert neighbour_mean(values, 0.02, 2)[19] == pytest.approx(0.5)
    # One side where there is no other; what has no neighbours stands for itself.
    ramp = np.arange(8.0)
    assert neighbour_mean(ramp, 0.002, 20)[0] == pytest.approx(4.0)
    assert neighbour_mean(ramp[:2], 0.002, 20).tolist() == [0.0, 1.0]


def test_neighbours_keep_the_motion_and_lose_the_noise() -> None:
    """A straight line stays; of white noise nothing of a sample's own is left."""
    time, rng = 0.002 * np.arange(4000), np.random.default_rng(2)
    noise = rng.normal(size=time.size)
    found = neighbour_mean(3.0 * time + noise, 0.002, 20)[10:-10]
    assert np.std(found - 3.0 * time[10:-10]) == pytest.approx(6.0**-0.5, rel=0.05)
    assert abs(np.corrcoef(found - 3.0 * time[10:-10], noise[10:-10])[0, 1]) < 0.05


@pytest.mark.parametrize("step_s", [0.002, 0.01, 0.02, 0.03, 0.1])
def test_an_instrument_knows_nothing_of_the_noise_it_stands_for(step_s: float) -> None:
    """At any rate, down to windows of one interval, whose ends are each other's neighbours."""
    noise, span = np.random.default_rng(3).normal(size=20000), WindowSettings().span(step_s)
    found = neighbour_mean(noise, step_s, span)
    own, other = (v[span:] - v[:-span] for v in (noise, found))
    assert abs(np.mean(own * other)) < 5.0 * np.std(own * other) / 20000**0.5
    # Of what goes on over the window it is a part.
    ramp = np.arange(400.0)
    assert (np.diff(neighbour_mean(ramp, step_s, span)[20:-20]) > 0.5).all()


def test_ordinary_least_squares_have_no_instrument_for_the_delay_either(
    robot: Robot, bench: Any
) -> None:
    """Where the delay is left, no chamber's slope in it asks for more of the same estimator."""
    trace, rng = bench.run(robot), np.random.default_rng(2)
    noise = 2.0e4 * rng.normal(size=(2, *trace.p_a.shape))
    noisy = replace(trace, p_a=trace.p_a + noise[0], p_b=trace.p_b + noise[1])
    gathered = FlowGatherer(robot, "synthetic", WindowSettings(), longest_s=trace.step_s)
    gathered.add(noisy)
    found = fit_delay(robot, [gathered], solve_ols)
    assert found is not None
    total, moved = 0.0, 0.0
    for chamber in gathered_chambers(robot, [gathered]).values():
        step = delay_step(chamber, found.delay_s, solve_ols)
        more = solve_ols(chamber.with_slope(found.delay_s, step.plain.theta)).theta[-1]
        total += 1.0 / step.variance
        moved += more * trace.step_s / step.variance
    assert abs(moved / total) < 1e-3 / np.sqrt(total)
