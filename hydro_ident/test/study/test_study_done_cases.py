"""The file of cases that are done: a killed run leaves a fragment, and no later case is lost."""

from __future__ import annotations

from pathlib import Path

import pytest

from hydro_ident.errors import IdentError
from hydro_ident.study.command import run
from hydro_ident.study.done_cases import append_score, done_scores


def _scores(*names: str) -> list[dict[str, str]]:
    return [{"case": name, "verdict": "matches"} for name in names]


def test_cases_come_back_as_they_were_appended(tmp_path: Path) -> None:
    file = tmp_path / "results.jsonl"
    assert done_scores(file) == []
    for score in _scores("aa", "bb"):
        append_score(file, score)
    assert done_scores(file) == _scores("aa", "bb")


@pytest.mark.parametrize("left", [1, 2, 10, 30])
def test_a_case_after_a_kill_in_mid_write_is_not_lost(tmp_path: Path, left: int) -> None:
    """The fragment may be all but the end of its line, which then stands for no case, either."""
    file = tmp_path / "results.jsonl"
    for score in _scores("aa", "bb"):
        append_score(file, score)
    file.write_bytes(file.read_bytes()[:-left])
    assert done_scores(file) == _scores("aa")
    for score in _scores("cc", "dd"):
        append_score(file, score)
    assert done_scores(file) == _scores("aa", "cc", "dd")


@pytest.mark.parametrize("line", ['{"case": "b', "", "[]", '{"verdict": "matches"}'])
def test_a_broken_line_that_has_an_end_is_an_error(tmp_path: Path, line: str) -> None:
    file = tmp_path / "results.jsonl"
    file.write_text(f'{{"case": "aa"}}\n{line}\n{{"case": "cc"}}\n', encoding="utf-8")
    with pytest.raises(IdentError, match=r"results\.jsonl:2: expected a "):
        done_scores(file)


def test_a_study_does_not_go_on_from_a_broken_file(tmp_path: Path) -> None:
    """It would score anew what is lost, and say nothing."""
    (tmp_path / "results.jsonl").write_text('{"case": "aa"}{"ca\n', encoding="utf-8")
    with pytest.raises(IdentError, match=r"results\.jsonl:1: expected a case's score"):
        run(["--out", str(tmp_path), "--cases", "1", "--done-only"])
