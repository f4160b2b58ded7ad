"""Keeping a process out of a folder by the system's own means, not by its good will.

A process in a mount namespace of its own sees an empty, read-only file system in the folder's
place. It holds no capability with which it could look behind that, or get one by a program it
starts. Linux with user namespaces (or root) can do this; elsewhere `secluded` says that it cannot.
"""

from __future__ import annotations

import functools
import shutil
import subprocess
import tempfile
from collections.abc import Sequence
from pathlib import Path

_TOOLS = ("unshare", "mount", "setpriv", "sh")
#: Covers the folder, gives every capability up (for good: what it starts gets none back), and
#: becomes the program.
_SCRIPT = (
    'mount -t tmpfs -o ro,size=4k,mode=555 none "$1" && shift'
    ' && exec setpriv --bounding-set=-all --inh-caps=-all --no-new-privs -- "$@"'
)
_PATIENCE_S = 20.0


def secluded(command: Sequence[str], folder: Path) -> list[str] | None:
    """A command that runs another where a folder cannot be read.

    Parameters
    ----------
    command : sequence of str
    folder : Path
        Must exist; the command's working directory may not lie in it.

    Returns
    -------
    list of str or None
        None where the system cannot keep a process out.
    """
    if not can_seclude():
        return None
    return _covering(command, folder)


def _covering(command: Sequence[str], folder: Path) -> list[str]:
    start = ["unshare", "--user", "--map-root-user", "--mount", "--propagation", "private"]
    return [*start, "sh", "-c", _SCRIPT, "sh", str(folder.resolve()), *command]


@functools.cache
def can_seclude() -> bool:
    """Whether this system can keep a process out of a folder: tried once."""
    if any(shutil.which(tool) is None for tool in _TOOLS):
        return False
    with tempfile.TemporaryDirectory() as place:
        hidden = Path(place) / "hidden"
        hidden.mkdir()
        (hidden / "file").write_text("seen", encoding="utf-8")
        command = _covering(["sh", "-c", 'test ! -e "$0"', str(hidden / "file")], hidden)
        try:
            done = subprocess.run(
                command, cwd="/", capture_output=True, timeout=_PATIENCE_S, check=False
            )
        except (OSError, subprocess.TimeoutExpired):
            return False
    return done.returncode == 0
