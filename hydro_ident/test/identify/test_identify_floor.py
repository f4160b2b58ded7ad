"""What the sensors' noise leaves is that of the machine, whatever inertia its file states."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from hydro_ident.identify.identification import identify
from hydro_ident.identify.model_error import left_out
from hydro_model.robot import Robot

pytestmark = pytest.mark.needs("clarabel")


@pytest.mark.parametrize("share", [0.0, 10.0])
def test_positions_noise_weighs_as_the_inertia_that_was_found(
    clean: Any, robot: Robot, share: float
) -> None:
    noise = np.random.default_rng(1).normal(size=clean.q.shape)
    recording = clean.recording(q=clean.q + 1e-4 * noise)
    floors, ratios = [], []
    for given in (robot, replace(robot, link_inertia=share * robot.link_inertia)):
        scores = identify(given, [replace(recording, robot=given)]).channels
        forces = [one for one in scores if one.name.endswith("/force")]
        floors.append([one.noise_floor for one in forces])
        ratios.append(left_out(forces))
    # Barrels and rods that stay the file's regroup with the links a little otherwise.
    np.testing.assert_allclose(floors[1], floors[0], rtol=0.02)
    assert ratios[1] == pytest.approx(ratios[0], rel=0.05)
