"""The device without its bus: determinism, parking, what the instruments report."""

from dataclasses import replace
from math import inf

import numpy as np
import pytest

from hydro_hw_bridge.errors import BridgeError
from hydro_hw_bridge.rig.core import Inputs, RigCore
from hydro_hw_bridge.rig.pose import tip_frame
from hydro_hw_bridge.rig.truth import Truth
from hydro_hw_bridge.rig.truth_files import load_truth
from hydro_model.robot import FloatArray, Robot


def _drive(core: RigCore, cycles: int) -> bytes:
    """Readings and true states of a run, as bytes."""
    out = []
    for k in range(cycles):
        measured = core.readings().measurement
        out.append(np.array([*measured.positions, *measured.pressures_pa, *measured.spools]))
        out.append(core.truth_row())
        core.actuate([2.0 * np.sin(0.02 * k), -2.0 * np.sin(0.02 * k)])
    return np.concatenate(out).tobytes()


def test_same_seed_same_bytes_and_another_seed_others(robot: Robot) -> None:
    truth = load_truth("realistic", robot)
    runs = [_drive(RigCore(robot, truth, seed=seed, q=[0.5, -1.5]), 200) for seed in (3, 3, 4)]
    assert runs[0] == runs[1]
    assert runs[0] != runs[2]


def test_noise_does_not_move_the_plant(robot: Robot) -> None:
    truth = load_truth("realistic", robot)
    cores = [RigCore(robot, truth, seed=seed, q=[0.5, -1.5]) for seed in (1, 2)]
    for core in cores:
        _drive(core, 50)
    np.testing.assert_array_equal(cores[0].truth_row(), cores[1].truth_row())


def test_readings_are_the_same_however_often_they_are_read(robot: Robot) -> None:
    core = RigCore(robot, load_truth("realistic", robot), seed=1)
    assert core.readings() == core.readings()
    core.actuate(None)
    assert core.readings().counter == 1


def test_parked_until_the_first_enabled_frame(robot: Robot) -> None:
    core = RigCore(robot, load_truth("realistic", robot), q=[0.5, -1.5])
    start = core.plant.state.copy()
    first = core.readings().measurement
    for frame in (None, [8.0, 8.0]):
        core.actuate(frame, enable=False)
        assert core.parked
        np.testing.assert_array_equal(core.plant.state, start)
    # Time and noise go on.
    assert core.readings().counter == 2
    assert core.readings().measurement != first
    core.actuate([0.0, 0.0], enable=True)
    assert not core.parked
    assert not np.array_equal(core.plant.state, start)


@pytest.mark.parametrize("off", ["emergency_stop_ok", "pump_on", "enable_switch"])
def test_any_permissive_keeps_it_parked(robot: Robot, off: str) -> None:
    core = RigCore(robot, load_truth("ideal", robot), inputs=replace(Inputs(), **{off: False}))
    core.actuate([5.0, 5.0], enable=True)
    assert core.parked
    assert not getattr(core.readings().inputs, off)
    core.set_inputs(**{off: True})
    core.actuate([5.0, 5.0], enable=True)
    assert not core.parked


def test_standing_without_pump_reads_open_air_and_biases(robot: Robot) -> None:
    truth = load_truth("realistic", robot)
    sensors = replace(truth.sensors, pressure_bias_pa={"supply": 40e3, "lift_cylinder/b": -25e3})
    core = RigCore(robot, replace(truth, sensors=sensors), inputs=Inputs(pump_on=False))
    rows = []
    for _ in range(400):
        rows.append(core.readings().measurement.pressures_pa)
        core.actuate(None)
    expected = [0.0, -25e3, 0.0, 0.0, 40e3, 0.0]
    np.testing.assert_allclose(np.mean(rows, axis=0), expected, atol=1e3)
    core.set_inputs(pump_on=True)
    core.actuate(None)
    assert core.readings().measurement.pressures_pa[4] > 15e6


def test_quantisation_and_noise_are_as_configured(robot: Robot) -> None:
    truth = load_truth("realistic", robot)
    core = RigCore(robot, truth, seed=5, q=[0.5, -1.5])
    positions, pressures = [], []
    for _ in range(2000):
        measured = core.readings().measurement
        positions.append(measured.encoder_counts)
        pressures.append(measured.pressures_pa)
        core.actuate(None)
    count = 2 * np.pi / (1 << 20)
    assert np.array(positions).dtype.kind == "i"
    # Rounding adds 1/12 of a squared count.
    spread = np.std(positions, axis=0)
    np.testing.assert_allclose(spread, np.sqrt(0.25 + 1 / 12), rtol=0.05)
    np.testing.assert_allclose(np.mean(positions, axis=0) * count, [0.5, -1.5], atol=count)
    np.testing.assert_array_equal(np.array(pressures) % 1000.0, 0.0)
    np.testing.assert_allclose(
        np.std(pressures, axis=0), np.hypot(4000.0, 1000.0 / np.sqrt(12)), rtol=0.08
    )


def test_encoder_offset_shifts_the_reading_alone(robot: Robot) -> None:
    truth = Truth.ideal(robot)
    sensors = replace(truth.sensors, encoder_offset={"tilt": 0.02})
    core = RigCore(robot, replace(truth, sensors=sensors), q=[0.5, -1.5])
    np.testing.assert_allclose(core.readings().measurement.positions, [0.5, -1.48], atol=1e-12)
    assert core.truth_row()[core.truth_names.index("position/tilt")] == -1.5


def test_stroke_sensor_reads_the_stroke(robot: Robot) -> None:
    sensed = replace(robot.cylinders[1], stroke_sensor=True)
    changed = replace(robot, cylinders=(robot.cylinders[0], sensed))
    core = RigCore(changed, load_truth("realistic", robot), q=[0.5, -1.5])
    (reading,) = core.readings().measurement.strokes_m
    assert reading == pytest.approx(core.plant.strokes()[1], abs=5e-6)


def test_positive_voltage_extends_and_raises(robot: Robot) -> None:
    core = RigCore(robot, load_truth("realistic", robot), q=[0.5, -1.5])
    before = core.plant.q.copy()
    for _ in range(250):
        core.actuate([2.0, 2.0])
    assert (core.plant.q > before + 0.01).all()


def test_truth_row_says_what_the_plant_does(robot: Robot) -> None:
    core = RigCore(robot, load_truth("realistic", robot), tip_m=[2.0, 0.0, -1.2])

    def picked(prefix: str) -> FloatArray:
        names = core.truth_names
        row = core.truth_row()
        return np.array([row[i] for i, n in enumerate(names) if n.startswith(prefix + "/")])

    np.testing.assert_allclose(picked("tip"), [2.0, 0.0, -1.2], atol=1e-9)
    core.actuate([3.0, -1.0])
    core.actuate([4.0, -2.0])
    # One cycle of delay: what was asked first is out now.
    np.testing.assert_array_equal(picked("voltage"), [3.0, -1.0])
    assert len(core.truth_names) == len(core.truth_row())
    assert core.truth_row()[1] == pytest.approx(0.004)


def test_counter_wraps(robot: Robot) -> None:
    core = RigCore(robot, Truth.ideal(robot), first_counter=(1 << 32) - 1)
    core.actuate(None)
    assert core.readings().counter == 0


@pytest.mark.parametrize(("lower", "upper", "begins"), [(-inf, inf, 0.0), (0.5, inf, None)])
def test_a_dry_joint_without_an_end_has_a_pose(
    robot: Robot, lower: float, upper: float, begins: float | None
) -> None:
    """A swing that turns as often as it likes, and carries no cylinder."""
    lift, tilt = robot.joints
    endless = replace(lift, lower=lower, upper=upper)
    dry = replace(
        robot, joints=(endless, tilt), cylinders=robot.cylinders[1:], valves=robot.valves[1:]
    )
    core = RigCore(dry, Truth.ideal(dry))
    begun = core.plant.state[0]
    assert begun == pytest.approx(0.5 * (lower + np.pi) if begins is None else begins)
    aim = np.array([1.2, -1.5])
    found = RigCore(dry, Truth.ideal(dry), tip_m=tip_frame(dry, aim)[0].tolist())
    np.testing.assert_allclose(found.plant.state[:2], aim, atol=1e-9)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"q": [0.5]}, "expected 2 joint positions"),
        ({"q": [0.5, 1.0]}, "expected 'tilt' within"),
        ({"tip_m": [9.0, 0.0, 0.0]}, "no pose within the joint limits"),
        ({"tip_m": [2.0, 1.0, 0.0]}, "no pose within the joint limits"),
    ],
)
def test_impossible_poses_are_refused(
    robot: Robot, arguments: dict[str, list[float]], message: str
) -> None:
    with pytest.raises(BridgeError, match=message):
        RigCore(robot, Truth.ideal(robot), q=arguments.get("q"), tip_m=arguments.get("tip_m"))
