"""A crane, a motion and a machine that does what it says, for the tests of the study."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from hydro_hw_bridge.rig.random_truth import plain_truth
from hydro_ident.study.experiments import Motion
from hydro_ident.study.hidden import Machine, Scene
from hydro_ident.study.traces import drive, scene_of
from hydro_model.robot import Robot
from hydro_model.robot_files import load_robot

POSE = np.array([0.7, -1.4])


@pytest.fixture(scope="module")
def crane() -> Robot:
    """The reference crane without its cylinders' bodies in the file."""
    robot = load_robot("xs031")
    bare = tuple(replace(c, barrel=None, rod=None) for c in robot.cylinders)
    return replace(robot, cylinders=bare)


@pytest.fixture(scope="module")
def motion(crane: Robot) -> Motion:
    """Nine seconds of both joints, with pauses, quick and slow."""
    t = np.arange(0.0, 9.0, 2e-3)[:, None]
    fade = np.clip(t / 1.5, 0.0, 1.0) ** 2 * (3.0 - 2.0 * np.clip(t / 1.5, 0.0, 1.0))
    pause = np.where((t > 6.0) & (t < 7.0), 0.0, 1.0)
    rate = fade * pause * np.array([0.22, 0.4]) * np.cos(np.array([1.3, 1.9]) * t)
    rate += fade * pause * np.array([0.05, 0.07]) * np.cos(np.array([6.0, 7.0]) * t)
    q = POSE + np.cumsum(rate, axis=0) * 2e-3
    return Motion("excite", q, rate)


@pytest.fixture(scope="module")
def plain(crane: Robot) -> Machine:
    return Machine(crane, plain_truth(crane, 12), lines_recorded=False)


@pytest.fixture(scope="module")
def scene(plain: Machine, motion: Motion) -> Scene:
    return scene_of(drive(plain, motion, 1))
