"""The worked examples of the page on other people's logs run and report what the page shows."""

from __future__ import annotations

import json
import re
import shlex
from pathlib import Path

import pytest

from hydro_ident.commands.convert import run

ROOT = Path(__file__).resolve().parents[1]
PAGE = (ROOT / "hydro_msgs_docs/log_map.md").read_text(encoding="utf-8")
LOG = ROOT / "hydro_msgs_docs/log_examples/control_desk.csv"
COMMANDS = re.findall(r"^\$\(hydro_exe hydro_ident convert\) (hydro_msgs_docs.*)$", PAGE, re.M)


def test_the_page_has_both_examples() -> None:
    assert len(COMMANDS) == 4


def test_a_suggestion_that_is_not_edited_is_warned_of_where_it_cannot_be(
    tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    log, mapping, bag = str(LOG), str(tmp_path / "new.yaml"), str(tmp_path / "bag")
    assert run([log, "--suggest", mapping, "--robot", "xs031"]) == 0
    capsys.readouterr()
    assert run([log, "--map", mapping, "--out", bag, "--json", "-"]) == 0
    said = capsys.readouterr()
    [warning] = json.loads(said.out)["warnings"]
    assert warning.startswith("joints, tilt: expected -2.4 to -0.15 rad, found -3.1")
    assert "100% of it outside the joint's range" in warning
    assert said.err == f"convert: warning: {warning}\n"
    assert "into the joint's range" not in said.out
    # With the encoder's zero filled in there is nothing to warn of.
    edited = LOG.with_name("control_desk.map.yaml")
    assert run([log, "--map", str(edited), "--out", str(tmp_path / "other"), "--json", "-"]) == 0
    said = capsys.readouterr()
    assert (json.loads(said.out)["warnings"], said.err) == ([], "")


@pytest.mark.parametrize("command", COMMANDS)
def test_a_worked_example_runs_as_shown(
    command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    words = [
        str(ROOT / word) if word.startswith("hydro_msgs_docs") else word
        for word in shlex.split(command)
    ]
    monkeypatch.chdir(tmp_path)
    assert run(words) == 0
    said = capsys.readouterr().out
    shown = re.search(rf"^```\n(written: {words[-1]}.*?)^```", PAGE, re.M | re.S)
    if shown is not None:
        assert shown[1].strip() in said
