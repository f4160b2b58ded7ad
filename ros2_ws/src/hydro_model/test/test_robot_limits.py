"""Joint limits of robot files against what the cylinders' strokes let the joints do."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml

from hydro_model.errors import RobotError
from hydro_model.hydraulics.cylinder import joint_position, lever, stroke
from hydro_model.robot_files import load_robot

#: The shipped crane's first joint.
GIVEN = 'lower="-0.05" upper="1.70"'


def limited(crane: Path, limits: str, kind: str = "revolute") -> None:
    """The crane's first joint gets other limits, none where they are empty."""
    urdf = crane.with_name("xs031.urdf")
    text = urdf.read_text(encoding="utf-8")
    assert GIVEN in text
    text = text.replace('name="lift" type="revolute"', f'name="lift" type="{kind}"')
    text = text.replace(GIVEN, limits) if limits else re.sub(f"<limit {GIVEN}[^>]*>", "", text)
    urdf.write_text(text, encoding="utf-8")


def refused(path: Path) -> str:
    with pytest.raises(RobotError) as caught:
        load_robot(path)
    return str(caught.value)


@pytest.mark.parametrize("wide", [1e-9, 0.03])
def test_slightly_wide_limits_end_where_the_piston_does(
    crane: Path, caplog: pytest.LogCaptureFixture, wide: float
) -> None:
    cylinder = load_robot(crane).cylinder("lift_cylinder")
    end = float(joint_position(cylinder, 0.0, near=0.5))
    limited(crane, f'lower="{end - wide!r}" upper="1.70"')
    caplog.clear()
    joint = load_robot(crane).joints[0]
    assert [joint.lower, joint.upper] == pytest.approx([end, 1.70], abs=2e-3)
    assert stroke(cylinder, joint.lower) >= 0.0
    [record] = caplog.records
    assert "outside its stroke" in record.message
    assert f"taken as {joint.lower:.4f} to {joint.upper:.4f}" in record.message


@pytest.mark.parametrize(
    ("limits", "kind", "ends"),
    [
        ('lower="-1.57" upper="1.90"', "revolute", (-0.0983, 1.90)),
        # Beyond a dead centre at 2.136, and beyond the other one, where the arm points back.
        ('lower="-1.57" upper="2.50"', "revolute", (-0.0983, 2.1)),
        ('lower="2.20" upper="4.60"', "revolute", (2.20, 4.370)),
        ("", "continuous", (-0.0983, 2.1)),
    ],
)
def test_limits_beyond_the_stroke_are_narrowed_for_who_reads_recordings_alone(
    crane: Path,
    caplog: pytest.LogCaptureFixture,
    limits: str,
    kind: str,
    ends: tuple[float, float],
) -> None:
    limited(crane, limits, kind)
    said = refused(crane)
    assert "outside its stroke" in said or "to have finite limits" in said
    caplog.clear()
    robot = load_robot(crane, narrow=True)
    joint, cylinder = robot.joints[0], robot.cylinder("lift_cylinder")
    assert [joint.lower, joint.upper] == pytest.approx(ends, abs=0.06)
    q = np.linspace(joint.lower, joint.upper, 500)
    x, arm = stroke(cylinder, q), lever(cylinder, q)
    assert x.min() >= 0.0
    assert x.max() <= cylinder.stroke_m
    assert len(set(np.sign(arm))) == 1
    assert np.abs(arm).min() > 0.01 * cylinder.l2_m
    [record] = caplog.records
    assert record.message == f"{said}: taken as {joint.lower:.4f} to {joint.upper:.4f}"


def test_limits_where_no_cylinder_has_its_stroke_are_refused_by_everybody(crane: Path) -> None:
    limited(crane, 'lower="-1.2" upper="-0.9"')
    with pytest.raises(RobotError, match="outside its stroke"):
        load_robot(crane, narrow=True)


def test_a_command_says_that_limits_were_narrowed(crane: Path) -> None:
    limited(crane, 'lower="-0.11" upper="1.70"')
    code = (
        "import sys; from hydro_model.command_line.command import run_command;"
        "from hydro_model.robot_files import load_robot;"
        "run_command('tool', lambda given: load_robot(given[0]).dof, sys.argv[1:])"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, str(crane)], capture_output=True, text=True, check=True
    )
    assert done.stdout == ""
    [line] = done.stderr.splitlines()
    assert line.startswith(
        f"tool: warning: {crane}: joint limits -0.11 to 1.7 move 'lift_cylinder'"
    )


def test_limits_past_a_dead_centre_are_refused_however_little_the_stroke(crane: Path) -> None:
    """There the piston comes back into its cylinder: 1 % of the stroke is a fifth of the range."""
    cylinder = load_robot(crane).cylinder("lift_cylinder")
    shortest = float(stroke(cylinder, -cylinder.q0_rad))
    data = yaml.safe_load(crane.read_text(encoding="utf-8"))
    data["cylinders"][0]["x0_m"] += shortest + 0.01 * cylinder.stroke_m
    crane.write_text(yaml.safe_dump(data), encoding="utf-8")
    limited(crane, f'lower="{-cylinder.q0_rad - 0.6}" upper="0.4"')
    assert "outside its stroke" in refused(crane)


def test_a_cylinder_needs_limits(crane: Path) -> None:
    limited(crane, GIVEN, "continuous")
    assert "needs joint 'lift' to have finite limits" in refused(crane)
