"""The robot that a bag names, or the shipped one whose joints it holds."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from hydro_ident.bag.reader import files_of
from hydro_ident.bag.series import SeriesBuilder
from hydro_model.errors import RobotError
from hydro_model.robot import Robot
from hydro_model.robot_files import is_file, load_robot, read_yaml, shipped_robots
from hydro_msgs_docs.cdr import JOINT_STATE
from hydro_msgs_docs.topics import JOINT_STATES

_SUFFIX = ".hydraulics.yaml"
#: Robot files of a folder that are looked into.
_MOST_FILES = 50
#: Of shipped robots with the same joints the one that is taken.
_DEFAULT = "xs031"
#: Messages of the joints that are looked at for their names: others may publish there, too.
_MOST_MESSAGES = 10_000


@dataclass(frozen=True, slots=True)
class Named:
    """What the name in a bag led to.

    Attributes
    ----------
    robot : Robot or None
        None where no file has that name in it, several have and none is named after it, or the
        one that has is broken.
    troubles : tuple of str
        What is wrong with files that have that name in it, or may have; empty with a robot.
    """

    robot: Robot | None
    troubles: tuple[str, ...] = ()


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
        As `Named.robot`.
    """
    return look_for(metadata, folders).robot


def look_for(metadata: Mapping[str, str], folders: Sequence[Path] = ()) -> Named:
    """The robot that a bag names, or why there is none.

    Parameters
    ----------
    metadata, folders
        As of `named_robot`.

    Returns
    -------
    Named
    """
    named = metadata.get("robot", "")
    # Never a path: what a bag says opens no other file.
    source: str | Path | None = named if named in shipped_robots() else None
    troubles: tuple[str, ...] = ()
    if source is None:
        source, troubles = _file_of(named, folders)
    if source is None:
        return Named(None, troubles)
    try:
        return Named(load_robot(source, narrow=True, bounded=True))
    except RobotError as error:
        return Named(None, (*troubles, str(error)))


def robot_of_joints(names: Collection[str]) -> Robot | None:
    """The shipped robot whose joints have these names, the default one first.

    Parameters
    ----------
    names : collection of str
        Of a topic of joint states: joints, or cylinders whose strokes stand for them.

    Returns
    -------
    Robot or None
        Where no robot is there whole, the one that has all the names there are.
    """
    robots = [load_robot(n) for n in sorted(shipped_robots(), key=lambda n: (n != _DEFAULT, n))]
    whole, parts = list[Robot](), list[Robot]()
    for robot in robots:
        strokes = {c.joint for c in robot.cylinders if c.name in names}
        known = {*robot.joint_names, *(c.name for c in robot.cylinders)}
        whole += [robot] if strokes.union(names).issuperset(robot.joint_names) else []
        parts += [robot] if names and known.issuperset(names) else []
    return next(iter([*whole, *parts]), None)


def robot_by_joints(path: Path) -> Robot | None:
    """The shipped robot whose joints a bag holds, by the names at its beginning.

    Parameters
    ----------
    path : Path
        rosbag2 directory or MCAP file.

    Returns
    -------
    Robot or None
        As of `robot_of_joints`.

    Raises
    ------
    BagError
        As `read_bag`.
    """
    builder, seen, known = SeriesBuilder(JOINT_STATES, JOINT_STATE), 0, 0
    for file in files_of(path)[0]:
        for block in file.blocks():
            channel = block.channel
            if (channel.topic, channel.message_type) != (JOINT_STATES, JOINT_STATE):
                continue
            if channel.encoding == "cdr":
                builder.add(block)
                builder.take()
            seen += len(block.offset)
            if seen >= _MOST_MESSAGES:
                return robot_of_joints(builder.names)
            if len(builder.names) == known:
                continue
            known, robot = len(builder.names), robot_of_joints(builder.names)
            if robot is not None and set(robot.joint_names).issubset(builder.names):
                return robot
    return robot_of_joints(builder.names)


def _file_of(named: str, folders: Sequence[Path]) -> tuple[Path | None, tuple[str, ...]]:
    """The one robot file of folders in which a robot is called so; what is wrong with others."""
    found, troubles = list[Path](), list[str]()
    for path in _files(folders) if named else ():
        try:
            name = read_yaml(path).text("robot")
        except RobotError as error:
            troubles.append(str(error))
            continue
        found += [path] if name == named else []
    own = [path for path in found if path.name == f"{named}{_SUFFIX}"]
    if len(found) > 1 and not own:
        files = ", ".join(str(path) for path in found)
        troubles.append(f"expected one file of robot '{named}', found {len(found)}: {files}")
    return next(iter(own), found[0] if len(found) == 1 else None), tuple(troubles)


def _files(folders: Sequence[Path]) -> Iterator[Path]:
    """Robot files of folders."""
    for folder in dict.fromkeys(folders):
        try:
            files = sorted(folder.glob(f"*{_SUFFIX}"))[:_MOST_FILES]
        except OSError:
            continue
        yield from (path for path in files if is_file(path))
