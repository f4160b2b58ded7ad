"""What there is in the place of a bag that is not there."""

from __future__ import annotations

from pathlib import Path

_SHOWN = 5


def bags_beside(path: Path) -> str:
    """The bags of the folder in which one is missing, for a message.

    Parameters
    ----------
    path : Path
        Of the missing bag.

    Returns
    -------
    str
    """
    if not path.parent.is_dir():
        return f"there is no folder '{path.parent}'"
    try:
        names = {file.parent.name for file in path.parent.glob("*/*.mcap")}
        names |= {file.name for file in path.parent.glob("*.mcap")}
    except OSError as error:
        return f"'{path.parent}' cannot be read: {error.strerror}"
    where = "the present folder" if path.parent == Path() else f"'{path.parent}'"
    found = sorted(names)
    rest = f" and {len(found) - _SHOWN} more" if len(found) > _SHOWN else ""
    return f"bags in {where}: {', '.join(found[:_SHOWN]) or 'none'}{rest}"
