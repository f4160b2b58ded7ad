"""The drawing of a robot is its geometry."""

from __future__ import annotations

import base64

import numpy as np
import pytest

from hydro_ident.report.robot_drawing import POSES, drawings, plane_of
from hydro_model.cylinder import stroke
from hydro_model.joint_ranges import limits
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


def test_the_plane_is_seen_from_the_side_gravity_down() -> None:
    plane = plane_of(load_robot("xs031"))
    assert np.allclose(plane.across, [1.0, 0.0, 0.0])
    assert np.allclose(plane.up, [0.0, 0.0, 1.0])
    slide = plane_of(load_robot("emps"))
    assert abs(slide.across @ slide.up) < 1e-12
