"""From parameters to files: result, model, report, and what the command writes and says."""

from __future__ import annotations

import hashlib
import json
import os
import sys
from collections.abc import Callable
from datetime import datetime
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from hydro_ident.commands.identify import main, run, write_results
from hydro_ident.errors import IdentError
from hydro_ident.identify.earlier_result import earlier_result
from hydro_ident.identify.identification import Identification, identify
from hydro_ident.identify.results import OWN_FILES, Provenance, result_dict, write_together
from hydro_ident.report.identification_report import report_html
from hydro_model.robot import EffectSpec
from hydro_model.robot_files import load_robot, shipped_robots

ORIGIN = Provenance("identify bag", "1.0", "xs031", {"bag": "00"}, {})


@pytest.mark.needs("clarabel")
def test_the_result_has_the_keys_of_the_contract(found: Identification) -> None:
    result = json.loads(json.dumps(result_dict(found, ORIGIN)))
    assert result["schema"] == "hydro_ident/identification/1"
    keys = {"name", "value", "std", "ci95", "unit", "datasheet", "identifiable", "model_error"}
    for p in result["parameters"]:
        assert keys <= set(p)
        if p["held"]:
            assert (p["identifiable"], p["std"], p["ci95"]) == (False, None, None)
        else:
            assert p["ci95"][0] < p["value"] < p["ci95"][1]
    assert any(p["held"] for p in result["parameters"])
    first = result["parameters"][0]
    assert first["combination"]["lift_link.mcx"] == 1.0
    assert first["combination"]["tilt_link.mass"] == pytest.approx(1.6)
    # Masses that move with the joints hang on their pins.
    assert first["combination"]["tilt_cylinder_rod.mass"] == pytest.approx(1.6)
    friction = next(p for p in result["parameters"] if p["name"].endswith("viscous_friction"))
    assert friction["datasheet"] is None
    keys = {"rmse_before", "rmse_after", "noise_floor", "fit_before_pct", "fit_after_pct", "unit"}
    joints = ("lift", "tilt")
    names = {f"{j}/{k}" for j in joints for k in ("force", "flow_a", "flow_b")}
    assert set(result["channels"]) == names
    assert all(keys <= set(channel) for channel in result["channels"].values())


@pytest.mark.needs("clarabel")
def test_the_same_bag_gives_the_same_text(found: Identification, clean: Any) -> None:
    again = identify(load_robot("xs031"), [clean.recording()])
    assert json.dumps(result_dict(again, ORIGIN)) == json.dumps(result_dict(found, ORIGIN))


@pytest.mark.needs("clarabel")
def test_the_model_predicts_exactly_what_the_identification_did(
    found: Identification, tmp_path: Path
) -> None:
    write_results(found, ORIGIN, tmp_path / "out")
    model = load_robot(tmp_path / "out" / "model.yaml")
    assert found.robot is not None
    assert np.array_equal(model.link_inertia, found.robot.link_inertia)
    assert model.cylinders == found.robot.cylinders
    assert model.valves == found.robot.valves
    assert model.command_delay_s == found.robot.command_delay_s
    assert np.array_equal(model.base_covariance, found.robot.base_covariance)
    written = yaml.safe_load((tmp_path / "out" / "model.yaml").read_text(encoding="utf-8"))
    rows = [entry["covariance"] for entry in written["base_parameters"]]
    assert np.array_equal(rows, found.robot.base_covariance)


class _Reader(HTMLParser):
    """Collects what a page would fetch, and checks that its tags close."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.fetched: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.fetched += [v or "" for k, v in attrs if k in ("src", "href")]
        if tag not in ("meta", "wbr"):
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.fetched += [v or "" for k, v in attrs if k in ("src", "href")]

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


@pytest.mark.needs("clarabel", "plotly")
def test_the_report_is_one_file_that_fetches_nothing(
    found: Identification, tmp_path: Path
) -> None:
    write_results(found, ORIGIN, tmp_path / "out")
    text = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    reader = _Reader()
    reader.feed(text)
    assert reader.open == []
    assert all(address.startswith("#") for address in reader.fetched)
    assert "lift_link.mcx + 1.6 tilt_link.mass" in text


@pytest.fixture
def without(monkeypatch: pytest.MonkeyPatch) -> Callable[[str], None]:
    """Makes a package one that is not installed."""
    return lambda package: monkeypatch.setitem(sys.modules, package, None)


@pytest.mark.needs("clarabel", "plotly")
def test_without_plotly_all_but_the_report_is_written(
    found: Identification, tmp_path: Path, without: Callable[[str], None]
) -> None:
    write_results(found, ORIGIN, tmp_path / "out")
    with_report = {file.name for file in (tmp_path / "out").iterdir()}
    without("plotly")
    write_results(found, ORIGIN, tmp_path / "out")
    left = {file.name for file in (tmp_path / "out").iterdir()}
    # No report of an earlier run stands beside the new result.
    assert with_report - left == {"report.html"}
    assert {"result.json", "model.yaml", "controller.yaml"} <= left


@pytest.mark.needs("clarabel")
def test_without_plotly_the_command_says_so_before_its_work(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], without: Callable[[str], None]
) -> None:
    without("plotly")
    words = ["nowhere", "--robot", "xs031", "--out", str(tmp_path / "out")]
    with pytest.raises(IdentError, match="no bag"):
        run(words)
    said = capsys.readouterr().err
    assert said.startswith("identify: plotly is not installed: report.html is not written, ")
    assert said.count("\n") == 1


def test_without_clarabel_the_command_does_not_begin(
    tmp_path: Path, without: Callable[[str], None]
) -> None:
    without("clarabel")
    with pytest.raises(IdentError, match="clarabel is not installed, needed for bodies") as said:
        run(["nowhere", "--robot", "xs031", "--out", str(tmp_path / "out")])
    assert said.value.exit_code == 2
    assert not (tmp_path / "out").exists()


def test_a_failure_while_writing_leaves_the_old_result(tmp_path: Path) -> None:
    out = tmp_path / "out"
    write_together(out, lambda d: (d / "result.json").write_text("old") and None)

    def fails(folder: Path) -> None:
        (folder / "result.json").write_text("new")
        raise OSError(28, "No space left on device")

    with pytest.raises(IdentError, match="No space left"):
        write_together(out, fails)
    assert (out / "result.json").read_text() == "old"
    assert [p.name for p in tmp_path.iterdir()] == ["out"]


def test_a_new_verdict_does_not_stand_beside_an_old_model(tmp_path: Path) -> None:
    out = tmp_path / "out"
    out.mkdir()
    (out / "mine.txt").write_text("kept")
    for name in OWN_FILES:
        (out / name).write_text("old")
    write_together(out, lambda d: (d / "result.json").write_text("new") and None)
    assert sorted(p.name for p in out.iterdir()) == ["mine.txt", "result.json"]


@pytest.mark.parametrize(
    ("urdf", "beside", "stays"),
    [
        ("xs031.urdf", (), False),
        ("xs031.urdf", ("xs031.hydraulics.yaml",), True),
        ("../xs031.urdf", (), True),
        ("notes.txt", (), True),
    ],
)
def test_the_old_models_urdf_goes_with_it(
    tmp_path: Path, urdf: str, beside: tuple[str, ...], stays: bool
) -> None:
    """Only the copy in the folder, where no robot of the user's own stands."""
    out = tmp_path / "out"
    out.mkdir()
    (out / urdf).write_text("<robot/>")
    (out / "other.urdf").write_text("<robot/>")
    for name in beside:
        (out / name).write_text("mine")
    (out / "model.yaml").write_text(f"urdf: {urdf}\n")
    write_together(out, lambda d: (d / "result.json").write_text("new") and None)
    assert not (out / "model.yaml").exists()
    assert (out / urdf).exists() == stays
    assert (out / "other.urdf").exists()


def test_whoever_finds_a_result_finds_all_of_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In a folder that was there: an empty one, and one with a result of before."""
    out = tmp_path / "out"
    out.mkdir()
    there = []
    put = os.replace

    def moved(source: Path, target: Path) -> None:
        put(source, target)
        there.append((out / "result.json").exists())

    monkeypatch.setattr(os, "replace", moved)
    for text in ("old", "new"):
        write_together(out, lambda d, t=text: [(d / n).write_text(t) for n in OWN_FILES] and None)
        assert there == [False] * (len(OWN_FILES) - 1) + [True]
        assert {(out / name).read_text() for name in OWN_FILES} == {text}
        there.clear()


@pytest.mark.thorough
@pytest.mark.needs("clarabel")
def test_where_it_is_written_does_not_change_the_result(bag: Path, tmp_path: Path) -> None:
    for name in ("one", "two"):
        assert run([str(bag), "--robot", "xs031", "--out", str(tmp_path / name)]) == 0
    one, two = ((tmp_path / n / "result.json").read_bytes() for n in ("one", "two"))
    assert one == two


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ('{"provenance": {"command": "diagnose A --robot xs031"}}', True),
        ("{", False),
        ("[]", False),
    ],
)
def test_an_earlier_result_is_told_by_its_date_and_command(
    text: str, named: bool, tmp_path: Path
) -> None:
    assert earlier_result(tmp_path) == ""
    file = tmp_path / "result.json"
    file.write_text(text, encoding="utf-8")
    noon = datetime(2026, 3, 1, 12, 0).astimezone().timestamp()
    os.utime(file, (noon, noon))
    command = " (diagnose A --robot xs031)" if named else ""
    assert earlier_result(tmp_path) == f"2026-03-01 12:00{command}"


def hashes_of(file: Path) -> list[dict[str, str]]:
    """Of a robot file and its URDF beside it."""
    both = [file, file.parent / "xs031.urdf"]
    return [{"name": f.name, "sha256": hashlib.sha256(f.read_bytes()).hexdigest()} for f in both]


@pytest.mark.needs("clarabel", "plotly")
def test_the_command_writes_every_file_from_a_bag(
    bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], clean: Any
) -> None:
    out = tmp_path / "results"
    out.mkdir()
    (out / "result.json").write_text('{"provenance": {"command": "identify before"}}')
    assert run([str(bag), "--robot", "xs031", "--out", str(out)]) == 0
    said = capsys.readouterr()
    assert "verdict: identified" in said.out
    assert f"identify: replaced in {out}: the result of 2" in said.err
    assert "(identify before)" in said.err
    assert sorted(p.name for p in out.iterdir()) == sorted([*OWN_FILES, "xs031.urdf"])
    result = json.loads((out / "result.json").read_text())
    values = {p["name"]: p["value"] for p in result["parameters"]}
    assert values["lift_valve.c_pa"] == pytest.approx(7.9e-7, rel=1e-3)
    assert result["provenance"]["bags"][0]["name"] == "excitation"
    assert result["provenance"]["robot_files"] == hashes_of(shipped_robots()["xs031"])
    assert result["provenance"]["compared"] == []
    again = ["--compare", str(out / "model.yaml"), "--out", str(tmp_path / "again")]
    compared = hashes_of(out / "model.yaml")
    assert run([str(bag), "--robot", "xs031", *again]) == 0
    later = json.loads((tmp_path / "again/result.json").read_text())
    assert later["provenance"]["compared"] == compared
    page = (tmp_path / "again/report.html").read_text()
    for one in [*compared, *result["provenance"]["robot_files"]]:
        assert f"{one['name']}  sha256 {one['sha256']}" in page
    controller = yaml.safe_load((out / "controller.yaml").read_text())
    parameters = controller["controller"]["ros__parameters"]
    assert parameters["robot"] == str(out / "model.yaml")
    assert load_robot(parameters["robot"]).base_parameters
    model = yaml.safe_load((out / "model.yaml").read_text())
    assert model["provenance"]["bags"] == result["provenance"]["bags"]


@pytest.mark.needs("clarabel", "plotly")
@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["missing", "--robot", "xs031"], "missing"),
        (["missing", "--robot", "no_such_robot"], "no robot file 'no_such_robot'"),
    ],
)
def test_unreadable_input_is_one_line_and_writes_nothing(
    arguments: list[str],
    message: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    out = tmp_path / "out"
    monkeypatch.setattr("sys.argv", ["identify", *arguments, "--out", str(out)])
    assert main() == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1
    assert not out.exists()


@pytest.mark.needs("clarabel", "plotly")
@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_too_little_motion_exits_1_with_a_result_and_no_model(
    clean: Any,
    write_bag: Callable[..., Path],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    robot, count = clean.robot, 3000
    still = np.repeat(clean.q[:1], count, axis=0)
    columns = {
        "/joint_states": (robot.joint_names, {"position": still}),
        "/chamber_pressures": (robot.pressure_names, {"effort": np.full((count, 6), 5e6)}),
        "/valve_state": (robot.valve_names, {"effort": np.zeros((count, 2))}),
    }
    path, out = write_bag(columns, name="rest"), tmp_path / "results"
    monkeypatch.setattr("sys.argv", ["identify", str(path), "--robot", "xs031", "--out", str(out)])
    assert main() == 1
    said, error = capsys.readouterr()
    assert "lift_link.iyy" in error
    assert "lift, tilt did not move" in error
    assert sorted(p.name for p in out.iterdir()) == ["report.html", "result.json"]
    result = json.loads((out / "result.json").read_text())
    assert result["verdict"] == "not_enough_data"
    rows = {p["name"]: p for p in result["parameters"]}
    for name in ("command_delay", "lift_cylinder.bulk_modulus", "tilt_cylinder.viscous_friction"):
        assert (rows[name]["std"], rows[name]["ci95"]) == (None, None)
        [line] = [line for line in said.splitlines() if line.strip().startswith(name)]
        assert "+-" not in line


@pytest.mark.needs("clarabel", "plotly")
def test_residuals_far_above_the_noise_are_said(driven: Callable[..., Any]) -> None:
    hidden = (EffectSpec("coulomb_friction", "xs031", {"force": 4000.0, "velocity_scale": 0.005}),)
    run = driven(12.0, hidden)
    noise = np.random.default_rng(3).normal(0.0, 4000.0, (2, *run.p_a.shape))
    rough = run.recording(p_a=run.p_a + noise[0], p_b=run.p_b + noise[1])
    found = identify(load_robot("xs031"), [rough])
    [note] = [note for note in found.notes if "physics is left out" in note]
    assert "lift/force" in note
    assert "tilt/force" in note
    marked = {p.name: p.model_error for p in found.parameters}
    assert marked["lift_link.mcx"]
    assert marked["tilt_cylinder.viscous_friction"]
    assert not marked["lift_valve.c_pa"]
    assert not marked["command_delay"]
    report = report_html(found, ORIGIN.as_dict())
    assert report.count("physics is left out") == 1
    assert report.index("physics is left out") < report.index("stands for lift_link.mcx + 1.6")
