"""Bags that can be read, but have no cycle of the robot: results that say so, and exit code 1."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hydro_ident.commands import diagnose, identify
from hydro_ident.identify.survey import looked_at
from hydro_ident.recordings.sources import bag_source

JOINTS, PRESSURES = "/joint_states", "/chamber_pressures"
CHANNELS = [
    f"{joint}/{kind}" for joint in ("lift", "tilt") for kind in ("force", "flow_a", "flow_b")
]
#: What a bag lacks, and how that is told.
LACKS = {
    "joints": "no /joint_states",
    "stamps": "no stamp of /chamber_pressures is one of /joint_states",
}


def _lacking(write_bag: Any, columns: dict[str, Any], lacks: str) -> Path:
    """A bag without joints, or with pressures in every other cycle and joints in the rest."""
    if lacks == "joints":
        del columns[JOINTS]
    else:
        for topic, first in ((JOINTS, 0), (PRESSURES, 1)):
            for values in columns[topic][1].values():
                values[first::2] = np.nan
    path: Path = write_bag(columns, name=lacks)
    return path


@pytest.mark.needs("clarabel", "plotly")
@pytest.mark.parametrize("lacks", LACKS)
@pytest.mark.parametrize("command", [identify, diagnose], ids=["identify", "diagnose"])
def test_a_bag_without_a_cycle_gives_a_result_of_what_it_lacks(
    write_bag: Any, run_columns: Any, tmp_path: Path, capsys: Any, command: Any, lacks: str
) -> None:
    """It had been refused as unreadable, and nothing was written."""
    bag = _lacking(write_bag, run_columns(100), lacks)
    assert command.run([str(bag), "--robot", "xs031", "--out", str(tmp_path / "out")]) == 1
    found = json.loads((tmp_path / "out" / "result.json").read_text())
    assert found["verdict"] == "not_enough_data"
    assert [loss["channel"] for loss in found["losses"]] == CHANNELS
    assert {(loss["bag"], loss["reason"]) for loss in found["losses"]} == {(lacks, LACKS[lacks])}
    assert len(found["problems"]) == 1
    said = capsys.readouterr()
    assert f"lost: {lacks}: lift/force: {LACKS[lacks]}" in said.out
    assert said.err.splitlines()[-1].endswith(found["problems"][0])
    report = (tmp_path / "out" / "report.html").read_text()
    assert LACKS[lacks] in report
    assert not (tmp_path / "out" / "model.yaml").exists()


def test_a_bag_without_a_cycle_is_left_out_beside_others(
    write_bag: Any, run_columns: Any, robot: Any
) -> None:
    whole = bag_source(write_bag(run_columns(100), name="whole"), robot)
    bare = bag_source(_lacking(write_bag, run_columns(100), "joints"), robot)
    apart = bag_source(_lacking(write_bag, run_columns(100), "stamps"), robot)
    looked = looked_at(robot, [bare, whole], [apart])
    assert (looked.sources, looked.others) == ((whole,), ())
    assert [survey.name for survey in looked.surveys] == ["whole"]
    assert [loss.bag for loss in looked.losses] == ["joints"] * 6 + ["stamps"] * 6
    assert [text.partition(": left out: ")[0] for text in looked.left_out] == ["joints", "stamps"]
    # Where nothing is left, that is the problem, not a note.
    assert looked_at(robot, [bare], [whole]).left_out == ()


@pytest.mark.needs("plotly")
def test_pressures_of_too_short_a_bag_are_not_called_absent(
    write_bag: Any, run_columns: Any, tmp_path: Path, capsys: Any
) -> None:
    """Nothing of one sample is left for the filters, but it is there."""
    arguments = [str(write_bag(run_columns(1))), "--robot", "xs031"]
    assert diagnose.run([*arguments, "--out", str(tmp_path / "out")]) == 1
    said = capsys.readouterr().err
    assert "too few rows in any channel" in said
    assert "no chamber pressures" not in said
