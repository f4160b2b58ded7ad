"""Loads that differ between recordings are told, with how much they differ by."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from hydro_ident.identify.survey import survey_source
from hydro_ident.mismatch.answer.loads_apart import with_loads
from hydro_ident.mismatch.locating.dependence import Dependence
from hydro_ident.mismatch.settings import DiagnosisSettings
from hydro_ident.mismatch.split.residuals import Residuals, residuals
from hydro_ident.mismatch.unnamed.unknown import Unexplained
from hydro_ident.recordings.sources import sources_of
from hydro_model.robot import Robot
from hydro_model.robot_files import load_robot

Make = tuple[Callable[..., Robot], Callable[..., Any]]
LOAD_KG = 60.0


@pytest.fixture(scope="module")
def runs(make_run: Make) -> tuple[Any, Any]:
    """Without a load, and with one that hung there all along."""
    true_crane, simulated_run = make_run
    return simulated_run(true_crane(), 12.0), simulated_run(true_crane(LOAD_KG), 12.0, seed=1)


def _laid(fitted: Sequence[Any], verified: Sequence[Any]) -> Residuals:
    robot = load_robot("xs031")
    sources, others = (
        sources_of([run.recording(f"{what}{k}") for k, run in enumerate(given)])
        for what, given in (("fit", fitted), ("check", verified))
    )
    surveys = [survey_source(source, robot) for source in (*sources, *others)]
    work = residuals(robot, sources, others, surveys, DiagnosisSettings())
    assert work is not None
    return work


def _told(work: Residuals, channel: str = "lift/force", on: str = "everywhere") -> str:
    """What is added to the text of something that follows nothing."""
    none = np.zeros(0)
    shown = Dependence(0, channel, "time", "", 1.0, 1, 1.0, 1.0, 0.1, 1.0, none, none, none, 0.0)
    one = Unexplained(channel, (on,), 1.0, None, "left", shown)
    (found,) = with_loads([one], work.training, work.base, work.check)
    assert replace(found, text="left") == one
    return found.text.removeprefix("left")


def test_another_load_where_it_is_verified(runs: tuple[Any, Any]) -> None:
    plain, loaded = runs
    told = _told(_laid([plain], [loaded]))
    (mass,) = re.findall(r"([+-][\d.]+) kg in check0", told)
    assert float(mass) == pytest.approx(LOAD_KG, rel=0.05)
    (less,) = re.findall(r"([+-][\d.]+) kg in check0", _told(_laid([loaded], [plain])))
    assert float(less) == pytest.approx(-LOAD_KG, rel=0.05)


def test_loads_that_differ_among_what_is_fitted(runs: tuple[Any, Any]) -> None:
    plain, loaded = runs
    told = _told(_laid([plain, loaded], [plain]))
    (apart,) = re.findall(r"differ by ([\d.]+) kg", told)
    assert float(apart) == pytest.approx(LOAD_KG, rel=0.05)


def test_one_load_in_all_and_what_is_no_force_or_follows_something(runs: tuple[Any, Any]) -> None:
    plain, loaded = runs
    same = _laid([plain], [plain])
    assert _told(same) == ""
    other = _laid([plain], [loaded])
    assert _told(other, "lift/flow_a") == _told(other, on="time") == ""
