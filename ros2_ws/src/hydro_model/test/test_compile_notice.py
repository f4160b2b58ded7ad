"""A run that compiles says what and where that is kept, one that need not says nothing."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from hydro_model.numerics.compile_notice import notice

FIRST = """
import numpy as np
from hydro_model.numerics.linear_kernels import solve_spd
assert solve_spd(np.eye(2), np.ones(2))
"""
FURTHER = """
import numpy as np
from hydro_model.numerics.kernel import copy
copy(np.ones(2), np.empty(2))
"""


def said_by(program: str, cache: Path) -> str:
    done = subprocess.run(
        [sys.executable, "-c", program],
        env=os.environ | {"NUMBA_CACHE_DIR": str(cache)},
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout == ""
    return done.stderr


def test_only_the_first_run_says_that_it_compiles(tmp_path: Path) -> None:
    expected = notice("hydro_model.numerics.linear_kernels", str(tmp_path)) + "\n"
    assert [said_by(FIRST, tmp_path) for _ in range(2)] == [expected, ""]


@pytest.mark.thorough
def test_a_run_that_needs_further_kernels_names_those(tmp_path: Path) -> None:
    # What the first run kept does not make the line of the second untrue.
    said_by(FIRST, tmp_path)
    further = said_by(FURTHER, tmp_path)
    assert further.startswith("hydro_model: compiling kernels of hydro_model.numerics.kernel and ")
    assert said_by(FIRST + FURTHER, tmp_path) == ""


def test_no_folder_is_promised_where_none_is_known() -> None:
    assert "kept" not in notice("hydro_model.numerics.kernel", "")


def test_what_is_kept_for_one_run_alone_is_said_so() -> None:
    said = notice("hydro_model.numerics.kernel", "/tmp/hydro_model_kernels_x1")
    assert "kept in" not in said
    assert "for this run alone" in said
