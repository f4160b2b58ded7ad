"""The drawing of a robot is its geometry."""

from __future__ import annotations

import base64
from dataclasses import replace

import numpy as np
import pytest

from hydro_ident.report.robot_drawing import POSES, drawings, plane_of
from hydro_ident.report.robot_report import _drawn
from hydro_model.hydraulics.cylinder import stroke
from hydro_model.multibody.joint_ranges import limits
from hydro_model.multibody.kinematics import link_frames
from hydro_model.robot_files import load_robot


def points(trace: dict[str, object]) -> np.ndarray:
    """Points of a trace of a figure, (N, 2)."""
    columns = [np.frombuffer(base64.b64decode(trace[k]["bdata"]), "<f4") for k in "xy"]  # type: ignore[index]
    return np.stack(columns, axis=1).astype(float)


@pytest.mark.parametrize("name", ["xs031", "patu655"])
def test_the_drawn_pins_are_as_far_apart_as_the_cylinder_is_long(name: str) -> None:
    robot = load_robot(name)
    low, high = limits(robot).T
    for figure, (_, share) in zip(drawings(robot), POSES, strict=False):
        q = low + share * (high - low)
        for cylinder in robot.cylinders:
            [trace] = [t for t in figure.traces if t["name"].startswith(cylinder.name)]
            a, b = points(trace)
            length = cylinder.x0_m + float(stroke(cylinder, q[robot.joint_index(cylinder.joint)]))
            assert np.linalg.norm(b - a) == pytest.approx(length, abs=1e-6)


@pytest.mark.parametrize("name", ["xs031", "patu655"])
def test_pins_have_names_and_lie_at_their_distances_from_the_axis(name: str) -> None:
    robot = load_robot(name)
    low, high = limits(robot).T
    for figure, (_, share) in zip(drawings(robot), POSES, strict=False):
        q = low + share * (high - low)
        origins, _ = link_frames(robot, q)
        for cylinder in robot.cylinders:
            [trace] = [t for t in figure.traces if t["name"] == f"pins of {cylinder.name}"]
            assert (trace["mode"], trace["text"]) == ("markers+text", ["1", "2"])
            axis = np.stack(plane_of(robot).flat(origins[robot.joint_index(cylinder.joint)]))
            first, second = np.linalg.norm(points(trace) - axis, axis=1)
            assert (first, second) == pytest.approx((cylinder.l1_m, cylinder.l2_m), abs=1e-6)


def test_the_legend_stands_once_in_short_names_and_strokes_in_the_note() -> None:
    robot = load_robot("xs031")
    first, *others = drawings(robot)[: len(POSES)]
    listed = [t["name"] for t in first.traces if t["showlegend"]]
    assert listed == [*robot.link_names, "joint axes", "tip", "lift_cylinder", "tilt_cylinder"]
    assert not any(t["showlegend"] for figure in others for t in figure.traces)
    for figure in (first, *others):
        assert figure.note.count(" out by ") == 2
        assert f"of {robot.cylinders[0].stroke_m:.3f} m" in figure.note


def test_the_plane_is_seen_from_the_side_gravity_down() -> None:
    plane = plane_of(load_robot("xs031"))
    assert np.allclose(plane.across, [1.0, 0.0, 0.0])
    assert np.allclose(plane.up, [0.0, 0.0, 1.0])
    slide = plane_of(load_robot("emps"))
    assert abs(slide.across @ slide.up) < 1e-12


def test_cylinders_that_slide_with_their_joint_are_said_not_to_be_drawn() -> None:
    crane = load_robot("xs031")
    lift, tilt = crane.cylinders
    sliding = replace(
        crane,
        joints=(crane.joints[0], replace(crane.joints[1], prismatic=True)),
        cylinders=(lift, replace(tilt, l1_m=0.0, l2_m=0.0, q0_rad=0.0, barrel=None, rod=None)),
    )
    names = {trace["name"].split(",")[0] for trace in drawings(sliding)[0].traces}
    assert names & {lift.name, tilt.name} == {lift.name}
    assert f"Not drawn: {tilt.name}." in _drawn(sliding)
    assert "Not drawn" not in _drawn(crane)
