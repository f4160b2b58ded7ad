"""The robot that a bag names."""

from __future__ import annotations

from collections.abc import Mapping

from hydro_model.errors import RobotError
from hydro_model.robot import Robot
from hydro_model.robot_files import load_robot, shipped_robots


def named_robot(metadata: Mapping[str, str]) -> Robot | None:
    """The shipped robot that a bag names.

    Parameters
    ----------
    metadata : mapping of str to str
        Of the bag.

    Returns
    -------
    Robot or None
    """
    named = metadata.get("robot")
    # Never a path: what a bag says opens no other file.
    if named not in shipped_robots():
        return None
    try:
        return load_robot(named)
    except RobotError:
        return None
