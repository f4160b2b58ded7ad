"""The loaders under test, each as a function that reads one file and what surrounds it."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from hydro_ident.bag.playback import messages
from hydro_ident.bag.reader import METADATA_FILE, read_bag
from hydro_ident.bag.streaming import stream_recordings
from hydro_ident.commands.inspect import text_of
from hydro_ident.inspecting.inspection_reading import inspect_bag
from hydro_ident.logs.convert import convert
from hydro_ident.logs.file import read_log
from hydro_ident.logs.map import read_map
from hydro_model.errors import HydroError
from hydro_model.robot import Robot
from hydro_model.robot_files import load_robot, shipped_robots

NAME = "xs031"
LOG_MAP = """\
schema: hydro_ident/log_map/1
robot: xs031
time: {signal: t, unit: ms}
joints:
  lift: {signal: lift, unit: deg}
  tilt: {signal: tilt, unit: deg, sign: -1}
pressures:
  lift_cylinder/a: {signal: pa, unit: bar, reference: gauge}
valves:
  lift_valve: {signal: u}
"""
LOG = "t,lift,tilt,pa,u,remark\n0,10,20,30,0.5,begin\n2,10.5,20.5,31,,\n4,11,21,32,0.7,\n"


@dataclass(frozen=True, slots=True)
class Target:
    """A loader.

    Attributes
    ----------
    name : str
        Also of its folder in the corpus.
    suffix : str
        Of its files.
    read : callable
        Reads a file in a folder of its own; raises HydroError where it is no good.
    """

    name: str
    suffix: str
    read: Callable[[Path], object]


@cache
def _robot() -> Robot:
    return load_robot(NAME)


def _bag(path: Path) -> None:
    inspection = inspect_bag(path, _robot())
    json.dumps(inspection.as_dict())
    text_of(inspection)
    for _ in messages(path):
        pass
    for _ in stream_recordings(path, _robot()):
        pass


def _bag_metadata(path: Path) -> None:
    """`path` is to be a metadata.yaml; a sound file of messages lies beside it."""
    folder = path.parent / "bag"
    folder.mkdir(exist_ok=True)
    shutil.copy(path, folder / METADATA_FILE)
    (file,) = path.parent.glob("*.mcap")
    shutil.copy(file, folder / "bag_0.mcap")
    read_bag(folder)


def _robot_file(path: Path) -> None:
    beside = shipped_robots()[NAME].parent / f"{NAME}.urdf"
    shutil.copy(beside, path.parent / beside.name)
    load_robot(path)


def _urdf(path: Path) -> None:
    shipped = shipped_robots()[NAME]
    text = shipped.read_text(encoding="utf-8").replace(f"{NAME}.urdf", path.name)
    robot = path.parent / "robot.yaml"
    robot.write_text(text, encoding="utf-8")
    load_robot(robot)


def shipped_mapping() -> Path:
    """The mapping that is shipped for the reference crane; its DBC lies beside it."""
    from hydro_msgs_docs.shipped_mapping import default_mapping

    return default_mapping(NAME)


def _dbc(path: Path) -> None:
    from hydro_hw_bridge.protocol.codec import Codec

    Codec.load(path, shipped_mapping(), _robot())


def _mapping(path: Path) -> None:
    from hydro_hw_bridge.protocol.codec import Codec

    shutil.copy(shipped_mapping().with_name(f"{NAME}.dbc"), path.parent)
    Codec.load(None, path, _robot())


def _csv(path: Path) -> None:
    mapping = path.parent / "log.map.yaml"
    mapping.write_text(LOG_MAP, encoding="utf-8")
    _converted(path, mapping)


def _log_map(path: Path) -> None:
    log = path.parent / "log.csv"
    log.write_text(LOG, encoding="utf-8")
    _converted(log, path)


def _converted(log: Path, mapping: Path) -> None:
    out = log.parent / "converted"
    shutil.rmtree(out, ignore_errors=True)
    read = read_map(mapping)
    convert(read_log(log, read.layout), read, out, {})
    read_bag(out)


TARGETS: tuple[Target, ...] = (
    Target("bag", ".mcap", _bag),
    Target("bag_metadata", ".yaml", _bag_metadata),
    Target("robot", ".yaml", _robot_file),
    Target("urdf", ".urdf", _urdf),
    Target("dbc", ".dbc", _dbc),
    Target("mapping", ".yaml", _mapping),
    Target("csv", ".csv", _csv),
    Target("log_map", ".yaml", _log_map),
)


def outcome(target: Target, path: Path) -> str:
    """What a loader makes of a file.

    Parameters
    ----------
    target : Target
    path : Path

    Returns
    -------
    str
        Empty where it was read, else the one line of the error.

    Raises
    ------
    AssertionError
        The error is no clear line.
    Exception
        Whatever else the loader lets out: a finding.
    """
    try:
        target.read(path)
    except HydroError as error:
        text = str(error)
        assert text.strip(), "an error that says nothing"
        assert len(text) < 3000, f"an error of {len(text)} characters"
        return text
    return ""
