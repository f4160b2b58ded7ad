"""Barrels and rods against pinocchio with constraints, geometry, energy and the readable twin."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pinocchio
import pytest
from scipy.integrate import solve_ivp

from hydro_model.errors import RobotError
from hydro_model.hydraulics.cylinder import stroke
from hydro_model.multibody import rigid_body, rigid_body_reference
from hydro_model.multibody.base_parameters import base_map
from hydro_model.multibody.closed_chain import part_places, pins, with_parameters
from hydro_model.multibody.spatial import axis_rotation
from hydro_model.robot import Cylinder, CylinderPart, FloatArray, Robot
from hydro_model.robot_files import load_robot

MakeChain = Callable[..., Robot]
CHAINS = [(seed, dof) for dof in range(1, 6) for seed in (0, 1)]


def with_cylinders(robot: Robot, seed: int) -> Robot:
    """A heavy cylinder on a random triangle at every joint that turns."""
    rng = np.random.default_rng([11, seed])
    cylinders = []
    for i, joint in enumerate(robot.joints):
        if joint.prismatic:
            continue
        l1, l2 = rng.uniform(0.8, 1.4), rng.uniform(0.2, 0.6)
        parts = [CylinderPart(*rng.uniform([5.0, 0.2, 0.3], [60.0, 0.5, 4.0])) for _ in range(2)]
        sizes = (f"c{i}", joint.name, 0.08, 0.045, 5.0, l1, l2, *rng.uniform(-3.0, 3.0, 3), *parts)
        cylinders.append(Cylinder(*sizes, 1.2e9))
    return replace(robot, cylinders=tuple(cylinders))


@pytest.fixture(params=CHAINS, ids=str)
def robot(request: pytest.FixtureRequest, make_chain: MakeChain) -> Robot:
    seed, dof = request.param
    return with_cylinders(make_chain(seed, dof), seed)


def motion(robot: Robot, count: int = 4) -> list[FloatArray]:
    rng = np.random.default_rng(robot.dof)
    return list(rng.uniform(-2.0, 2.0, size=(4, count, robot.dof)))


def close(found: FloatArray, wanted: FloatArray, share: float = 1e-11) -> bool:
    return bool(np.allclose(found, wanted, rtol=0.0, atol=share * (1.0 + np.abs(wanted).max())))


def pin_points(robot: Robot, q: FloatArray) -> list[tuple[FloatArray, FloatArray]]:
    """Parent and child pin of every cylinder in the base frame, by the joints' placements."""
    frames = [(np.eye(3), np.zeros(3))]
    for joint, angle in zip(robot.joints, q, strict=True):
        turn, origin = frames[-1]
        rotation, shift = joint.rotation, joint.translation_m
        if joint.prismatic:
            shift = shift + angle * joint.rotation @ joint.axis
        else:
            rotation = rotation @ axis_rotation(joint.axis, np.asarray(angle))
        frames.append((turn @ rotation, origin + turn @ shift))
    points = []
    places = part_places(robot)
    for barrel, rod in zip(places[::2], places[1::2], strict=True):
        (a, b), (c, d) = frames[barrel.host + 1], frames[rod.host + 1]
        points.append((b + a @ barrel.pin_m, d + c @ rod.pin_m))
    return points


def test_pins_are_as_far_apart_as_the_stroke_says(robot: Robot) -> None:
    for q in motion(robot)[0]:
        for cylinder, (parent, child) in zip(robot.cylinders, pin_points(robot, q), strict=True):
            x = stroke(cylinder, q[robot.joint_index(cylinder.joint)])
            assert np.linalg.norm(child - parent) == pytest.approx(x + cylinder.x0_m, abs=1e-12)


def test_child_pin_of_the_crane_stands_where_its_file_says() -> None:
    robot = load_robot("xs031")
    for cylinder, joint in zip(robot.cylinders, robot.joints, strict=True):
        _, child = pins(cylinder, joint)
        angle = cylinder.child_pin_angle_rad
        # From the x axis towards +Z, as the file's comment says: the joint turns about -Y.
        assert np.allclose(child, [np.cos(angle), 0.0, np.sin(angle)], atol=1e-12)


@pytest.mark.parametrize("off", [1e-9, 1e-6, 1e-4, 5e-3])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_an_axis_that_is_x_but_for_its_last_digits_turns_about_x(off: float, sign: float) -> None:
    """Whatever of x is left across it would point anywhere."""
    robot = load_robot("xs031")
    joint, cylinder = robot.joints[0], robot.cylinders[0]
    exact = pins(cylinder, replace(joint, axis=np.array([sign, 0.0, 0.0])))
    for aside in ([0.0, off], [off, 0.0], [-off, off]):
        axis = np.array([sign, *aside])
        near = pins(cylinder, replace(joint, axis=axis / np.linalg.norm(axis)))
        np.testing.assert_allclose(near, exact, atol=2.0 * off)


def test_energy_is_that_of_points_on_the_lines(robot: Robot) -> None:
    """Barrel and rod as two points each, with the same mass, first moment and inertia."""
    bare = replace(robot, cylinders=())
    q, qd = motion(robot)[0][0], motion(robot)[1][0]

    def points(at: FloatArray) -> list[tuple[float, FloatArray]]:
        found = []
        for c, (parent, child) in zip(robot.cylinders, pin_points(robot, at), strict=True):
            e = (child - parent) / np.linalg.norm(child - parent)
            for part, pin, line in ((c.barrel, parent, e), (c.rod, child, -e)):
                assert part is not None
                arm = np.sqrt(part.inertia_com_kg_m2 / part.mass_kg)
                for s in (part.com_from_pin_m - arm, part.com_from_pin_m + arm):
                    found.append((0.5 * part.mass_kg, pin + s * line))
        return found

    step = 1e-6
    after, before, now = points(q + step * qd), points(q - step * qd), points(q)
    kinetic = sum(
        0.5 * m * float(np.sum(((b - a) / (2.0 * step)) ** 2))
        for (m, b), (_, a) in zip(after, before, strict=True)
    )
    potential = -sum(m * float(robot.gravity_m_s2 @ x) for m, x in now)
    extra = rigid_body.kinetic_energy(robot, q, qd) - rigid_body.kinetic_energy(bare, q, qd)
    height = rigid_body.potential_energy(robot, q) - rigid_body.potential_energy(bare, q)
    assert float(extra) == pytest.approx(kinetic, rel=1e-7, abs=1e-6)
    assert float(height) == pytest.approx(potential, rel=1e-10, abs=1e-9)


def constrained(robot: Robot) -> pinocchio.Model:
    """The chain in pinocchio, with barrels and rods on joints of their own."""
    model = pinocchio.Model()
    model.gravity.linear = robot.gravity_m_s2
    order = [0, 1, 2, 3, 4, 5, 7, 6, 8, 9]
    revolute, slide = pinocchio.JointModelRevoluteUnaligned, pinocchio.JointModelPrismaticUnaligned

    def add(parent: int, kind: object, place: pinocchio.SE3, name: str, body: FloatArray) -> int:
        at = int(model.addJoint(parent, kind, place, name))
        inertia = pinocchio.Inertia.FromDynamicParameters(body[order])
        model.appendBodyToJoint(at, inertia, pinocchio.SE3.Identity())
        return at

    def add_parts(host: int, parent: int) -> None:
        for k, place in enumerate(part_places(robot)):
            if place.host != host:
                continue
            m, h, inertia = robot.part_parameters[k]
            body = np.array([m, h, 0.0, 0.0, 0.0, 0.0, 0.0, inertia, 0.0, inertia])
            across = np.cross(place.axis, place.towards)
            frame = np.stack([place.towards, across, place.axis], axis=1)
            at = pinocchio.SE3(frame, place.pin_m)
            add(parent, revolute(np.array([0.0, 0.0, 1.0])), at, f"part{k}", body)

    # Depth first: pinocchio takes the joints of a subtree to be numbered in a row.
    parent = 0
    add_parts(-1, parent)
    for i, joint in enumerate(robot.joints):
        kind = slide if joint.prismatic else revolute
        place = pinocchio.SE3(joint.rotation, joint.translation_m)
        parent = add(parent, kind(joint.axis), place, joint.name, robot.link_inertia[i])
        add_parts(i, parent)
    return model


def dependent(robot: Robot, q: FloatArray) -> FloatArray:
    """Angles of all parts from the directions between their pins."""
    angles = []
    for place in part_places(robot):
        a = q[place.joint] + place.angle_rad
        tip = place.other_m * np.exp(1j * a) - place.own_m
        angles.append(np.angle(tip))
    return np.array(angles)


def test_pinocchio_with_constraints_agrees(robot: Robot) -> None:
    """Free bodies' torques projected on the motions that the triangles allow, tau = G^T tau_f."""
    model = constrained(robot)
    data = model.createData()
    names = [*robot.joint_names, *(f"part{k}" for k in range(len(part_places(robot))))]
    order = np.array([model.joints[model.getJointId(name)].idx_v for name in names])
    q, qd, qdd, _ = (one[0] for one in motion(robot))
    step = 1e-4

    def slope(at: FloatArray) -> FloatArray:
        """d(angle of part)/dq by central differences of fourth order, (parts, n)."""
        columns = []
        for unit in np.eye(robot.dof) * step:
            fine = dependent(robot, at + unit) - dependent(robot, at - unit)
            wide = dependent(robot, at + 2 * unit) - dependent(robot, at - 2 * unit)
            fine, wide = np.angle(np.exp(1j * fine)), np.angle(np.exp(1j * wide))
            columns.append((8.0 * fine - wide) / (12.0 * step))
        return np.array(columns).T.reshape(-1, robot.dof)

    follow = np.vstack([np.eye(robot.dof), slope(q)])
    drift = (slope(q + step * qd) - slope(q - step * qd)) @ qd / (2.0 * step)
    full = np.concatenate([q, dependent(robot, q)])
    speeds = follow @ qd
    rates = follow @ qdd + np.concatenate([np.zeros(robot.dof), drift])
    packed = [np.empty_like(full) for _ in range(3)]
    for target, source in zip(packed, (full, speeds, rates), strict=True):
        target[order] = source
    torque = follow.T @ pinocchio.rnea(model, data, *packed)[order]
    assert close(rigid_body.inverse_dynamics(robot, q, qd, qdd), torque, 1e-6)
    mass = pinocchio.crba(model, data, packed[0])
    mass = (np.triu(mass) + np.triu(mass, 1).T)[np.ix_(order, order)]
    assert close(rigid_body.mass_matrix(robot, q), follow.T @ mass @ follow, 1e-9)


def test_compiled_equals_reference(robot: Robot) -> None:
    q, qd, qdd, other = motion(robot)
    for name, arguments in (
        ("inverse_dynamics", (q, qd, qdd)),
        ("required_torque", (q, qd, qd + 0.3 * other, qdd, 70.0)),
        ("regressor", (q, qd, qdd)),
        ("mass_matrix", (q,)),
    ):
        readable = getattr(rigid_body_reference, name)(robot, *arguments)
        assert close(getattr(rigid_body, name)(robot, *arguments), readable), name


def test_regressor_and_mass_matrix_are_the_inverse_dynamics(robot: Robot) -> None:
    q, qd, qdd, _ = motion(robot)
    torque = rigid_body.inverse_dynamics(robot, q, qd, qdd)
    assert close(rigid_body.regressor(robot, q, qd, qdd) @ robot.parameter_vector, torque)
    bias = rigid_body.inverse_dynamics(robot, q, qd, 0.0 * qd)
    mass = rigid_body.mass_matrix(robot, q)
    assert close(np.einsum("nij,nj->ni", mass, qdd) + bias, torque)
    assert np.linalg.eigvalsh(mass).min() > 0.0
    assert close(rigid_body.forward_dynamics(robot, q, qd, torque), qdd, 1e-8)


def test_power_of_the_required_torque_has_no_feedback_on_parts(robot: Robot) -> None:
    """(qd_r - qd)^T (tau_r - tau) is the rate of the error's energy, k_v on the links alone."""
    q, qd, qdd, other = (one[0] for one in motion(robot))
    qd_r, k_v, step = qd + 0.2 * other, 40.0, 1e-6
    qdd_r = qdd[::-1].copy()
    bare = replace(robot, cylinders=())

    def power(model: Robot, gain: float) -> float:
        required = rigid_body.required_torque(model, q, qd, qd_r, qdd_r, gain)
        return float((qd_r - qd) @ (required - rigid_body.inverse_dynamics(model, q, qd, qdd)))

    def energy(t: float) -> float:
        error = qd_r - qd + t * (qdd_r - qdd)
        at = q + t * qd + 0.5 * t * t * qdd
        return 0.5 * float(error @ rigid_body.mass_matrix(robot, at) @ error)

    rate = (energy(step) - energy(-step)) / (2.0 * step)
    assert power(robot, 0.0) == pytest.approx(rate, rel=1e-6, abs=1e-6)
    feedback = power(bare, k_v) - power(bare, 0.0)
    assert power(robot, k_v) - power(robot, 0.0) == pytest.approx(feedback, rel=1e-9)


def test_a_free_crane_keeps_its_energy() -> None:
    robot = load_robot("xs031")
    robot = replace(
        robot,
        cylinders=tuple(
            replace(c, barrel=CylinderPart(300.0, 0.4, 30.0), rod=CylinderPart(200.0, 0.3, 20.0))
            for c in robot.cylinders
        ),
    )

    def rates(_: float, y: FloatArray) -> FloatArray:
        acceleration = rigid_body.forward_dynamics(robot, y[:2], y[2:], np.zeros(2))
        return np.concatenate([y[2:], acceleration])

    way = solve_ivp(rates, (0.0, 2.0), [0.5, -1.2, 0.3, 0.1], rtol=1e-10, atol=1e-10)
    energy = rigid_body.kinetic_energy(robot, way.y[:2].T, way.y[2:].T)
    energy = energy + rigid_body.potential_energy(robot, way.y[:2].T)
    assert np.ptp(way.y[0]) > 1.0
    assert np.ptp(energy) < 1e-6 * np.ptp(rigid_body.potential_energy(robot, way.y[:2].T))


def test_base_parameters_span_all_columns(robot: Robot) -> None:
    found = base_map(robot)
    q, qd, qdd = np.random.default_rng(1).uniform(-3.0, 3.0, size=(3, 150, robot.dof))
    columns = rigid_body.regressor(robot, q, qd, qdd).reshape(-1, len(robot.parameter_names))
    lengths = np.linalg.norm(columns, axis=0)
    unit = columns / np.where(lengths > 0.0, lengths, 1.0)
    assert np.linalg.matrix_rank(unit, tol=1e-9) == len(found.names)
    assert np.linalg.matrix_rank(unit[:, found.leading], tol=1e-9) == len(found.names)
    assert found.of_links.names == base_map(replace(robot, cylinders=())).names
    theta = robot.parameter_vector
    assert close(columns[:, found.leading] @ (found.combination @ theta), columns @ theta, 1e-10)
    leading = np.zeros(theta.size)
    leading[found.leading] = found.combination @ theta
    other = with_parameters(robot, leading)
    assert close(
        rigid_body.inverse_dynamics(other, q, qd, qdd),
        rigid_body.inverse_dynamics(robot, q, qd, qdd),
        1e-10,
    )


def test_base_parameters_of_the_crane() -> None:
    robot = load_robot("xs031")
    found = base_map(robot)
    bare = base_map(replace(robot, cylinders=()))
    assert found.of_links.names == bare.names
    assert found.names[6:] == (
        *("lift_cylinder_barrel.mcx", "lift_cylinder_barrel.izz", "lift_cylinder_rod.mcx"),
        *("tilt_cylinder_barrel.mcx", "tilt_cylinder_barrel.izz", "tilt_cylinder_rod.mcx"),
    )
    turning = {"lift_cylinder_barrel.izz": 1.0, "lift_cylinder_rod.izz": 1.0}
    assert found.coefficients(7) == pytest.approx(turning)
    # The rod's mass hangs on the tilt link at the pin, the barrel of the first one on the base.
    child = robot.cylinders[1]
    x = child.l2_m * np.cos(child.child_pin_angle_rad)
    assert found.coefficients(3)["tilt_cylinder_rod.mass"] == pytest.approx(x)
    assert not any("lift_cylinder_barrel.mass" in found.coefficients(i) for i in range(12))


def test_gravity_along_the_axis_hides_the_first_barrel() -> None:
    robot = replace(load_robot("xs031"), gravity_m_s2=np.array([0.0, -9.81, 0.0]))
    names = base_map(robot).names
    assert "lift_cylinder_barrel.mcx" not in names
    assert {"lift_cylinder_barrel.izz", "lift_cylinder_rod.mcx"} <= set(names)


def test_a_cylinder_on_a_slide_adds_no_bodies(make_slider: Callable[..., Robot]) -> None:
    robot = make_slider()
    part = CylinderPart(50.0, 0.3, 2.0)
    cylinders = (replace(robot.cylinders[0], barrel=part, rod=part),)
    assert replace(robot, cylinders=cylinders).parameter_names == robot.standard_names


def test_parameters_of_the_wrong_size_are_refused() -> None:
    with pytest.raises(RobotError, match="expected 32 parameters, found shape"):
        with_parameters(load_robot("xs031"), np.zeros(20))
