"""The controller without ROS: stamps, paths, requests, and the loop closed around a plant."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hydro_control.core.core import Answer, ControllerCore, Sample
from hydro_control.errors import ControlError
from hydro_control.gains import Gains
from hydro_control.motion.trajectory import Waypoint
from hydro_model.errors import RobotError
from hydro_model.hydraulics.cylinder import lever, stroke
from hydro_model.hydraulics.valve import edge_flows
from hydro_model.motion.paths import JointPath, TipPath, load_path
from hydro_model.motion.paths_joints import joints_at_tip
from hydro_model.motion.paths_segments import Quintic
from hydro_model.multibody.kinematics import tip_position
from hydro_model.multibody.rigid_body import forward_dynamics, inverse_dynamics
from hydro_model.robot import EffectSpec, FloatArray, Robot
from hydro_model.robot_files import load_robot

DATASHEET = load_robot("xs031")
ROBOT = replace(
    DATASHEET,
    cylinders=tuple(replace(c, viscous_friction=30e3) for c in DATASHEET.cylinders),
)
POSE = np.array([0.6, -1.5])
STEP_NS = 2_000_000
EMPTY = np.array([])


def balance(robot: Robot, q: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Gauge pressures that hold a pose."""
    torque = inverse_dynamics(robot, q, 0 * q, 0 * q)
    p_b = np.full(2, 8e6)
    arms = [float(lever(c, x)) for c, x in zip(robot.cylinders, q, strict=True)]
    force = torque / np.array(arms)
    areas = np.array([(c.area_a_m2, c.area_b_m2) for c in robot.cylinders])
    return (force + p_b * areas[:, 1]) / areas[:, 0], p_b


def sample(cycle: int, q: FloatArray = POSE, *, supply: bool = True) -> Sample:
    p_a, p_b = balance(ROBOT, POSE)
    air = ROBOT.atmospheric_pressure_pa
    p_s = ROBOT.supply_pressure_pa + air if supply else None
    p_t = ROBOT.tank_pressure_pa + air if supply else None
    return Sample(10**18 + cycle * STEP_NS, q, p_a + air, p_b + air, p_s, p_t)


def answered(core: ControllerCore, cycle: int, q: FloatArray = POSE) -> Answer:
    answer = core.answer(sample(cycle, q))
    assert answer is not None
    return answer


def answered_up_to(core: ControllerCore, first: int, last: int) -> Answer:
    """Cycle by cycle: over a gap no motion goes on."""
    return [answered(core, k) for k in range(first, last + 1)][-1]


def test_one_answer_per_stamp() -> None:
    core = ControllerCore(ROBOT, Gains())
    first = answered(core, 5)
    assert core.answer(sample(5, POSE + 0.01)) is first
    assert core.answer(sample(4)) is None
    assert answered(core, 6) is not first
    answered(core, 9)
    counts = core.counts
    assert (counts.answered, counts.repeated, counts.old, counts.missed) == (3, 1, 1, 2)


def test_repeats_and_old_stamps_change_nothing_that_follows() -> None:
    noise = np.random.default_rng(3).normal(size=(30, 2)) * 1e-4

    def voltages(*, repeated: bool) -> bytes:
        core, out = ControllerCore(ROBOT, Gains()), []
        for k, e in enumerate(noise):
            out.append(answered(core, k, POSE + e).output.voltage_v)
            if repeated:
                core.answer(sample(k, POSE))
                core.answer(sample(k - 1, POSE))
        return np.array(out).tobytes()

    assert voltages(repeated=False) == voltages(repeated=True)


def test_topics_pressures_are_absolute() -> None:
    answer = answered(ControllerCore(ROBOT, Gains()), 0)
    np.testing.assert_allclose(answer.output.force_n, answer.output.required_force_n, rtol=1e-9)


def test_without_supply_and_tank_the_robots_constants_serve() -> None:
    moved = POSE - 0.01
    with_them, without = ControllerCore(ROBOT, Gains()), ControllerCore(ROBOT, Gains())
    for core in (with_them, without):
        core.answer(sample(0))
    a = with_them.answer(sample(1, moved))
    b = without.answer(sample(1, moved, supply=False))
    assert a is not None
    assert b is not None
    np.testing.assert_allclose(a.output.voltage_v, b.output.voltage_v, rtol=1e-9)


def test_plays_its_path_from_the_first_sample() -> None:
    path = JointPath((Quintic.at_rest([0.6], [0.8], 2.0),), joints=("lift",))
    core = ControllerCore(ROBOT, Gains(), path, start_delay_s=0.1)
    for k in range(100):
        answer = answered(core, k)
        expected = path.sample(k * 0.002 - 0.1)[0][0]
        np.testing.assert_allclose(answer.reference.position, [expected, -1.5], atol=1e-12)
    assert core.moving


def test_a_path_that_cannot_be_followed_is_refused_at_once() -> None:
    path = JointPath((Quintic.at_rest([0.6], [2.8], 9.0),), joints=("lift",))
    with pytest.raises(RobotError, match=r"'lift' goes to 2\.8"):
        ControllerCore(ROBOT, Gains(), path)


def test_a_path_that_starts_elsewhere_is_not_played() -> None:
    path = JointPath((Quintic.at_rest([1.2], [1.1], 2.0),), joints=("lift",))
    core = ControllerCore(ROBOT, Gains(), path)
    answer = answered(core, 0)
    np.testing.assert_array_equal(answer.reference.position, POSE)
    assert "path refused, holding: the path starts 0.600" in core.message
    assert core.counts.refused == 1


def test_requests_play_stop_and_are_refused() -> None:
    core = ControllerCore(ROBOT, Gains())
    there = [Waypoint(1.0, np.array([0.7]), EMPTY, EMPTY)]
    with pytest.raises(ControlError, match="no sample has come yet"):
        core.requests.trajectory("joint", ["lift"], there)
    answered(core, 0)
    with pytest.raises(ControlError, match=r"trajectory refused: .* should name lift, tilt"):
        core.requests.trajectory("joint", ["boom"], there)
    assert "trajectory refused" in core.message
    core.requests.trajectory("joint", ["lift"], there)
    assert core.message == ""
    before, _ = core.moving, answered(core, 1)
    assert (before, core.moving) == (False, True)
    moving = answered_up_to(core, 2, 251).reference
    assert moving.velocity[0] == pytest.approx(0.1875, rel=1e-3)
    with pytest.raises(ControlError, match="a motion is being played"):
        core.requests.trajectory("joint", ["lift"], there)
    core.requests.trajectory("joint", [], [])
    still = answered_up_to(core, 252, 600).reference
    assert still.velocity[0] == 0.0
    assert 0.65 < still.position[0] < 0.7


def test_a_start_time_is_kept_and_a_past_one_refused() -> None:
    core = ControllerCore(ROBOT, Gains())
    answered(core, 0)
    there = [Waypoint(1.0, np.array([0.7]), EMPTY, EMPTY)]
    with pytest.raises(ControlError, match=r"now or later, found 0\.200 s ago"):
        core.requests.trajectory("joint", ["lift"], there, sample(-100).stamp_ns)
    core.requests.trajectory("joint", ["lift"], there, sample(100).stamp_ns)
    np.testing.assert_array_equal(answered(core, 1).reference.position, POSE)
    np.testing.assert_array_equal(answered_up_to(core, 2, 100).reference.position, POSE)
    motion = Quintic.at_rest([0.6], [0.7], 1.0)
    for k in range(101, 200):
        expected = motion.sample((k - 100) * 0.002)[0][0]
        assert answered(core, k).reference.position[0] == pytest.approx(expected, abs=1e-12)
    assert answered_up_to(core, 200, 600).reference.position[0] == pytest.approx(0.7)


def test_not_a_number_first_starts_nothing() -> None:
    core = ControllerCore(ROBOT, Gains())
    for k in (0, 1, 2):
        bad = answered(core, k, np.array([np.nan, -1.5]))
        assert "joint position" in bad.output.fault
    good = answered(core, 3)
    np.testing.assert_array_equal(good.reference.position, POSE)
    assert not good.output.fault
    assert core.counts.faults == 3


def test_restart_forgets() -> None:
    core = ControllerCore(ROBOT, Gains())
    answered(core, 100)
    core.restart()
    assert core.last is None
    answer = answered(core, 0, POSE + 0.1)
    np.testing.assert_array_equal(answer.reference.position, POSE + 0.1)


class Plant:
    """The textbook plant: rigid links, viscous friction, stiff chambers; Heun, 8 steps a cycle."""

    def __init__(self, robot: Robot, q: FloatArray) -> None:
        self.robot = robot
        self.state = np.array([q, 0 * q, *balance(robot, q)])

    def _rate(self, state: FloatArray, u: FloatArray) -> FloatArray:
        q, qd, p_a, p_b = state
        torque, rate = np.empty(2), np.empty((2, 2))
        for i, (c, valve) in enumerate(zip(self.robot.cylinders, self.robot.valves, strict=True)):
            x, arm = float(stroke(c, q[i])), float(lever(c, q[i]))
            xd = arm * qd[i]
            force = p_a[i] * c.area_a_m2 - p_b[i] * c.area_b_m2 - c.viscous_friction * xd
            torque[i] = arm * force
            p_s, p_t = self.robot.supply_pressure_pa, self.robot.tank_pressure_pa
            q_a, q_b = edge_flows(valve, u[i], p_a[i], p_b[i], p_s, p_t)
            rate[0, i] = c.bulk_modulus_pa * (q_a - c.area_a_m2 * xd) / (c.area_a_m2 * x)
            room = c.area_b_m2 * (c.stroke_m - x)
            rate[1, i] = c.bulk_modulus_pa * (q_b + c.area_b_m2 * xd) / room
        return np.array([qd, forward_dynamics(self.robot, q, qd, torque), *rate])

    def advance(self, voltage_v: FloatArray) -> None:
        u, h = voltage_v / 10.0, 0.00025
        for _ in range(8):
            first = self._rate(self.state, u)
            second = self._rate(self.state + h * first, u)
            self.state = self.state + 0.5 * h * (first + second)

    def sample(self, cycle: int) -> Sample:
        q, _, p_a, p_b = self.state
        air = self.robot.atmospheric_pressure_pa
        stamp = 10**18 + cycle * STEP_NS
        return Sample(stamp, q.copy(), p_a + air, p_b + air, None, None)


def follow(
    path: TipPath, robot: Robot, cycles: int, *, model: Robot | None = None, delay: int = 0
) -> FloatArray:
    """Tip error of every cycle along a path, m; commands act `delay` cycles late."""
    q = joints_at_tip(robot, path.sample(0.0)[0])
    plant = Plant(robot, q)
    core = ControllerCore(robot if model is None else model, Gains(), path, 0.5)
    errors, under_way = [], [np.zeros(2)] * delay
    for k in range(cycles):
        answer = core.answer(plant.sample(k))
        assert answer is not None
        tip = tip_position(robot, plant.state[0])
        errors.append(np.linalg.norm(tip - answer.output.tip_d_m))
        under_way.append(answer.output.voltage_v)
        plant.advance(under_way.pop(0))
    return np.array(errors)


def parallelogram() -> TipPath:
    path = load_path("xs031/parallelogram")
    assert isinstance(path, TipPath)
    return path


def test_a_plant_that_equals_the_model_is_followed_to_a_tenth_of_a_millimetre() -> None:
    """The anchor: rho 0.0001 s, 0.04 mm on the paper's path (here its first side)."""
    assert follow(parallelogram(), ROBOT, 1600).max() < 1e-4


@pytest.mark.thorough
def test_one_cycle_of_delay_leaves_the_loop_stable() -> None:
    """On the second side too, where the load is greatest and an oscillation would build up."""
    assert follow(parallelogram(), ROBOT, 3200, delay=1).max() < 5e-4


def test_a_wrong_model_is_followed_worse_but_stably() -> None:
    heavy = replace(ROBOT, link_inertia=ROBOT.link_inertia * 1.2)
    errors = follow(parallelogram(), ROBOT, 1600, model=heavy, delay=1)
    assert 1e-4 < errors.max() < 0.05
    # It comes to rest, off by what the wrong weight leaves.
    assert np.ptp(errors[-100:]) < 5e-5


def test_what_a_listed_load_makes_too_heavy_is_refused() -> None:
    """The feed-forward knows the load; where no pressure can hold it the arm would sink."""
    out = Quintic.at_rest([0.6, -1.5], [0.6, -0.9], 6.0)
    path = JointPath((out,), joints=("lift", "tilt"))
    loaded = replace(ROBOT, effects=(EffectSpec("payload_change", ROBOT.name, {"mass": 500.0}),))
    ControllerCore(ROBOT, Gains(), path)
    with pytest.raises(RobotError, match="'lift_cylinder' would have to hold"):
        ControllerCore(loaded, Gains(), path)
    there = [Waypoint(6.0, np.array([-0.9]), EMPTY, EMPTY)]
    for robot, accepted in ((ROBOT, True), (loaded, False)):
        core = ControllerCore(robot, Gains())
        answered(core, 0)
        if accepted:
            core.requests.trajectory("joint", ["tilt"], there)
            continue
        with pytest.raises(ControlError, match="'lift_cylinder' would have to hold"):
            core.requests.trajectory("joint", ["tilt"], there)


@pytest.mark.parametrize(("apart_ns", "said"), [(1_000_000, "1 ms"), (3_000_000, "3 ms")])
def test_samples_at_another_rate_than_the_robot_files_are_at_0_v(apart_ns: int, said: str) -> None:
    """All that is computed by the sample would be wrong: velocities are half or more."""
    core = ControllerCore(ROBOT, Gains())
    first = sample(0)
    for k in range(52):
        answer = core.answer(replace(first, stamp_ns=first.stamp_ns + k * apart_ns))
        assert answer is not None
        # Fifty spacings are known once the 51st sample is answered.
        assert bool(answer.output.fault) is (k == 51)
    page = Path(__file__).parents[2] / "hydro_msgs_docs/safety_case.md"
    assert "are at 0 V from the 52nd on" in page.read_text(encoding="utf-8")
    assert answer.output.fault.startswith(f"samples are {said} apart, expected 2 ms (rate_hz")
    assert not answer.output.voltage_v.any()
    with pytest.raises(ControlError, match="the controller stopped: samples are"):
        core.requests.trajectory("joint", ["lift"], [Waypoint(1.0, np.array([0.7]), EMPTY, EMPTY)])
    core.restart()
    assert not answered(core, 1000).output.fault


def test_lost_and_late_samples_are_no_other_rate() -> None:
    core = ControllerCore(ROBOT, Gains())
    rng = np.random.default_rng(3)
    first, cycle = sample(0), 0
    for _ in range(60):
        cycle += int(rng.integers(1, 4))
        late_ns = int(rng.integers(0, 200_000))
        answer = core.answer(replace(first, stamp_ns=first.stamp_ns + cycle * STEP_NS + late_ns))
        assert answer is not None
        assert not answer.output.fault
