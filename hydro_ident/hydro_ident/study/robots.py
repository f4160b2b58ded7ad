"""The cranes of a study, each with its designed excitation, made once and kept in a folder."""

from __future__ import annotations

import json
import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from hydro_ident.errors import IdentError
from hydro_ident.study.experiments import Motion, excitation
from hydro_ident.study.machines import random_crane
from hydro_model.robot import Robot
from hydro_model.robot_files import load_robot

_MOTIONS, _FILES = "motions.npz", "robot.json"
_TRIES = 30


@dataclass(frozen=True, slots=True)
class StudyRobot:
    """A crane of the study.

    Attributes
    ----------
    folder : Path
        Of its two files.
    robot : Robot
    excitation : (Motion, Motion)
        Designed run, and another motion to verify on.
    """

    folder: Path
    robot: Robot
    excitation: tuple[Motion, Motion]


def robot_count(cases: int) -> int:
    """Cranes for a number of cases."""
    return min(max(2, cases // 30), 24)


def study_robot(folder: Path, seed: int, number: int) -> StudyRobot:
    """A crane of a study, from its folder or made anew.

    Parameters
    ----------
    folder : Path
    seed : int
        Of the study.
    number : int

    Returns
    -------
    StudyRobot

    Raises
    ------
    IdentError
        No crane of this number can be excited within its limits.
    """
    place = folder / f"{number:02d}"
    if (place / _FILES).is_file():
        return _read(place)
    last = ""
    for attempt in range(_TRIES):
        name = f"crane_{number:02d}"
        try:
            draw = int(np.random.default_rng([seed, 2, number, attempt]).integers(1 << 31))
            files, robot = random_crane(name, draw, place)
            motions = excitation(robot, draw)
        except IdentError as error:
            last = str(error)
            continue
        arrays = {
            f"{part}_{key}": getattr(motion, key)
            for part, motion in zip(("train", "check"), motions, strict=True)
            for key in ("q", "qd")
        }
        np.savez(place / _MOTIONS, **arrays)
        # Last, and at once: a folder with this file is whole.
        partial = place / f".{_FILES}"
        partial.write_text(json.dumps({"name": files.name}), encoding="utf-8")
        os.replace(partial, place / _FILES)
        return StudyRobot(place, robot, motions)
    raise IdentError(f"study robot {number} of seed {seed}: {_TRIES} draws failed, last: {last}")


def _read(place: Path) -> StudyRobot:
    name = json.loads((place / _FILES).read_text(encoding="utf-8"))["name"]
    robot = load_robot(place / f"{name}.hydraulics.yaml")
    with np.load(place / _MOTIONS) as data:
        train = Motion("excite", data["train_q"], data["train_qd"])
        check = Motion("excite", data["check_q"], data["check_qd"])
    return StudyRobot(place, robot, (train, check))
