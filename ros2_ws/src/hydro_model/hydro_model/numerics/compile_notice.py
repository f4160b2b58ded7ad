"""Says once that numba compiles, so that a first run does not look as if it hung."""

from __future__ import annotations

import sys
from typing import Any

from numba.core import config, event

from hydro_model.numerics.compile_cache import is_kept


def notice(module: str, folder: str) -> str:
    """What is said.

    Parameters
    ----------
    module : str
        Of the kernel that is compiled first.
    folder : str
        Where compiled kernels are kept; empty where numba finds a place itself.

    Returns
    -------
    str
    """
    # Which other kernels this run will need nobody knows yet.
    kept = f"; kept in {folder} for later runs" if folder else ""
    if not is_kept(folder):
        kept = "; for this run alone: no cache folder can be written to (XDG_CACHE_HOME names one)"
    return (
        f"hydro_model: compiling kernels of {module} and what else no earlier run of these"
        f" sources has needed (seconds to two minutes){kept}"
    )


class _Notice(event.Listener):
    """Speaks at the first compilation of the process and then listens no more."""

    def on_start(self, event_: Any) -> None:
        event.unregister("numba:compile", self)
        module = event_.data["dispatcher"].py_func.__module__
        print(notice(module, config.CACHE_DIR), file=sys.stderr, flush=True)

    def on_end(self, event_: Any) -> None:
        """Nothing to say."""


def announce_compilation() -> None:
    """Print a line on stderr when a kernel is compiled that the user's cache does not hold."""
    event.register("numba:compile", _Notice())
