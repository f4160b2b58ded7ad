"""The sources that a run of the campaign is of: what it says holds for these alone."""

from __future__ import annotations

import ast
from collections.abc import Iterable, Mapping
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
#: What runs beside in wall time alone, of a package: recorder and identification node, and what
#: reads their bags. With whatever these import.
PACKAGE = "hydro_ident"
BESIDE = (
    "hydro_ident/hydro_ident/identify/identification_node.py",
    "hydro_ident/hydro_ident/bag/reader.py",
    "hydro_ident/hydro_ident/bag/recorder.py",
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
    # Of what runs beside nothing is left out: names are those of other folders there.
    beside = with_imports(root, BESIDE) if wall else []
    return digests_of(root, paths, LEFT_OUT) | digests_of(root, beside, ())


def with_imports(root: Path, names: Iterable[str]) -> list[Path]:
    """Sources of the package and all of it that they import, at their head or inside functions.

    Parameters
    ----------
    root : Path
        The repository's top.
    names : iterable of str
        Paths below it. What is not there is left out.
    """
    found: dict[Path, None] = {}
    left = [root / name for name in names]
    while left:
        path = left.pop()
        if path in found or not path.is_file():
            continue
        found[path] = None
        modules = _imported(path)
        places = [root / PACKAGE / module.replace(".", "/") for module in modules]
        left += [
            one for place in places for one in (place.with_suffix(".py"), place / "__init__.py")
        ]
    return list(found)


def _imported(path: Path) -> set[str]:
    """Names of the package's modules that one imports, and of what it takes out of them."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
    return {name for name in names if name.split(".")[0] == PACKAGE}


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
