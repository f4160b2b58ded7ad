"""A ROS parameters file for the controller, looked over before anything starts."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path

from hydro_control.errors import ControlError
from hydro_control.node.parameters import PARAMETERS
from hydro_model.errors import HydroError
from hydro_msgs_docs.parameter_file import check_file


def check_parameter_file(path: Path, overridden: Collection[str]) -> None:
    """Refuse a file that would not do, or not alone, what it says.

    Parameters
    ----------
    path : Path
    overridden : collection of str
        Parameters that are given beside the file. They may stand in it, as the robot does in the
        `controller.yaml` of an identification, but not where the file would win.

    Raises
    ------
    ControlError
        The file is missing or malformed, has nothing for the controller, a parameter that the
        controller does not have, or one of `overridden` that would win.
    """
    try:
        known = [one.name for one in PARAMETERS]
        check_file(path, "controller", known, overridden=overridden)
    except HydroError as error:
        raise ControlError(str(error)) from error
