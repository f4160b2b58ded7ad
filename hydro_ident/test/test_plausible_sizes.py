"""What a parameter could be at most: of the machine, not of placeholders or of a slide's zero."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from hydro_ident.design.prediction import expected_trace
from hydro_ident.estimate.effects.listed_effects import ListedEffects
from hydro_ident.estimate.forces.inertial import InertialFit, fit_inertial, force_model
from hydro_ident.estimate.forces.plausible_sizes import parameter_scales, reach_m
from hydro_ident.estimate.signals.traces import Trace
from hydro_model.robot import Joint, Robot

H = 0.002


def telescope(robot: Robot, zero_m: float, ends_m: tuple[float, float] = (0.0, 1.5)) -> Robot:
    """The crane with a slide for its second joint, whose position counts from another place."""
    lift, tilt = robot.joints
    slide = Joint(
        name="tele",
        parent_link=tilt.parent_link,
        child_link=tilt.child_link,
        prismatic=True,
        translation_m=np.array([1.6 + zero_m, 0.0, 0.0]),
        rotation=np.eye(3),
        axis=np.array([1.0, 0.0, 0.0]),
        lower=ends_m[0] - zero_m,
        upper=ends_m[1] - zero_m,
        velocity_limit=0.5,
        effort_limit=4e4,
        viscous_friction=0.0,
    )
    direct = replace(
        robot.cylinders[1], joint="tele", l1_m=0.0, l2_m=0.0, x0_m=-zero_m, stroke_m=1.5,
        barrel=None, rod=None,
    )  # fmt: skip
    return replace(robot, joints=(lift, slide), cylinders=(robot.cylinders[0], direct), valves=())


@pytest.mark.parametrize("zero_m", [0.0, 1.5, 0.4, -2.0])
def test_a_slide_counts_with_its_travel_wherever_its_zero_is(robot: Robot, zero_m: float) -> None:
    tip_m = float(np.linalg.norm(robot.tip_offset_m))
    moved = telescope(robot, zero_m)
    first = float(np.linalg.norm(robot.joints[0].translation_m))
    assert reach_m(moved) == pytest.approx(first + 1.6 + 1.5 + tip_m)
    wanted = parameter_scales(force_model(telescope(robot, 0.0)))
    np.testing.assert_allclose(parameter_scales(force_model(moved)), wanted, rtol=1e-12)


def test_an_endless_slide_goes_as_far_as_its_cylinder(robot: Robot) -> None:
    endless = telescope(robot, 0.4, (-np.inf, np.inf))
    assert reach_m(endless) == pytest.approx(reach_m(telescope(robot, 0.4)))
    free = replace(endless, cylinders=endless.cylinders[:1])
    assert reach_m(free) == pytest.approx(reach_m(endless) - 1.5 + 0.4)


def swaying(robot: Robot, noise_n: float) -> Trace:
    """The crane in motion, with slow forces that no model has."""
    time = np.arange(0.0, 24.0, H)
    q = np.array([0.8, -1.2]) * np.ones((time.size, 2))
    qd, qdd = np.zeros_like(q), np.zeros_like(q)
    for joint, terms in enumerate((((0.3, 0.9), (0.05, 3.1)), ((0.4, 1.3), (0.06, 4.2)))):
        for size, w in terms:
            q[:, joint] += size * np.sin(w * time)
            qd[:, joint] += size * w * np.cos(w * time)
            qdd[:, joint] -= size * w * w * np.sin(w * time)
    _, trace = expected_trace(ListedEffects.of(robot), (q, qd, qdd), H)
    rng = np.random.default_rng(1)
    slow = np.zeros(q.shape)
    for k in range(1, len(slow)):
        slow[k] = 0.98 * slow[k - 1] + rng.normal(size=2) * np.sqrt(1.0 - 0.98**2)
    areas = np.array([c.area_a_m2 for c in robot.cylinders])
    return replace(trace, p_a=trace.p_a + noise_n * slow / areas)


def fitted(given: Robot, trace: Trace) -> InertialFit:
    found = fit_inertial(force_model(given), [trace])
    assert found is not None
    return found


@pytest.fixture(scope="module")
def trace(robot: Robot) -> Trace:
    return swaying(robot, 3000.0)


@pytest.mark.parametrize("mass_kg", [0.0, 1.0, 5.0])
def test_placeholder_masses_make_no_estimate_unknown(
    robot: Robot, trace: Trace, mass_kg: float
) -> None:
    right = fitted(robot, trace)
    links = np.zeros((2, 10))
    links[:, 0] = mass_kg
    links[:, [4, 7, 9]] = 0.01 * mass_kg
    placed = fitted(replace(robot, link_inertia=links), trace)
    assert not right.missing
    assert placed.missing == right.missing
    assert not placed.rejected
    np.testing.assert_allclose(placed.fit.theta[:6], right.fit.theta[:6], rtol=1e-9)


def test_a_placeholder_of_a_force_limit_makes_no_friction_unknown(
    robot: Robot, trace: Trace
) -> None:
    """Not even one that is near zero."""
    weak = replace(robot, joints=tuple(replace(j, effort_limit=100.0) for j in robot.joints))
    assert fitted(weak, trace).missing == fitted(robot, trace).missing == ()


def test_a_value_that_is_sure_is_known_whatever_its_size(robot: Robot) -> None:
    model = force_model(robot)
    plain = parameter_scales(model)
    theta, std = np.zeros(plain.size), np.ones(plain.size)
    at = model.names.index("tilt_cylinder.viscous_friction")
    theta[at], std[at] = 100.0 * plain[at], 19.0 * plain[at]
    found = parameter_scales(model, theta, std)
    assert found[at] > std[at]
    # Of others it says nothing.
    np.testing.assert_array_equal(np.delete(found, at), np.delete(plain, at))
    std[at] = 21.0 * plain[at]
    np.testing.assert_array_equal(parameter_scales(model, theta, std), plain)


@pytest.mark.parametrize("deviations", [9.0, 11.0])
def test_a_value_of_few_deviations_makes_no_other_known(robot: Robot, deviations: float) -> None:
    model = force_model(robot)
    plain = parameter_scales(model)
    theta, std = np.zeros(plain.size), np.ones(plain.size)
    theta[5] = 7.0 * plain[5]
    std[5] = theta[5] / deviations
    found = parameter_scales(model, theta, std)
    grown = found[:5] / plain[:5]
    np.testing.assert_allclose(grown, 7.0 if deviations > 10.0 else 1.0)
    # What others take for themselves shows no mass.
    std[5] = np.inf
    np.testing.assert_array_equal(parameter_scales(model, theta, std), plain)
