"""What commands print: lines for a person, JSON for a program, never both on one stream."""

from __future__ import annotations

import errno
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from hydro_model.command_line.output import (
    STDOUT,
    OutputError,
    report,
    report_files,
    unwritable,
    write_text,
)

DATA = {"schema": "s/1", "x": 1.5}


def test_a_person_gets_the_text_and_a_program_its_file(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    report(tmp_path / "x.json", DATA, "x is 1.5 m")
    assert capsys.readouterr().out == "x is 1.5 m\n"
    assert json.loads((tmp_path / "x.json").read_text()) == DATA
    assert [file.name for file in tmp_path.iterdir()] == ["x.json"]


def test_on_standard_output_json_stands_alone(capsys: pytest.CaptureFixture[str]) -> None:
    report(STDOUT, DATA, "x is 1.5 m")
    assert json.loads(capsys.readouterr().out) == DATA


def test_nothing_is_printed_where_there_is_nothing_to_tell(
    capsys: pytest.CaptureFixture[str],
) -> None:
    report(None, DATA, "")
    assert capsys.readouterr().out == ""


def test_a_person_has_the_text_even_where_the_file_cannot_be_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(OutputError, match="No such file or directory; make its folder"):
        report(tmp_path / "no" / "x.json", DATA, "a long fit")
    assert capsys.readouterr().out == "a long fit\n"


@pytest.mark.parametrize("to_stdout", [False, True])
def test_a_reader_that_went_away_takes_neither_file_nor_exit_code(
    tmp_path: Path, to_stdout: bool
) -> None:
    file = tmp_path / "x.json"
    code = (
        "import sys; from pathlib import Path\n"
        "from hydro_model.command_line.command import run_command\n"
        "from hydro_model.command_line.output import report\n"
        "def main(words):\n"
        "    report(Path(words[0]), {'x': [1] * 100000}, 'a line\\n' * 100000)\n"
        "    print('written')\n"
        "    return 1\n"
        "sys.exit(run_command('some', main))\n"
    )
    read, write = os.pipe()
    os.close(read)
    words = [sys.executable, "-c", code, "-" if to_stdout else str(file)]
    done = subprocess.run(words, stdout=write, stderr=subprocess.PIPE, check=False)
    os.close(write)
    assert (done.returncode, done.stderr) == (1, b"")
    assert file.is_file() is not to_stdout


@pytest.mark.parametrize(
    ("number", "way"),
    [
        (errno.ENOENT, "make its folder first"),
        (errno.EACCES, "give a place that you may write to"),
        (errno.ENOSPC, "make room there, or give another place"),
        (errno.EROFS, "give another place"),
    ],
)
def test_what_cannot_be_written_says_what_to_try(number: int, way: str) -> None:
    said = unwritable(Path("out/x.json"), OSError(number, os.strerror(number)))
    assert said == f"out/x.json: cannot be written: {os.strerror(number)}; {way}"


def test_files_are_named_one_by_one(capsys: pytest.CaptureFixture[str]) -> None:
    files = [Path("a/b.xml"), Path("a/c.json")]
    report_files(None, "s/1", files)
    assert capsys.readouterr().out == "a/b.xml\na/c.json\n"
    report_files(STDOUT, "s/1", files)
    said = json.loads(capsys.readouterr().out)
    assert said == {"schema": "s/1", "files": ["a/b.xml", "a/c.json"]}


def test_what_cannot_be_written_leaves_nothing_half_done(tmp_path: Path) -> None:
    (tmp_path / "x.json").mkdir()
    with pytest.raises(OutputError, match="cannot be written"):
        write_text(tmp_path / "x.json", "new")
    assert [file.name for file in tmp_path.iterdir()] == ["x.json"]
