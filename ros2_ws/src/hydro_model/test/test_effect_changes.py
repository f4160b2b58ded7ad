"""Effects that make another robot: bodies, gravity, delay, and when they start."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from hydro_model.effects import resolve, with_changes
from hydro_model.multibody.kinematics import tip_jacobian
from hydro_model.multibody.rigid_body import inverse_dynamics, mass_matrix
from hydro_model.robot import CylinderPart, EffectSpec, Robot
from hydro_model.robot_files import load_robot
from hydro_model.simulation.simulate import Model, simulate

CRANE = load_robot("xs031")
Q = np.array([0.4, -1.1])
ZERO = np.zeros(2)


def listed(robot: Robot, *specs: tuple[str, str, dict[str, float]]) -> Robot:
    return replace(robot, effects=tuple(EffectSpec(*spec) for spec in specs))


def test_payload_weighs_at_the_tip_and_moves_with_it() -> None:
    robot = with_changes(listed(CRANE, ("payload_change", "xs031", {"mass": 80.0})))
    columns = tip_jacobian(CRANE, Q)
    weight = 80.0 * 9.81 * columns[2]
    held = inverse_dynamics(robot, Q, ZERO, ZERO) - inverse_dynamics(CRANE, Q, ZERO, ZERO)
    np.testing.assert_allclose(held, weight, rtol=1e-9)
    more = mass_matrix(robot, Q) - mass_matrix(CRANE, Q)
    np.testing.assert_allclose(more, 80.0 * columns.T @ columns, rtol=1e-9)
    assert robot.effects == ()
    assert with_changes(robot) is robot


def test_cylinder_bodies_are_those_of_a_description_that_has_them() -> None:
    bodies = ("cylinder_inertia", "lift_cylinder", {"barrel_mass": 20.0, "rod_mass": 12.0})
    bare = tuple(replace(c, barrel=None, rod=None) for c in CRANE.cylinders)
    x0 = CRANE.cylinders[0].x0_m
    full = [CylinderPart(mass, x0 / 2.0, mass * x0**2 / 12.0) for mass in (20.0, 12.0)]
    described = replace(CRANE, cylinders=(replace(bare[0], barrel=full[0], rod=full[1]), bare[1]))
    found = with_changes(listed(replace(CRANE, cylinders=bare), bodies))
    rates, pull = np.array([0.3, -0.2]), np.array([0.5, 0.4])
    np.testing.assert_allclose(
        inverse_dynamics(found, Q, rates, pull), inverse_dynamics(described, Q, rates, pull)
    )


def test_barrel_of_a_telescope_weighs_on_the_link_before_it() -> None:
    """Points at the joint's origin: of the boom, and of the tube that moves with the joint."""
    slide = replace(CRANE.joints[1], prismatic=True, lower=0.0, upper=1.0)
    seat = replace(CRANE.cylinders[1], l1_m=0.0, barrel=None, rod=None)
    robot = replace(CRANE, joints=(CRANE.joints[0], slide), cylinders=(CRANE.cylinders[0], seat))
    bodies = ("cylinder_inertia", "tilt_cylinder", {"barrel_mass": 20.0, "rod_mass": 12.0})
    found = with_changes(listed(robot, bodies))
    at = np.array([Q[0], 0.4])
    more = inverse_dynamics(found, at, ZERO, ZERO) - inverse_dynamics(robot, at, ZERO, ZERO)
    pulls = []
    for mass, along in ((20.0, 0.0), (12.0, at[1])):
        place = slide.translation_m + along * slide.rotation @ slide.axis
        point = replace(robot, tip_offset_m=np.zeros(3), joints=(robot.joints[0],))
        point = replace(point, link_inertia=robot.link_inertia[:1], cylinders=())
        columns = tip_jacobian(replace(point, tip_offset_m=place), at[:1])
        pulls.append(mass * 9.81 * float(columns[2, 0]))
    assert more[0] == pytest.approx(sum(pulls), rel=1e-9)


def test_tilt_turns_gravity_as_turning_the_first_joint_does() -> None:
    """The crane's joints turn about one axis: tilting it is an offset of the first angle."""
    robot = with_changes(listed(CRANE, ("base_tilt", "xs031", {"pitch": 0.02})))
    assert np.linalg.norm(robot.gravity_m_s2) == pytest.approx(9.81)
    assert robot.gravity_m_s2 @ [1.0, 0.0, 0.0] == pytest.approx(9.81 * np.sin(0.02))
    plain = replace(
        CRANE, cylinders=tuple(replace(c, barrel=None, rod=None) for c in CRANE.cylinders)
    )
    tilted = replace(plain, gravity_m_s2=robot.gravity_m_s2)
    held = inverse_dynamics(tilted, Q, ZERO, ZERO)
    shifts = np.array([[0.02, 0.0], [-0.02, 0.0]])
    turned = [inverse_dynamics(plain, Q + shift, ZERO, ZERO) for shift in shifts]
    assert min(np.abs(held - one).max() for one in turned) < 1e-6 * np.abs(held).max()


def test_command_delay_adds_to_the_robots(make_slider) -> None:
    times, volts = np.arange(101) * 0.002, np.zeros((101, 1))
    volts[20:60] = 3.0
    effects = {"command_delay": {"delay": 0.004}}
    ours = simulate(make_slider(command_delay_s=0.002, effects=effects), times, volts, [0.2])
    theirs = simulate(make_slider(command_delay_s=0.006), times, volts, [0.2])
    np.testing.assert_array_equal(ours.q, theirs.q)


@pytest.mark.parametrize("target", ["tilt_valve", "tilt_cylinder", "tilt"])
def test_a_late_valve_follows_its_commands_of_before(target: str) -> None:
    times, rng = np.arange(151) * 0.002, np.random.default_rng(2)
    volts = 2.0 * np.cumsum(rng.normal(size=(151, 2)), axis=0) / 12.0
    late = volts.copy()
    late[:, 1] = np.concatenate([np.full(3, volts[0, 1]), volts[:-3, 1]])
    robot = listed(CRANE, ("command_delay", target, {"delay": 0.006}))
    ours = simulate(robot, times, volts, [0.5, -1.0])
    theirs = simulate(CRANE, times, late, [0.5, -1.0])
    np.testing.assert_allclose(ours.q, theirs.q, rtol=0.0, atol=1e-12)
    assert np.abs(ours.q - simulate(CRANE, times, volts, [0.5, -1.0]).q).max() > 1e-6


def test_a_valve_late_by_a_part_of_a_sample_has_its_commands_mean() -> None:
    """What came through by then is the same as where the delay is all valves' and exact."""
    times, volts = np.arange(101) * 0.002, np.zeros((101, 2))
    volts[20:60, 0] = 3.0
    part = listed(CRANE, ("command_delay", "lift_valve", {"delay": 0.003}))
    exact = replace(CRANE, command_delay_s=CRANE.command_delay_s + 0.003)
    start = [0.5, -1.0]
    ours, theirs = (simulate(robot, times, volts, start) for robot in (part, exact))
    plain = simulate(CRANE, times, volts, start)
    moved = np.abs(plain.q[-1, 0] - start[0])
    assert abs(ours.q[-1, 0] - theirs.q[-1, 0]) < 2e-3 * moved
    assert np.abs(plain.q[:, 0] - theirs.q[:, 0]).max() > 2e-2 * moved


def test_payload_is_taken_up_at_its_time(make_slider) -> None:
    """A constant force: the acceleration falls when the mass grows."""
    robot = replace(make_slider(), cylinders=(), valves=())
    load = ("payload_change", "slider", {"mass": 250.0, "start_s": 10.4})
    times = 10.0 + np.arange(501) * 0.002
    out = simulate(
        listed(robot, load), times, np.zeros((501, 0)), [0.1], torque=np.full((501, 1), 500.0)
    )
    before, after = times <= 10.4, times >= 10.4
    np.testing.assert_allclose(out.qd[before, 0], 0.5 * (times[before] - 10.0), atol=1e-9)
    np.testing.assert_allclose(out.qd[after, 0], 0.2 + 0.4 * (times[after] - 10.4), atol=2e-3)
    assert np.diff(out.qd[-2:, 0]) == pytest.approx(0.4 * 0.002)


def test_changes_before_during_and_after_a_roll_out(make_slider) -> None:
    times, volts = np.arange(101) * 0.002, np.full((101, 1), 2.0)
    plain = make_slider(viscous_friction=2e4)

    def end(*starts: float) -> float:
        specs = [("payload_change", "slider", {"mass": 400.0, "start_s": s}) for s in starts]
        return float(simulate(listed(plain, *specs), times, volts, [0.2]).q[-1, 0])

    assert end(5.0) == end()
    heavy = replace(plain, link_inertia=plain.link_inertia + np.eye(1, 10) * 400.0)
    assert end(-1.0) == pytest.approx(simulate(heavy, times, volts, [0.2]).q[-1, 0], abs=1e-12)
    assert len({end(), end(0.05), end(0.1), end(0.05, 0.1), end(-1.0)}) == 5


def test_a_load_that_is_let_go_is_two_changes(make_slider) -> None:
    """Taken up and let go: as a load of the same size and one of minus that from then on."""
    times, volts = np.arange(201) * 0.002, np.full((201, 1), 2.0)
    plain = make_slider(viscous_friction=2e4)

    def run(*loads: dict[str, float]) -> np.ndarray:
        listing = [("payload_change", "slider", {"mass": 400.0, **load}) for load in loads]
        return simulate(listed(plain, *listing), times, volts, [0.2]).q[:, 0]

    let_go = run({"start_s": 0.1, "end_s": 0.2})
    np.testing.assert_array_equal(let_go, run({"start_s": 0.1}, {"start_s": 0.2, "mass": -400.0}))
    assert np.abs(let_go - run({"start_s": 0.1})).max() > 1e-6
    np.testing.assert_array_equal(run({"end_s": -1.0}), run({"start_s": 5.0}))
    assert np.abs(run({"end_s": 0.1}) - run({"start_s": 5.0})).max() > 1e-6


def test_later_changes_stay_listed_until_their_time() -> None:
    robot = listed(
        CRANE,
        ("payload_change", "xs031", {"mass": 80.0, "start_s": 5.0}),
        ("base_tilt", "xs031", {"pitch": 0.01}),
        ("coulomb_friction", "lift", {"force": 1e3}),
    )
    now = with_changes(robot, 1.0)
    assert [spec.name for spec in now.effects] == ["payload_change", "coulomb_friction"]
    np.testing.assert_array_equal(now.link_inertia, robot.link_inertia)
    later = with_changes(now, 5.0)
    assert [spec.name for spec in later.effects] == ["coulomb_friction"]
    assert later.link_inertia[1, 0] == pytest.approx(robot.link_inertia[1, 0] + 80.0)


def test_the_flexible_share_leaves_the_link_for_its_law_only() -> None:
    mode = ("structural_flexibility", "tilt_cylinder", {"inertia": 50.0, "frequency": 6.0})
    robot = listed(CRANE, mode)
    assert with_changes(robot) is robot
    model = Model(robot)
    less = mass_matrix(robot, Q) - mass_matrix(model.robot, Q)
    # What its own joint's acceleration meets; how other joints move the link stays.
    np.testing.assert_allclose(less, np.diag([0.0, 50.0]), atol=1e-9)
    assert resolve(model.robot)[0].effect.name == "structural_flexibility"
    held = inverse_dynamics(model.robot, Q, ZERO, ZERO)
    np.testing.assert_allclose(held, inverse_dynamics(CRANE, Q, ZERO, ZERO))


def test_contact_pushes_as_the_tips_jacobian_says() -> None:
    """Accelerations with and without ground differ by M^-1 J^T F."""
    ground = ("external_contact", "xs031", {"stiffness": 2e5, "height": 10.0})
    from hydro_model.multibody.kinematics import tip_position

    force = 2e5 * (10.0 - tip_position(CRANE, Q)[2])
    state = np.concatenate([Q, ZERO, [8e6, 5e6, 4e6, 6e6]])
    rates = []
    for robot in (CRANE, listed(CRANE, ground)):
        model = Model(robot)
        rates.append(model.rates(0.0, state, model.inputs([0.0, 0.0], 19e6, 1e6))[2:4])
    pushed = np.linalg.solve(mass_matrix(CRANE, Q), tip_jacobian(CRANE, Q)[2] * force)
    np.testing.assert_allclose(rates[1] - rates[0], pushed, rtol=1e-9)
