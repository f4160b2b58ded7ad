"""What bags say of how their readings came about is told, and where they do not agree."""

from __future__ import annotations

import hashlib
import re
from pathlib import Path
from typing import Any

import pytest
import yaml

from hydro_ident.bag.provenance import project_metadata
from hydro_ident.bag.recorded_with import recorded_apart, recorded_with
from hydro_ident.bag.writer import BagWriter
from hydro_ident.commands.identify import summary_text
from hydro_ident.errors import BagError
from hydro_ident.identify.identification import identify
from hydro_ident.identify.recording_summary import recording_summaries
from hydro_ident.identify.results import Provenance
from hydro_ident.identify.survey import recorded_notes, survey_source
from hydro_ident.recordings.sources import bag_source, sources_of
from hydro_ident.report.provenance_section import provenance_section
from hydro_ident.report.recording_sections import health_section
from hydro_ident.report.verdict_words import health_line
from hydro_model.robot_files import load_robot
from hydro_msgs_docs.cdr import JOINT_STATE

START_NS, PERIOD_NS = 1_700_000_000_000_000_000, 2_000_000
SHIPPED = Path(__file__).parents[2] / "hydro_msgs_docs/can/xs031.mapping.yaml"


def calibration(name: str, lift: float = 0.01, **more: Any) -> str:
    content = {
        "schema": "hydro_hw_bridge/calibration/1",
        "name": name,
        "robot": "xs031",
        "mapping": "xs031",
        "pressure_zero_pa": {"lift_cylinder/a": 1200.0},
        "position_offset": {"lift": lift, "tilt": -0.2},
        "valve_sign": {"lift_valve": 1},
        "notes": {"date": name},
    }
    return yaml.safe_dump(content | more)


JUNE = calibration("june")


def told(*bags: dict[str, str]) -> list[tuple[str, str, str]]:
    named = [(f"bag{k}", metadata) for k, metadata in enumerate(bags)]
    return [(one.bag, one.key, one.text) for one in recorded_apart(named)]


def test_bags_with_the_same_calibration_or_none_agree() -> None:
    assert told({}, {}) == []
    assert told({"calibration": JUNE}, {"calibration": JUNE}) == []
    again = calibration("measured again")  # another name and date, the same numbers
    assert told({"calibration": JUNE}, {"calibration": again}) == []
    mapping = SHIPPED.read_text(encoding="utf-8")
    assert told({"mapping": mapping}, {"mapping": f"# of today\n{mapping}"}, {}) == []
    assert told({"note": "warm", "log": "a.csv"}, {"note": "cold", "log": "b.csv"}) == []


def test_another_calibration_is_told_with_what_is_another_one_in_it() -> None:
    [one] = told({}, {"calibration": JUNE}, {"calibration": calibration("july", 0.0234)})[1:]
    first = "another one than bag1 was recorded with: "
    assert one == ("bag2", "calibration", f"{first}position_offset.lift 0.0234 instead of 0.01")
    [one] = told({"calibration": JUNE}, {"calibration": calibration("x", valve_sign={"v": -1})})
    assert one[2].endswith(
        "valve_sign.lift_valve none instead of 1, valve_sign.v -1 instead of none"
    )
    other = calibration("x", position_offset=dict.fromkeys("abcd", 1.0))
    [one] = told({"calibration": JUNE}, {"calibration": other})
    assert one[2].endswith(" and 3 more")


def test_a_bag_that_does_not_say_which_is_told_where_another_one_does() -> None:
    said = ("bag0", "calibration", "not said which; bag1 says it")
    assert told({"mapping": "a: 1"}, {"calibration": JUNE}) == [said]


@pytest.mark.parametrize(
    ("key", "text", "first", "said"),
    [
        ("mapping", "joints: {lift: {sign: -1}}", "joints: {lift: {sign: 1}}", "lift.sign -1"),
        ("mapping", "joints: [1, 2]", "joints: [1, 3]", "joints.1 2 instead of 3"),
        ("mapping", "a: [b", "a: [c", "another text"),
        ("dbc", 'VERSION "1"', 'VERSION "2"', "another text"),
        ("mapping", "a: {b: \"\\x1b[2J\"}", "a: {b: 1}", "a.b \\x1b[2J instead of 1"),
        ("mapping", f"a: {'x' * 100}", "a: 1", f"a {'x' * 37}... instead of 1"),
    ],
)  # fmt: skip
def test_other_files_between_sensors_and_readings(
    key: str, text: str, first: str, said: str
) -> None:
    [(bag, kind, found)] = told({key: first}, {key: text})
    assert (bag, kind) == ("bag1", key)
    assert said in found


def test_short_texts_are_told_and_files_by_their_name_and_hash() -> None:
    kept = {
        "robot": "xs031",
        "note": "warm oil",
        "calibration": JUNE,
        "mapping": "a\n: [",
        "x": "",
    }
    note, calibrated, broken = recorded_with(kept)
    assert (note.key, note.name, note.sha256) == ("note", "warm oil", "")
    assert (calibrated.name, calibrated.sha256) == (
        "june", hashlib.sha256(JUNE.encode()).hexdigest(),
    )  # fmt: skip
    assert (broken.name, len(broken.sha256)) == ("", 64)


def test_a_dbc_is_kept_in_its_own_encoding(tmp_path: Path) -> None:
    for name in ("own.dbc", "own.yaml"):
        (tmp_path / name).write_bytes('CM_ SG_ 1 Oil "°C";'.encode("cp1252"))
    robot = load_robot("xs031")
    kept = project_metadata(robot, "", [f"dbc={tmp_path / 'own.dbc'}"])
    assert kept["dbc"] == 'CM_ SG_ 1 Oil "°C";'
    with pytest.raises(BagError, match="cannot be attached"):
        project_metadata(robot, "", [f"mapping={tmp_path / 'own.yaml'}"])


@pytest.fixture(scope="module")
def surveys(crane_run: Any) -> Any:
    """Recordings with two calibrations, of which one is only checked on."""
    runs = [
        crane_run.recording(name, metadata={"robot": "xs031", "calibration": text})
        for name, text in (("fit", JUNE), ("same", JUNE), ("check", calibration("july", 0.02)))
    ]
    return [survey_source(source, load_robot("xs031")) for source in sources_of(runs)]


def test_a_diagnosis_notes_it(surveys: Any) -> None:
    assert recorded_notes(surveys)[0] == (
        "check: calibration: another one than fit was recorded with: position_offset.lift 0.02"
        " instead of 0.01"
    )


def test_a_report_tells_it_in_the_strip_under_data_health_and_where_numbers_come_from(
    surveys: Any,
) -> None:
    found = recording_summaries(surveys, 2)
    assert [one.as_dict()["recorded_with"]["calibration"]["name"] for one in found] == [
        "june", "june", "july",
    ]  # fmt: skip
    [line] = health_line(found[2:])
    assert line.startswith("The recordings are not clean (calibration other")
    health = health_section(found, (), ("lift", "tilt")).html()
    assert "another one than fit was recorded with" in health
    origin = Provenance("diagnose", "1", "xs031", {}, {}).as_dict()
    html = provenance_section(origin, (), (), found).html()
    rows = [row for row in re.findall(r"<tr>.*?</tr>", html) if "<td>calibration</td>" in row]
    assert len(rows) == 2
    assert ["june" in row and "(fit, same)" in row for row in rows] == [True, False]
    assert ["july" in row and "(check)" in row for row in rows] == [False, True]
    html = provenance_section(origin, (), (), found[:2]).html()
    [row] = [row for row in re.findall(r"<tr>.*?</tr>", html) if "<td>calibration</td>" in row]
    assert "(fit" not in row  # it is that of all of them


def test_an_identification_notes_it(tmp_path: Path) -> None:
    robot = load_robot("xs031")
    for name, text in (("fit", JUNE), ("check", calibration("july", 0.02))):
        with BagWriter(tmp_path / name, {"robot": "xs031", "calibration": text}) as bag:
            bag.add_topic("/joint_states", JOINT_STATE)
            for k in range(600):
                q = {"position": [0.5 + 1e-4 * k, -1.0]}
                bag.write_stamped(
                    "/joint_states", START_NS + PERIOD_NS * k, q, names=robot.joint_names
                )
    sources = [bag_source(tmp_path / name, robot) for name in ("fit", "check")]
    found = identify(robot, sources[:1], sources[1:])
    said = "check: calibration: another one than fit was recorded with: position_offset.lift"
    assert found.notes[0].startswith(said)
    assert f"note: {said}" in summary_text(found)
    assert found.recordings[1].findings[0].signal == "calibration"
