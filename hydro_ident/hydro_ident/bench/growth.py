"""How time and memory of the streaming commands grow with the length of a bag."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from hydro_ident.study.long_bag import measure

#: Commands that take a bag of any length.
COMMANDS = ("inspect", "identify")


def exponents(minutes: Sequence[float], folder: Path, command: str) -> tuple[float, float]:
    """Exponents of time and of peak memory of a command over the length of its bag.

    Parameters
    ----------
    minutes : sequence of float
        At least two lengths.
    folder : Path
        Where the bags go for a while.
    command : str
        One of `COMMANDS`.

    Returns
    -------
    float
        Slope of log time over log length: 1 is linear.
    float
        That of peak memory: 0 is flat.
    """
    runs = [measure(length, folder, command) for length in minutes]
    length = np.log([one.minutes for one in runs])
    time, memory = np.log([one.seconds for one in runs]), np.log([one.peak_mb for one in runs])
    return float(np.polyfit(length, time, 1)[0]), float(np.polyfit(length, memory, 1)[0])
