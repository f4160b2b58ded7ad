"""Bags given on a command line: each once, under a name of its own."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from hydro_ident.errors import IdentError
from hydro_ident.sources import bag_sources
from hydro_ident.survey import survey_source
from hydro_model.robot import Robot


@pytest.fixture
def runs(write_bag: Callable[..., Path]) -> list[Path]:
    """Bags of one name, of different positions, in folders of their own."""
    paths = []
    for k, name in enumerate(("monday/am/run", "monday/pm/run", "tuesday/am/run", "other")):
        wave = 0.1 * k + np.sin(np.linspace(0.0, 6.0, 300))
        fields = {"position": np.stack([wave, -wave], axis=1)}
        paths.append(write_bag({"/joint_states": (("lift", "tilt"), fields)}, name=name))
    return paths


def test_runs_of_one_name_are_told_apart_by_their_folders(runs: list[Path], robot: Robot) -> None:
    training, validation = bag_sources(runs[:2], runs[2:], robot)
    names = [source.name for source in (*training, *validation)]
    assert names == ["monday_am_run", "pm_run", "tuesday_am_run", "other"]
    for path, source in zip(runs, (*training, *validation), strict=True):
        assert source.path == path
        survey = survey_source(source, robot)
        assert survey.name == source.name
        (piece,) = source.pieces()
        assert piece.recording.path.name == source.name


def test_names_that_differ_stay(runs: list[Path], robot: Robot) -> None:
    training, validation = bag_sources(runs[:1], runs[3:], robot)
    assert [s.name for s in (*training, *validation)] == ["run", "other"]


def test_a_bag_is_given_once(
    runs: list[Path], robot: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What is learnt from cannot verify."""
    monkeypatch.chdir(runs[0].parent)
    with pytest.raises(IdentError, match="expected each bag once, found 'run' twice"):
        bag_sources([runs[0]], ["run"], robot)
