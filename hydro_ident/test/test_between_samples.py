"""Logs at the controller's rate read forces at one place of each cycle: intervals count that."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hydro_ident.bag.recording import Recording
from hydro_ident.estimate.forces.between_samples import curved_rows, oil_spring, with_curvature
from hydro_ident.estimate.forces.inertial import InertialFit, fit_inertial, force_model, force_rows
from hydro_ident.estimate.signals.derivatives import FilterSettings
from hydro_ident.estimate.signals.traces import Trace, traces_of
from hydro_ident.estimate.statistics.moments import Moments
from hydro_ident.identify.identification import Identification, identify
from hydro_ident.identify.job import Settings
from hydro_model.hydraulics.cylinder import stroke
from hydro_model.robot import Cylinder, FloatArray, Joint, Robot, Valve
from hydro_model.simulation.simulate import simulate

MASS_KG, FRICTION, FINE_S = 1000.0, 5000.0, 0.002


def slider() -> Robot:
    """A mass that a cylinder moves on a level way."""
    joint = Joint(
        name="slide", parent_link="base", child_link="sled", prismatic=True,
        translation_m=np.zeros(3), rotation=np.eye(3), axis=np.array([1.0, 0.0, 0.0]),
        lower=0.01, upper=0.59, velocity_limit=1.0, effort_limit=1e5, viscous_friction=0.0,
    )  # fmt: skip
    cylinder = Cylinder(
        name="ram", joint="slide", bore_m=0.080, rod_m=0.045, stroke_m=0.6, l1_m=0.0, l2_m=0.0,
        q0_rad=0.0, x0_m=0.0, child_pin_angle_rad=0.0, barrel=None, rod=None,
        bulk_modulus_pa=1.2e9, viscous_friction=FRICTION,
    )  # fmt: skip
    return Robot(
        name="slider",
        joints=(joint,),
        link_inertia=np.eye(1, 10) * MASS_KG,
        tip_link="sled",
        tip_offset_m=np.zeros(3),
        gravity_m_s2=np.zeros(3),
        cylinders=(cylinder,),
        valves=(Valve("spool", "ram", 10.0, c_pa=9e-7, c_at=8e-7, c_pb=7e-7, c_bt=6e-7),),
        supply_pressure_pa=19e6,
        tank_pressure_pa=1e6,
    )


def recorded(robot: Robot, every: int, late: int) -> Recording:
    """16 s with commands held over some fine steps, read as often, some fine steps behind them."""
    time = np.arange(0.0, 16.0, FINE_S)
    asked = (1.2 * np.sin(2.0 * time + 1.5) + 0.5 * np.sin(6.0 * time))[:, None]
    held = np.repeat(asked[::every], every, axis=0)
    out = simulate(robot, time, held, np.array([0.3]), np.zeros(1))
    read = slice(late, None, every)
    count, rng = len(time[read]), np.random.default_rng(0)
    noise = rng.normal(size=(3, count, 1))
    rail, volts, step_s = np.ones(count), held[read], every * FINE_S
    return Recording(
        path=Path("slider"), robot=robot, period_s=step_s,
        stamp_ns=1_700_000_000_000_000_000 + np.arange(count) * round(1e9 * step_s),
        q=out.q[read] + 3e-6 * noise[0], stroke=None, effort=None,
        p_a=out.p_a[read] + 4e3 * noise[1], p_b=out.p_b[read] + 4e3 * noise[2],
        supply=robot.supply_pressure_pa * rail, tank=robot.tank_pressure_pa * rail,
        valve_v=volts, valve_source="/valve_state", command_v=volts, spool=None,
        latched=np.zeros(count, dtype=bool), q_ref=None, qd_ref=None, force_ref=None,
        tip_ref=None, temperature_stamp_ns=None, temperature_c=None, losses=(), gaps=(),
        duplicates={}, notes=(), metadata={},
    )  # fmt: skip


def mass_of(found: Identification) -> tuple[float, float]:
    [row] = [p for p in found.parameters if p.name == "sled.mass"]
    return row.value, row.std


def spring_of(robot: Robot) -> float:
    """In the middle of the motion, N/m."""
    return float(oil_spring(robot.cylinders[0], np.array(0.3), 1.2e9))


@pytest.mark.needs("clarabel")
@pytest.mark.parametrize(("late", "share"), [(0, -1.0 / 12.0), (2, 1.0 / 24.0)])
def test_where_in_a_cycle_a_slow_log_reads_is_in_the_interval(late: int, share: float) -> None:
    """Corners or the middle of the parabola: the mass is a third too small, or a sixth too large.

    Noise alone leaves 16 kg of it.
    """
    robot = slider()
    settings = Settings(hold_out_every=0, estimator="wls")
    value, std = mass_of(identify(robot, [recorded(robot, 5, late)], settings=settings))
    added = spring_of(robot) * 0.01**2
    assert value - MASS_KG == pytest.approx(share * added, rel=0.2)
    assert std == pytest.approx(added / 12.0, rel=0.1)
    assert abs(value - MASS_KG) < 2.0 * std


@pytest.mark.needs("clarabel")
def test_at_500_hz_it_is_a_hundredth() -> None:
    """Of a mass that its oil could swing at 20 Hz; with the period's square."""
    robot = slider()
    settings = Settings(hold_out_every=0, estimator="wls")
    value, std = mass_of(identify(robot, [recorded(robot, 1, 0)], settings=settings))
    alone = spring_of(robot) * FINE_S**2 / 12.0
    assert 11.0 < alone < 12.0
    assert alone < std < 2.0 * alone
    assert abs(value - MASS_KG) < 2.0 * std


def fitted(robot: Robot, torque: bool = False) -> tuple[InertialFit, Trace]:
    [trace] = traces_of([recorded(robot, 5, 0)])
    if torque:
        force = trace.p_a * robot.cylinders[0].area_a_m2 - trace.p_b * robot.cylinders[0].area_b_m2
        trace = replace(trace, joint_torque=force)
    found = fit_inertial(force_model(robot, torque), [trace])
    assert found is not None
    return found, trace


def told(fit: InertialFit, trace: Trace, bulk_pa: float) -> InertialFit:
    rows = force_rows(fit.model, trace, FilterSettings())
    assert rows is not None
    wide = curved_rows(fit.model, trace, rows, FilterSettings(), {"ram": bulk_pa})
    moments = Moments.like(wide, "run")
    moments.add(wide)
    return with_curvature(fit, [moments])


def test_the_spring_is_that_of_both_chambers_oil() -> None:
    """Against pressures that rise as volumes shrink; finite at the ends."""
    cylinder = slider().cylinders[0]
    x, dx, bulk = np.array([0.05, 0.3, 0.55]), 1e-6, 8e8

    def force(at: FloatArray) -> FloatArray:
        a = bulk * np.log(x / at) * cylinder.area_a_m2
        b = bulk * np.log((0.6 - x) / (0.6 - at)) * cylinder.area_b_m2
        return np.asarray(a - b)

    slope = (force(x - dx) - force(x + dx)) / (2.0 * dx)
    np.testing.assert_allclose(oil_spring(cylinder, x, bulk), slope, rtol=1e-6)
    ends = oil_spring(cylinder, np.array([-0.01, 0.0, 0.6, 0.7]), bulk)
    assert np.all(np.isfinite(ends))
    assert np.all(ends > oil_spring(cylinder, np.array(0.05), bulk))


def test_the_covariance_has_one_direction_more_with_oil_in_proportion() -> None:
    fit, trace = fitted(slider())
    one, two = (told(fit, trace, bulk).fit for bulk in (1.2e9, 2.4e9))
    np.testing.assert_array_equal(one.theta, fit.fit.theta)
    more, twice = (own.covariance - fit.fit.covariance for own in (one, two))
    np.testing.assert_allclose(twice, 4.0 * more, rtol=1e-6, atol=1e-9 * np.abs(more).max())
    assert np.linalg.matrix_rank(more, tol=1e-9 * np.abs(more).max()) == 1
    x = stroke(slider().cylinders[0], trace.q[:, 0])
    springs = oil_spring(slider().cylinders[0], x, 1.2e9) * 0.01**2 / 12.0
    assert springs.min() < np.sqrt(more[0, 0]) < springs.max()
    assert np.all(one.dof >= fit.fit.dof)


def test_measured_forces_know_nothing_of_oil() -> None:
    fit, trace = fitted(slider(), torque=True)
    assert told(fit, trace, 1.2e9) is fit
