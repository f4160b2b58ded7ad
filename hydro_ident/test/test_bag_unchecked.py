"""Whatever reads a bag without checksums says so, once for each: its bytes may have changed."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path

import pytest

from hydro_ident.bag.reader import read_bag
from hydro_ident.bag.recording import read_recording
from hydro_ident.commands.diagnose import run as diagnose
from hydro_ident.commands.identify import run as identify
from hydro_ident.commands.inspect import main as inspect
from hydro_ident.commands.tracking import main as tracking
from hydro_ident.identify.recording_summary import recording_summaries
from hydro_ident.identify.survey import survey_source
from hydro_ident.recordings.sources import bag_source
from hydro_ident.report.recording_sections import health_section

SAID = "not checksummed"
Bags = tuple[Path, Path]


@pytest.fixture
def bags(write_bag, run_columns) -> Bags:
    metadata = {"robot": "xs031"}
    one, two = (write_bag(run_columns(600), name=n, metadata=metadata) for n in ("one", "two"))
    return one, two


@pytest.fixture
def unchecked_bags(bags: Bags, without_checksums: Callable[[Path], Path]) -> Bags:
    one, two = (without_checksums(bag) for bag in bags)
    return one, two


def _json(command: Callable[[Sequence[str]], int], folder: Path, *words: object) -> dict:
    """What a command says to programs, whatever it makes of the data."""
    command([*map(str, words), "--json", str(folder / "said.json")])
    said: dict = json.loads((folder / "said.json").read_text())
    return said


@pytest.mark.needs("clarabel", "plotly")
@pytest.mark.parametrize("command", [identify, diagnose])
def test_results_note_it_of_each_bag(
    command: Callable[[Sequence[str]], int], unchecked_bags: Bags, tmp_path: Path, capsys
) -> None:
    one, two = unchecked_bags
    words = (one, "--validate", two, "--robot", "xs031", "--out", tmp_path / "out")
    found = _json(command, tmp_path, *words)
    notes = [note for note in found["notes"] if SAID in note]
    (expected,) = read_bag(one).unchecked
    assert notes == [f"one: {expected}", f"two: {expected}"]
    assert capsys.readouterr().out.count(SAID) == 2
    assert (tmp_path / "out/report.html").read_text().count(f"one: {SAID}") > 0


def test_figures_of_the_tip_warn_of_it(unchecked_bags: Bags, tmp_path: Path, capsys) -> None:
    one, _ = unchecked_bags
    found = _json(tracking, tmp_path, one)
    (expected,) = read_bag(one).unchecked
    assert (found["checksummed"], found["damage"]) == (False, [])
    assert capsys.readouterr().err == f"tracking: warning: {expected}\n"


def test_an_inspection_says_it_and_calls_it_no_damage(
    unchecked_bags: Bags, tmp_path: Path, capsys
) -> None:
    found = _json(inspect, tmp_path, unchecked_bags[0])
    assert (found["checksummed"], found["damage"]) == (False, [])
    assert capsys.readouterr().out.count(SAID) == 1


@pytest.mark.needs("clarabel", "plotly")
def test_nothing_is_said_of_a_bag_whose_checksums_hold(bags: Bags, tmp_path: Path, capsys) -> None:
    one, two = bags
    words = (one, "--validate", two, "--robot", "xs031", "--out", tmp_path / "out")
    for command in (identify, diagnose):
        _json(command, tmp_path, *words)
    assert _json(tracking, tmp_path, one)["checksummed"] is True
    assert _json(inspect, tmp_path, one)["checksummed"] is True
    said = capsys.readouterr()
    assert SAID not in said.out + said.err


def test_data_health_of_a_report_has_it(unchecked_bags: Bags, robot) -> None:
    """Read whole, or in pieces."""
    one, _ = unchecked_bags
    (expected,) = read_bag(one).unchecked
    assert read_recording(one, robot).notes == (expected,)
    summaries = recording_summaries([survey_source(bag_source(one, robot), robot)], 1)
    assert summaries[0].notes == (expected,)
    assert f"one: {expected}" in health_section(summaries, (), robot.joint_names).body
