"""The files that fuzzing starts from: the shipped ones, and those of a folder."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from hydro_ident.study.fuzz.targets import LOG, LOG_MAP, NAME, TARGETS, Target, shipped_mapping
from hydro_model.robot_files import shipped_robots


def seeds(target: Target, folder: Path) -> list[bytes]:
    """What edits are made to.

    Parameters
    ----------
    target : Target
    folder : Path
        With a folder per target.

    Returns
    -------
    list of bytes
        Never empty for a target that has shipped files or files in the folder.
    """
    shipped = shipped_robots()[NAME]
    own: Mapping[str, tuple[bytes, ...]] = {
        "robot": (shipped.read_bytes(),),
        "urdf": (shipped.with_name(f"{NAME}.urdf").read_bytes(),),
        "mapping": (shipped_mapping().read_bytes(),),
        "dbc": (shipped_mapping().with_name(f"{NAME}.dbc").read_bytes(),),
        "csv": (LOG.encode(),),
        "log_map": (LOG_MAP.encode(),),
    }
    return [*own.get(target.name, ()), *(path.read_bytes() for path in files(target, folder))]


def files(target: Target, folder: Path) -> list[Path]:
    """A target's files in the corpus, by name."""
    return sorted(p for p in (folder / target.name).glob("*") if p.is_file())


def named(name: str) -> Target:
    """A target by its name."""
    return next(target for target in TARGETS if target.name == name)
