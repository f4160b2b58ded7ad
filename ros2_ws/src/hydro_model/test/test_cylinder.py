"""Cylinder geometry against finite differences, rigid triangles and closed forms."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hydro_model.errors import RobotError
from hydro_model.hydraulics import cylinder as geometry
from hydro_model.robot import Cylinder
from hydro_model.robot_files import load_robot

ROBOT = load_robot("xs031")
PAIRS = list(zip(ROBOT.joints, ROBOT.cylinders, strict=True))
DIRECT = replace(ROBOT.cylinders[0], l1_m=0.0, l2_m=0.0, q0_rad=0.0, x0_m=-0.1)


@st.composite
def triangles(draw: st.DrawFn) -> tuple[Cylinder, float]:
    """A cylinder on a triangle that may be reflected, and an angle off its dead centres."""
    l1 = draw(st.floats(0.3, 2.0))
    l2 = draw(st.floats(0.1, 0.25))
    half_turn = draw(st.integers(-3, 2)) * np.pi
    angle = half_turn + draw(st.floats(0.1, 3.0))
    q0 = draw(st.floats(-6.0, 6.0))
    cylinder = replace(ROBOT.cylinders[0], l1_m=l1, l2_m=l2, q0_rad=q0, x0_m=l1 - l2 - 0.01)
    return cylinder, angle - q0


@given(triangles())
def test_derivatives_match_finite_differences(case: tuple[Cylinder, float]) -> None:
    cylinder, q = case
    h = 1e-5
    above, below = geometry.stroke(cylinder, q + h), geometry.stroke(cylinder, q - h)
    assert geometry.lever(cylinder, q) == pytest.approx((above - below) / (2 * h), abs=1e-9)
    above, below = geometry.lever(cylinder, q + h), geometry.lever(cylinder, q - h)
    assert geometry.lever_rate(cylinder, q) == pytest.approx((above - below) / (2 * h), abs=1e-8)


@given(triangles())
def test_lever_is_the_distance_of_the_axis_from_the_pin_line(
    case: tuple[Cylinder, float],
) -> None:
    cylinder, q = case
    angle = q + cylinder.q0_rad
    parent = np.array([cylinder.l1_m, 0.0])
    child = cylinder.l2_m * np.array([np.cos(angle), np.sin(angle)])
    along = child - parent
    length = np.linalg.norm(along)
    moment = (child[0] * along[1] - child[1] * along[0]) / length
    assert geometry.stroke(cylinder, q) == pytest.approx(length - cylinder.x0_m, abs=1e-12)
    assert geometry.lever(cylinder, q) == pytest.approx(moment, abs=1e-12)


@given(triangles())
def test_joint_position_inverts_stroke_on_its_side_of_dead_centre(
    case: tuple[Cylinder, float],
) -> None:
    cylinder, q = case
    x = geometry.stroke(cylinder, q)
    assert geometry.joint_position(cylinder, x, near=q) == pytest.approx(q, abs=1e-9)


@pytest.mark.parametrize(("joint", "cylinder"), PAIRS)
def test_reference_crane_round_trip_over_the_whole_range(joint, cylinder) -> None:
    q = np.linspace(joint.lower, joint.upper, 101)
    back = geometry.joint_position(cylinder, geometry.stroke(cylinder, q))
    np.testing.assert_allclose(back, q, atol=1e-12)
    assert np.all(geometry.lever(cylinder, q) > 0.1)


def test_paper_without_squares_would_be_far_off() -> None:
    """Erratum of eq. 16: `l1 + l2` instead of the squares is up to 120 mm wrong."""
    worst = 0.0
    for joint, c in PAIRS:
        q = np.linspace(joint.lower, joint.upper, 101)
        printed = np.sqrt(c.l1_m + c.l2_m - 2.0 * c.l1_m * c.l2_m * np.cos(q + c.q0_rad))
        worst = max(worst, np.abs(printed - c.x0_m - geometry.stroke(c, q)).max())
    assert worst > 0.1


def test_impossible_displacement_is_named() -> None:
    with pytest.raises(RobotError, match=r"lift_cylinder.*x = 9 m.*closes from"):
        geometry.joint_position(ROBOT.cylinders[0], [0.1, 9.0])
    with pytest.raises(RobotError, match="no joint position"):
        geometry.joint_position(ROBOT.cylinders[0], np.nan)


def test_direct_cylinder_is_the_joint_itself() -> None:
    q = np.array([[0.0, 0.2], [0.3, 0.4]])
    np.testing.assert_allclose(geometry.stroke(DIRECT, q), q + 0.1)
    np.testing.assert_allclose(geometry.joint_position(DIRECT, q + 0.1), q)
    np.testing.assert_array_equal(geometry.lever(DIRECT, q), np.ones((2, 2)))
    np.testing.assert_array_equal(geometry.lever_rate(DIRECT, q), np.zeros((2, 2)))


def test_piston_force_uses_the_annulus() -> None:
    """Erratum of eq. 9: equal pressures leave the rod area times pressure."""
    cylinder = ROBOT.cylinders[0]
    rod_area = np.pi * cylinder.rod_m**2 / 4.0
    assert geometry.piston_force(cylinder, 1e7, 1e7) == pytest.approx(1e7 * rod_area)
    assert geometry.piston_force(cylinder, 1e7, 0.0) == pytest.approx(1e7 * np.pi * 0.0016)


def test_chamber_volumes_change_with_the_areas() -> None:
    cylinder = ROBOT.cylinders[0]
    x = np.array([0.0, 0.2, cylinder.stroke_m])
    volume_a, volume_b = geometry.chamber_volumes(cylinder, x)
    np.testing.assert_allclose(np.diff(volume_a) / np.diff(x), cylinder.area_a_m2)
    np.testing.assert_allclose(np.diff(volume_b) / np.diff(x), -cylinder.area_b_m2)
    assert volume_a[0] == 0.0
    assert volume_b[-1] == 0.0
