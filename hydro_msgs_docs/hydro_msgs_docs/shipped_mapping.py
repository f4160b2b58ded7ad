"""Where the bus mappings lie that this package ships for robots."""

from __future__ import annotations

from pathlib import Path

from hydro_msgs_docs.errors import ContractError


def default_mapping(robot: str) -> Path:
    """The mapping that is shipped for a robot.

    Parameters
    ----------
    robot : str
        Name of the robot.

    Returns
    -------
    Path

    Raises
    ------
    ContractError
        None is shipped.
    """
    name = f"{robot}.mapping.yaml"
    folders = [*_shared_can(), Path(__file__).resolve().parents[1] / "can"]
    for folder in folders:
        if (folder / name).is_file():
            return folder / name
    raise ContractError(
        f"no mapping is shipped for robot '{robot}': expected one by --mapping FILE"
    )


def _shared_can() -> list[Path]:
    try:
        from ament_index_python.packages import (
            PackageNotFoundError,
            get_package_share_directory,
        )
    except ImportError:  # plain Python without a workspace: the source tree has it
        return []
    try:
        return [Path(get_package_share_directory("hydro_msgs_docs")) / "can"]
    except PackageNotFoundError:
        return []
