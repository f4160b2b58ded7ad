"""A real recording: the EMPS axis against its published reference model.

A. Janot, M. Gautier, M. Brunot, "Data Set and Reference Models of EMPS", Nonlinear System
Identification Benchmarks, 2019. The data stay where they are; nothing of them is kept here.
"""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np
import pytest
import yaml
from scipy.io import loadmat

from hydro_ident.commands.convert import run as convert
from hydro_ident.commands.identify import run as identify

#: Recordings of real machines: named by this variable, or beside the repository.
FOLDER = "HYDRO_REAL_DATA"
REAL = Path(os.environ.get(FOLDER) or Path(__file__).parents[3] / "shared" / "real")
DATA = REAL / "emps" / "DATA_EMPS.mat"

pytestmark = pytest.mark.needs("clarabel")

#: Published values and how close the issue asks to come.
REFERENCE = {
    "carriage_link.mass": (95.1, 0.01),
    "carriage.viscous_friction": (203.5, 0.01),
    "carriage.coulomb_friction.force": (20.4, 0.01),
    "carriage.constant_force_offset.force": (-3.16, 0.02),
}
#: Estimator of the reference: ordinary least squares, 4th-order zero-phase 50 Hz Butterworth on
#: both sides, no decimation.
SETTINGS = [
    *("--estimator", "ols", "--differentiation-cutoff", "50", "--parallel-cutoff", "50"),
    *("--filter-order", "4", "--decimation", "1"),
]


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    if not DATA.is_file():
        pytest.skip(f"no recording of the EMPS axis at {DATA} ({FOLDER} names the folder)")
    folder = tmp_path_factory.mktemp("emps")
    gain = float(loadmat(DATA)["gtau"].item())
    mapping = {
        "robot": "emps",
        "time": {"signal": "t"},
        "joints": {"carriage": {"signal": "qm", "unit": "m"}},
        "efforts": {"carriage": {"signal": "vir", "scale": gain, "unit": "N"}},
        "references": {"carriage": {"signal": "qg", "unit": "m"}},
    }
    (folder / "map.yaml").write_text(yaml.safe_dump(mapping))
    arguments = [str(DATA), "--map", str(folder / "map.yaml"), "--out", str(folder / "bag")]
    assert convert(arguments) == 0
    return folder / "bag"


def test_the_published_reference_model_is_recovered(bag: Path, tmp_path: Path) -> None:
    arguments = [
        str(bag),
        "--robot",
        "emps",
        *SETTINGS,
        "--hold-out",
        "0",
        "--out",
        str(tmp_path / "out"),
    ]
    assert identify(arguments) == 0
    result = json.loads((tmp_path / "out" / "result.json").read_text())
    assert result["verdict"] == "identified"
    found = {p["name"]: p for p in result["parameters"]}
    assert set(found) == set(REFERENCE)
    for name, (value, share) in REFERENCE.items():
        p = found[name]
        assert p["identifiable"]
        assert p["value"] == pytest.approx(value, rel=share), name
        low, high = p["ci95"]
        assert low < value < high, name
        assert p["std"] > 0.0
    assert [p["unit"] for p in result["parameters"]] == ["kg", "N s/m", "N", "N"]


def test_held_out_blocks_are_predicted_and_rolled_out(bag: Path, tmp_path: Path) -> None:
    arguments = [str(bag), "--robot", "emps", *SETTINGS, "--out", str(tmp_path / "out")]
    assert identify(arguments) == 0
    result = json.loads((tmp_path / "out" / "result.json").read_text())
    channel = result["channels"]["carriage/torque"]
    assert channel["unit"] == "N"
    assert channel["fit_after_pct"] > 95.0
    assert channel["rollout_unit"] == "m"
    # The drive's force alone moves the carriage to within millimetres over seconds.
    assert channel["rollout_rmse_after"] < min(0.01, channel["rollout_rmse_before"])
    model = yaml.safe_load((tmp_path / "out" / "model.yaml").read_text())
    assert set(model["standard_deviations"]) == set(REFERENCE) - {"carriage_link.mass"}
    assert np.isfinite(list(model["standard_deviations"].values())).all()
