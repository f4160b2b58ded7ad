"""Words of reports that a reader stumbled over."""

from __future__ import annotations

import re
import shlex
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from hydro_ident.commands.identify import parser
from hydro_ident.mismatch.answer.not_testable import _too_small
from hydro_ident.mismatch.answer.outcome import EXPLAINED, Diagnosis
from hydro_ident.report.channel_rows import ChannelRows, channel_rows
from hydro_ident.report.correlation_section import correlation_section
from hydro_ident.report.diagnosis_verdict import _size, diagnosis_verdict
from hydro_ident.report.found_words import as_share
from hydro_ident.report.free_run_section import free_run_section
from hydro_ident.report.provenance_section import provenance_section
from hydro_ident.report.verdict_words import error_line
from hydro_ident.rollouts.free_run import FreeRun, JointRollout
from hydro_model.effects.catalogue import CATALOGUE
from hydro_model.robot_files import load_robot

NONE = np.zeros(0)


def channel(name: str, before: float, after: float, noise: float = 1.0) -> ChannelRows:
    summary = {"rmse_before": before, "rmse_after": after, "noise_floor": noise}
    return channel_rows((name, "N"), (NONE,) * 4, (None, "", ""), summary)


@pytest.mark.parametrize(
    ("after", "told"),
    [(100.0, "where it is unchanged."), (99.7, "where it is unchanged."), (98.0, "to 98 %.")],
)
def test_an_error_that_stays_is_unchanged(after: float, told: str) -> None:
    [line] = error_line([channel("lift/force", 100.0, 10.0), channel("tilt/force", 100.0, after)])
    assert line.endswith(f"; least in tilt/force, {told}")


@pytest.fixture
def strip(monkeypatch: pytest.MonkeyPatch) -> Any:
    """The strip of findings of such probabilities, with so much left over the noise."""
    told = {
        "names": ["valve_deadband", "valve_null_bias"], "probability": [0.5, 0.5],
        "separating_experiment": "staircase", "modelled_as": "valve_deadband", "target": "x",
        "parameters": [{"name": "valve_deadband.width", "value": 0.01, "unit": "1", "std": 1e-3}],
    }  # fmt: skip
    monkeypatch.setattr("hydro_ident.report.diagnosis_verdict.finding_dict", lambda *_: told)

    def shown(probabilities: tuple[float, ...], left: float) -> Any:
        verification = SimpleNamespace(silent=False, by_base=lambda _name: False)
        effect = SimpleNamespace(name="valve_deadband")
        findings = tuple(
            SimpleNamespace(
                named=SimpleNamespace(
                    probability=(p, 1.0 - p), p_value=1e-3, names=told["names"],
                    term=SimpleNamespace(target="x", effect=effect),
                ),
                verification=verification, channels=("lift/force",),
            )
            for p in probabilities
        )  # fmt: skip
        found = Diagnosis(EXPLAINED, load_robot("xs031"), None, findings=findings)  # type: ignore[arg-type]
        return diagnosis_verdict(found, [channel("lift/force", 100.0, left)])

    return shown


def test_the_headline_is_green_only_where_all_is_named_and_little_left(strip: Any) -> None:
    sure = strip((0.99,), 1.5)
    assert (sure.tone, "found and named" in sure.headline) == ("good", True)
    vague = strip((0.99, 0.5), 1.5)
    assert vague.tone == "warn"
    assert vague.headline.endswith("has been found, but 1 of 2 names could be another as well.")
    left = strip((0.99,), 8.0)
    assert left.tone == "warn"
    assert left.headline.endswith("but what is left is up to 8 times sensor noise (lift/force).")
    both = strip((0.5,), 8.0)
    assert "its name could be another as well, and what is left is up to 8" in both.headline
    assert both.word == EXPLAINED


def test_a_width_of_a_valve_is_told_as_a_share_of_its_opening(strip: Any) -> None:
    [line] = dict(strip((0.99,), 1.5).cards)["What was left out"]
    assert "valve deadband or valve null bias (width 1 % of full opening)" in line


@pytest.mark.parametrize(
    ("of_a", "of_b", "told"),
    [(0.0, 2.1e-12, "b 2.1e-12"), (3e-12, 2.1e-12, "a 3e-12"), (1e-15, 1e-15, "a 1e-15")],
)
def test_the_number_that_is_told_from_0_is_the_one_in_the_strip(
    of_a: float, of_b: float, told: str
) -> None:
    parameters = [
        {"name": f"external_leakage.coefficient_{side}", "value": v, "unit": "", "std": 1e-13}
        for side, v in (("a", of_a), ("b", of_b))
    ]
    assert _size({"parameters": parameters}) == f" (coefficient {told})"


def test_every_share_is_a_number_of_the_catalogue_without_a_unit() -> None:
    units = {f"{e.name}.{p.name}": p.unit for e in CATALOGUE.values() for p in e.parameters}
    shares = {name for name in units if as_share(name, 0.01)}
    assert "valve_deadband.width" in shares
    assert {units[name] for name in shares} == {"1"}
    assert as_share("coulomb_friction.force", 40.0) == ""


def test_one_is_no_plural() -> None:
    t = np.arange(100) * 0.02
    joint = JointRollout("lift", "m", 0.2, 0.1, 0.2, 0.1, t, t, t, t)
    for count, told in ((1, "1 window of 2 s"), (2, "2 windows of 2 s")):
        run = FreeRun((joint,), count, count, 2.0, (), "")
        body = free_run_section(run, ("lift",)).body
        assert told in body
        assert ("1 whole run." in body) == (count == 1)


@pytest.mark.parametrize(
    ("size", "told"),
    [(1.02, "a little over its usual size"), (5.2, "5.2 times its usual size")],
)
def test_what_had_to_be_a_little_larger_is_not_told_as_once_its_size(
    size: float, told: str
) -> None:
    # Found at five deviations: a size whose information is (5 / size)^2 is just found.
    partial = SimpleNamespace(gram=np.array([[(5.0 / size) ** 2]]), plain=np.array([0.1]))
    why = _too_small("x", [SimpleNamespace(partial=partial)])  # type: ignore[list-item]
    assert why == f"in this motion it would have to be {told} to stand out"


def test_a_channel_without_a_correlation_says_why() -> None:
    t = np.arange(200) * 0.02
    noise = np.random.default_rng(1).normal(size=200)

    def below(count: int, speed: np.ndarray | None, residual: np.ndarray) -> str:
        columns = (t[:count], residual[:count], np.zeros(count), np.zeros(count))
        motion = None if speed is None else speed[:count]
        one = channel_rows(("lift/force", "N"), columns, (motion, "piston velocity", "m/s"), {})
        body = correlation_section([one], ("lift",)).body
        return body.partition("<tbody>")[2].partition("</tbody>")[0]

    assert "–" not in below(200, noise, noise)
    few = below(30, noise, noise)
    assert "–" in few
    assert "<small>30 rows, fewer than the 40 that a correlation takes</small>" in few
    assert "<small>the piston velocity is not known</small>" in below(200, None, noise)
    assert "<small>the piston velocity never changes</small>" in below(200, 0.0 * t, noise)
    assert "<small>the residual never changes</small>" in below(200, noise, 0.0 * t)


def test_the_command_shown_can_be_given_again() -> None:
    origin = {
        "command": "identify run --robot xs031", "version": "0.1.0", "robot": "xs031",
        "bags": [], "validation": [], "robot_files": [], "compared": [],
    }  # fmt: skip
    body = provenance_section(origin, (), ()).body
    command = re.search(r">(ros2 run hydro_ident [^<]*)<", body)
    assert command is not None
    package, *words = shlex.split(command[1])[2:]
    assert (package, words.pop(0)) == ("hydro_ident", "identify")
    options = parser().parse_args(words)
    assert (options.bags, options.robot, options.out) == (["run"], "xs031", Path("again"))
