"""The sources that a run of the campaign is of: what it says holds for these alone."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from hydro_ident.study.sources import differing, digests_of

#: Of the repository: the bridge with rig and faults, and the campaign itself.
FOLDERS = ("hydro_hw_bridge/hydro_hw_bridge", "hydro_ident/hydro_ident/study/faults")
#: Makes no frame and no command: calibration, which is run by itself, and what makes this page.
LEFT_OUT = (
    "calibrate.py",
    "calibration_session.py",
    "calibration_steps.py",
    "page.py",
    "sources.py",
)


def digests(root: Path) -> dict[str, str]:
    """SHA-256 of every source by its path from the repository's top.

    Parameters
    ----------
    root : Path
        That top.
    """
    paths = (path for folder in FOLDERS for path in (root / folder).rglob("*.py"))
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
