"""The sources that a run of the campaign is of: what it says holds for these alone."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from hydro_ident.study.sources import differing, digests_of

#: Of the repository: the bridge with rig and faults, the campaign itself, the controller, whose
#: core answers every third injection, and what these stand on.
FOLDERS = (
    "hydro_hw_bridge/hydro_hw_bridge",
    "hydro_ident/hydro_ident/study/faults",
    "hydro_control/hydro_control",
    "hydro_msgs_docs/hydro_msgs_docs",
    "ros2_ws/src/hydro_model/hydro_model",
)
#: What runs beside in wall time alone: recorder and identification node, and the bag that is read.
BESIDE = (
    "hydro_ident/hydro_ident/identification_node.py",
    "hydro_ident/hydro_ident/bag/definitions.py",
    "hydro_ident/hydro_ident/bag/metadata.py",
    "hydro_ident/hydro_ident/bag/provenance.py",
    "hydro_ident/hydro_ident/bag/publisher_numbers.py",
    "hydro_ident/hydro_ident/bag/reader.py",
    "hydro_ident/hydro_ident/bag/recorder.py",
    "hydro_ident/hydro_ident/bag/recorder_summary.py",
    "hydro_ident/hydro_ident/bag/recorder_topics.py",
    "hydro_ident/hydro_ident/bag/writer.py",
)
#: Makes no frame and no command: calibration, which is run by itself, what draws and lays out for
#: viewers, and what makes this page.
LEFT_OUT = (
    "layout_files.py",
    "layouts_command.py",
    "live_layouts.py",
    "rviz_files.py",
    "visual_command.py",
    "visual_node.py",
    "visual_urdf.py",
    "calibrate.py",
    "calibration_session.py",
    "calibration_steps.py",
    "page.py",
    "sources.py",
)


def digests(root: Path, *, wall: bool = False) -> dict[str, str]:
    """SHA-256 of every source by its path from the repository's top.

    Parameters
    ----------
    root : Path
        That top.
    wall : bool
        Of a run in wall time, which has more processes.
    """
    paths = [path for folder in FOLDERS for path in (root / folder).rglob("*.py")]
    if wall:
        paths += [root / name for name in BESIDE if (root / name).is_file()]
    return digests_of(root, paths, LEFT_OUT)


def changed(then: Mapping[str, str], root: Path, *, wall: bool = False) -> list[str]:
    """Sources that are others than those of a run, are new, or are gone.

    Parameters
    ----------
    then : mapping of str to str
        `digests` as a run wrote them down.
    root : Path
    wall : bool
        As of `digests`.
    """
    return differing(then, digests(root, wall=wall))
