"""The sources that a run of the campaign is of: loaders, and the campaign itself."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from hydro_ident.study.sources import differing, digests_of

#: Of the repository: folders with all their modules, and single modules of the others.
FOLDERS = (
    "hydro_ident/hydro_ident/bag",
    "hydro_ident/hydro_ident/logs",
    "hydro_ident/hydro_ident/inspecting",
    "hydro_ident/hydro_ident/study/fuzz",
)
MODULES = {
    "hydro_ident/hydro_ident": ("commands/inspect",),
    "hydro_hw_bridge/hydro_hw_bridge/protocol": ("codec", "e2e", "layout", "mapping", "signals"),
    "hydro_msgs_docs/hydro_msgs_docs": ("cdr",),
    "ros2_ws/src/hydro_model/hydro_model": (
        *(
            "description/fields",
            "robot",
            "description/robot_checks",
            "robot_files",
            "description/safe_yaml",
            "description/urdf",
            "description/urdf_xml",
        ),
    ),
}
#: Read no file of other people's.
LEFT_OUT = ("recorder.py", "recorder_summary.py", "recorder_topics.py", "player.py", "sources.py")


def digests(root: Path) -> dict[str, str]:
    """SHA-256 of every source by its path from the repository's top.

    Parameters
    ----------
    root : Path
        That top.
    """
    paths = [path for folder in FOLDERS for path in (root / folder).rglob("*.py")]
    paths += [root / top / f"{name}.py" for top, names in MODULES.items() for name in names]
    return digests_of(root, paths, LEFT_OUT)


def changed(then: Mapping[str, str], root: Path) -> list[str]:
    """Sources that are others than those of a run, are new, or are gone.

    Parameters
    ----------
    then : mapping of str to str
        `digests` as a run wrote them down.
    root : Path
    """
    return differing(then, digests(root))
