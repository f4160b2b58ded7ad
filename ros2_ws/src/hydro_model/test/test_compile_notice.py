"""A first run says that it compiles, later ones say nothing."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

PROGRAM = """
import numpy as np
from hydro_model.composite_kernels import solve_spd
assert solve_spd(np.eye(2), np.ones(2))
"""


def test_only_the_first_run_says_that_it_compiles(tmp_path: Path) -> None:
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)}
    said = [
        subprocess.run(
            [sys.executable, "-c", PROGRAM],
            env=environment,
            capture_output=True,
            text=True,
            check=True,
        )
        for _ in range(2)
    ]
    assert said[0].stderr.count("compiling") == 1
    assert (said[0].stdout, said[1].stdout, said[1].stderr) == ("", "", "")
