"""Where numba keeps compiled kernels: the user's cache folder, one per state of the sources.

numba's own cache looks at the file a kernel stands in, not at the files of the kernels it calls,
so after an update it would go on running old code. A folder named after all sources cannot.
"""

from __future__ import annotations

import hashlib
import os
import shutil
from pathlib import Path

#: Working copies and versions whose kernels are kept: those that were used last.
_KEPT = 16


def source_state() -> str:
    """A short name that changes with any source file of this package.

    Kernels elsewhere call only kernels of their own file, for which numba's check suffices.
    """
    digest = hashlib.sha256()
    for file in sorted(Path(__file__).parent.rglob("*.py")):
        status = file.stat()
        digest.update(f"{file} {status.st_size} {status.st_mtime_ns}\n".encode())
    return digest.hexdigest()[:16]


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
