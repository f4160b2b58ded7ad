"""Hydraulics of the truth plant at one cylinder: analytic behaviour, effects as configured."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from hydro_hw_bridge.rig.kernel_hydraulics import dead_zone, edge_flow
from hydro_hw_bridge.rig.plant import Plant
from hydro_hw_bridge.rig.truth import Truth
from hydro_model.robot import Cylinder, FloatArray, Joint, Robot, Valve

BETA, STROKE = 1.2e9, 0.59
EDGE = 8.0e-7
STILL = np.zeros(1)


def _slide(mass_kg: float = 2000.0, **valve: Any) -> tuple[Robot, Truth]:
    """A mass on a horizontal cylinder: everything about it is known by hand."""
    joint = Joint(
        *("slide", "base", "sled", True, np.zeros(3), np.eye(3), np.array([1.0, 0.0, 0.0])),
        *(0.0, STROKE, 1.0, 1.0),
    )
    cylinder = Cylinder(
        *("ram", "slide", 0.08, 0.045, STROKE, 0.0, 0.0, 0.0, 0.0, 0.0, None, None, BETA)
    )
    robot = Robot(
        *("slide", (joint,), np.array([[mass_kg, 0, 0, 0, 1, 0, 0, 1, 0, 1.0]]), "sled"),
        *(np.zeros(3), np.array([0.0, 0.0, -9.81]), (cylinder,)),
        (Valve("valve", "ram", 10.0, EDGE, EDGE, EDGE, EDGE),),
        supply_pressure_pa=19.0e6,
        tank_pressure_pa=1.0e6,
    )
    truth = Truth.ideal(robot)
    return robot, replace(truth, valves=(replace(truth.valves[0], **valve),))


def _with_cylinder(truth: Truth, **changes: Any) -> Truth:
    return replace(truth, cylinders=(replace(truth.cylinders[0], **changes),))


def _volumes(robot: Robot, x: float) -> tuple[float, float]:
    ram = robot.cylinders[0]
    return ram.area_a_m2 * x, ram.area_b_m2 * (STROKE - x)


def test_hydraulic_natural_frequency() -> None:
    robot, truth = _slide(mass_kg=2000.0)
    ram, x = robot.cylinders[0], 0.25
    plant = Plant(robot, truth, np.array([x]))
    plant.qd[0] = 1e-4
    volume_a, volume_b = _volumes(robot, x)
    stiffness = BETA * (ram.area_a_m2**2 / volume_a + ram.area_b_m2**2 / volume_b)
    expected = np.sqrt(stiffness / 2000.0) / (2 * np.pi)
    crossings, before = [], 1.0
    for k in range(4000):
        plant.advance(STILL, 1e-4)
        if before < 0.0 <= plant.qd[0]:
            crossings.append(k - plant.qd[0] / (plant.qd[0] - before))
        before = float(plant.qd[0])
    assert len(crossings) > 5
    assert 1e4 / np.mean(np.diff(crossings)) == pytest.approx(expected, rel=1e-4)


@pytest.mark.parametrize("share", [0.07, 0.93])
def test_a_small_cylinder_is_as_stiff_as_its_volumes_make_it(share: float) -> None:
    """A thin cylinder's chambers hold less than 0.2 l long before its ends."""
    robot, truth = _slide(mass_kg=400.0)
    ram = replace(robot.cylinders[0], bore_m=0.05, rod_m=0.03)
    robot = replace(robot, cylinders=(ram,))
    x = share * STROKE
    volumes = _volumes(robot, x)
    assert min(volumes) < 2.0e-4
    plant = Plant(robot, replace(truth, name="thin"), np.array([x]))
    plant.qd[0] = 1e-3
    before = plant.state[2:4].copy()
    plant.advance(STILL, 1e-6)
    rises = (plant.state[2:4] - before) / 1e-6
    expected = BETA * 1e-3 * np.array([-ram.area_a_m2, ram.area_b_m2]) / volumes
    assert rises == pytest.approx(expected, rel=1e-3)


def test_oil_in_closed_chambers_is_conserved_while_the_piston_moves() -> None:
    robot, truth = _slide()
    plant = Plant(robot, truth, np.array([0.3]))
    plant.qd[0] = 0.05

    def mass() -> FloatArray:
        # d(ln rho) = dp / beta
        pressures = np.array([plant.pressures_a[0], plant.pressures_b[0]])
        return np.array(_volumes(robot, float(plant.q[0]))) * np.exp(pressures / BETA)

    before = mass()
    moved = 0.0
    for _ in range(100):
        plant.advance(STILL, 1e-3)
        moved = max(moved, abs(plant.q[0] - 0.3))
    assert moved > 3e-4
    np.testing.assert_allclose(mass(), before, rtol=1e-9)


def _flow_into_a(plant: Plant, u: float) -> float:
    """Net valve flow into chamber A at rest, from the chamber's pressure rate."""
    volume, _ = _volumes(plant.robot, float(plant.q[0]))
    return float(plant.rates(np.array([u]))[2] * volume / BETA)


def test_deadband_and_null_bias_are_where_they_were_put() -> None:
    band, bias = 0.010, 0.004
    robot, truth = _slide(deadband=band, null_bias=bias, deadband_rounding=2e-4)
    plant = Plant(robot, truth, np.array([0.3]))
    edges = []
    for sign in (1.0, -1.0):
        u = sign * np.array([0.05, 0.10])
        flow = [_flow_into_a(plant, value) for value in u]
        slope = (flow[1] - flow[0]) / (u[1] - u[0])
        edges.append(u[0] - flow[0] / slope)
    upper, lower = edges
    assert (upper - lower) / 2 == pytest.approx(band, rel=1e-3)
    assert -(upper + lower) / 2 == pytest.approx(bias, rel=1e-2)
    # Hardly anything flows in the middle of the band.
    assert abs(_flow_into_a(plant, -bias)) < 1e-3 * abs(_flow_into_a(plant, 0.05))


def test_edges_follow_the_square_root_law() -> None:
    robot, truth = _slide()
    plant = Plant(robot, truth, np.array([0.3]))
    for p_a, p_b in ((5.0e6, 8.0e6), (12.0e6, 3.0e6)):
        plant.pressures_a[0], plant.pressures_b[0] = p_a, p_b
        rates = {u: plant.rates(np.array([u])) for u in (0.5, -0.5)}
        volumes = _volumes(robot, 0.3)
        flows = {u: (r[2] * volumes[0] / BETA, r[3] * volumes[1] / BETA) for u, r in rates.items()}
        half = 0.5 * EDGE
        supply = half * np.sqrt(19.0e6 - p_a), -half * np.sqrt(p_b - 1.0e6)
        tank = -half * np.sqrt(p_a - 1.0e6), half * np.sqrt(19.0e6 - p_b)
        np.testing.assert_allclose(flows[0.5], supply, rtol=1e-3)
        np.testing.assert_allclose(flows[-0.5], tank, rtol=1e-3)


def test_small_pressure_drops_flow_laminar_and_both_ways() -> None:
    flow = [edge_flow(EDGE, 1.0, drop, 4e4) for drop in (-100.0, -50.0, 50.0, 100.0)]
    np.testing.assert_allclose(np.array(flow) / flow[3], [-1.0, -0.5, 0.5, 1.0], rtol=1e-5)
    assert edge_flow(EDGE, -0.1, 1e6, 4e4) == 0.0


def test_dead_zone_is_smooth_odd_and_monotonic() -> None:
    u = np.linspace(-0.05, 0.05, 2001)
    opening = np.array([dead_zone(v, 0.01, 1e-3) for v in u])
    assert (np.diff(opening) > 0.0).all()
    np.testing.assert_allclose(opening, -opening[::-1], atol=1e-15)
    outside = np.abs(u) > 0.03
    np.testing.assert_allclose(
        opening[outside], u[outside] - 0.01 * np.sign(u[outside]), atol=3e-5
    )


def test_internal_leakage_evens_the_pressures_at_its_rate() -> None:
    leak = 4.0e-13
    robot, truth = _slide(mass_kg=1.0e13)
    plant = Plant(robot, _with_cylinder(truth, internal_leakage=leak), np.array([0.3]))
    plant.pressures_a[0], plant.pressures_b[0] = 9.0e6, 4.0e6
    volume_a, volume_b = _volumes(robot, 0.3)
    rate = leak * BETA * (1 / volume_a + 1 / volume_b)
    plant.advance(STILL, 0.5)
    drop = plant.pressures_a[0] - plant.pressures_b[0]
    assert drop == pytest.approx(5.0e6 * np.exp(-0.5 * rate), rel=1e-6)


def test_external_leakage_empties_its_chamber_alone() -> None:
    robot, truth = _slide(mass_kg=1.0e13)
    plant = Plant(robot, _with_cylinder(truth, external_leakage_b=3e-13), np.array([0.3]))
    before = plant.pressures_a[0], plant.pressures_b[0]
    plant.advance(STILL, 0.2)
    assert plant.pressures_a[0] == pytest.approx(before[0], rel=1e-9)
    rate = 3e-13 * BETA / _volumes(robot, 0.3)[1]
    assert plant.pressures_b[0] == pytest.approx(before[1] * np.exp(-0.2 * rate), rel=1e-6)


def test_dead_volume_softens_the_chamber() -> None:
    robot, truth = _slide()
    bare = Plant(robot, truth, np.array([0.2]))
    full = Plant(robot, _with_cylinder(truth, dead_volume_a_m3=1.0e-3), np.array([0.2]))
    volume, _ = _volumes(robot, 0.2)
    ratio = bare.rates(np.array([0.3]))[2] / full.rates(np.array([0.3]))[2]
    assert ratio == pytest.approx((volume + 1.0e-3) / volume, rel=1e-12)


def test_oil_is_softer_at_low_pressure() -> None:
    robot, truth = _slide()
    fluid = replace(truth.fluid, low_pressure_loss=0.3, low_pressure_scale_pa=2.0e6)
    plant = Plant(robot, replace(truth, fluid=fluid), np.array([0.3]))
    plant.qd[0] = -0.01
    volume, _ = _volumes(robot, 0.3)
    for p in (1.0e6, 4.0e6, 15.0e6):
        plant.pressures_a[0] = p
        squeezed = plant.rates(STILL)[2] * volume / (robot.cylinders[0].area_a_m2 * 0.01)
        expected = BETA * (1 - 0.3 * np.exp(-(p + 101325.0) / 2.0e6))
        assert squeezed == pytest.approx(expected, rel=1e-9)


def test_pressure_does_not_fall_below_vacuum() -> None:
    robot, truth = _slide()
    plant = Plant(robot, truth, np.array([0.1]))
    plant.qd[0] = 1.0
    lowest = 0.0
    for _ in range(100):
        plant.advance(STILL, 1e-3)
        lowest = min(lowest, plant.pressures_a[0], plant.pressures_b[0])
    assert lowest == pytest.approx(2.0e3 - 101325.0)


def test_spool_is_second_order_at_its_frequency() -> None:
    frequency, damping = 100.0, 0.7
    robot, truth = _slide(natural_frequency_hz=frequency, damping_ratio=damping)
    plant = Plant(robot, truth, np.array([0.3]))
    step, count = 5e-5, 4000
    time = np.arange(1, count + 1) * step
    spool = np.empty(count)
    for k in range(count):
        # The mean of the sine over the step stands for it.
        asked = 0.02 * np.sin(2 * np.pi * frequency * (time[k] - 0.5 * step))
        plant.advance(np.array([asked]), step)
        spool[k] = plant.spools[0]
    late = time > 0.1
    phase = 2 * np.pi * frequency * time[late]
    basis = np.column_stack([np.sin(phase), np.cos(phase)])
    in_phase, quadrature = np.linalg.lstsq(basis, spool[late] / 0.02, rcond=None)[0]
    # At the natural frequency the lag is a quarter turn and the gain 1 / (2 zeta).
    assert quadrature == pytest.approx(-1 / (2 * damping), rel=5e-3)
    assert abs(in_phase) < 5e-3


def test_spool_speed_is_limited() -> None:
    robot, truth = _slide(natural_frequency_hz=100.0, rate_limit_1_s=60.0)
    plant = Plant(robot, truth, np.array([0.3]))
    travel = []
    for _ in range(100):
        before = float(plant.spools[0])
        plant.advance(np.array([1.0]), 5e-4)
        travel.append((plant.spools[0] - before) / 5e-4)
    assert max(travel) == pytest.approx(60.0, rel=1e-6)
    assert plant.spools[0] == pytest.approx(1.0, abs=1e-3)


def test_friction_holds_below_and_slides_above_its_static_force() -> None:
    robot, truth = _slide()
    changes = {"coulomb_friction_n": 4000.0, "static_friction_n": 4400.0}
    changes |= {"bristle_damping": 2e5, "stribeck_velocity_m_s": 0.01}
    real = _with_cylinder(truth, **changes)
    ram = robot.cylinders[0]
    soft = replace(real, fluid=replace(real.fluid, bulk_modulus_pa=1.0))
    travel = {}
    for push in (2000.0, 4800.0):
        plant = Plant(robot, soft, np.array([0.3]))
        # Oil without stiffness keeps the push constant.
        plant.pressures_a[0] = (push + plant.pressures_b[0] * ram.area_b_m2) / ram.area_a_m2
        plant.advance(STILL, 0.5)
        travel[push] = plant.q[0] - 0.3
    assert 0.0 < travel[2000.0] < 1e-4
    assert travel[4800.0] > 5e-3


def test_sliding_friction_is_coulomb_plus_viscous() -> None:
    robot, truth = _slide(mass_kg=1.0e9)
    real = _with_cylinder(
        truth, coulomb_friction_n=4000.0, static_friction_n=4400.0, viscous_friction=30e3
    )
    plant = Plant(robot, real, np.array([0.3]))
    for v in (0.1, -0.1):
        plant.qd[0] = v
        plant.state[4] = 0.0
        plant.advance(STILL, 0.01)
        ram = robot.cylinders[0]
        oil = plant.pressures_a[0] * ram.area_a_m2 - plant.pressures_b[0] * ram.area_b_m2
        friction = oil - 1.0e9 * plant.rates(STILL)[1]
        assert friction == pytest.approx(np.sign(v) * (4000.0 + 30e3 * 0.1), rel=1e-3)


def test_supply_droops_with_its_flow_and_lag() -> None:
    robot, truth = _slide()
    supply = replace(truth.supply, droop=2.0e8, droop_lag_s=0.05, tank_resistance=1.0e11)
    plant = Plant(robot, replace(truth, supply=supply), np.array([0.1]))
    plant.advance(np.array([0.3]), 0.6)
    ram = robot.cylinders[0]
    drawn, returned = ram.area_a_m2 * plant.qd[0], ram.area_b_m2 * plant.qd[0]
    assert drawn > 3e-4
    assert plant.supply_pa == pytest.approx(19.0e6 - 2.0e8 * drawn, abs=2e3)
    assert plant.tank_pa == pytest.approx(1.0e6 + 1.0e11 * returned**2, abs=2e3)
    plant.advance(STILL, 0.05, pump=False)
    assert plant.supply_pa < 0.4 * 19.0e6


@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_end_stop_holds_full_valve_opening(direction: float) -> None:
    robot, truth = _slide()
    plant = Plant(robot, truth, np.array([0.3]))
    for _ in range(50):
        plant.advance(np.array([direction]), 0.05)
        assert -0.02 < plant.q[0] < STROKE + 0.02
    end = STROKE if direction > 0 else 0.0
    assert plant.q[0] == pytest.approx(end, abs=3e-3)
    assert abs(plant.qd[0]) < 1e-3
