"""Where numba keeps compiled kernels: the user's cache folder, one per state of the sources.

numba's own cache looks at the file a kernel stands in, not at the files of the kernels it calls
or of the constants it was compiled with, so after an update it would go on running old code. A
folder named after all sources cannot.
"""

from __future__ import annotations

import hashlib
import importlib.util
import os
import shutil
from pathlib import Path

#: Working copies and versions whose kernels are kept: those that were used last.
_KEPT = 16


#: Packages with kernels that take constants and kernels from several of their files; in others
#: each takes what is in its own file and in this package.
_WITH_KERNELS = ("hydro_control", "hydro_hw_bridge")


def source_state() -> str:
    """A short name that changes with any source file that kernels are compiled from."""
    digest = hashlib.sha256()
    for folder in _folders():
        for file in sorted(folder.rglob("*.py")):
            status = file.stat()
            digest.update(f"{file} {status.st_size} {status.st_mtime_ns}\n".encode())
    return digest.hexdigest()[:16]


def _folders() -> list[Path]:
    """Of this package and of those with kernels that are installed, without importing any."""
    found = [importlib.util.find_spec(name) for name in _WITH_KERNELS]
    places = [place for spec in found if spec for place in spec.submodule_search_locations or ()]
    return [Path(__file__).parent, *map(Path, places)]


def use_user_cache() -> None:
    """Point numba at the folder of the sources as they stand, unless the user chose one.

    Has no effect once numba is imported, so `hydro_model` calls it when it is imported itself.
    """
    if "NUMBA_CACHE_DIR" in os.environ:
        return
    base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "hydro_model"
    folder = base / source_state()
    try:
        if not folder.is_dir():
            folder.mkdir(parents=True, exist_ok=True)
            _prune(base)
        # Used now: another copy's process that prunes will not take these away from a run.
        os.utime(folder)
    except OSError:
        return  # no home to write to: numba then compiles anew each time
    os.environ["NUMBA_CACHE_DIR"] = str(folder)


def _prune(base: Path) -> None:
    """Forget the caches of all but the states of the sources that were used last."""
    folders = sorted(base.iterdir(), key=lambda folder: folder.stat().st_mtime, reverse=True)
    for old in folders[_KEPT:]:
        shutil.rmtree(old, ignore_errors=True)
