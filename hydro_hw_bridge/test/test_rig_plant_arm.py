"""The truth plant of a whole arm: conservation, rest, convergence, and what it refuses."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from hydro_hw_bridge.errors import BridgeError
from hydro_hw_bridge.rig.plant import Plant
from hydro_hw_bridge.rig.truth import Truth
from hydro_hw_bridge.rig.truth_files import load_truth
from hydro_model.robot import FloatArray
from hydro_model.robot_files import load_robot

BETA = 1.2e9


def _oil_energy(p: float, volume: float, now: float) -> float:
    """Work stored in a closed chamber of constant modulus: p falls by beta ln(V / V0)."""
    return float(BETA * (now * np.log(now / volume) - now + volume) - p * (now - volume))


def test_energy_is_conserved_with_closed_valves_and_no_friction() -> None:
    robot = load_robot("xs031")
    ideal = Truth.ideal(robot)
    bodies = tuple(
        replace(t, barrel=c.barrel, rod=c.rod)
        for t, c in zip(ideal.cylinders, robot.cylinders, strict=True)
    )
    plant = Plant(robot, replace(ideal, cylinders=bodies), np.array([0.7, -1.2]))
    x_0, p_a, p_b = plant.strokes(), plant.pressures_a.copy(), plant.pressures_b.copy()
    plant.qd[:] = [0.04, -0.05]

    def weight(q: FloatArray, travelled: FloatArray) -> float:
        # Straight-line integral of the bias at rest: the potential does not care for the way.
        nodes, weights = np.polynomial.legendre.leggauss(16)
        along = [
            travelled @ plant.equations(q - travelled * 0.5 * (1 - s), np.zeros(2))[1]
            for s in nodes
        ]
        return float(0.5 * np.dot(weights, along))

    start = plant.q.copy()

    def total() -> float:
        q, qd = plant.q.copy(), plant.qd.copy()
        energy = 0.5 * qd @ plant.equations(q, qd)[0] @ qd + weight(q, q - start)
        x = plant.strokes()
        for i, c in enumerate(robot.cylinders):
            a, b = c.area_a_m2, c.area_b_m2
            energy += _oil_energy(p_a[i], a * x_0[i], a * x[i])
            energy += _oil_energy(p_b[i], b * (c.stroke_m - x_0[i]), b * (c.stroke_m - x[i]))
        return float(energy)

    first = total()
    kinetic = float(0.5 * plant.qd @ plant.equations(plant.q, plant.qd)[0] @ plant.qd)
    for _ in range(10):
        plant.advance(np.zeros(2), 0.05)
        assert total() == pytest.approx(first, abs=1e-6 * kinetic)


@pytest.mark.parametrize("name", ["ideal", "realistic", "random:5"])
def test_static_equilibrium_stays_at_rest(name: str) -> None:
    robot = load_robot("xs031")
    truth = load_truth(name, robot)
    tight = replace(
        truth,
        cylinders=tuple(replace(c, internal_leakage=0.0) for c in truth.cylinders),
        valves=tuple(replace(v, null_bias=0.0, deadband_rounding=1e-9) for v in truth.valves),
    )
    plant = Plant(robot, tight, np.array([0.5, -1.5]))
    before = plant.state.copy()
    plant.advance(np.zeros(2), 1.0)
    np.testing.assert_allclose(plant.q, before[:2], atol=1e-9)
    np.testing.assert_allclose(plant.qd, 0.0, atol=1e-9)
    np.testing.assert_allclose(plant.pressures_a, before[4:6], rtol=1e-6)


def test_integration_converges_with_the_step() -> None:
    robot = load_robot("xs031")
    truth = load_truth("realistic", robot)

    def end(step_s: float) -> FloatArray:
        plant = Plant(robot, truth, np.array([0.5, -1.5]))
        for k in range(100):
            plant.advance(np.array([0.3, -0.2]) * np.sin(0.06 * k), 2e-3, step_s=step_s)
        return np.concatenate([plant.q, 1e-7 * plant.pressures_a])

    np.testing.assert_allclose(end(50e-6), end(10e-6), atol=2e-7)


def test_pose_beyond_strokes_or_strength_is_refused() -> None:
    robot: Any = load_robot("xs031")
    with pytest.raises(BridgeError, match=r"'tilt_cylinder' at .* outside its stroke"):
        Plant(robot, Truth.ideal(robot), np.array([0.8, 0.4]))
    weak = replace(robot, supply_pressure_pa=5.0e6)
    with pytest.raises(BridgeError, match=r"more than 5\.0 MPa"):
        Plant(weak, Truth.ideal(weak), np.array([0.5, -0.5]))


@pytest.mark.parametrize("name", ["ideal", "realistic", "random:1", "random:2"])
def test_wild_commands_stay_finite_and_within_the_strokes(name: str) -> None:
    robot = load_robot("xs031")
    random = np.random.default_rng(9)
    plant = Plant(robot, load_truth(name, robot), np.array([0.5, -1.5]))
    for _ in range(40):
        plant.advance(random.choice([-1.0, -0.3, 0.0, 0.3, 1.0], 2), random.uniform(0.01, 0.15))
        for x, cylinder in zip(plant.strokes(), robot.cylinders, strict=True):
            assert -0.03 < x < cylinder.stroke_m + 0.03
    assert np.abs(plant.qd).max() < 5.0
    assert plant.pressures_a.max() < 60e6
