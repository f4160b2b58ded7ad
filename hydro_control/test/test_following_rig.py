"""Arms that run against something, on the rig's truth plant, and what is slow and no such arm."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import pytest

from hydro_control.core.core import ControllerCore, Sample
from hydro_control.gains import Gains
from hydro_control.monitoring.following_error import FollowingLimits
from hydro_control.motion.trajectory import Waypoint
from hydro_hw_bridge.rig.core import RigCore
from hydro_hw_bridge.rig.extras import Extras, MachineExtras
from hydro_hw_bridge.rig.payload import Payload
from hydro_hw_bridge.rig.random_truth import random_truth
from hydro_hw_bridge.rig.truth import Truth
from hydro_hw_bridge.rig.truth_files import load_truth
from hydro_model.motion.paths import TipPath, load_path
from hydro_model.multibody.kinematics import tip_position
from hydro_model.robot import FloatArray
from hydro_model.robot_files import load_robot

ROBOT = load_robot("xs031")
TRUTH = load_truth("realistic", ROBOT)
NONE = np.empty(0)
START = (0.6, -1.5)
#: From the error's limit on an arm is believed to follow for so long.
TIME_S = FollowingLimits().time_s


@dataclass
class Driven:
    """Rig and controller, cycle by cycle."""

    core: ControllerCore
    rig: RigCore
    #: Joint, and the position that it cannot pass on its way up: rigid, and it does not pull.
    wall: tuple[int, float] | None = None
    #: Valve, and the voltage at which its spool is stuck.
    stuck: tuple[int, float] | None = None
    q: list[FloatArray] = field(default_factory=list)
    behind: list[FloatArray] = field(default_factory=list)
    faults: list[str] = field(default_factory=list)
    dropped: list[int] = field(default_factory=list)

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds / self.rig.cycle_s)):
            self._cycle()

    def _cycle(self) -> None:
        read = self.rig.readings().measurement
        pressure = np.array(read.pressures_pa) + ROBOT.atmospheric_pressure_pa
        chambers, lines = pressure[:4].reshape(2, 2), pressure[4:6].tolist()
        stamp_ns, q = 10**18 + len(self.q) * 2_000_000, np.array(read.positions)
        answer = self.core.answer(Sample(stamp_ns, q, chambers[:, 0], chambers[:, 1], *lines))
        assert answer is not None
        voltage_v = answer.output.voltage_v.copy()
        self.core.applied(stamp_ns, voltage_v)
        if self.stuck is not None:
            voltage_v[self.stuck[0]] = self.stuck[1]
        self.rig.actuate(voltage_v.tolist())
        plant = self.rig.plant
        if self.wall is not None and plant.q[self.wall[0]] > self.wall[1]:
            plant.q[self.wall[0]] = self.wall[1]
            plant.qd[self.wall[0]] = min(plant.qd[self.wall[0]], 0.0)
        self.q.append(plant.q.copy())
        self.behind.append(np.abs(answer.output.q_d - q))
        self.faults.append(answer.output.fault)
        self.dropped.append(self.core.counts.not_followed)

    def go(self, to: Sequence[float], seconds: float) -> None:
        point = Waypoint(seconds, np.array(to), NONE, NONE)
        self.core.requests.trajectory("joint", ROBOT.joint_names, [point])

    def force_n(self, cylinder: int) -> float:
        c, plant = ROBOT.cylinders[cylinder], self.rig.plant
        oil = plant.pressures_a * c.area_a_m2 - plant.pressures_b * c.area_b_m2
        return float(oil[cylinder])


def driven(
    start: Sequence[float] = START,
    *,
    truth: Truth = TRUTH,
    payloads: Sequence[Payload] = (),
    following: FollowingLimits | None = None,
) -> Driven:
    rig = RigCore(ROBOT, truth, seed=1, q=start, payloads=payloads)
    return Driven(ControllerCore(ROBOT, Gains(), following=following or FollowingLimits()), rig)


def against_a_tree(following: FollowingLimits | None = None) -> Driven:
    """Its tilt meets something 0.1 rad on its way, and there it has been for four seconds."""
    one = driven(following=following)
    one.wall = (1, -1.4)
    one.run(0.2)
    one.go((0.6, -1.0), 3.0)
    one.run(4.0)
    return one


def test_an_arm_that_runs_against_something_is_held_there_and_does_not_press_on() -> None:
    pressing, held = against_a_tree(FollowingLimits(time_s=60.0)), against_a_tree()
    assert pressing.core.counts.not_followed == 0
    assert held.core.counts.not_followed == 1
    assert not any(held.faults)
    assert held.core.message.startswith("holding: the motion was dropped, as joint 'tilt' is 0.26")
    assert "it runs against something, or lacks the force" in held.core.message
    first = next(k for k, far in enumerate(held.behind) if far[1] > 0.05 * 2.25)
    assert held.dropped.index(1) == first + round(TIME_S / held.rig.cycle_s)
    assert held.behind[-1].max() < 5e-3
    assert held.force_n(1) < 0.5 * pressing.force_n(1)
    # The tree gives way.
    for one, least, most in ((pressing, 0.3, 0.5), (held, 0.0, 1e-3)):
        one.wall, stood = None, one.q[-1]
        one.run(1.0)
        assert least <= abs(one.q[-1] - stood).max() < most
    # And the arm is driven on as before.
    held.go((0.6, -1.7), 3.0)
    held.run(4.0)
    assert abs(held.q[-1] - [0.6, -1.7]).max() < 5e-3
    assert held.core.counts.not_followed == 1
    assert held.core.message == ""


def test_a_tip_that_is_lowered_onto_the_ground_is_held_there() -> None:
    tip = np.asarray(tip_position(ROBOT, np.array(START)))
    ground = MachineExtras(contact_stiffness=1e7, contact_height=float(tip[2]) - 0.1)
    one = driven(truth=replace(TRUTH, extras=Extras(machine=ground)))
    one.run(0.2)
    down = Waypoint(4.0, tip - [0.0, 0.0, 0.6], NONE, NONE)
    one.core.requests.trajectory("tip", [ROBOT.tip_link], [down])
    one.run(5.0)
    assert one.core.counts.not_followed == 1
    assert not any(one.faults)
    assert one.behind[-1].max() < 5e-3
    stands = np.asarray(tip_position(ROBOT, one.q[-1]))
    assert 0.0 < ground.contact_height - stands[2] < 0.01
    assert np.ptp(np.array(one.q[-250:]), axis=0).max() < 1e-3


def weak(*, pressure: float = 1.0, droop: float = 1.0) -> Truth:
    """A supply with so much of its pressure, which sinks so much more under flow."""
    s = TRUTH.supply
    return replace(
        TRUTH,
        supply=replace(s, pressure_pa=pressure * s.pressure_pa, droop=droop * s.droop),
    )


@pytest.mark.parametrize("truth", [weak(pressure=0.6), weak(droop=30.0)], ids=["low", "drooping"])
def test_a_pump_that_cannot_do_more_is_behind_by_far_and_no_fault(truth: Truth) -> None:
    one = driven((0.4, -1.9), truth=truth)
    one.run(0.2)
    one.go((1.2, -1.1), 2.6)
    one.run(8.0)
    assert np.max(one.behind) > 0.25
    assert np.sum(np.array(one.behind)[:, 0] > 0.0875) * one.rig.cycle_s > 2.0 * TIME_S
    assert one.core.counts.not_followed == 0
    assert not any(one.faults)
    assert abs(one.q[-1] - [1.2, -1.1]).max() < 0.02  # it has come


def test_a_pump_that_cannot_lift_the_arm_is_named_and_the_arm_held() -> None:
    one = driven((0.4, -1.9), truth=weak(pressure=0.4))
    one.run(0.2)
    one.go((1.2, -1.1), 2.6)
    one.run(8.0)
    assert one.core.counts.not_followed == 1
    assert "joint 'lift' is 0.3" in one.core.message
    assert not any(one.faults)
    after = np.array(one.q[one.dropped.index(1) + 250 :])
    assert np.ptp(after, axis=0).max() < 0.01


@pytest.mark.thorough
def test_a_machine_far_from_its_model_that_comes_after_is_followed_on() -> None:
    """That of this seed has hardly the force for the path, by a model that knows none of it."""
    path = load_path("xs031/parallelogram")
    assert isinstance(path, TipPath)
    rig = RigCore(ROBOT, random_truth(ROBOT, 102), seed=1, tip_m=path.sample(0.0)[0].tolist())
    one = Driven(ControllerCore(ROBOT, Gains(), path), rig)
    one.run(path.duration_s + 2.0)
    assert np.max(one.behind) > 0.1
    assert one.core.counts.not_followed == 0
    assert not any(one.faults)


@pytest.mark.thorough
def test_a_load_that_nobody_told_is_taken_up_and_set_down_without_a_word() -> None:
    loads = [Payload(400.0, 1.0), Payload(0.0, 6.0)]
    one = driven((0.9, -1.3), payloads=loads)
    one.run(2.2)
    one.go((0.7, -1.0), 3.0)
    one.run(5.0)
    assert np.max(one.behind) < 0.01  # a ninth of what would be looked at
    assert one.core.counts.not_followed == 0
    assert not any(one.faults)


def test_an_arm_that_does_not_stay_where_it_is_held_is_at_0_v_and_said_so() -> None:
    """A spool is stuck: what is commanded has no say in it."""
    one = driven()
    one.run(0.5)
    one.stuck = (1, -1.0)
    one.run(3.0)
    said = {fault for fault in one.faults if fault}
    assert len(said) == 1
    assert "joint 'tilt' is 0." in (fault := said.pop())
    assert "came nearer by -0." in fault
    assert "latched" in fault
    assert one.core.counts.not_followed == 0
