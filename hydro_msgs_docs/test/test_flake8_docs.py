"""The package is as ament's flake8 wants it, with the repository's settings."""

from __future__ import annotations

from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parents[1]
SETTINGS = PACKAGE.parent / ".flake8"


@pytest.mark.thorough
def test_ament_flake8_finds_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    linter = pytest.importorskip("ament_flake8.main", reason="ament_flake8 is not installed")
    # As `colcon test` does: below the root there is .venv, whose hundreds of folders that begin
    # with a dot or an underscore would be patterns that every file is held against.
    monkeypatch.chdir(PACKAGE)
    code, errors = linter.main_with_errors(argv=["--config", str(SETTINGS), str(PACKAGE)])
    assert code == 0, "\n".join(errors)
