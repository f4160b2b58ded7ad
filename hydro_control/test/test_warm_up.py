"""What is compiled, or loaded, is so before the first sample: in it that takes up to seconds."""

from __future__ import annotations

import subprocess
import sys

import pytest

#: Counts of the kernels' signatures after a controller was made, and after some of its samples.
_SCRIPT = """
import sys
from dataclasses import replace
import numpy as np
from numba.core.dispatcher import Dispatcher
from hydro_control.core.core import ControllerCore, Sample
from hydro_control.gains import Gains
from hydro_control.motion.trajectory import Waypoint
from hydro_model.multibody.kinematics import tip_position
from hydro_model.robot import EffectSpec
from hydro_model.robot_files import load_robot

robot, listed = load_robot("xs031"), sys.argv[1:]
values = {"internal_leakage": {"coefficient": 4e-12}, "command_delay": {"delay": 0.006}}
robot = replace(robot, effects=tuple(EffectSpec(n, "xs031", values[n]) for n in listed))
core = ControllerCore(robot, Gains())

def compiled():
    modules = [m for name, m in sys.modules.items() if name.startswith("hydro_")]
    kernels = {id(k): k for m in modules for k in vars(m).values() if isinstance(k, Dispatcher)}
    return {k.__name__: len(k.signatures) for k in kernels.values() if k.signatures}

before, q = compiled(), np.array([0.5, -1.4])
for k in range(6):
    frozen = q.copy()
    frozen.flags.writeable = False
    chambers = np.full((2, 2), 9e6)
    sample = Sample(10**18 + 2_000_000 * k, frozen, chambers[:, 0], chambers[:, 1], 19e6, None)
    assert not core.answer(sample).output.fault
    if k == 2:
        assert compiled() == before, (before, compiled())
        there = tip_position(robot, q) + np.array([0.0, 0.0, 0.05])
        point = Waypoint(1.0, there, np.zeros(3), np.zeros(3))
        core.requests.trajectory("tip", [robot.tip_link], [point])
        before = compiled()  # what checks a trajectory is not what answers samples
assert core.moving
assert compiled() == before, (before, compiled())
assert {"force_kernel", "valve_kernel"} <= compiled().keys()
"""


@pytest.mark.parametrize("listed", [(), ("internal_leakage", "command_delay")], ids=len)
def test_no_sample_has_anything_compiled(listed: tuple[str, ...]) -> None:
    words = [sys.executable, "-c", _SCRIPT, *listed]
    found = subprocess.run(words, capture_output=True, text=True, check=False)
    assert found.returncode == 0, found.stderr
