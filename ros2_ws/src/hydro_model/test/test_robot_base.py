"""Base parameters in a robot file: what an identified model moves like, and what is refused."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from hydro_model.errors import RobotError
from hydro_model.multibody.base_parameters import base_map
from hydro_model.multibody.rigid_body import inverse_dynamics
from hydro_model.robot_files import load_robot


def _with_base(crane: Path, parameters: list[dict[str, Any]], **further: object) -> Path:
    data = yaml.safe_load(crane.read_text(encoding="utf-8"))
    data |= {"base_parameters": parameters, **further}
    crane.write_text(yaml.safe_dump(data), encoding="utf-8")
    return crane


def test_base_parameters_give_the_dynamics_of_the_links(crane: Path) -> None:
    robot = load_robot("xs031")
    found = base_map(robot)
    values = found.combination @ robot.parameter_vector
    rows = [
        {"name": name, "combination": found.coefficients(i), "value": float(values[i])}
        for i, name in enumerate(found.names)
    ]
    covariance = np.eye(len(found.names)).tolist()
    schema = "hydro_model/model/1"
    model = load_robot(_with_base(crane, rows, base_covariance=covariance, schema=schema))
    assert model.base_covariance is not None
    assert np.array_equal(model.base_covariance, np.eye(len(found.names)))
    assert [p.name for p in model.base_parameters] == list(found.names)
    q, qd, qdd = np.random.default_rng(0).normal(size=(3, 50, 2))
    expected = inverse_dynamics(robot, q, qd, qdd)
    assert np.allclose(inverse_dynamics(model, q, qd, qdd), expected, rtol=0, atol=1e-8)


def test_base_parameters_of_links_alone_have_no_parts_beside_them(crane: Path) -> None:
    """A model made without closed chains: what its parts do is in its links."""
    row = {"name": "tilt_link.mcx", "combination": {"tilt_link.mcx": 1.0}, "value": 1100.0}
    model = load_robot(_with_base(crane, [row]))
    assert not model.part_parameters.any()
    assert model.cylinders[0].barrel is not None


@pytest.mark.parametrize("covariance", [[[1.0]], "none", [[1.0] * 6] * 5, [[1.0] * 5] * 6])
def test_covariance_of_another_size(crane: Path, covariance: object) -> None:
    rows = [
        {"name": f"lift_link.{p}", "combination": {f"lift_link.{p}": 1.0}, "value": 1.0}
        for p in ("mcx", "mcy", "mcz", "ixx", "iyy", "izz")
    ]
    with pytest.raises(RobotError, match="base_covariance"):
        load_robot(_with_base(crane, rows, base_covariance=covariance))
