"""What the records of a robot file have to agree on; messages name the file."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

from hydro_model.errors import RobotError
from hydro_model.robot import Robot


def check_robot(robot: Robot, path: Path) -> None:
    """Names that are given twice or are not there, and cylinders that their joints do not fit.

    Parameters
    ----------
    robot : Robot
    path : Path
        Of its file.

    Raises
    ------
    RobotError
    """
    check_once("cylinder", [c.name for c in robot.cylinders], path)
    check_once("cylinder on joint", [c.joint for c in robot.cylinders], path)
    check_once("valve", [v.name for v in robot.valves], path)
    check_once("valve of cylinder", [v.cylinder for v in robot.valves], path)
    cylinders = tuple(c.name for c in robot.cylinders)
    for cylinder in robot.cylinders:
        check_known(
            f"cylinder '{cylinder.name}'", "joint", cylinder.joint, robot.joint_names, path
        )
        joint = robot.joints[robot.joint_index(cylinder.joint)]
        if cylinder.l1_m == 0.0 and not joint.prismatic:
            raise RobotError(
                f"{path}: cylinder '{cylinder.name}' on revolute joint '{joint.name}' needs"
                " l1_m, l2_m, q0_rad and x0_m"
            )
        if not np.isfinite([joint.lower, joint.upper]).all():
            raise RobotError(
                f"{path}: cylinder '{cylinder.name}' needs joint '{joint.name}' to have finite"
                f" limits, found {joint.lower} to {joint.upper}"
            )
    for valve in robot.valves:
        check_known(f"valve '{valve.name}'", "cylinder", valve.cylinder, cylinders, path)


def check_known(who: str, what: str, name: str, known: tuple[str, ...], path: Path) -> None:
    """A name that a record gives is one of those that are there.

    Parameters
    ----------
    who : str
        The record.
    what : str
        What the name is of.
    name : str
    known : tuple of str
    path : Path
        Of the file.

    Raises
    ------
    RobotError
    """
    if name not in known:
        raise RobotError(
            f"{path}: {who} has no {what} '{name}' (known: {', '.join(known) or 'none'})"
        )


def check_once(what: str, names: list[str], path: Path) -> None:
    """Every name is given once.

    Parameters
    ----------
    what : str
        What the names are of.
    names : list of str
    path : Path
        Of the file.

    Raises
    ------
    RobotError
    """
    twice = sorted(name for name, count in Counter(names).items() if count > 1)
    if twice:
        raise RobotError(f"{path}: {what} '{twice[0]}' appears more than once")


def check_pistons(robot: Robot, path: Path) -> None:
    """Joint limits keep every piston in its cylinder.

    Parameters
    ----------
    robot : Robot
    path : Path
        Of its file.

    Raises
    ------
    RobotError
    """
    from hydro_model.cylinder import stroke

    for cylinder in robot.cylinders:
        joint = robot.joints[robot.joint_index(cylinder.joint)]
        x: Any = stroke(cylinder, np.linspace(joint.lower, joint.upper, 101))
        if x.min() < 0.0 or x.max() > cylinder.stroke_m:
            raise RobotError(
                f"{path}: joint limits {joint.lower} to {joint.upper} move '{cylinder.name}' from"
                f" {x.min():.3f} to {x.max():.3f} m, outside its stroke 0 to {cylinder.stroke_m} m"
            )
