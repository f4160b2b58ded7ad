"""Diagnosis of a real recording: the EMPS axis with a first model of mass and viscous friction.

A. Janot, M. Gautier, M. Brunot, "Data Set and Reference Models of EMPS", Nonlinear System
Identification Benchmarks, 2019. The data stay where they are; nothing of them is kept here.
"""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from scipy.io import loadmat

from hydro_ident.commands.convert import run as convert
from hydro_ident.mismatch.answer.diagnosis import diagnose
from hydro_ident.mismatch.answer.outcome import Diagnosis
from hydro_ident.recordings.sources import bag_source
from hydro_model.robot_files import load_robot

REAL = os.environ.get("HYDRO_REAL_DATA", "")
DATA = Path(REAL) / "emps" / "DATA_EMPS.mat"
#: What is even in velocity: these look alike in one run.
EVEN = {"constant_force_offset", "asymmetric_friction"}


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> Diagnosis:
    if not REAL or not DATA.is_file():
        pytest.skip(
            "takes one to two minutes: set HYDRO_REAL_DATA to the folder that holds"
            f" emps/DATA_EMPS.mat (now '{REAL}')"
        )
    folder = tmp_path_factory.mktemp("emps")
    mapping = {
        "robot": "emps",
        "time": {"signal": "t"},
        "joints": {"carriage": {"signal": "qm", "unit": "m"}},
        "efforts": {
            "carriage": {"signal": "vir", "scale": float(loadmat(DATA)["gtau"].item()),
                         "unit": "N"}
        },
    }  # fmt: skip
    (folder / "map.yaml").write_text(yaml.safe_dump(mapping))
    arguments = [str(DATA), "--map", str(folder / "map.yaml"), "--out", str(folder / "bag")]
    assert convert(arguments) == 0
    robot = replace(load_robot("emps"), effects=())
    return diagnose(robot, [bag_source(folder / "bag", robot)])


def test_coulomb_friction_and_what_is_even_in_velocity_are_found(found: Diagnosis) -> None:
    names = [f.named.names for f in found.findings]
    assert any("coulomb_friction" in n for n in names)
    assert any(EVEN & set(n) for n in names)
    coulomb = next(f for f in found.findings if "coulomb_friction" in f.named.names)
    assert coulomb.named.first.term.parameters[0] == pytest.approx(20.4, rel=0.1)


def test_offset_and_direction_dependent_friction_are_told_apart(found: Diagnosis) -> None:
    even = next(f.named for f in found.findings if EVEN & set(f.named.names))
    assert even.names == ("asymmetric_friction",)
    assert even.first.term.parameters[1] == pytest.approx(-39.3, rel=0.15)


def test_held_out_blocks_are_predicted_to_a_few_percent(found: Diagnosis) -> None:
    channel = found.channels[0]
    size = np.linalg.norm(channel.measured)
    before = np.linalg.norm(channel.measured - channel.before) / size
    after = np.linalg.norm(channel.measured - channel.after) / size
    assert before > 0.15
    assert after < 0.04
