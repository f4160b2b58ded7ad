"""A ROS parameters file for the bridge, looked over before anything starts.

ROS passes over, unsaid, what no node of that name declares, and of a value that stands both in a
file and on the command line it takes the one whose node was named last.
"""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path

from hydro_hw_bridge.errors import BridgeError
from hydro_hw_bridge.parameters import PARAMETERS
from hydro_model.errors import RobotError
from hydro_model.fields import Fields
from hydro_model.robot_files import read_yaml

#: How a file names the bridge's node: by itself, or with all others.
NODES = ("can_bridge", "/can_bridge", "/**", "**", "*", "/*")
#: What rclpy declares for every node; `qos_overrides` by topic.
_OF_EVERY_NODE = ("use_sim_time", "start_type_description_service", "qos_overrides")


def check_parameter_file(path: Path, given: Collection[str]) -> None:
    """Refuse a file that would not do, or not alone, what it says.

    Parameters
    ----------
    path : Path
    given : collection of str
        Parameters that are given beside the file and may not stand in it.

    Raises
    ------
    BridgeError
        The file is missing or malformed, has nothing for the bridge, a parameter that the bridge
        does not have, or one of `given`.
    """
    try:
        top = read_yaml(path)
        names = _names(top)
    except RobotError as error:
        raise BridgeError(str(error)) from error
    if not names:
        found = ", ".join(top.keys()) or "nothing"
        raise BridgeError(
            f"{path}: expected parameters below 'can_bridge:' and 'ros__parameters:',"
            f" found {found}"
        )
    known = [rule.name for rule in PARAMETERS]
    for name in names:
        if name in given:
            raise BridgeError(f"{path}: expected '{name}' by its option alone, found it in here")
        if name.split(".")[0] not in (*known, *_OF_EVERY_NODE):
            free = ", ".join(one for one in known if one not in given)
            raise BridgeError(
                f"{path}: expected parameters of can_bridge ({free}), found '{name}'"
            )


def _names(top: Fields) -> list[str]:
    """The parameters that a file sets for the bridge."""
    nodes = [top.fields(node).fields("ros__parameters") for node in NODES if node in top]
    return [name for parameters in nodes for name in parameters.keys()]  # noqa: SIM118 - no dict
