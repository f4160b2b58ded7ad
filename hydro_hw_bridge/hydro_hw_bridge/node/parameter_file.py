"""A ROS parameters file for the bridge, looked over before anything starts."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path

from hydro_hw_bridge.errors import BridgeError
from hydro_hw_bridge.node.parameters import PARAMETERS
from hydro_model.errors import HydroError
from hydro_msgs_docs.parameter_file import check_file


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
        check_file(path, "can_bridge", [rule.name for rule in PARAMETERS], given=given)
    except HydroError as error:
        raise BridgeError(str(error)) from error
