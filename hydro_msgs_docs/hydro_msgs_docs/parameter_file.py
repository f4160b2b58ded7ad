"""ROS parameters files, looked over before anything starts.

ROS passes over, unsaid, what no node of that name declares, and of a value that stands both in a
file and on the command line it takes the one whose node was named last: the command line's goes
below `/**`, which a file may have named before the node itself.
"""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path

from hydro_model.description.fields import Fields
from hydro_model.robot_files import read_yaml
from hydro_msgs_docs.errors import ContractError

#: Where ROS puts what stands on the command line.
_ALL = "/**"
#: What rclpy declares for every node; `qos_overrides` by topic.
_OF_EVERY_NODE = ("use_sim_time", "start_type_description_service", "qos_overrides")


class ParameterFileError(ContractError):
    """A parameters file would not do, or not alone, what it says."""


def check_file(
    path: Path,
    node: str,
    known: Collection[str],
    *,
    given: Collection[str] = (),
    overridden: Collection[str] = (),
) -> None:
    """Refuse a file that would not do, or not alone, what it says.

    Parameters
    ----------
    path : Path
    node : str
        Name of the node that is to have the parameters.
    known : collection of str
        What it declares.
    given : collection of str
        Parameters that are given beside the file and may not stand in it.
    overridden : collection of str
        Parameters that are given beside the file and may stand in it, but not where the file
        would win.

    Raises
    ------
    RobotError
        The file is missing or malformed.
    ParameterFileError
        It has nothing for the node, a parameter that the node does not have, one of `given`, or
        one of `overridden` that would win.
    """
    top = read_yaml(path)
    names = _names(top, node)
    if not names:
        found = ", ".join(top.keys()) or "nothing"
        raise ParameterFileError(
            f"{path}: expected parameters below '{node}:' and 'ros__parameters:', found {found}"
        )
    behind_all = False
    for place, name in names:
        behind_all = behind_all or place == _ALL
        if name in given:
            raise ParameterFileError(
                f"{path}: expected '{name}' by its option alone, found it in here"
            )
        if name in overridden and behind_all and place != _ALL:
            raise ParameterFileError(
                f"{path}: expected '{name}' by its option alone, or '{place}:' before '{_ALL}:',"
                f" found it behind '{_ALL}:', where ROS takes it in place of the option's"
            )
        if name.split(".")[0] not in (*known, *_OF_EVERY_NODE):
            free = ", ".join(one for one in known if one not in given)
            raise ParameterFileError(
                f"{path}: expected parameters of {node} ({free}), found '{name}'"
            )


def _names(top: Fields, node: str) -> list[tuple[str, str]]:
    """The parameters that a file sets for a node, in its order, each with the name it is under."""
    places = (node, f"/{node}", _ALL, "**", "*", "/*")
    return [
        (place, name)
        for place in top.keys()  # noqa: SIM118 - no dict
        if place in places
        for name in top.fields(place).fields("ros__parameters").keys()  # noqa: SIM118
    ]
