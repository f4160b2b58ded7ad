"""Where nothing was held out there are no scores, and that is said, not shown as a number."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import yaml

from hydro_ident.commands.identify import run
from hydro_model.robot_files import load_robot

SAID = "nothing was held out: everything was fitted, nothing is scored"


@pytest.mark.needs("clarabel", "plotly")
def test_no_score_is_written_and_the_files_say_so(
    bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    assert run([str(bag), "--robot", "xs031", "--out", str(out), "--hold-out", "0"]) == 0
    told = capsys.readouterr().out
    assert f"note: {SAID}" in told
    assert "RMSE" not in told.split("free run")[0]
    result = json.loads((out / "result.json").read_text())
    assert result["channels"] == {}
    assert SAID in result["notes"]
    joints = ("lift", "tilt")
    assert set(result["training"]) == {
        f"{j}/{kind}" for j in joints for kind in ("force", "flow_a", "flow_b")
    }
    # No score tells what is noise: for later comparisons the whole residual is what was left out.
    known = {p["name"] for p in result["parameters"] if p["identifiable"]}
    assert not any(p["model_error"] for p in result["parameters"])
    model = yaml.safe_load((out / "model.yaml").read_text())
    assert model["model_error"].keys() == known
    assert all(0.0 < error < float("inf") for error in model["model_error"].values())
    assert load_robot(out / "model.yaml").base_parameters
    page = (out / "report.html").read_text()
    assert "Nothing was scored on rows that took no part in the fit" in page
    assert SAID in page
