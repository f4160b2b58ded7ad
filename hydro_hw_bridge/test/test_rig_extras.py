"""Extras of the truth plant: nothing without them, and each as physics asks."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from hydro_hw_bridge.errors import BridgeError
from hydro_hw_bridge.rig.core import RigCore
from hydro_hw_bridge.rig.extras import AxisExtras, Extras, MachineExtras, SensorExtras
from hydro_hw_bridge.rig.following import Servo, Signals, balance_residuals, follow, true_rates
from hydro_hw_bridge.rig.kernel_following import rates_along
from hydro_hw_bridge.rig.plant import Plant
from hydro_hw_bridge.rig.process import Process
from hydro_hw_bridge.rig.random_truth import plain_truth
from hydro_hw_bridge.rig.readings import read_pressures, shown_pressures, true_pressures
from hydro_hw_bridge.rig.truth import Truth
from hydro_model.robot import FloatArray, Robot

POSE = np.array([0.5, -1.5])
SERVO = Servo(np.array([3.0, 3.0]), np.array([6e-7, 6e-7]))


def _with(truth: Truth, *, machine: MachineExtras | None = None, **axis: Any) -> Truth:
    axes = (AxisExtras(**axis), AxisExtras())
    return replace(truth, extras=Extras(axes, machine or MachineExtras()))


def _path(count: int) -> tuple[FloatArray, FloatArray]:
    t = np.arange(count)[:, None] * 2e-3
    fade = np.minimum(t, 1.0) ** 2
    q = POSE + fade * np.array([0.15, 0.2]) * np.sin(np.array([2.0, 2.7]) * t)
    return q, np.gradient(q, 2e-3, axis=0)


def _signals(robot: Robot, plant: Plant, states: FloatArray, asked: FloatArray) -> Signals:
    n, m = robot.dof, len(robot.cylinders)
    track_rates = np.empty_like(states)
    rates_along(states, asked, 0.0, 2e-3, *plant.records, track_rates)
    a, b, s = 2 * n, 2 * n + m, plant.lines_index
    return Signals(
        *(states[:, :n], states[:, n : 2 * n], track_rates[:, n : 2 * n]),
        *(states[:, a : a + m], states[:, b : b + m]),
        *(track_rates[:, a : a + m], track_rates[:, b : b + m]),
        states[:, s : s + 2],
        asked,
    )


def test_extras_of_zero_are_none(robot: Robot) -> None:
    assert not Extras((AxisExtras(), AxisExtras())).in_plant
    assert not SensorExtras(pressure_gain={"supply": 0.0}).any
    truth = plain_truth(robot, 3)
    bare = replace(truth, extras=Extras())
    runs = []
    for one in (bare, _with(bare, seal=1e-30)):
        plant = Plant(robot, one, POSE)
        for k in range(200):
            plant.advance(np.array([0.2, -0.1]) * np.sin(0.02 * k), 2e-3)
        runs.append(plant.state[: plant.lines_index + 2].copy())
    np.testing.assert_allclose(runs[0], runs[1], rtol=1e-12)


def test_cycle_by_cycle_is_the_compiled_run(robot: Robot) -> None:
    """Behind the bus and in the compiled loop the machine is the same."""
    truth = plain_truth(robot, 4)
    truth = _with(
        truth,
        machine=replace(truth.extras.machine, command_delay_s=0.0013),
        hysteresis=0.01,
        mount_stiffness=1e9,
        mount_gap=1e-4,
        line_inertance=2e7,
        flex_inertia=100.0,
        even_force=300.0,
    )
    q, qd = _path(400)
    track = follow(Plant(robot, truth, POSE), SERVO, q, qd, seed=1, step_s=50e-6)
    plant = Plant(robot, truth, POSE)
    for k in range(400):
        np.testing.assert_allclose(plant.state, track.states[k], rtol=1e-9, atol=1e-9)
        plant.advance(track.commands[k], 2e-3)


def test_plain_machine_leaves_nothing_in_its_balances(robot: Robot) -> None:
    truth = plain_truth(robot, 5)
    plant = Plant(robot, truth, POSE)
    q, qd = _path(1000)
    track = follow(plant, SERVO, q, qd, seed=1)
    signals = _signals(robot, plant, track.states, track.asked)
    left = balance_residuals(Plant(robot, truth, POSE), signals)
    assert np.abs(left[:, 0::3]).max() < 1e-6
    assert np.abs(left[:, 1::3]).max() < 1e-15
    assert np.abs(left[:, 2::3]).max() < 1e-15


@pytest.mark.parametrize(
    ("axis", "expected"),
    [
        ({"offset_force": 500.0}, lambda x, v, pa, pb: 500.0 + 0 * v),
        ({"even_viscous": 1e4}, lambda x, v, pa, pb: 1e4 * np.abs(v)),
        ({"turbulent": 2e4}, lambda x, v, pa, pb: 2e4 * np.sign(v) * np.abs(v) ** 1.75),
        ({"seal": 1e-4}, lambda x, v, pa, pb: 1e-4 * (pa + 0.7 * pb) * np.sign(v)),
        ({"gas_force": 900.0}, lambda x, v, pa, pb: -900.0 * (1 + x / 0.59) ** -1.3),
    ],
)
def test_forces_are_what_they_say(robot: Robot, axis: dict[str, Any], expected: Any) -> None:
    truth = replace(plain_truth(robot, 6), extras=Extras())
    plant = Plant(robot, _with(truth, **axis), POSE)
    random = np.random.default_rng(2)
    count = 60
    states = np.tile(plant.state, (count, 1))
    states[:, :2] += random.uniform(-0.2, 0.2, (count, 2))
    states[:, 2:4] = random.choice([-1.0, 1.0], (count, 2)) * random.uniform(0.3, 0.6, (count, 2))
    signals = _signals(robot, plant, states, np.zeros((count, 2)))
    left = balance_residuals(Plant(robot, truth, POSE), signals)
    x, v = np.empty(count), np.empty(count)
    for k, state in enumerate(states):
        plant.state[:4] = state[:4]
        x[k] = plant.strokes()[0]
        v[k] = plant.equations(state[:2], state[2:4])[2][0] * state[2]
    wanted = expected(x, v, states[:, 4], states[:, 6])
    np.testing.assert_allclose(left[:, 0], wanted, rtol=1e-3, atol=1e-3)
    np.testing.assert_allclose(left[:, 1:3], 0.0, atol=1e-16)
    np.testing.assert_allclose(left[:, 3], 0.0, atol=1e-6)


def test_sprung_load_keeps_its_energy(robot: Robot) -> None:
    """Oil as stiff as stone, no friction: the sprung part swings at its own frequency."""
    truth = Truth.ideal(robot)
    stiff = replace(truth, fluid=replace(truth.fluid, bulk_modulus_pa=2e10))
    rate = 2 * np.pi * 5.0
    plant = Plant(robot, _with(stiff, flex_inertia=50.0, flex_rate=rate, flex_damping=0.0), POSE)
    first = plant.lines_index + 2 + 2
    plant.state[first] = 0.01
    swing = []
    for _ in range(400):
        plant.advance(np.zeros(2), 1e-3)
        swing.append(plant.state[first])
    crossings = np.flatnonzero(np.diff(np.sign(swing)))
    assert 0.5e3 / np.mean(np.diff(crossings)) == pytest.approx(5.0, rel=0.03)
    assert np.max(np.abs(swing[200:])) == pytest.approx(0.01, rel=0.05)


def test_play_lets_the_joint_float_by_its_width(robot: Robot) -> None:
    truth = replace(plain_truth(robot, 7), extras=Extras())
    # Oil without stiffness keeps the push constant.
    truth = replace(truth, fluid=replace(truth.fluid, bulk_modulus_pa=1.0))
    gap = 2e-4
    bends = []
    for force in (3e4, -3e4):
        plant = Plant(robot, _with(truth, mount_stiffness=1e9, mount_gap=0.5 * gap), POSE)
        area = robot.cylinders[0].area_a_m2, robot.cylinders[0].area_b_m2
        plant.pressures_b[0] = 12e6
        plant.pressures_a[0] = (force + 12e6 * area[1]) / area[0]
        plant.advance(np.zeros(2), 0.04)
        bends.append(float(plant.state[plant.lines_index + 2]))
    # The spring gives way by 30 um either way.
    assert bends[0] - bends[1] == pytest.approx(gap + 2 * 3e4 / 1e9, rel=0.05)


def test_ground_pushes_only_upwards_and_only_below(robot: Robot) -> None:
    truth = replace(plain_truth(robot, 8), extras=Extras())
    free = Plant(robot, truth, POSE)
    height = float(free.tip()[2])
    for offset, touches in ((-0.01, False), (0.02, True)):
        machine = MachineExtras(contact_stiffness=1e5, contact_height=height + offset)
        plant = Plant(robot, _with(truth, machine=machine), POSE)
        gained = plant.rates(np.zeros(2))[2:4] - free.rates(np.zeros(2))[2:4]
        mass, _, _ = free.equations(POSE, np.zeros(2))
        torque = mass @ gained
        if not touches:
            np.testing.assert_allclose(torque, 0.0, atol=1e-9)
            continue
        push = 1e5 * 0.02**1.5
        probe = 1e-6
        for j in range(2):
            moved = Plant(robot, truth, POSE + probe * np.eye(2)[j])
            lift = (moved.tip()[2] - height) / probe
            assert torque[j] == pytest.approx(push * lift, rel=1e-3)


def test_hose_passes_steady_flow_and_delays_a_step(robot: Robot) -> None:
    truth = replace(plain_truth(robot, 9), extras=Extras())
    plants = [Plant(robot, t, POSE) for t in (truth, _with(truth, line_inertance=2e7))]
    for plant in plants:
        plant.advance(np.array([0.3, 0.0]), 2e-3)
    assert plants[1].pressures_a[0] < plants[0].pressures_a[0]
    for plant in plants:
        plant.advance(np.array([0.3, 0.0]), 0.6)
    assert plants[1].qd[0] == pytest.approx(plants[0].qd[0], rel=0.1)


def test_instruments_show_what_is_wrong_with_them(robot: Robot) -> None:
    truth = Truth.ideal(robot)
    names = robot.pressure_names
    sensors = SensorExtras(
        pressure_gain={names[0]: 0.01},
        pressure_delay_s={names[1]: 0.004},
        encoder_swing={"lift": 1e-3},
        encoder_swing_count={"lift": 20.0},
    )
    odd = replace(truth, extras=Extras(sensors=sensors))
    core, past = RigCore(robot, odd, q=POSE.tolist()), []
    for k in range(60):
        past.append((core.plant.pressures_a[0], core.plant.pressures_b[0], core.plant.q[0]))
        shown = core.readings().measurement
        assert shown.pressures_pa[0] == pytest.approx(1.01 * past[-1][0])
        assert shown.pressures_pa[1] == pytest.approx(past[max(k - 2, 0)][1])
        wanted = past[-1][2] + 1e-3 * np.sin(20.0 * past[-1][2])
        assert shown.positions[0] == pytest.approx(wanted, abs=1e-12)
        core.actuate([3.0, 1.0])


def test_readings_of_a_run_are_those_of_the_instruments(robot: Robot) -> None:
    truth = plain_truth(robot, 10)
    wandering = replace(truth.extras.sensors, wander_pa=3e3, wander_time_s=0.01)
    truth = replace(truth, extras=replace(truth.extras, sensors=wandering))
    q, qd = _path(2000)
    plant = Plant(robot, truth, POSE)
    track = follow(plant, SERVO, q, qd, seed=1)
    true, read = true_pressures(plant, track.states), read_pressures(plant, track, 2)
    np.testing.assert_array_equal(shown_pressures(plant, true, track.cycle_s), true)
    assert np.all(read % robot.sensors.pressure_resolution_pa == 0.0)
    parts = (
        truth.sensors.pressure_noise_pa,
        robot.sensors.pressure_resolution_pa / np.sqrt(12),
        3e3,
    )
    spread = np.sqrt(np.sum(np.square(parts)))
    np.testing.assert_allclose(np.std(read - true, axis=0), spread, rtol=0.15)
    counts = 2 * np.pi / robot.sensors.encoder_counts_per_rev
    assert np.abs(track.seen - track.states[:, :2]).max() < 6 * counts


def test_random_forces_have_their_size_and_memory() -> None:
    machine = MachineExtras(disturbance_n=40.0, disturbance_time_s=0.05, shake=1e-3)
    pushes, shakes = Process(machine, 2, 2e-3).draw(60_000)
    np.testing.assert_allclose(pushes.std(axis=0), 40.0, rtol=0.08)
    np.testing.assert_allclose(shakes.std(axis=0), 1e-3, rtol=0.08)
    lag = round(0.05 / 2e-3)
    for column in pushes.T:
        kept = np.mean(column[lag:] * column[:-lag]) / np.var(column)
        assert kept == pytest.approx(np.exp(-1.0), abs=0.06)
    assert not np.any(Process(MachineExtras(), 2, 2e-3).draw(10)[0])


def test_true_rates_leave_out_the_random_forces(robot: Robot) -> None:
    truth = plain_truth(robot, 11)
    q, qd = _path(300)
    plant = Plant(robot, truth, POSE)
    track = follow(plant, SERVO, q, qd, seed=1)
    quiet = Plant(robot, replace(truth, extras=Extras()), POSE)
    rates = true_rates(plant, track)
    for k in (10, 150, 299):
        quiet.state[:] = track.states[k, : quiet.state.size]
        wanted = quiet.rates(track.asked[k])
        np.testing.assert_allclose(rates[k, : quiet.state.size], wanted, rtol=1e-9, atol=1e-9)
    # This machine has neither mounts nor sprung loads nor hoses.
    np.testing.assert_array_equal(rates[:, quiet.state.size :], 0.0)


def test_wrong_number_of_extras_is_refused(robot: Robot) -> None:
    truth = replace(Truth.ideal(robot), extras=Extras((AxisExtras(seal=1e-4),)))
    with pytest.raises(BridgeError, match="expected extras of 2 cylinders, found 1"):
        Plant(robot, truth, POSE)
