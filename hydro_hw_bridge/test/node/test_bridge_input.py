"""`can_bridge` and what it is told: one clear line where it cannot be used."""

from __future__ import annotations

import subprocess
from collections.abc import Callable

import pytest

from hydro_hw_bridge.node.parameters import PARAMETERS, markdown_table

pytestmark = pytest.mark.ros

Run = Callable[..., subprocess.CompletedProcess[str]]


@pytest.mark.parametrize(
    ("parameter", "text"),
    [
        ("robot:=nowhere", "no robot file 'nowhere'"),
        ("mapping:=/nowhere.yaml", "no mapping file '/nowhere.yaml'"),
        ("dbc:=/nowhere.dbc", "no DBC file '/nowhere.dbc'"),
        ("calibration:=/nowhere.yaml", "no calibration file '/nowhere.yaml'"),
        ("can:=can77", "cannot open CAN bus socketcan:can77"),
        ("clock:=sundial", "should be one of real_time, lockstep, found 'sundial'"),
        ("max_age_ms:=0.0", "max_age_ms should be a number with a decimal point from 2 to"),
        (
            "slew_limit_v_s:=fast",
            "with a decimal point from 1 to 100000, found 'fast'",
        ),
        ("required_subscribers:=all", "'required_subscribers' should be"),
    ],
)
def test_bad_input_is_one_line_and_exit_2(
    can_name: str, parameter: str, text: str, within: Run, run_bridge: Run
) -> None:
    """One of them as a process of its own, too."""
    for run in (within, run_bridge) if "robot:=" in parameter else (within,):
        done = run(can_name, parameter)
        assert done.returncode == 2
        assert done.stdout == ""
        assert done.stderr.startswith("can_bridge: ")
        assert text in done.stderr
        assert done.stderr.count("\n") == 1


def test_help_names_every_parameter(executable: str) -> None:
    done = subprocess.run([executable, "--help"], capture_output=True, text=True, check=False)
    assert done.returncode == 0
    for rule in PARAMETERS:
        assert rule.name in done.stdout
        assert f"`{rule.name}`" in markdown_table()
    wrong = subprocess.run([executable, "--wrong"], capture_output=True, text=True, check=False)
    assert wrong.returncode == 2
