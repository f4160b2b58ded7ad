"""The robot that a bag names."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from hydro_model.errors import RobotError
from hydro_model.robot import Robot
from hydro_model.robot_files import is_file, load_robot, read_yaml, shipped_robots

_SUFFIX = ".hydraulics.yaml"
#: Robot files of a folder that are looked into.
_MOST_FILES = 50


def named_robot(metadata: Mapping[str, str], folders: Sequence[Path] = ()) -> Robot | None:
    """The shipped robot that a bag names, or that of a robot file in some folders.

    Parameters
    ----------
    metadata : mapping of str to str
        Of the bag.
    folders : sequence of Path
        Whoever asks says where files may be; what the bag says only chooses among them.

    Returns
    -------
    Robot or None
        None where no file has that name in it, or several have and none is named after it.
    """
    named = metadata.get("robot", "")
    # Never a path: what a bag says opens no other file.
    source = named if named in shipped_robots() else _file_of(named, folders)
    if source is None:
        return None
    try:
        return load_robot(source)
    except RobotError:
        return None


def _file_of(named: str, folders: Sequence[Path]) -> Path | None:
    """The one robot file of folders in which a robot is called so."""
    found: list[Path] = []
    for folder in dict.fromkeys(folders) if named else ():
        try:
            files = sorted(folder.glob(f"*{_SUFFIX}"))[:_MOST_FILES]
        except OSError:
            continue
        found += [path for path in files if is_file(path) and _name_in(path) == named]
    own = [path for path in found if path.name == f"{named}{_SUFFIX}"]
    return next(iter(own), found[0] if len(found) == 1 else None)


def _name_in(path: Path) -> str:
    """What a robot file calls its robot; empty where it cannot be read."""
    try:
        return read_yaml(path).text("robot")
    except RobotError:
        return ""
