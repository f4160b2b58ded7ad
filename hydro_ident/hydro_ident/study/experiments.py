"""What the cranes of the study do: designed excitation, and plain work with pauses."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from hydro_hw_bridge.rig.following import Servo
from hydro_ident.design.experiment import LIMITS, design_excitation, design_validation
from hydro_ident.design.limits import half_range, natural_frequencies_hz
from hydro_ident.design.program import Entry, Program
from hydro_ident.errors import IdentError
from hydro_model.description.fields import Fields
from hydro_model.hydraulics.cylinder import lever
from hydro_model.motion.paths import JointPath
from hydro_model.motion.paths_kinds import read_segments
from hydro_model.multibody.joint_ranges import middle
from hydro_model.multibody.rigid_body import mass_matrix
from hydro_model.robot import FloatArray, Robot

#: Lengths of the recordings to learn from and to verify on, s.
TRAIN_S, CHECK_S = 60.0, 40.0
#: The same for every case: what they end at says nothing.
START_S = 1.0
Kind = Literal["excite", "work"]


@dataclass(frozen=True, slots=True)
class Motion:
    """Joint targets of a run at the device's rate.

    Attributes
    ----------
    kind : {"excite", "work"}
    q, qd : (N, n) array
    """

    kind: Kind
    q: FloatArray
    qd: FloatArray


def excitation(robot: Robot, seed: int) -> tuple[Motion, Motion]:
    """A designed run and a second motion to verify on.

    Parameters
    ----------
    robot : Robot
    seed : int

    Returns
    -------
    tuple of Motion

    Raises
    ------
    IdentError
        No motion fits the robot's limits.
    """
    start = middle(robot)
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        train = design_excitation(robot, start, TRAIN_S - START_S, place, seed=seed)
        check = design_validation(robot, start, CHECK_S - START_S, place, seed=seed)
    return (
        _sampled(robot, "excite", train.path, TRAIN_S),
        _sampled(robot, "excite", check.path, CHECK_S),
    )


def work(robot: Robot, seed: int) -> tuple[Motion, Motion]:
    """Pick and place: the same stations again and again, with pauses; then other stations.

    Parameters and errors as `excitation`.
    """
    return _cycles(robot, seed, TRAIN_S), _cycles(robot, seed + 1_000_003, CHECK_S)


def _cycles(robot: Robot, seed: int, duration_s: float) -> Motion:
    random = np.random.default_rng(seed)
    centre, half = middle(robot), half_range(robot)
    program = Program(robot, LIMITS, centre)
    stations = [
        centre + half * random.uniform(-0.6, 0.6, robot.dof) for _ in range(random.integers(3, 6))
    ]
    shortest = float(random.uniform(1.5, 3.0))
    failures, ways = 0, dict[tuple[object, ...], list[Entry] | None]()
    while program.duration_s < duration_s - START_S and failures < 40:
        for number, station in enumerate(stations):
            # Round after round the same ways between the same stations.
            key = (number, *np.round(program.at, 9).tolist())
            if key not in ways:
                ways[key] = _way(program, station, shortest)
            way = ways[key]
            if way is None:
                failures += 1
                continue
            program.again(way)
            program.hold(float(random.uniform(0.3, 1.5)))
    if not program.entries:
        raise IdentError(f"robot {robot.name}: no station of seed {seed} can be reached")
    at, segments = np.asarray(program.start, dtype=float), []
    for entry in program.entries:
        fresh = read_segments(Fields(entry, "work cycle"), at)
        at = fresh[-1].sample(fresh[-1].duration_s)[0]
        segments += fresh
    path = JointPath(tuple(segments), joints=robot.joint_names)
    return _sampled(robot, "work", path, duration_s)


def _way(program: Program, station: FloatArray, shortest: float) -> list[Entry] | None:
    """What leads to a station from where a program stands; None where nothing does."""
    trial = program.copy()
    try:
        trial.move(station, at_least_s=shortest)
    except IdentError:
        return None
    return trial.entries[len(program.entries) :]


def _sampled(robot: Robot, kind: Kind, path: JointPath, duration_s: float) -> Motion:
    """The path after a pause, cut to the duration."""
    step = 1.0 / robot.sensors.rate_hz
    time = np.arange(round(duration_s / step)) * step - START_S + path.start_delay_s
    q, qd, _ = path.sample_many(time)
    columns = [path.joints.index(name) for name in robot.joint_names]
    return Motion(kind, q[:, columns], qd[:, columns])


def servo_for(robot: Robot) -> Servo:
    """A servo slow enough for the robot's hydraulic modes at the middle of its range."""
    q = middle(robot)
    slowest = natural_frequencies_hz(robot, q[None])[0]
    inertia = np.diag(np.asarray(mass_matrix(robot, q)))
    gain, damping = [], []
    for i, cylinder in enumerate(robot.cylinders):
        j = robot.joint_index(cylinder.joint)
        mass = inertia[j] / float(lever(cylinder, q[j])) ** 2
        rate = 2.0 * np.pi * float(slowest[i])
        gain.append(min(0.25 * rate, 5.0))
        # Force feedback that alone would damp the mode by 0.3.
        damping.append(0.6 / (rate * mass))
    return Servo(np.array(gain), np.array(damping))
