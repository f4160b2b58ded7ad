"""What a folder of results held before: it is replaced, and that is said.

The same command may be run again and again into one folder, and the same input gives the same
result, so that nothing is refused.
"""

from __future__ import annotations

import json
from datetime import datetime
from pathlib import Path

from hydro_ident.identify.results import RESULT_FILE
from hydro_model.errors import printable


def earlier_result(folder: Path) -> str:
    """A result that a folder holds, as a line.

    Parameters
    ----------
    folder : Path

    Returns
    -------
    str
        When it was written and by which command; empty where there is none.
    """
    file = folder / RESULT_FILE
    try:
        written = datetime.fromtimestamp(file.stat().st_mtime).astimezone()
    except OSError:
        return ""
    said = f"{written:%Y-%m-%d %H:%M}"
    try:
        command = str(json.loads(file.read_bytes())["provenance"]["command"])
    except (OSError, ValueError, KeyError, TypeError):
        return said  # Something else's file, or one that was cut: the date is what is known.
    return f"{said} ({printable(command)})"
