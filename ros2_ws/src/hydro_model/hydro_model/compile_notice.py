"""Says once that numba compiles, so that a first run does not look as if it hung."""

from __future__ import annotations

import sys
from typing import Any

from numba.core import event


class _Notice(event.Listener):
    """Speaks at the first compilation of the process and then listens no more."""

    def on_start(self, event_: Any) -> None:
        event.unregister("numba:compile", self)
        print(
            "hydro_model: compiling its kernels, once per version of the sources"
            " (about half a minute)",
            file=sys.stderr,
            flush=True,
        )

    def on_end(self, event_: Any) -> None:
        """Nothing to say."""


def announce_compilation() -> None:
    """Print a line on stderr when a kernel is compiled that the user's cache does not hold."""
    event.register("numba:compile", _Notice())
