"""What the project keeps in its bags beside the messages: robot, files, version, note."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from hydro_ident.errors import BagError
from hydro_model.robot import Robot

_MAX_ATTACHMENT_BYTES = 4_000_000


def project_metadata(robot: Robot, note: str, attachments: Sequence[str]) -> dict[str, str]:
    """What the project keeps in its bags beside the messages.

    Parameters
    ----------
    robot : Robot
    note : str
    attachments : sequence of str
        `KEY=FILE`.

    Returns
    -------
    dict of str to str

    Raises
    ------
    BagError
        An attachment that is not `KEY=FILE`, or a file that cannot be read as text.
    """
    metadata = {"robot": robot.name, "software": software_version(), "note": note}
    if robot.source is not None:
        metadata["robot_file"] = text_of(robot.source)
    for attachment in attachments:
        key, _, file = attachment.partition("=")
        if not key or not file:
            raise BagError(f"expected --attach KEY=FILE, found '{attachment}'")
        metadata[key] = text_of(Path(file))
    return metadata


def software_version() -> str:
    """Name and version of what writes."""
    try:
        return f"hydro_ident {version('hydro_ident')}"
    except PackageNotFoundError:
        return "hydro_ident unknown"


def text_of(path: Path) -> str:
    """A text file that is to be kept in a bag.

    Parameters
    ----------
    path : Path

    Returns
    -------
    str

    Raises
    ------
    BagError
        It is too large, no text, or cannot be read.
    """
    try:
        if path.stat().st_size > _MAX_ATTACHMENT_BYTES:
            raise BagError(f"{path}: larger than {_MAX_ATTACHMENT_BYTES} bytes")
        if path.suffix.lower() == ".dbc":
            # As the bridge reads one: its format knows no other encoding.
            return path.read_text(encoding="cp1252", errors="replace")
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise BagError(f"{path}: cannot be attached: {error}") from error
