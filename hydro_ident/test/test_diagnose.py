"""From bags to findings: simulated machines, the command, its files and its exit codes."""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Callable
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from hydro_ident.commands.diagnose import (
    diagnosed,
    main,
    parser,
    run,
    summary_text,
    write_results,
)
from hydro_ident.identify.results import Provenance
from hydro_ident.mismatch.answer import minor
from hydro_ident.mismatch.answer.diagnosis import diagnose
from hydro_ident.mismatch.answer.diagnosis_file import finding_dict
from hydro_ident.mismatch.answer.outcome import Diagnosis
from hydro_ident.mismatch.naming.baselines import always_coulomb, greedy_bic
from hydro_ident.mismatch.settings import DiagnosisSettings
from hydro_ident.report.diagnosis_report import report_html
from hydro_ident.report.diagnosis_verdict import diagnosis_verdict
from hydro_ident.report.diagnosis_views import law_views
from hydro_ident.report.model_parameters import finding_rows
from hydro_model.effects.catalogue import CATALOGUE
from hydro_model.errors import HydroError
from hydro_model.robot import EffectSpec, Robot
from hydro_model.robot_files import load_robot

SECONDS, CHECKED = 14.0, 9.0

pytestmark = pytest.mark.long

EFFECTS = (
    EffectSpec("coulomb_friction", "lift_cylinder", {"force": 2500.0}),
    EffectSpec("valve_null_bias", "tilt_valve", {"bias": 0.006}),
)
#: Keys of the contract.
KEYS = {"schema", "verdict", "channels", "findings", "unexplained", "not_testable"}
CHANNEL_KEYS = {
    "unit", "rmse_before", "rmse_after", "noise_floor", "fit_before_pct", "fit_after_pct",
    "rollout_rmse_before", "rollout_rmse_after", "rollout_unit",
}  # fmt: skip
FINDING_KEYS = {
    "channel", "also", "where", "names", "probability", "p_value", "equation", "parameters",
    "heldout_rmse_before", "heldout_rmse_after", "separating_experiment",
}  # fmt: skip


@pytest.fixture(scope="module")
def truth(make_run: tuple) -> Robot:
    return replace(make_run[0](), effects=EFFECTS)


@pytest.fixture(scope="module")
def runs(make_run: tuple, truth: Robot) -> tuple:
    return make_run[1](truth, SECONDS), make_run[1](truth, CHECKED, seed=3)


@pytest.fixture(scope="module")
def bags(
    runs: tuple, write_bag_in: Callable[..., Path], tmp_path_factory: pytest.TempPathFactory
) -> tuple[Path, Path]:
    train, check = runs
    folder = tmp_path_factory.mktemp("bags")
    return (
        write_bag_in(folder, train.columns(), name="train"),
        write_bag_in(folder, check.columns(), name="check"),
    )


@pytest.fixture(scope="module")
def commanded(
    bags: tuple[Path, Path], tmp_path_factory: pytest.TempPathFactory
) -> tuple[int, Diagnosis, Path]:
    """What the command ends with, finds, and the folder of its files."""
    out = tmp_path_factory.mktemp("diagnosed") / "out"
    arguments = [str(bags[0]), "--robot", "xs031", "--validate", str(bags[1]), "--refine"]
    code, answer = diagnosed(parser().parse_args([*arguments, "--out", str(out)]))
    return code, answer, out


@pytest.fixture(scope="module")
def found(commanded: tuple[int, Diagnosis, Path]) -> Diagnosis:
    return commanded[1]


@pytest.fixture(scope="module")
def matching(crane_run: object) -> Diagnosis:
    return diagnose(load_robot("xs031"), [crane_run.recording()])


class _Closed(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.links: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.links += [v or "" for k, v in attrs if k in ("src", "href")]


@pytest.mark.needs("plotly")
def test_the_command_writes_the_contract(commanded: tuple[int, Diagnosis, Path]) -> None:
    """First of all that look at what it found: for others plotly, and so the report, is hidden."""
    code, _, out = commanded
    assert code == 0
    files = {f.name for f in out.iterdir()}
    assert {"result.json", "report.html", "model.yaml", "controller.yaml"} <= files
    result = json.loads((out / "result.json").read_text())
    assert set(result) >= KEYS
    assert result["schema"] == "hydro_ident/diagnosis/1"
    assert result["verdict"] == "explained"
    refined = result["refinement"]
    assert {p["name"] for p in refined["parameters"]} >= {"tilt_cylinder.valve_null_bias.bias"}
    assert refined["windows"] >= refined["held_out_windows"] > 0
    assert refined["accepted"] != bool(refined["reason"])
    for channel in result["channels"].values():
        assert set(channel) >= CHANNEL_KEYS
    for finding in result["findings"]:
        assert set(finding) >= FINDING_KEYS
        assert sum(finding["probability"]) <= 1.0 + 1e-9
        assert len(finding["names"]) == len(finding["probability"])
        assert set(finding["names"]) <= set(CATALOGUE)
        assert finding["where"]["low"] <= finding["where"]["high"]
        assert all(p["name"].startswith(finding["names"][0]) for p in finding["parameters"])
    listed = load_robot(out / "model.yaml")
    assert {e.name for e in listed.effects} >= {"valve_null_bias"}
    page = (out / "report.html").read_text()
    assert re.findall(r'<section id="(\w+)"', page) == [
        "verdict", "health", "excitation", "parameters", "predictions", "laws", "correlation",
        "free_run", "control", "provenance",
    ]  # fmt: skip
    reader = _Closed()
    reader.feed(page)
    assert all(link.startswith("#") for link in reader.links)
    controller = yaml.safe_load((out / "controller.yaml").read_text())
    assert controller["controller"]["ros__parameters"]["robot"] == str(out / "model.yaml")


def test_a_machine_that_equals_its_structure_matches(matching: Diagnosis) -> None:
    assert matching.verdict == "matches"
    assert not matching.findings
    assert not matching.unexplained
    for channel in matching.channels:
        assert channel.after == pytest.approx(channel.before)


@pytest.mark.thorough
def test_what_every_machine_has_is_modelled_and_noted_but_no_finding(
    runs: tuple, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Were friction as large as here that of any seal."""
    monkeypatch.setattr(minor, "_FRICTION_SHARE", 0.1)
    train, check = runs
    found = diagnose(load_robot("xs031"), [train.recording()], [check.recording("check")])
    assert [one.named.names[0] for one in found.findings] == ["valve_null_bias"]
    assert found.verdict == "explained"
    assert found.robot is not None
    assert {effect.name for effect in found.robot.effects} >= {EFFECTS[0].name, EFFECTS[1].name}
    (note,) = [note for note in found.notes if "surely larger than every machine" in note]
    assert note.startswith("coulomb_friction of lift_cylinder is there")


def test_both_effects_are_named_in_their_places_and_nothing_else_is(found: Diagnosis) -> None:
    assert found.verdict == "explained"
    assert not found.unexplained
    named = {f.named.names[0]: f for f in found.findings}
    assert set(named) == {"coulomb_friction", "valve_null_bias"}
    assert named["coulomb_friction"].channels[0] == "lift/force"
    assert set(named["valve_null_bias"].channels) == {"tilt/flow_a", "tilt/flow_b"}
    assert named["valve_null_bias"].named.names == ("valve_null_bias",)


def test_sizes_are_those_of_the_truth(found: Diagnosis) -> None:
    first = {f.named.names[0]: f.named.first.term.parameters for f in found.findings}
    assert first["coulomb_friction"][0] == pytest.approx(2500.0, rel=0.05)
    assert first["valve_null_bias"][0] == pytest.approx(0.006, rel=0.05)


def test_a_number_that_its_error_hides_is_told_as_one(
    found: Diagnosis, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = finding_dict(found, found.findings[0])
    told = [one for one in whole["parameters"] if one["std"] is not None]
    assert told
    assert "no larger than its error" not in summary_text(found)
    hidden = [one | {"std": 2.0 * abs(one["value"])} for one in told]
    monkeypatch.setattr(
        "hydro_ident.mismatch.answer.diagnosis_file.finding_dict",
        lambda *_: whole | {"parameters": hidden},
    )
    lines = [line for line in summary_text(found).splitlines() if "+-" in line]
    assert lines
    assert all(line.endswith(": no larger than its error") for line in lines)


def test_the_report_draws_each_law_through_its_own_rows(found: Diagnosis) -> None:
    views = {view.title: view for view in law_views(found)}
    friction = views["lift cylinder: Coulomb friction"]
    assert friction.x_axis.title == "piston velocity in m/s"
    assert friction.y_axis.title == "lift/force, error in N"
    fast = np.abs(friction.x) > 0.02
    for column in (friction.law, friction.residual):
        assert np.median((column * np.sign(friction.x))[fast]) == pytest.approx(2500.0, rel=0.1)
    assert np.std(friction.left) < 0.2 * np.std(friction.residual)


@pytest.mark.needs("plotly")
def test_the_report_says_in_words_what_the_result_says(found: Diagnosis) -> None:
    origin = Provenance("diagnose", "1", "r", {}, {}).as_dict()
    report = report_html(found, origin)
    strip = report[report.index('id="verdict"') : report.index("<nav>")]
    assert "It has been found and named." in strip
    assert "lift cylinder: Coulomb friction (force 2" in strip
    assert re.search(r"tilt cylinder: valve null bias \(bias 0\.\d+ % of full opening\)", strip)
    for channel in found.fitted:
        assert channel.name in report.replace("<wbr>", "")
    assert len(report.encode()) < 8_000_000


@pytest.mark.needs("plotly")
def test_its_sections_and_axes_are_those_of_a_report(
    found: Diagnosis,
    read: Callable[[str], Any],
    figures_of: Callable[[str], list[dict[str, Any]]],
) -> None:
    report = report_html(found, Provenance("diagnose", "1", "r", {}, {}).as_dict())
    reader = read(report)
    assert reader.sections == reader.ORDER
    assert {one.removeprefix("#") for one in reader.addresses} == set(reader.ORDER) - {"verdict"}
    assert len(figures_of(report)) > 20


@pytest.mark.thorough
@pytest.mark.needs("plotly")
def test_a_browser_opens_it_without_errors(
    found: Diagnosis, tmp_path: Path, browser_check: Callable[..., dict[str, Any]]
) -> None:
    file = tmp_path / "report.html"
    origin = Provenance("diagnose", "1", "r", {}, {}).as_dict()
    file.write_text(report_html(found, origin), encoding="utf-8")
    # At all widths the report of an identification is looked at, whose frame is the same.
    views = browser_check(file, 390, 1400)["views"]
    assert [view["found"] for view in views] == [[]] * len(views)
    looked = [(v["width"], v["scheme"]) for v in views if "width" in v]
    assert looked == [(w, s) for w in (390, 1400) for s in ("light", "dark")]
    assert views[0]["drawn"] == views[0]["figures"] > 20


def test_names_that_held_out_rows_do_not_speak_of_are_not_counted_among_the_sure(
    found: Diagnosis,
) -> None:
    """A finding that is not sure at all, which the rows to verify on do not exercise."""
    bias = next(f for f in found.findings if f.named.names[0] == "valve_null_bias")
    unsure = replace(
        bias,
        named=replace(bias.named, probability=(0.6,)),
        verification=replace(bias.verification, silent=True),
    )
    both = tuple(unsure if one is bias else one for one in found.findings)
    sure = " ".join(_card(replace(found, findings=both), "How sure"))
    assert "The names that could be verified fit better than any other" in sure
    assert "(over 99 %)" in sure
    assert "60 %" not in sure
    assert "do not exercise valve null bias of tilt cylinder: only cross-validation" in sure
    alone = " ".join(_card(replace(found, findings=(unsure,)), "How sure"))
    assert "fit better" not in alone
    assert "The names fit better" in " ".join(_card(found, "How sure"))


def _card(found: Diagnosis, head: str) -> tuple[str, ...]:
    """Lines of a card of the verdict strip."""
    return dict(diagnosis_verdict(found, []).cards)[head]


def test_numbers_of_a_law_at_their_bound_are_grey(found: Diagnosis) -> None:
    """A null bias may have either sign, a velocity over which a sign is rounded may not."""
    rows = [row for one in found.findings for row in finding_rows(found, one, {})]
    least = {"Coulomb friction: velocity scale": 1e-5, "Coulomb friction: force": 0.0}
    assert set(least) < {row.name for row in rows}
    for row in rows:
        assert row.interval is not None
        assert row.off == (row.interval[0] <= least.get(row.name, -np.inf)), row.name


def test_without_plotly_all_but_the_report_is_written(
    found: Diagnosis, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "plotly", None)
    write_results(found, Provenance("diagnose", "1", "r", {}, {}), tmp_path / "out")
    written = {file.name for file in (tmp_path / "out").iterdir()}
    assert written == {"result.json", "model.yaml", "xs031.urdf", "controller.yaml"}


def test_what_was_found_predicts_what_was_never_seen(found: Diagnosis) -> None:
    rms = {
        c.name: [float(np.std(c.measured - side)) for side in (c.before, c.after)]
        for c in found.channels
    }
    for name in ("lift/force", "tilt/flow_a", "tilt/flow_b"):
        assert rms[name][1] < 0.5 * rms[name][0], name
    for name in ("tilt/force", "lift/flow_a", "lift/flow_b"):
        assert rms[name][1] < 1.1 * rms[name][0], name
    assert found.free_run is not None
    for joint in found.free_run.joints:
        assert joint.rmse_after is not None
        assert joint.rmse_before is not None
        assert joint.rmse_after < 0.5 * joint.rmse_before
    for finding in found.findings:
        assert finding.verification.p_value < 0.05


def test_baselines_name_something(found: Diagnosis) -> None:
    assert found.work is not None
    assert always_coulomb(found.work)[0].channel == "lift/force"
    greedy = greedy_bic(found.work)
    assert ("valve_null_bias", "tilt_cylinder") in {(g.name, g.target) for g in greedy}


def test_the_model_file_with_the_effects_needs_no_further_diagnosis(
    found: Diagnosis, runs: tuple
) -> None:
    """A second diagnosis of the same machine with the first one's model finds nothing."""
    assert found.robot is not None
    again = diagnose(found.robot, [runs[0].recording()], [runs[1].recording("check")])
    assert not again.findings
    assert {e.name for e in again.given.effects} >= {"valve_null_bias"}


def test_too_little_is_said_and_nothing_is_modelled(
    runs: tuple,
    write_bag: Callable[..., Path],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    columns = {
        topic: (names, {f: v[:500] for f, v in fields.items()})
        for topic, (names, fields) in runs[0].columns().items()
    }
    bag, out = write_bag(columns, name="short"), tmp_path / "out"
    arguments = [str(bag), "--robot", "xs031", "--out", str(out)]
    assert run(arguments) == 1
    assert "replaced" not in capsys.readouterr().err
    assert run(arguments) == 1
    assert f"diagnose: replaced in {out}: the result of 2" in capsys.readouterr().err
    result = json.loads((out / "result.json").read_text())
    assert result["verdict"] == "not_enough_data"
    assert result["problems"]
    assert not (out / "model.yaml").exists()


@pytest.mark.needs("plotly")
def test_unreadable_input_writes_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    arguments = ["diagnose", str(tmp_path / "none"), "--robot", "xs031", "--out", str(out)]
    monkeypatch.setattr("sys.argv", arguments)
    assert main() == 2
    assert not out.exists()
    assert len(capsys.readouterr().err.strip().splitlines()) == 1
    with pytest.raises(HydroError):
        run(arguments[1:])


@pytest.mark.thorough
def test_a_payload_is_told_against_a_fixed_base_alone(
    make_run: tuple, matching: Diagnosis
) -> None:
    """A refit swallows it; a base known beforehand does not, and another recording confirms it.

    What begins at an instant pays for every instant tried, and no refit takes it up.
    """
    true_crane, simulated_run = make_run
    known = matching.robot
    assert known is not None
    loaded, check = (
        simulated_run(true_crane(50.0), seconds, seed=seed).recording(name)
        for name, seconds, seed in (("run", SECONDS, 2), ("check", 30.0, 4))
    )
    fixed = DiagnosisSettings(fixed_base=True)
    (finding,) = diagnose(known, [loaded], [check], fixed).findings
    assert finding.named.names == ("payload_change",)
    assert finding.named.first.term.parameters[0] == pytest.approx(50.0, rel=0.1)
    assert finding.verification.p_value < 0.01
    assert not finding.verification.silent
    assert diagnose(known, [loaded]).verdict == "matches"
