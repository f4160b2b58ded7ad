"""The worked examples of the page on other people's logs run and report what the page shows."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest

from hydro_ident.commands.convert import run

ROOT = Path(__file__).resolve().parents[1]
PAGE = (ROOT / "hydro_msgs_docs/log_map.md").read_text(encoding="utf-8")
COMMANDS = re.findall(r"^\$\(hydro_exe hydro_ident convert\) (hydro_msgs_docs.*)$", PAGE, re.M)


def test_the_page_has_both_examples() -> None:
    assert len(COMMANDS) == 4


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
