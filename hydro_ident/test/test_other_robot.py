"""A bag that names another robot than the one it is looked at for is told wherever it is read."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from hydro_ident.commands.inspect import main
from hydro_ident.identify.survey import recorded_notes, survey_source
from hydro_ident.identify.verdict import NOT_ENOUGH, judge
from hydro_ident.recordings.sources import sources_of
from hydro_model.robot_files import load_robot


def test_a_diagnosis_begins_its_notes_with_it(crane_run: Any) -> None:
    robot = load_robot("xs031")
    runs = [
        crane_run.recording(name, metadata=metadata)
        for name, metadata in (("own", {"robot": "xs031"}), ("none", {}), ("x", {"robot": "mh26"}))
    ]
    surveys = [survey_source(source, robot) for source in sources_of(runs)]
    notes = recorded_notes(surveys)
    assert [note for note in notes if "recorded as" in note] == [notes[0]]
    assert notes[0].startswith("x was recorded as robot 'mh26', not xs031: every parameter is")


def test_an_identification_without_a_model_says_it_before_what_else_was_wrong(
    crane_run: Any,
) -> None:
    run = crane_run.recording("x", metadata={"robot": "mh26"})
    judged = judge(load_robot("xs031"), [run], None, None)
    assert judged.verdict == NOT_ENOUGH
    said, *more = judged.problems
    assert said.startswith("x was recorded as robot 'mh26', not xs031: every parameter is")
    assert more


def test_inspect_asks_to_look_at_it(
    write_bag: Any, run_columns: Any, tmp_path: Path, capsys: Any
) -> None:
    columns = run_columns(400)
    for name, told in (("mh26", 1), ("xs031", 0)):
        bag = write_bag(columns, name=name, metadata={"robot": name})
        assert main([str(bag), "--robot", "xs031"]) == 0
        said = capsys.readouterr().out
        assert said.count("CHECK   robot: recorded as 'mh26', looked at as xs031") == told
