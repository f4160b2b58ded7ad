"""Where numba keeps compiled kernels: the user's cache folder, one per state of the sources.

numba's own cache looks at the file a kernel stands in, not at the files of the kernels it calls
or of the constants it was compiled with, so after an update it would go on running old code. A
folder named after all sources cannot.
"""

from __future__ import annotations

import atexit
import hashlib
import importlib.util
import os
import shutil
import tempfile
from pathlib import Path

#: Working copies and versions whose kernels are kept: those that were used last.
_KEPT = 16
#: What the name of a folder begins with that one run has for itself.
_PASSING = "hydro_model_kernels_"

#: Packages with kernels that take constants and kernels from several of their files; in others
#: each takes what is in its own file and in `hydro_model`.
_WITH_KERNELS = ("hydro_model", "hydro_control", "hydro_hw_bridge")


def source_state() -> str:
    """A short name that changes with any source file that kernels are compiled from."""
    digest = hashlib.sha256()
    for folder in _folders():
        for file in sorted(folder.rglob("*.py")):
            status = file.stat()
            digest.update(f"{file} {status.st_size} {status.st_mtime_ns}\n".encode())
    return digest.hexdigest()[:16]


def _folders() -> list[Path]:
    """Of the packages with kernels that are installed, without importing any."""
    found = [importlib.util.find_spec(name) for name in _WITH_KERNELS]
    places = [place for spec in found if spec for place in spec.submodule_search_locations or ()]
    return [Path(place) for place in places]


def use_user_cache() -> None:
    """Point numba at the folder of the sources as they stand, unless the user chose one.

    Has no effect once numba is imported, so `hydro_model` calls it when it is imported itself.
    Where there is no home, or none that can be written to, what is compiled is kept for this
    process and those that it starts.
    """
    if "NUMBA_CACHE_DIR" in os.environ:
        return
    try:
        folder = _user_folder()
    except (OSError, RuntimeError):  # the latter: nobody knows where the home is
        # Not numba's own choice, beside the sources: kernels of older ones may lie there.
        folder = _folder_of_this_run()
    os.environ["NUMBA_CACHE_DIR"] = str(folder)


def is_kept(folder: str) -> bool:
    """Whether what lies in a cache folder is there for later runs.

    Parameters
    ----------
    folder : str
    """
    return not Path(folder).name.startswith(_PASSING)


def _user_folder() -> Path:
    base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "hydro_model"
    folder = base / source_state()
    fresh = not folder.is_dir()
    folder.mkdir(parents=True, exist_ok=True)
    # Used now: another copy's process that prunes will not take these away from a run.
    os.utime(folder)
    if fresh:
        _prune(base)
    return folder


def _folder_of_this_run() -> Path:
    folder, owner = Path(tempfile.mkdtemp(prefix=_PASSING)), os.getpid()

    def forget() -> None:
        if os.getpid() == owner:  # not where a fork of it ends
            shutil.rmtree(folder, ignore_errors=True)

    atexit.register(forget)
    return folder


def _prune(base: Path) -> None:
    """Forget the caches of all but the states of the sources that were used last."""
    for old in sorted(base.iterdir(), key=_last_used, reverse=True)[_KEPT:]:
        shutil.rmtree(old, ignore_errors=True)


def _last_used(folder: Path) -> float:
    try:
        return folder.stat().st_mtime
    except OSError:  # another process that prunes was quicker
        return 0.0
