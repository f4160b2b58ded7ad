"""A crane with a telescope: three joints, two coordinates of the tip that they can move."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from hydro_control.core.core import Answer, ControllerCore, Sample
from hydro_control.errors import ControlError
from hydro_control.gains import Gains
from hydro_control.motion.path_limits import refuse_beyond
from hydro_control.motion.posture import is_redundant, posture_at_tip
from hydro_control.motion.trajectory import Waypoint
from hydro_model.errors import RobotError
from hydro_model.hydraulics.cylinder import lever
from hydro_model.motion.paths import TipPath
from hydro_model.multibody.kinematics import tip_jacobian, tip_position
from hydro_model.robot import Cylinder, FloatArray, Joint, Robot, Valve
from hydro_model.robot_files import load_robot

CRANE = load_robot("xs031")
STEP_NS, DT_S = 2_000_000, 0.002
EMPTY = np.array([])
POSE = np.array([0.6, -1.5, 0.4])
#: Oil that leaks past the telescope's piston, as speed of the joint, m/s.
CREEP_M_S = 2e-3


def telescope() -> Robot:
    """The shipped crane with a boom of 60 kg that slides out of its second link."""
    joint = Joint(
        name="extension",
        parent_link="tilt_link",
        child_link="extension_link",
        prismatic=True,
        translation_m=np.array([2.106, 0.0, 0.0]),
        rotation=np.eye(3),
        axis=np.array([1.0, 0.0, 0.0]),
        lower=0.05,
        upper=0.95,
        velocity_limit=0.5,
        effort_limit=3e4,
    )
    cylinder = Cylinder(
        name="extension_cylinder",
        joint="extension",
        bore_m=0.050,
        rod_m=0.030,
        stroke_m=1.0,
        l1_m=0.0,
        l2_m=0.0,
        q0_rad=0.0,
        x0_m=0.0,
        child_pin_angle_rad=0.0,
        barrel=None,
        rod=None,
        bulk_modulus_pa=1.2e9,
    )
    body = [60.0, -30.0, 0.0, 0.0, 1.0, 0.0, 0.0, 20.0, 0.0, 20.0]
    valve = Valve("extension_valve", "extension_cylinder", 10.0, 4e-7, 4e-7, 4e-7, 4e-7)
    return replace(
        CRANE,
        name="telescope",
        joints=(*CRANE.joints, joint),
        link_inertia=np.vstack([CRANE.link_inertia, body]),
        tip_offset_m=np.zeros(3),
        cylinders=(*CRANE.cylinders, cylinder),
        valves=(*CRANE.valves, valve),
    )


ROBOT = telescope()
TIP = np.asarray(tip_position(ROBOT, POSE))
UP, UP_AND_OUT = np.array([0.0, 0.0, 0.1]), np.array([0.1, 0.0, 0.2])


class Leaking:
    """A machine that moves as it is asked to, but for a telescope that creeps out."""

    def __init__(
        self, path: TipPath | None = None, q: FloatArray = POSE, delay_s: float = 0.0
    ) -> None:
        self.core = ControllerCore(ROBOT, Gains(), path, delay_s)
        self.q, self.cycle = q.copy(), -1

    def run(self, seconds: float) -> Answer:
        for _ in range(round(seconds / DT_S)):
            answer = self._cycle()
        return answer

    def _cycle(self) -> Answer:
        self.cycle += 1
        air = ROBOT.atmospheric_pressure_pa
        rails = ROBOT.supply_pressure_pa + air, ROBOT.tank_pressure_pa + air
        chambers = np.full(3, 8e6 + air)
        stamp_ns = 10**18 + self.cycle * STEP_NS
        answer = self.core.answer(Sample(stamp_ns, self.q.copy(), chambers, chambers, *rails))
        assert answer is not None
        assert not answer.output.fault
        arms = [float(lever(c, x)) for c, x in zip(ROBOT.cylinders, self.q, strict=True)]
        speed = answer.output.required_piston_velocity_m_s / arms + [0.0, 0.0, CREEP_M_S]
        self.q = self.q + DT_S * speed
        return answer

    def go_to(self, place: FloatArray, seconds: float) -> None:
        point = Waypoint(seconds, place, EMPTY, EMPTY)
        self.core.requests.trajectory("tip", [ROBOT.tip_link], [point])


def test_it_is_redundant_and_the_crane_is_not() -> None:
    assert is_redundant(ROBOT, POSE)
    assert not is_redundant(CRANE, POSE[:2])


@pytest.mark.parametrize("stopped", [False, True])
def test_after_a_motion_of_the_tip_the_joints_do_not_creep_around_it(stopped: bool) -> None:
    """With the tip held alone, lift and tilt make way for the telescope until it is at its end."""
    machine = Leaking()
    machine.run(0.1)
    machine.go_to(TIP + UP_AND_OUT, 2.0)
    machine.run(1.2)
    assert machine.core.last is not None
    assert machine.core.last.reference.space == "tip"
    if stopped:
        machine.core.requests.trajectory("tip", [], [])
    end = machine.run(1.5).output.tip_d_m
    there = machine.q.copy()
    answer = machine.run(5.0)
    # Five seconds of the leak are 10 mm; k_p holds it within creep over gain, which is 0.1 mm.
    np.testing.assert_allclose(machine.q, there, atol=2e-4)
    np.testing.assert_allclose(answer.output.tip_d_m, end, atol=1e-9)
    if not stopped:
        np.testing.assert_allclose(end, TIP + UP_AND_OUT, atol=1e-9)


@pytest.mark.parametrize("away", [0.0, 0.02])
def test_while_a_path_waits_the_joints_do_not_creep_either(away: float) -> None:
    """Where the machine stands at its start, and where it has gone there first."""
    start = TIP + away * UP_AND_OUT
    path = TipPath.through([start.tolist(), (start + UP).tolist()], [2.0])
    machine = Leaking(path, delay_s=6.0)
    machine.run(1.0)
    there = machine.q.copy()
    assert machine.run(4.9).reference.space == "joint"
    np.testing.assert_allclose(machine.q, there, atol=2e-4)
    assert machine.core.moving
    assert machine.run(1.0).reference.space == "tip"
    np.testing.assert_allclose(machine.run(1.2).output.tip_d_m, start + UP, atol=1e-9)


def test_what_waits_with_its_joints_held_does_not_set_out_once_stopped() -> None:
    machine = Leaking()
    machine.run(0.1)
    point = Waypoint(1.0, TIP + UP, EMPTY, EMPTY)
    start_ns = 10**18 + (machine.cycle + 2500) * STEP_NS
    machine.core.requests.trajectory("tip", [ROBOT.tip_link], [point], start_ns)
    assert machine.run(4.0).reference.space == "joint"
    assert machine.core.moving
    machine.core.requests.stop()
    answer = machine.run(2.0)
    assert not machine.core.moving
    np.testing.assert_allclose(answer.output.tip_d_m, TIP, atol=1e-6)
    np.testing.assert_allclose(machine.q, POSE, atol=3e-4)


def test_from_holding_the_tip_to_holding_the_joints_nothing_leaps() -> None:
    machine = Leaking()
    machine.run(0.1)
    machine.go_to(TIP + UP_AND_OUT, 1.0)
    spaces, asked, tips = [], [], []
    for _ in range(750):
        answer = machine.run(DT_S)
        spaces.append(answer.reference.space)
        asked.append(answer.output.q_d)
        tips.append(answer.output.tip_d_m)
    change = len(spaces) - 1 - spaces[::-1].index("tip")
    assert spaces[change : change + 2] == ["tip", "joint"]
    steps = np.abs(np.diff(asked, axis=0))
    # A tenth of what the reference moves by in a sample on the way.
    assert np.all(steps[change] < 0.1 * steps[:change].max(axis=0))
    np.testing.assert_allclose(tips[change + 1], tips[change], atol=1e-6)


def test_the_next_motion_of_the_tip_begins_where_the_last_one_ended() -> None:
    machine = Leaking()
    machine.run(0.1)
    machine.go_to(TIP + UP, 1.0)
    machine.run(1.2)
    end = TIP + UP
    rows = [(0.0, end), (1.0, TIP)]
    points = [Waypoint(t, np.asarray(place), EMPTY, EMPTY) for t, place in rows]
    machine.core.requests.trajectory("tip", [ROBOT.tip_link], points)
    before = machine.run(DT_S).reference
    assert before.space == "tip"
    np.testing.assert_allclose(before.position, end, atol=1e-8)
    # Without an approach, of which there is nothing to be gone: back after a second.
    np.testing.assert_allclose(machine.run(1.0 + DT_S).output.tip_d_m, TIP, atol=1e-9)
    assert not machine.core.moving


def test_a_place_out_of_reach_is_held_near_and_no_joint_thrown_about() -> None:
    far = TIP + np.array([9.0, 0.0, 0.0])
    near = posture_at_tip(ROBOT, far, POSE)
    assert np.all(np.abs(near - POSE) <= 0.6)
    before, after = (np.linalg.norm(far - tip_position(ROBOT, q)) for q in (POSE, near))
    assert after < before
    place = TIP + 0.3 * UP_AND_OUT
    exact = posture_at_tip(ROBOT, place, POSE)
    np.testing.assert_allclose(tip_position(ROBOT, exact), place, atol=1e-9)
    # By as little motion of the joints as there is: none along those that leave the tip.
    null = np.linalg.svd(tip_jacobian(ROBOT, POSE))[2][2]
    assert abs(null @ (exact - POSE)) < 0.05 * np.linalg.norm(exact - POSE)


#: From here the crane's joints make way for the motion; in the posture found first the telescope
#: would have to go in beyond its end.
STEEP = np.array([1.35, -1.79, 0.6])
OUT = np.array([-0.33, 0.0, 0.27])


def tip_path(step: FloatArray, seconds: float) -> TipPath:
    place = np.asarray(tip_position(ROBOT, STEEP))
    return TipPath.through([place.tolist(), (place + step).tolist()], [seconds])


def test_a_tip_path_of_a_redundant_chain_is_judged_in_the_posture_it_stands_in() -> None:
    path = tip_path(OUT, 3.0)
    with pytest.raises(RobotError, match="joint 'extension' goes to"):
        refuse_beyond(ROBOT, path, 3.0)
    machine = Leaking(path, STEEP)
    assert machine.run(0.1).reference.space == "tip"
    assert machine.core.moving


@pytest.mark.parametrize(
    ("path", "expected"),
    [
        (tip_path(30.0 * OUT, 90.0), "cannot put its tip at"),
        (tip_path(OUT, 0.2), "the tip reaches"),
        (replace(tip_path(OUT, 3.0), tip_link="hook"), "the path is of 'hook'"),
    ],
)
def test_a_place_or_a_speed_in_no_posture_is_refused_at_once(path: TipPath, expected: str) -> None:
    with pytest.raises((ControlError, RobotError), match=expected):
        ControllerCore(ROBOT, Gains(), path)
